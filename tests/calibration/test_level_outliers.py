"""Levels whose stated light contradicts the others are found; bends, offsets and lamps that scatter are not."""

from functools import partial

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.photon_transfer.level_outliers import find_light_outliers
from photosite.calibration.photon_transfer.photon_transfer import LightLevels
from photosite.frames.frame_set import FrameSet

GAIN, FULL, SAMPLES = 0.3, 3800.0, 300_000


def straight(x):
    return x


def bent(x, size=-0.1, power=1):
    return x * (1.0 + size * x**power)


def knee(x, at, slope):
    return np.where(x < at, x, at + slope * (x - at))


def light_levels(rng, x, *, wrong=(), response=straight, lamp=2e-4, offset=0.0):
    """Levels up to 1.1 times the full scale; stated light is `wrong` by a factor for some."""
    true = np.array(x) * (1.0 + lamp * rng.normal(size=len(x)))
    stated = np.array(x)
    for place, factor in wrong:
        stated[place] *= factor
    signal = FULL * response(true)
    slope = (response(true * 1.0001) - response(true * 0.9999)) / (0.0002 * true)
    clipped = signal > FULL
    shot = np.where(clipped, 0.0, GAIN * FULL * slope**2 * true)
    of_signal, of_shot = (shot + 4.0) / SAMPLES, 2.0 * (shot + 4.0) ** 2 / SAMPLES
    signal = np.minimum(signal, FULL) + rng.normal(0.0, np.sqrt(of_signal)) + offset
    everything = dict.fromkeys(LightLevels.__dataclass_fields__)
    levels = LightLevels(
        **everything
        | {
            "abscissa": "exposure_s",
            "x": stated,
            "signal": signal,
            "signal_covariance": np.diag(of_signal),
            "shot": shot + rng.normal(0.0, np.sqrt(of_shot)),
            "shot_covariance": np.diag(of_shot),
            "mean": signal + 64.0,
            "spread": np.full(len(x), 5.0),
            "mean_variance": of_signal,
            "frame_scatter": np.zeros_like(of_signal),
            "clipped": clipped,
            "white_fraction": clipped.astype(float),
            "group": np.arange(len(x)),
            "trusted": np.ones(len(x), np.bool_),
        }
    )
    return levels.take(np.argsort(stated, kind="stable"))


EVEN, LOG = np.linspace(0.08, 1.12, 14), np.geomspace(0.02, 1.12, 14)


def found(*channels):
    return {entry.group: entry.stated_over_expected for entry in find_light_outliers(channels, [4095] * len(channels))}


@pytest.mark.parametrize("spacing", [EVEN, LOG], ids=["even", "log"])
@pytest.mark.parametrize("response", [straight, bent], ids=["straight", "bent"])
@pytest.mark.parametrize("factor", [0.96, 1.04, 0.1, 1000.0])
def test_a_wrong_level_is_found_with_its_size(spacing, response, factor):
    rng = np.random.default_rng(3)
    for place in (2, 5, 9):
        outliers = found(light_levels(rng, spacing, wrong=[(place, factor)], response=response))
        assert list(outliers) == [place]
        assert outliers[place] == pytest.approx(factor, rel=0.01)


def test_three_wrong_levels_are_found():
    wrong = [(2, 1.05), (6, 0.9), (11, 1.03)]
    spacing = np.linspace(0.055, 1.1, 20)
    assert list(found(light_levels(np.random.default_rng(4), spacing, wrong=wrong))) == [2, 6, 11]


def test_the_brightest_level_is_wrong_if_its_noise_is_that_of_a_straight_response():
    rng = np.random.default_rng(5)
    below = EVEN[EVEN < 0.9]
    last = len(below) - 1
    assert list(found(light_levels(rng, below, wrong=[(last, 1.06)]))) == [last]
    at = 0.5 * (below[-1] + below[-2])
    assert not found(light_levels(rng, below, response=partial(knee, at=at, slope=0.3)))


