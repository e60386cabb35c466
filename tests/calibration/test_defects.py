"""Pixels that deviate from their channel."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.chip_maps.defects import channel_values, deviations, listed, merged
from photosite.frames.frame_set import FrameSet
from photosite.sensor.chip import DefectKind
from photosite.sensor.readout import digital_numbers

TILE = np.array([[0, 1], [1, 2]])


def test_channels_are_judged_separately() -> None:
    """Channels of different levels and spreads; the robust deviation of 4000 pixels is known to 4 %."""
    rng = np.random.default_rng(1)
    level, spread = np.array([0.0, 50.0, -20.0]), np.array([1.0, 4.0, 0.2])
    tile = np.tile(TILE, (60, 70))
    values = (level[tile] + spread[tile] * rng.normal(0, 1, tile.shape)).astype(np.float32)
    values[10, 10], values[11, 10] = level[0] + 20 * spread[0], level[1] - 20 * spread[1]
    found = deviations(values, np.zeros_like(values), TILE)[:]
    for k in range(3):
        assert np.std(np.clip(channel_values(found, TILE, k), -5, 5)) == pytest.approx(1.0, abs=0.06)
    assert found[10, 10] == pytest.approx(20, rel=0.1)
    assert found[11, 10] == pytest.approx(-20, rel=0.1)


def test_imprecisely_measured_pixel_is_not_listed() -> None:
    values = np.random.default_rng(2).normal(0, 1, (100, 100)).astype(np.float32)
    uncertainty = np.full_like(values, 0.3)
    values[5, 5], uncertainty[5, 5] = 8.0, 4.0
    assert deviations(values, uncertainty, np.zeros((1, 1), np.int64))[:][5, 5] == pytest.approx(8 / 4.1, rel=0.05)
    uncertainty[5, 5] = 0.3
    assert deviations(values, uncertainty, np.zeros((1, 1), np.int64))[:][5, 5] > 7


def test_merged_lists_are_sorted() -> None:
    chosen = np.zeros((4, 4), bool)
    chosen[2, 1] = chosen[0, 3] = True
    values = np.arange(16.0).reshape(4, 4)
    joined = merged(
        [listed(DefectKind.OFFSET, chosen, values, values), listed(DefectKind.HOT, chosen, 2 * values, values)]
    )
    assert list(zip(joined.row.tolist(), joined.col.tolist(), joined.kind.tolist(), strict=True)) == [
        (0, 3, DefectKind.HOT),
        (0, 3, DefectKind.OFFSET),
        (2, 1, DefectKind.HOT),
        (2, 1, DefectKind.OFFSET),
    ]
    assert joined.value.tolist() == [6.0, 3.0, 18.0, 9.0]


@pytest.mark.parametrize(("defects", "count"), [(None, None), ({"dead_columns": 1}, 96), ({"stuck_fraction": 1e-3}, 7)])
def test_defects_are_named_and_left_out(defects, count) -> None:
    sensor = ps.load_sensor("nikon-d200").with_(
        rows=96,
        cols=120,
        cfa="mono",
        black_level_dn=100,
        pixel_defects=defects,
        channels={"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}},
    )
    steps = [("dark", 0.01, 0)] * 4 + [("light", 0.01 * n, 3000 * n) for n in range(1, 10) for _ in range(2)]
    frames = [
        (kind, time_s, digital_numbers(sensor, np.full((96, 120), light, np.float32), time_s, seed=1, frame=n))
        for n, (kind, time_s, light) in enumerate(steps)
    ]
    calibration = ps.calibrate(FrameSet.from_arrays(frames, bits=12, sensor=sensor.with_(pixel_defects=None)))
    assert ("defective-pixels" in limits(calibration)) == (count is not None)
    assert "far-pixels" not in limits(calibration)
    assert calibration.prnu_percent.value == pytest.approx(sensor.noise.prnu_percent.value, abs=0.05)
    if count is not None:
        assert limits(calibration)["defective-pixels"] * 96 * 120 == pytest.approx(count)
