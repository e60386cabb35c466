"""Sensors drawn over the range of practice: the draw, its files, the truth, and the counts of the study."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photosite.frames.open import open_frames
from photosite.studies.drawn_sensors import ROUTES, DrawnSensor, Level, draw_sensor
from photosite.studies.outcome import Outcome
from photosite.studies.random_sensors import TRUE, RandomSensors, SensorResult, measure_sensor, random_sensors

SENSORS = [draw_sensor(number) for number in range(400)]

SMALL = DrawnSensor(
    number=3,
    shape=(64, 66),
    bits=12,
    tile="mono",
    gain=0.4,
    black_dn=64.3,
    read_noise_e=4.0,
    dsnu_e=3.0,
    prnu=0.01,
    well_e=9000.0,
    dark_e_per_s=50.0,
    dcnu=0.2,
    efficiency={"M": 0.5},
    levels=(
        *(Level("dark", t, 0.0, 8) for t in (0.01, 1.0)),
        *(Level("light", t, 4e5 * t, 4) for t in (0.01, 0.02, 0.03, 0.04, 0.05)),
    ),
    photons_stated=True,
    route="HDF5",
)


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [
        ([s.gain for s in SENSORS], 0.02, 20.0),
        ([s.read_noise_e for s in SENSORS], 0.7, 40.0),
        ([s.prnu for s in SENSORS], 0.001, 0.03),
        ([s.well_e for s in SENSORS], 2e3, 2e5),
        ([s.shape[0] for s in SENSORS], 64, 400),
        ([s.shape[1] for s in SENSORS], 64, 600),
        ([s.lights[0].count for s in SENSORS], 2, 50),
        ([len(s.lights) for s in SENSORS], 4, 40),
    ],
)
def test_the_draw_covers_each_range(values: list[float], low: float, high: float) -> None:
    """The ends of 400 values are within 15 % of the range's logarithm."""
    assert low <= min(values) < low * (high / low) ** 0.15
    assert high * (low / high) ** 0.15 < max(values) <= high


def test_the_draw_has_all_kinds() -> None:
    assert {sensor.route for sensor in SENSORS} == set(ROUTES)
    assert {sensor.bits for sensor in SENSORS} == {8, 10, 12, 14, 16}
    assert {sensor.tile for sensor in SENSORS} == {"mono", "rggb", "bggr", "grbg", "gbrg"}
    assert {sensor.photons_stated for sensor in SENSORS} == {True, False}
    assert min(sensor.gain * sensor.read_noise_e for sensor in SENSORS) < 0.06


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("tile", ["mono", "gbrg"])
def test_files_hold_the_frames(route: str, tile: str, tmp_path: Path) -> None:
    efficiency = {"M": 0.5} if tile == "mono" else {"R": 0.3, "G": 0.5, "B": 0.2}
    sensor = replace(SMALL, route=route, tile=tile, efficiency=efficiency, photons_stated=route in ("HDF5", "TIFF"))
    path, options = sensor.write(tmp_path)
    opened = open_frames(path, **options)
    assert (opened.bits, opened.cfa[0][0]) == (12, "M" if tile == "mono" else "G")
    drawn = {(level.kind, level.exposure_s): (level, dn) for level, dn in sensor.frames()}
    assert {(group.kind, group.exposure_s) for group in opened.groups} == set(drawn)
    for group in opened.groups:
        level, dn = drawn[group.kind, group.exposure_s]
        assert np.array_equal(np.stack(list(group)), dn)
        stated = group.kind == "light" and (sensor.photons_stated or route == "EMVA 1288")
        assert group.photons_per_pixel in ((level.photons,) if stated else (None, 0.0))