def test_dark_flats_and_saturated_flats_out_of_order_are_found():
    rng = np.random.default_rng(6)
    assert list(found(light_levels(rng, np.append(1e-3, LOG), wrong=[(0, 500.0)]))) == [0]
    assert list(found(light_levels(rng, LOG, wrong=[(len(LOG) - 1, 0.2)]))) == [len(LOG) - 1]


def test_a_wrong_level_counts_in_all_channels():
    rng = np.random.default_rng(7)
    outliers = found(light_levels(rng, 0.1 * EVEN, lamp=0.01), light_levels(rng, EVEN, wrong=[(4, 1.05)]))
    assert list(outliers) == [4]


@pytest.mark.parametrize("spacing", [EVEN, LOG], ids=["even", "log"])
@pytest.mark.parametrize(
    "response",
    [
        *(partial(bent, size=size, power=power) for size in (-0.3, -0.02, 0.1) for power in (1, 2)),
        *(partial(knee, at=at, slope=slope) for at in (0.15, 0.3, 0.6) for slope in (0.5, 0.9)),
        lambda x: np.tanh(1.2 * x) / 1.2,
        lambda x: x / (1.0 + (x / 0.9) ** 8) ** 0.125,
    ],
)
def test_a_bend_is_no_wrong_level(spacing, response):
    rng = np.random.default_rng(8)
    assert not any(found(light_levels(rng, spacing, response=response, lamp=lamp)) for lamp in (0.0, 1e-3))


@pytest.mark.parametrize("levels", [4, 6, 9, 14])
def test_a_lamp_that_scatters_gives_no_wrong_level(levels):
    rng = np.random.default_rng(9)
    for lamp in np.tile([0.0, 0.003, 0.02], 20):
        spacing = np.linspace(1.1 / levels, 1.1, levels)
        assert not found(light_levels(rng, spacing, lamp=lamp, offset=rng.normal()))


def stack(factor, seed=0):
    """Dark frames and fourteen flats of 2 % curvature; the fifth has another light than its exposure time says."""
    rng = np.random.default_rng(seed)
    shape, times = (64, 64), np.linspace(0.01, 0.14, 14)
    response = 1.0 + 0.01 * rng.normal(size=shape)

    def take(kind, exposure_s, electrons):
        e = rng.poisson(electrons * response, (6, *shape))
        dn = 64.0 + GAIN * e * (1.0 - 0.04 * e / 10_000.0) + rng.normal(0.0, 2.0, e.shape)
        frames = np.clip(np.rint(dn), 0, 4095).astype(np.uint16)
        return [(kind, exposure_s, dn) for dn in frames]

    darks = [take("dark", float(t), 0.0) for t in (0.01, 0.14)]
    light = [1e5 * t * (factor if i == 4 else 1.0) for i, t in enumerate(times)]
    lights = [take("light", float(t), e) for t, e in zip(times, light, strict=True)]
    return FrameSet.from_arrays([shot for group in (*darks, *lights) for shot in group], bits=12)


def test_one_wrong_level_no_longer_hides_a_bend():
    clean, wrong = calibrate(stack(1.0)), calibrate(stack(1.04))
    assert set(limits(clean)) == {"bent-response"}
    assert set(limits(wrong)) == {"bent-response", "wrong-light-levels"}
    assert limits(wrong)["wrong-light-levels"] == pytest.approx(1.0 / 1.04, abs=0.005)
    for name in ("linearity_error_percent", "prnu_percent", "system_gain_dn_per_e"):
        one, other = getattr(clean, name), getattr(wrong, name)
        assert other.value == pytest.approx(one.value, abs=2.0 * one.standard_uncertainty)
    assert wrong.linear_range["M"].levels == clean.linear_range["M"].levels - 1


def test_a_level_far_off_does_not_make_the_others_unreadable():
    calibration = calibrate(stack(0.2))
    assert calibration.prnu_percent.value == pytest.approx(1.0, rel=0.1)
    assert limits(calibration)["wrong-light-levels"] == pytest.approx(5.0, rel=0.05)
    # Its noise serves the photon transfer.
    curve = calibration.curves["M"]["photon_transfer"]
    assert curve.used.sum() == calibration.linear_range["M"].levels + 1
