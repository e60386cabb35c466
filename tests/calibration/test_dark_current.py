"""The dark current from the variance, compared with that from the mean, and black levels that move."""

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.dark.black_level_change import CHANGE_P_VALUE, black_level_change, contradiction
from photosite.calibration.dark.dark_frames import dark_lines, measure_dark_level
from photosite.calibration.dark.dark_lines import DarkLines
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import Level
from photosite.calibration.reduction.reduce import reduce_frames
from photosite.engine.frame_sums import FrameSums
from photosite.frames.frame_set import FrameSet
from photosite.sensor.io.sensor_file import load_sensor
from photosite.values.uncertain import Uncertain

GAIN, READ_E, DARK_E_PER_S = 0.8, 5.0, 300.0


def frames_of(seed, *, clamped=False, step_dn=0.0):
    """Darks of 0.1 to 1 s and flats; black level clamping subtracts the mean of the dark charge. The black level of the
    longer half of the darks lies `step_dn` higher."""
    rng = np.random.default_rng(seed)
    shape = (48, 64)

    def frame(electrons, off_e=0.0, black=120.0):
        charge = rng.poisson(electrons, shape) - off_e + rng.normal(0.0, READ_E, shape)
        return np.clip(np.round(black + GAIN * charge), 0, 4095).astype(np.uint16)

    frames = []
    for t in np.linspace(0.1, 1.0, 8):
        dark = DARK_E_PER_S * t
        black = 120.0 + step_dn * (t > 0.5)
        frames += [("dark", t, frame(dark, dark if clamped else 0.0, black)) for _ in range(4)]
    for t in np.linspace(0.1, 1.0, 6):
        dark = DARK_E_PER_S * t
        frames += [("light", t, frame(4000.0 * t + dark, dark if clamped else 0.0)) for _ in range(2)]
    return FrameSet.from_arrays(frames, bits=12)


def test_the_dark_current_from_the_variance_is_right():
    """30 chips: 28.5 intervals of 95 % contain the truth on average, 24 or fewer once in 3000 runs. The mean error is
    within four standard errors."""
    inside, errors = 0, []
    for seed in range(30):
        estimate = calibrate(frames_of(seed)).dark_current_from_variance_e_per_s
        low, high = estimate.interval_95
        inside += low < DARK_E_PER_S < high
        errors.append((estimate.value - DARK_E_PER_S) / estimate.standard_uncertainty)
    assert inside > 24
    assert abs(np.mean(errors)) < 4.0 / np.sqrt(30)


def test_both_agree_without_clamping():
    calibration = calibrate(frames_of(100))
    low, high = calibration.dark_current_e_per_s.interval_95
    assert low < DARK_E_PER_S < high
    assert "implausible" not in limits(calibration)


@pytest.mark.parametrize("spoiled", [{"clamped": True}, {"step_dn": 40.0}, {"step_dn": -40.0}])
def test_a_mean_that_contradicts_the_variance_is_withheld(spoiled):
    """The dark current from the variance and the read noise at exposure zero stay right."""
    calibration = calibrate(frames_of(101, **spoiled))
    for name in ("dark_current_e_per_s", "dark_voltage_mv_per_s", "dcnu_percent"):
        assert getattr(calibration, name).value is None, name
    for name, truth in (("dark_current_from_variance_e_per_s", DARK_E_PER_S), ("read_noise_e", READ_E)):
        low, high = getattr(calibration, name).interval_95
        assert low < truth < high
    assert calibration.dark_current_e_per_s.reason_id == "implausible"
    assert "implausible" in limits(calibration)


def test_maps_of_a_clamped_camera_have_its_read_noise_but_no_dark_rate():
    calibration = calibrate(frames_of(102, clamped=True), maps=True)
    assert calibration.chip.dark_rate_dn_per_s is None
    read_e = np.sqrt(np.mean(np.sign(calibration.chip.read_noise_dn) * calibration.chip.read_noise_dn**2)) / GAIN
    assert read_e == pytest.approx(READ_E, rel=0.1)


def reduced(seed, steps, exposures_s=(0.01, 0.1, 1.0), rows=40, cols=48, frames=(8, 8, 8), dark_e_per_s=5.0):
    """Dark groups of 1 DN/e-, noise 2 DN and some dark current; `steps(group, frame, rng)` in DN moves the black
    level."""
    rng = np.random.default_rng(seed)
    listed = []
    for g, (t, count) in enumerate(zip(exposures_s, frames, strict=False)):
        for i in range(count):
            dark = 100.0 + rng.poisson(dark_e_per_s * t, (rows, cols)) + steps(g, i, rng)
            listed.append(("dark", t, np.uint16(np.round(dark + rng.normal(0.0, 2.0, (rows, cols))))))
    with FrameReader(FrameSet.from_arrays(listed, bits=12)) as reader:
        return reduce_frames(reader).darks


