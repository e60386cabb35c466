"""Temporal noise of pixels, rows, columns and frames recovered from synthetic stacks."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.chip_maps.temporal_noise import BINS, measure_temporal_noise, read_residuals
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
    look = read_residuals(iter(stack), sums.mean_frame(), PIXEL, none)
    return measure_temporal_noise(group, look, sums.mean_frame(), tile)


@pytest.mark.parametrize("tile", [np.zeros((1, 1), np.int64), np.array([[0, 1], [1, 2]])], ids=["mono", "bayer"])
def test_every_part_is_recovered(tile) -> None:
    """Each within 4 standard uncertainties: 5e-4 false alarms in total. Planes of a CFA share rows and columns."""
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


def test_absent_noise_has_an_interval_up_to_its_limit() -> None:
    """Of ten stacks without line noise, half have a negative variance. No interval may lie below zero."""
    tile, negative = np.zeros((1, 1), np.int64), 0
    for seed in range(10):
        rng = np.random.default_rng([seed, 5])
        stack = rng.normal(100, PIXEL, (8, 40, 30)).round().astype(np.uint16)
        sums = FrameSums((40, 30), tile).add(stack)
        sources = tuple(FrameSource(str(i), lambda: np.zeros((40, 30), np.uint16)) for i in range(8))
        group = GroupStatistics(FrameGroup("dark", 0.01, sources), tuple(map(Level.of, sums.label_totals())))
        look = read_residuals(iter(stack), sums.mean_frame(), PIXEL, (np.zeros(0, np.int64), np.zeros(0, np.int64)))
        noise = measure_temporal_noise(group, look, sums.mean_frame(), tile)
        for estimate in (noise.row_noise_dn, noise.column_noise_dn, noise.frame_noise_dn):
            low, high = estimate.interval_95
            assert low <= max(estimate.value, 0.0) <= high
            assert high > 0.0
            if estimate.value < 0.0:
                negative += 1
                assert high >= estimate.upper_limit_95
    assert negative > 5


def test_bands_are_distinguished_from_channels_and_each_other() -> None:
    """A fixed pattern of columns, and hum in rows whose phase changes from frame to frame."""
    rng = np.random.default_rng(7)
    fixed = 0.5 * np.sin(2 * np.pi * 0.2 * np.arange(SHAPE[1]))[None, None, :]
    hum = 0.7 * np.sin(2 * np.pi * 0.09 * np.arange(SHAPE[0])[None, :, None] + rng.uniform(0, 6.3, (FRAMES, 1, 1)))
    bands = measured(np.array([[0, 1], [1, 2]]), extra=fixed + hum).bands
    assert [round(band.cycles_per_pixel, 3) for band in bands["fixed columns"]] == [0.2]
    assert [round(band.cycles_per_pixel, 3) for band in bands["temporal rows"]] == [0.09]
    assert bands["temporal rows"][0].amplitude_dn == pytest.approx(0.7, abs=0.1)
    assert bands["fixed rows"] == bands["temporal columns"] == ()


def test_to_dict_is_json() -> None:
    import json

    content = json.loads(json.dumps(measured(np.zeros((1, 1), np.int64)).to_dict()))
    assert content["frames"] == FRAMES
    assert content["row_noise_dn"]["value"] == pytest.approx(ROW, rel=0.1)
    assert abs(content["tukey_lambda"]["value"] - 0.14) < 0.01


def test_residuals_match_numpy() -> None:
    rng = np.random.default_rng(1)
    stack = rng.normal(100, 5, (9, 40, 34)) + rng.normal(0, 3, (9, 1, 1)) + rng.normal(0, 2, (9, 40, 1))
    stack = stack.round().astype(np.uint16)
    mean = FrameSums((40, 34), np.array([[0, 1], [1, 2]])).add(stack).mean_frame()
    place = np.array([3, 39]), np.array([0, 33])
    look = read_residuals(iter(stack), mean, 5.0, place)

    residual = stack - stack.mean(axis=0)
    shift = residual.mean(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(look.variance, ((residual - shift) ** 2).sum(axis=0) / (len(stack) - 1), rtol=1e-5)
    np.testing.assert_allclose(look.fourth, ((residual - shift) ** 4).sum(axis=0), rtol=1e-5)
    np.testing.assert_allclose(look.series, (stack - shift)[:, place[0], place[1]].T, rtol=1e-6)
    rows = residual.mean(axis=2, keepdims=True)
    columns = residual.mean(axis=1, keepdims=True) - shift
    own = (residual - rows - columns) * np.sqrt(9 / 8)
    counts, _ = np.histogram(own, (np.arange(BINS + 1) - BINS / 2) * 5 / 8)
    # A residual at the boundary of two bins may count in either.
    assert np.abs(np.cumsum(look.histogram.sum(axis=0)) - np.cumsum(counts)).max() <= 3
    assert look.bin_dn == 5 / 8
    row_sums, column_sums = look.lines
    assert (row_sums[:, :, 1] == stack[:, :, 1::2].sum(axis=2)).all()
    assert (column_sums[:, 0] == stack[:, 0::2].sum(axis=1)).all()


def test_wrong_number_of_frames_is_rejected() -> None:
    stack = np.ones((3, 4, 4), np.uint16)
    mean = FrameSums((4, 4)).add(stack).mean_frame()
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    with pytest.raises(ValueError, match="3 frames"):
        read_residuals(iter(stack[:2]), mean, 1.0, none)
