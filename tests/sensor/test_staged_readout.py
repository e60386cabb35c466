"""Frames of sensors with effects: equal to those without where the effects do nothing, and distributed as stated."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.sensor.chip import Blinking, MeasuredChip, no_defects
from photosite.sensor.readout import digital_numbers

SENSOR = ps.load_sensor("nikon-d200").with_(rows=120, cols=150, black_level_dn=64, row_noise_mv=0.1, dcnu_percent=20)
MEAN = np.tile(np.linspace(0, 40000, 150, dtype=np.float32), (120, 1))
NEUTRAL = {"readout_channels": {"relative_gain": [[1.0]]}}


def frame(sensor: ps.Sensor, **options: Any) -> np.ndarray[Any, np.dtype[np.uint16]]:
    return digital_numbers(sensor, MEAN, 0.5, seed=3, frame=2, **options)


def test_effects_without_a_size_change_nothing() -> None:
    """Maps are rounded to 32 bits, which changes a count in less than one of 10 000 pixels."""
    assert (frame(SENSOR) != frame(SENSOR.with_(effects=NEUTRAL))).mean() < 1e-4


@pytest.mark.parametrize("region", [(0, 1, 0, 1), (17, 50, 3, 150), (119, 120, 0, 150), (3, 120, 149, 150)])
def test_regions_are_parts_of_the_frame(region: tuple[int, int, int, int]) -> None:
    sensor = SENSOR.with_(
        response_curve={"polynomial_percent": [0, -2]},
        readout_channels={"arrangement": "blocks", "offset_e": [[0, 9], [-5, 3]]},
    )
    r0, r1, c0, c1 = region
    assert (frame(sensor, region=region) == frame(sensor)[r0:r1, c0:c1]).all()


def test_measured_maps_with_effects(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    maps = {name: rng.normal(0, 2, (120, 150)).astype(np.float32) for name in ("offset_dn", "dark_rate_dn_per_s")}
    place = np.arange(20, 60), np.arange(40, 80)
    blinking = Blinking(*place, *(np.full(40, value) for value in (60.0, 0.4, 2.0)))
    chip = MeasuredChip(
        **maps,
        dark_rate_uncertainty_dn_per_s=np.zeros((120, 150), np.float32),
        prnu_uncertainty=np.zeros((120, 150), np.float32),
        prnu=rng.normal(0, 0.02, (120, 150)).astype(np.float32),
        read_noise_dn=rng.normal(2, 1, (120, 150)).astype(np.float32),
        read_noise_freedom=9,
        offset_uncertainty_dn=np.zeros((120, 150), np.float32),
        row_noise_dn=0.5,
        black_level_dn=64.0,
        system_gain_dn_per_e=0.2,
        reference_exposure_s=0.01,
        defects=no_defects(),
        blinking=blinking,
    )
    measured = SENSOR.with_(maps=chip.save(tmp_path / "chip.maps.h5"))
    # The maps hold the pattern of channels and lines.
    again = measured.with_(readout_channels={"relative_gain": [[1.2, 0.8]]}, line_pattern={"column_offset_e": 90})
    assert (frame(measured) != frame(again)).mean() < 1e-4
    assert (frame(measured) != frame(measured.with_(effects=NEUTRAL))).mean() < 1e-4
    at_blinking = [frame(one)[place].astype(int) for one in (measured, measured.with_(effects=NEUTRAL))]
    assert np.ptp(at_blinking[0] - at_blinking[1]) <= 1


def test_moments_with_a_curve_and_channels() -> None:
    """Mean and variance of each channel against s(q) and s'(q)^2 q, 4.5 sigma: false alarms below 1e-4 in all."""
    sensor = SENSOR.with_(
        prnu_percent=0,
        dsnu_mv=0,
        dark_voltage_mv_per_s=0,
        row_noise_mv=0,
        response_curve={"polynomial_percent": [1.0, -6.0]},
        readout_channels={"relative_gain": [[1.02, 0.97]], "offset_e": [[40, -25]]},
    )
    well, gain = sensor.pixel.well_capacity_e.value, sensor.system_gain_dn_per_e
    for level in (200.0, 9000.0, 30000.0):
        dn = digital_numbers(sensor, np.full((120, 150), level, np.float32), 0.5, seed=8).astype(float)
        x = level / well
        signal = level * (1 + 0.01 * x - 0.06 * x**2)
        slope = 1 + 0.02 * x - 0.18 * x**2
        for column, (relative, offset) in enumerate(((1.02, 40), (0.97, -25))):
            part = dn[:, column::2]
            read_e = sensor.electrons(sensor.noise.read_noise_mv.value)
            variance = (gain * relative) ** 2 * (slope**2 * level + read_e**2) + 1 / 12
            # The curvature of s lowers the mean by s'' q / 2.
            curvature = (0.02 - 0.36 * x) / well * level / 2
            expected = 64 + gain * relative * (signal + curvature + offset)
            assert abs(part.mean() - expected) < 4.5 * np.sqrt(variance / part.size)
            assert abs(part.var() / variance - 1) < 4.5 * np.sqrt(2 / part.size)