@pytest.mark.parametrize("log_spread", [0.0, 0.4])
def test_the_dark_noise_of_the_sensor_is_not_better_known_with_more_groups_of_the_same_uneven_pixels(log_spread):
    rng = np.random.default_rng(5)
    groups, frames, pixels = 8, 6, 64 * 64
    sigma = 8.0 * np.exp(log_spread * rng.standard_normal((64, 64)))
    levels = [
        Level.of(
            FrameSums((64, 64)).add(np.uint16(np.rint(rng.normal(100.0, sigma, (frames, 64, 64))))).label_totals()[0]
        )
        for _ in range(groups)
    ]
    found = measure_dark_level(DarkLines.of([0.01 * 2**k for k in range(groups)], levels), levels[0], "").dark_variance
    # Of a log-normal square: mean m = s^2 exp(2 b^2), mean square m^2 exp(4 b^2)
    mean, relative = 64.0 * np.exp(2.0 * log_spread**2), np.exp(4.0 * log_spread**2)
    of_pixels, sampling = relative - 1.0, 2.0 / (frames - 1) * relative
    repetition = DarkLines.of([0.01 * 2**k for k in range(groups)], levels).variance.repetition
    expected = mean * np.sqrt((of_pixels + sampling * repetition) / pixels)
    assert found.standard_uncertainty == pytest.approx(expected, rel=0.15)
    assert abs(found.value - 1 / 12 - mean) < 3.0 * expected


def test_a_steady_black_level_neither_shifts_nor_drifts():
    """60 sets: 0.06 alarms are expected by chance, and more than one in 550 runs with new seeds."""
    found = [black_level_change(reduced(seed, lambda g, i, rng: 0.0)) for seed in range(60)]
    assert CHANGE_P_VALUE <= 0.0005
    assert sum(change.shift > 0.0 or change.drift > 0.0 for change in found) <= 1


def test_a_noisy_group_is_compared_with_its_own_noise():
    """At 1 s the dark current has a hundred times the variance of the read noise, in few frames."""
    noisy = {"rows": 16, "cols": 16, "frames": (24, 3), "dark_e_per_s": 400.0}
    found = [black_level_change(reduced(seed, lambda g, i, rng: 0.0, (0.01, 1.0), **noisy)) for seed in range(20)]
    assert not [change for change in found if change.shift > 0.0 or change.drift > 0.0]


def test_shifts_are_found_with_their_size():
    found = [black_level_change(reduced(seed, lambda g, i, rng: 0.4 * rng.normal())) for seed in range(20)]
    assert np.sqrt(np.mean([change.shift**2 for change in found])) == pytest.approx(0.4, rel=0.2)
    assert all(change.notable(change.shift) or change.notable(change.drift) for change in found)


def test_a_drift_widens_the_dark_slope_until_its_interval_holds():
    """A drift of 0.5 DN in each of two groups, which continues from one to the other. Two points always fit a line."""
    inside = [0, 0]
    for seed in range(20):
        darks = reduced(seed, lambda g, i, rng: 0.5 * (g + i / 8), (0.01, 1.0))
        change = black_level_change(darks)
        assert change.drift == pytest.approx(1.0, rel=0.4)
        assert change.shift == 0.0
        for k, moved in enumerate((None, change)):
            low, high = dark_lines(darks, None, moved).mean.line[1].interval_95
            inside[k] += low < 5.0 < high
    assert inside[0] == 0
    assert inside[1] == 20


def test_a_drift_that_changes_its_direction_is_no_larger_than_it_is():
    """A random walk of 0.15 DN a frame through 8 groups, and the intervals of the dark slope."""
    times = tuple(0.01 * 2.0**k for k in range(8))
    moved, inside = [], 0
    for seed in range(20):
        walk = np.cumsum(0.15 * np.random.default_rng([4, seed]).normal(size=64))
        darks = reduced(seed, lambda g, i, rng, walk=walk: walk[8 * g + i], times, frames=(8,) * 8)
        change = black_level_change(darks)
        low, high = dark_lines(darks, None, change).mean.line[1].interval_95
        moved.append(change.drift)
        inside += low < 5.0 < high
    assert 0.4 < np.sqrt(np.mean(np.square(moved))) / (0.15 * np.sqrt(64)) < 1.5
    assert inside >= 17


def test_a_contradiction_needs_more_than_chance():
    """20 clean sets show none; a level that is 1 DN higher at 1 s is found in all."""
    for step, expected in ((0.0, 0), (1.0, 20)):
        found = 0
        for seed in range(20):
            lines = dark_lines(reduced(seed, lambda g, i, rng, step=step: step * (g == 2)), None)
            slopes = lines.mean.line[1], lines.mean.sampling, lines.variance.line[1]
            found += contradiction(*slopes, Uncertain(1.0), lines.mean.exposure_s) is not None
        assert found == expected


def test_the_temperature_of_the_dark_current_is_that_of_the_dark_frames():
    frames = frames_of(1)
    groups = tuple(replace(group, temperature_c=25.0 if group.kind == "dark" else 41.0) for group in frames.groups)
    sensor = load_sensor("sony-imx174").with_(rows=48, cols=64)
    measured = calibrate(replace(frames, groups=groups, sensor=sensor))
    assert measured.temperature_c == (25.0, 25.0)
    assert measured.sensor.noise.dark_current_temperature_c == 25.0
