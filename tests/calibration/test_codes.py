"""Numbers that are not the converter's: digital gains after it, and white levels below full scale."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.codes import count_codes, find_steps, find_white_level
from photosite.calibration.reduction.frame_screening import sample_grid
from photosite.frames.frame_set import FrameSet

K, READ_E, DSNU_DN, PRNU, BLACK = 0.3, 6.0, 0.6, 0.008, 64.0
SHAPE = (96, 120)
RGGB = (("R", "G"), ("G", "B"))
LIGHT = np.array([[0.6, 1.0], [1.0, 0.7]])


def stack(
    seed, numbers, *, bits=12, cfa=(("mono",),), shape=SHAPE, frames=8, rate=1.5e5, levels=(1, 2, 3, 4, 5, 6, 8, 10)
):
    """Darks at three exposure times and flats; `numbers` makes the file's numbers of the converter's codes."""
    rng = np.random.default_rng(seed)
    response = 1.0 + PRNU * rng.normal(size=shape)
    if len(cfa) > 1:
        response = response * np.tile(LIGHT, (shape[0] // 2, shape[1] // 2))
    offset = BLACK + DSNU_DN * rng.normal(size=shape)

    def take(kind, exposure_s):
        shots = []
        for _ in range(frames):
            electrons = rng.poisson(response * (rate * exposure_s if kind == "light" else 0.0))
            codes = np.clip(np.rint(offset + K * (electrons + rng.normal(0.0, READ_E, shape))), 0, 4095)
            dn = np.clip(numbers(codes), 0, 2**bits - 1).astype(np.uint16)
            shots.append((kind, exposure_s, dn))
        return shots

    groups = [take("dark", t) for t in (0.01, 0.1, 1.0)] + [take("light", 0.01 * t) for t in levels]
    return FrameSet.from_arrays([shot for group in groups for shot in group], bits=bits, cfa=cfa)


def times(gain):
    return lambda codes: np.floor(codes * gain + 0.5)


def replicated(codes):
    codes = codes.astype(int)
    return (codes << 4) | (codes >> 8)


def within(estimate, truth):
    low, high = estimate.interval_95
    return low <= truth <= high


@pytest.mark.parametrize(("gain", "bits"), [(1.37, 14), (0.8, 12), (0.93, 12), (3.0, 14), (65535 / 4095, 16)])
def test_a_digital_gain_is_named_and_the_figures_hold(gain, bits):
    found = calibrate(stack(1, times(gain), bits=bits))
    assert limits(found) == {"digital-gain": pytest.approx(gain, rel=0.01)}
    assert within(found.system_gain_dn_per_e, gain * K)
    assert within(found.read_noise_e, READ_E)
    assert within(found.prnu_percent, 100.0 * PRNU)
    assert within(found.dsnu_dn, gain * DSNU_DN)
    # Without the noise of the converter's step, the read noise is 1 % high at the largest gain, 1 u is 0.4 %.
    assert found.read_noise_e.standard_uncertainty < 0.15 * READ_E


def test_numbers_replicated_to_sixteen_bits_are_named():
    found = calibrate(stack(1, replicated, bits=16))
    assert limits(found)["digital-gain"] == pytest.approx(65535 / 4095, rel=1e-3)
    assert within(found.system_gain_dn_per_e, K * 65535 / 4095)


def test_prescaled_channels_have_each_their_gain():
    scale = np.tile([[2.1, 1.0], [1.0, 1.5]], (SHAPE[0] // 2, SHAPE[1] // 2))
    found = calibrate(stack(3, lambda codes: np.floor(codes * scale + 0.5), bits=14, cfa=RGGB))
    assert found.system_gain_dn_per_e.value is None
    assert found.system_gain_dn_per_e.reason_id == "unequal-digital-gains"
    for name, gain in (("R", 2.1), ("G", 1.0), ("B", 1.5)):
        assert within(found.channels[name].system_gain_dn_per_e, gain * K)
        assert within(found.channels[name].read_noise_e, READ_E)


def counts_of(frames, channels):
    rows, cols = sample_grid((frames.rows, frames.cols), 8)
    labels = np.zeros((rows.size, cols.size), np.int64)
    if channels > 1:
        labels = np.array([[0, 1], [1, 2]])[rows % 2, cols % 2]
    counts, noise = [], []
    for group in frames.groups:
        samples = [dn[rows, cols] for dn in group]
        counts.append(count_codes(samples, labels))
        spread = np.var(samples, axis=0, ddof=1)
        noise.append([float(np.sqrt(spread[labels == k].mean())) for k in range(channels)])
    return counts, noise


@pytest.mark.parametrize("gain", [0.55, 0.6, 0.75, 0.9, 0.97, 1.02, 1.1, 1.5, 2.0, 2.5, 4.3, 16.0])
def test_the_step_of_the_converter_is_found(gain):
    counts, noise = counts_of(stack(4, times(gain), bits=16), 1)
    found = find_steps(counts, [value for (value,) in noise], 0, 1, (0, 65535))
    assert found.step == pytest.approx(gain, rel=0.01)


@pytest.mark.parametrize("period", [2, 4])
def test_unequal_steps_of_the_converter_are_no_digital_gain(period):
    """Differential nonlinearity: one of the codes of a period is 10 % rarer."""
    rng = np.random.default_rng(5)

    def rarer(codes):
        return codes - (codes % period == 1) * (rng.random(codes.shape) < 0.1)

    counts, noise = counts_of(stack(5, rarer), 1)
    assert find_steps(counts, [value for (value,) in noise], 0, 1, (0, 4095)) is None


def test_steps_that_grow_with_the_level_are_those_of_decoded_numbers():
    def decoded(codes):
        return np.rint(np.rint(np.sqrt(codes * 16.0)) ** 2 / 16.0)

    found = calibrate(stack(6, decoded, bits=12))
    assert set(limits(found)) == {"decoded-companding"}
    assert within(found.system_gain_dn_per_e, K)
    assert within(found.read_noise_e, READ_E)


@pytest.mark.slow
def test_false_alarms_of_clean_stacks():
    """Expected below 0.1 in 300 stacks."""
    alarms = 0
    for seed in range(300):
        mono = seed % 4 > 0
        frames = stack(
            seed, lambda codes: codes, shape=(48, 60), frames=(2, 8)[seed % 2], cfa=(("mono",),) if mono else RGGB
        )
        channels = 1 if mono else 3
        counts, noise = counts_of(frames, channels)
        lights = counts[3:]
        for k in range(channels):
            alarms += find_steps(counts, [entry[k] for entry in noise], k, channels, (0, 4095)) is not None
            alarms += find_white_level(lights, k, 65535) not in (4095, 65535)
    assert alarms == 0


@pytest.mark.parametrize(("white", "levels"), [(3000, (1, 2, 3, 4, 5, 6, 8, 10)), (2790, (1, 2, 3, 4, 5, 6))])
def test_clipping_below_full_scale_leaves_the_figures_right(white, levels):
    """At 2790 DN, the brightest flats are clipped in part."""
    found = calibrate(stack(7, lambda codes: np.minimum(codes, white), levels=levels))
    assert within(found.system_gain_dn_per_e, K)
    assert within(found.prnu_percent, 100.0 * PRNU)
    assert found.saturation_dn.value == pytest.approx(white)
    assert not found.rejected


def test_channels_are_clipped_each_at_its_white_level():
    white = np.tile([[2600, 3400], [3400, 3000]], (SHAPE[0] // 2, SHAPE[1] // 2))
    frames = stack(8, lambda codes: np.minimum(codes, white), cfa=RGGB, rate=2.2e5)
    counts, _ = counts_of(frames, 3)
    found = calibrate(frames)
    for k, (name, top) in enumerate((("R", 2600), ("G", 3400), ("B", 3000))):
        assert find_white_level(counts[3:], k, 4095) == top
        own = found.channels[name]
        assert own.saturation_dn.value == top
        assert within(own.system_gain_dn_per_e, K)
        assert within(own.prnu_percent, 100.0 * PRNU)


def test_wells_that_differ_are_no_white_level():
    """They spread the numbers; the largest variance then shows saturation."""
    rng = np.random.default_rng(9)
    wells = rng.normal(3000.0, 30.0, SHAPE)
    frames = stack(9, lambda codes: np.rint(np.minimum(codes, wells) + rng.normal(0.0, 2.0, SHAPE)))
    counts, _ = counts_of(frames, 1)
    assert find_white_level(counts[3:], 0, 4095) == 4095
    assert within(calibrate(frames).system_gain_dn_per_e, K)
