"""Temporal noise of pixels, rows, columns and frames, planted and found."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.chip_maps.second_look import look_again
from photosite.calibration.chip_maps.temporal import measure_temporal
from photosite.calibration.reduction.groups import GroupStatistics, Level
from photosite.engine.frame_sums import FrameSums
from photosite.frames.frame_set import FrameGroup, FrameSource

SHAPE, FRAMES = (300, 240), 24
PIXEL, ROW, COLUMN, FRAME = 4.0, 0.8, 0.5, 0.6


def measured(tile, seed=1, extra=0.0):
    rng = np.random.default_rng(seed)
    channels = np.tile(tile, (SHAPE[0] // len(tile), SHAPE[1] // len(tile)))
    fixed = np.random.default_rng([seed, 1]).normal(100, 3, SHAPE) + 20 * channels
    stack = fixed + rng.normal(0, PIXEL, (FRAMES, *SHAPE)) + extra
    stack += rng.normal(0, ROW, (FRAMES, SHAPE[0], 1)) + rng.normal(0, COLUMN, (FRAMES, 1, SHAPE[1]))
    stack = (stack + rng.normal(0, FRAME, (FRAMES, 1, 1))).round().astype(np.uint16)
    sums = FrameSums(SHAPE, tile).add(stack)
    sources = tuple(FrameSource(str(i), lambda: np.zeros(SHAPE, np.uint16)) for i in range(FRAMES))
    group = GroupStatistics(FrameGroup("dark", 0.01, sources), tuple(map(Level.of, sums.label_totals())))
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    look = look_again(iter(stack), sums.mean_frame(), PIXEL, none)
    return measure_temporal(group, look, sums.variance().astype(np.float32), sums.mean_frame(), tile)


@pytest.mark.parametrize("tile", [np.zeros((1, 1), np.int64), np.array([[0, 1], [1, 2]])], ids=["mono", "bayer"])
def test_every_part_is_found(tile) -> None:
    """Each within 4 standard uncertainties: false alarms 5e-4 in all. Planes of a CFA share rows and columns."""
    noise = measured(tile)
    for estimate, true, relative in (
        (noise.pixel_noise_dn, PIXEL, 0.002),
        (noise.row_noise_dn, ROW, 0.02),
        (noise.column_noise_dn, COLUMN, 0.04),
        (noise.frame_noise_dn, FRAME, 0.25),
    ):
        assert abs(estimate.value - true) < 4 * estimate.standard_uncertainty
        assert estimate.standard_uncertainty < relative * true
    assert all(not bands for bands in noise.bands.values())


def test_what_is_not_there_has_an_interval_that_reaches_its_limit() -> None:
    """Of ten sets without line noise, half have a variance below zero; none may say that the noise is below zero."""
    tile, negative = np.zeros((1, 1), np.int64), 0
    for seed in range(10):
        rng = np.random.default_rng([seed, 5])
        stack = rng.normal(100, PIXEL, (8, 40, 30)).round().astype(np.uint16)
        sums = FrameSums((40, 30), tile).add(stack)
        sources = tuple(FrameSource(str(i), lambda: np.zeros((40, 30), np.uint16)) for i in range(8))
        group = GroupStatistics(FrameGroup("dark", 0.01, sources), tuple(map(Level.of, sums.label_totals())))
        look = look_again(iter(stack), sums.mean_frame(), PIXEL, (np.zeros(0, np.int64), np.zeros(0, np.int64)))
        noise = measure_temporal(group, look, sums.variance().astype(np.float32), sums.mean_frame(), tile)
        for estimate in (noise.row_noise_dn, noise.column_noise_dn, noise.frame_noise_dn):
            low, high = estimate.interval_95
            assert low <= estimate.value <= high
            assert high > 0.0
            if estimate.value < 0.0:
                negative += 1
                assert high >= estimate.upper_limit_95
    assert negative > 5


def test_bands_are_told_from_channels_and_from_each_other() -> None:
    """A fixed pattern of columns; a hum whose phase changes from frame to frame, in rows."""
    rng = np.random.default_rng(7)
    fixed = 0.5 * np.sin(2 * np.pi * 0.2 * np.arange(SHAPE[1]))[None, None, :]
    hum = 0.7 * np.sin(2 * np.pi * 0.09 * np.arange(SHAPE[0])[None, :, None] + rng.uniform(0, 6.3, (FRAMES, 1, 1)))
    bands = measured(np.array([[0, 1], [1, 2]]), extra=fixed + hum).bands
    assert [round(band.cycles_per_pixel, 3) for band in bands["fixed columns"]] == [0.2]
    assert [round(band.cycles_per_pixel, 3) for band in bands["temporal rows"]] == [0.09]
    assert bands["temporal rows"][0].amplitude_dn == pytest.approx(0.7, abs=0.1)
    assert bands["fixed rows"] == bands["temporal columns"] == ()


def test_the_numbers_are_plain() -> None:
    import json

    said = json.loads(json.dumps(measured(np.zeros((1, 1), np.int64)).to_dict()))
    assert said["frames"] == FRAMES
    assert said["row_noise_dn"]["value"] == pytest.approx(ROW, rel=0.1)
    assert abs(said["tukey_lambda"]["value"] - 0.14) < 0.01