def test_the_truth_is_that_of_the_frames() -> None:
    """Means and variances of many frames against the truth, in their standard errors."""
    sensor = replace(SMALL, shape=(200, 300), levels=(Level("dark", 1.0, 0.0, 30), Level("light", 1.0, 2e5, 4)))
    (_, dark), (_, full) = sensor.frames()
    truth, pixels = sensor.truth({"M": 1.0}), 200 * 300
    variance = float(dark.var(axis=0, ddof=1).mean())
    read_variance = truth["read_noise_dn"] ** 2 + 1.0 / 12.0
    assert abs(variance - read_variance) < 4.0 * read_variance * (2.0 / (29 * pixels)) ** 0.5
    spread = float(dark.mean(axis=0).var()) - variance / 30
    assert abs(spread - truth["dsnu_dn"] ** 2) < 5.0 * (truth["dsnu_dn"] ** 2 + variance / 30) * (2.0 / pixels) ** 0.5
    level_error = 4.0 * truth["dsnu_dn"] / pixels**0.5
    assert abs(float(dark.mean()) - truth["black_level_dn"]) < level_error
    assert abs(float(full.mean()) - truth["saturation_dn"]) < level_error
    assert truth["saturation_dn"] == pytest.approx(64.3 + 0.4 * 9000.0, abs=1e-6)


def test_partly_clipped_full_wells_have_a_lower_mean() -> None:
    """Half of a normal distribution is cut: its mean is lower by sigma / sqrt(2 pi), less the end of the rounding."""
    sensor, sigma = replace(SMALL, well_e=(4095.0 - 64.3) / 0.4), 0.4 * 5.0
    lower = (sigma - 1.0 / (24.0 * sigma)) / (2.0 * np.pi) ** 0.5
    assert 4095.0 - sensor.truth({})["saturation_dn"] == pytest.approx(lower, rel=1e-3)
    assert replace(SMALL, well_e=1e5).truth({})["saturation_dn"] == 4095.0


def test_counts() -> None:
    good, bad = Outcome(0.5, 0.5, 1.0, True), Outcome(-3.0, 1.0, 1.0, False)
    raised = frozenset({"jpeg-frames", "no-saturation"})
    dim = replace(SMALL, levels=SMALL.levels[:-3])
    study = RandomSensors(
        (
            SensorResult(replace(SMALL, number=1), {"a": good, "b": Outcome(0.0, 0.0, 1.0, True)}),
            SensorResult(replace(dim, number=2), {"a": bad, "b": Outcome(1.0, 0.0, 1.0, False)}, raised),
            SensorResult(replace(SMALL, number=5), {"a": "no frames", "b": "no frames"}),
            SensorResult(replace(SMALL, number=7), refused="too dark"),
        )
    )
    first, second = study.parameters
    assert (first.intervals, first.covered, first.withheld, first.exact, first.wrong) == (2, 1, 1, 0, 0)
    assert (first.rms_z, first.largest_z, first.sensor) == (pytest.approx(5.0**0.5), -3.0, 2)
    assert (second.intervals, second.exact, second.wrong, second.sensor) == (0, 2, 1, None)
    assert study.coverage == 0.5
    assert study.raised == {"jpeg-frames": 1, "no-saturation": 1}
    assert study.false_alarms == {"jpeg-frames": [2]}
    assert study.refused == {7: "too dark"}


def test_a_sensor_is_measured() -> None:
    result = measure_sensor(SMALL)
    assert result.refused is None
    gain = result.outcomes["system_gain_dn_per_e"]
    assert isinstance(gain, Outcome)
    assert abs(gain.error) < 4.0 * gain.standard_uncertainty < 0.04


def test_saturation_of_wells_that_are_not_all_full() -> None:
    """Light 2 standard deviations beyond the well: its mean is 0.35 DN low, 7 of its uncertainties."""
    times = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    levels = (
        *(Level("dark", t, 0.0, 8) for t in (0.01, 1.0)),
        *(Level("light", t, (9190.0 / 0.6 - 50.0) * t / 0.5, 8) for t in times[:-1]),
        Level("light", 0.6, (9190.0 - 30.0) / 0.5, 8),
    )
    sensor = replace(SMALL, shape=(160, 180), prnu=0.001, levels=levels)
    outcome = measure_sensor(sensor).outcomes["saturation_dn"]
    assert isinstance(outcome, Outcome)
    assert abs(outcome.error) < 4.0 * outcome.standard_uncertainty < 0.24


