"""The drift of the black level is measured from series of dark frames, and steady levels have none."""

import math

import numpy as np
import pytest

from photosite.calibration.effects.black_level_drift import measure_drift, octaves_within
from photosite.engine.pixel_model import Exposure
from photosite.engine.random_numbers import key_from_seed
from photosite.sensor.chip_effects import drift_e
from photosite.sensor.effects.black_level_drift import BlackLevelDrift
from photosite.sensor.io.sensor_file import load_sensor
from photosite.values.uncertain import Missing, Uncertain

SENSOR = load_sensor("nikon-d200")

SERIES = 24, 4, 4, 4, 4
NOISE_DN = 0.1


def series(rng, seed, drift):
    """Means of successive dark frames in DN, with a gain of 0.5 DN per electron."""
    key, first = key_from_seed(seed), 0
    found = []
    for count in SERIES:
        frames = (Exposure(1.0, 1e4, 0.5, 64.0, 4095.0, 0, 0, 10, np.uint32(first + n), *key) for n in range(count))
        found.append([64.0 + 0.5 * drift_e(drift, frame) + rng.normal(0.0, NOISE_DN) for frame in frames])
        first += count
    return found


def measured(rng, seed, drift):
    return measure_drift(series(rng, seed, drift), [NOISE_DN**2] * len(SERIES), Uncertain.of(0.5, 0.001))


def drift_section(found):
    return found.section(SENSOR, "")["black_level_drift"]


def test_steady_levels_have_no_drift():
    rng = np.random.default_rng(1)
    found = [measured(rng, seed, BlackLevelDrift(standard_deviation_e=0.0)) for seed in range(50)]
    assert not any(entry.significant or drift_section(entry) is not None for entry in found)
    assert sum(entry.drift_dn.interval_95[0] == 0.0 for entry in found) >= 46


@pytest.mark.parametrize("size_e", [0.8, 4.0])
def test_intervals_contain_the_drift(size_e):
    """The standard deviation over 24 frames, of 40 seeds: 35 or more, which 95 % intervals miss in 1 of 100 tests."""
    rng = np.random.default_rng(2)
    drift = BlackLevelDrift(standard_deviation_e=size_e)
    truth_e = size_e * math.sqrt(octaves_within(24) / drift.octaves)
    found = [measured(rng, seed, drift) for seed in range(40)]
    inside = [entry.drift_e.interval_95[0] <= truth_e <= entry.drift_e.interval_95[1] for entry in found]
    assert sum(inside) >= 35
    error = np.array([entry.drift_e.value / truth_e - 1.0 for entry in found])
    assert abs(error.mean()) < 4.0 * error.std() / math.sqrt(40)
    assert sum(entry.significant for entry in found) >= 38


def test_the_file_gives_the_same_drift_again():
    drift = BlackLevelDrift(standard_deviation_e=3.0)
    found = [measured(np.random.default_rng(seed), seed, drift) for seed in range(8)]
    again = [drift_section(entry) for entry in found]
    assert {section.octaves for section in again} == {6}
    over_24 = [part.standard_deviation_e * math.sqrt(octaves_within(24) / part.octaves) for part in again]
    assert over_24 == pytest.approx([entry.drift_e.value for entry in found])


def test_few_frames_and_unknown_gain():
    assert measure_drift([[64.0, 64.2, 64.1]], [0.01], Uncertain(0.5)) is None
    found = measure_drift(
        series(np.random.default_rng(3), 3, BlackLevelDrift(standard_deviation_e=3)), [0.01] * 5, Missing("no light")
    )
    assert found.drift_e.reason == "no light"
    assert found.significant
    assert drift_section(found) is None