def test_lines_have_the_stated_spreads() -> None:
    """Means over 100 frames against the stated spreads, 4.5 sigma of 400 and 500 lines; another serial differs."""
    lines = {"row_offset_e": 20, "column_offset_e": 30, "column_gain_percent": 2}
    sensor = SENSOR.with_(rows=400, cols=500, prnu_percent=0, dsnu_mv=0, read_noise_mv=0, row_noise_mv=0)
    sensor = sensor.with_(
        dark_voltage_mv_per_s=0, readout_channels={"relative_gain": [[1.02, 0.98]]}, line_pattern=lines
    )
    gain = sensor.system_gain_dn_per_e

    def mean_of(one: ps.Sensor, level: float) -> Any:
        return digital_numbers(one, np.full((400, 500), level, np.float32), 0.01, seed=5).astype(float)

    dark, flat = mean_of(sensor, 0.0), mean_of(sensor, 30000.0)
    rows, columns = dark.mean(axis=1) / gain, dark.mean(axis=0) / gain
    response = (flat - dark).mean(axis=0) / (30000 * gain) / np.tile([1.02, 0.98], 250)
    for found, expected in ((rows, 20), (columns, 30), (100 * response, 2)):
        assert abs(found.std() / expected - 1) < 4.5 / np.sqrt(2 * found.size)
    assert abs(np.corrcoef(columns, response)[0, 1]) < 4.5 / np.sqrt(500)
    assert response.mean() == pytest.approx(1, abs=4.5 * 0.02 / np.sqrt(500))
    part = digital_numbers(sensor, np.full((400, 500), 9, np.float32), 0.01, seed=5, region=(30, 90, 7, 411))
    assert (part == mean_of(sensor, 9.0)[30:90, 7:411]).all()
    other = mean_of(sensor.with_(serial="another"), 0.0).mean(axis=0) / gain
    assert abs(np.corrcoef(columns, other)[0, 1]) < 4.5 / np.sqrt(500)


@pytest.mark.parametrize(
    ("effects", "what", "where"),
    [
        ({"response_curve": {"polynomial_percent": [-200.0]}}, "the curve", "effects.response_curve"),
        (
            {"response_curve": {"charge_e": [0, 5], "deviation_percent": [1, 2]}},
            "deviation_percent[0]",
            "effects.response_curve",
        ),
        (
            {"response_curve": {"polynomial_percent": [-1.0]}, "em_gain": {"gain": 100}},
            "response_curve and em_gain",
            "effects",
        ),
        ({"readout_channels": {"relative_gain": [[1.0] * 200]}}, "relative_gain", "effects.readout_channels"),
        ({"readout_channels": {"offset_e": [[1, 2], [3]]}}, "offset_e", "effects.readout_channels"),
    ],
)
def test_invalid_effects(effects: dict[str, Any], what: str, where: str) -> None:
    with raises(InputError, what, where=where):
        SENSOR.with_(effects=effects)


def test_file_keeps_effects(tmp_path: Path) -> None:
    sensor = SENSOR.with_(
        response_curve={"charge_e": [0, 20000, 36000], "deviation_percent": [0, -0.5, -2.5]},
        readout_channels={"relative_gain": [[1.01, 0.99]]},
    )
    sensor.save(tmp_path / "bent.sensor.yaml")
    again = ps.load_sensor(tmp_path / "bent.sensor.yaml")
    assert again.effects == sensor.effects
    assert again.with_(response_curve=None, readout_channels=None).effects is None