def test_a_full_well_of_one_channel_is_that_of_the_others() -> None:
    """Green saturates; red at the brightest level is 2 standard deviations below the well."""
    levels = (
        *(Level("dark", t, 0.0, 20) for t in (0.01, 1.0)),
        *(Level("light", t, 4.4e5 * t, 20) for t in np.geomspace(0.002, 0.05, 8).tolist()),
    )
    sensor = replace(SMALL, shape=(200, 220), tile="rggb", efficiency={"R": 0.397, "G": 0.55, "B": 0.2}, levels=levels)
    result = measure_sensor(sensor)
    gain = result.outcomes["system_gain_dn_per_e"]
    assert isinstance(gain, Outcome)
    assert abs(gain.error) < 4.0 * gain.standard_uncertainty < 0.004
    assert not result.false_alarms


def test_rounding_of_a_coarse_converter_is_no_step_of_the_read_noise() -> None:
    """The dark variance, of 0.3 DN of noise, is 0.05 DN^2 low at this phase of the mean."""
    sensor = replace(
        SMALL,
        shape=(136, 144),
        bits=8,
        gain=0.0234,
        black_dn=12.23,
        read_noise_e=12.94,
        dsnu_e=7.07,
        well_e=17_900.0,
        levels=(
            *(Level("dark", t, 0.0, 29) for t in (0.001, 0.1)),
            *(Level("light", 0.001, 2.0 * e, 29) for e in np.geomspace(245.0, 1500.0, 14)),
        ),
        photons_stated=True,
    )
    assert measure_sensor(sensor).refused is None


def test_levels_up_to_the_largest_variance_count_as_linear() -> None:
    """Five even levels: of 94 %, with dark current that fills the wells of the brightest, or of 116 % of saturation."""
    few = TRUE["few-light-levels"]
    assert few(draw_sensor(408))
    assert few(draw_sensor(468))
    dim = (*SMALL.levels[:2], *(Level("light", t, 3.2e5 * t, 4) for t in (0.01, 0.02, 0.03, 0.04, 0.05)))
    assert not few(replace(SMALL, levels=dim))


@pytest.mark.slow
def test_intervals_contain_the_truth_and_clean_sensors_raise_no_alarm() -> None:
    """40 sensors, about 1000 intervals.

    Resampled from 400 sensors, the coverage of 40 has a standard deviation of 0.9 %: correct intervals are outside the
    limits in 1 of 100 sets, and uncertainties that are 1.3 times too small in 3 of 4. A diagnostic that is false for
    1 of 200 sensors is raised for two or more of 40 in 1 of 60 sets, one that is false for 1 of 10 in 19 of 20.
    """
    study = random_sensors(range(40))
    assert 0.92 < study.coverage < 0.985
    assert max(abs(error) for error in study.errors) < 5.0
    assert not any(row.wrong for row in study.parameters)
    assert max(map(len, study.false_alarms.values()), default=0) <= 1
    assert len(study.refused) <= 1


def test_saturation_in_photons_is_that_of_the_most_responsive_channel() -> None:
    """Red and green saturate at the same, brightest level; the capacity of red is 10 % larger."""
    sensor = replace(SMALL, tile="rggb", efficiency={"R": 0.5, "G": 0.55, "B": 0.3})
    outcome = measure_sensor(sensor).outcomes["saturation_capacity_photons"]
    assert isinstance(outcome, Outcome)
    assert abs(outcome.error) < 4.0 * outcome.standard_uncertainty < 0.01 * 9000.0 / 0.55
