"""The second look against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.chip_maps.second_look import BINS, look_again
from photosite.engine.frame_sums import FrameSums


def test_a_stack_looked_at_again() -> None:
    rng = np.random.default_rng(1)
    stack = rng.normal(100, 5, (9, 40, 34)) + rng.normal(0, 3, (9, 1, 1)) + rng.normal(0, 2, (9, 40, 1))
    stack = stack.round().astype(np.uint16)
    mean = FrameSums((40, 34), np.array([[0, 1], [1, 2]])).add(stack).mean_frame()
    place = np.array([3, 39]), np.array([0, 33])
    look = look_again(iter(stack), mean, 5.0, place)

    residual = stack - stack.mean(axis=0)
    np.testing.assert_allclose(look.fourth, (residual**4).sum(axis=0), rtol=1e-5)
    shift = residual.mean(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(look.series, (stack - shift)[:, place[0], place[1]].T, rtol=1e-6)
    rows = residual.mean(axis=2, keepdims=True)
    columns = residual.mean(axis=1, keepdims=True) - shift
    own = (residual - rows - columns) * np.sqrt(9 / 8)
    counts, _ = np.histogram(own, (np.arange(BINS + 1) - BINS / 2) * 5 / 8)
    # A residual on the border of two bins may be counted on either side of it.
    assert np.abs(np.cumsum(look.histogram.sum(axis=0)) - np.cumsum(counts)).max() <= 3
    assert look.bin_dn == 5 / 8
    row_sums, column_sums = look.lines
    assert (row_sums[:, :, 1] == stack[:, :, 1::2].sum(axis=2)).all()
    assert (column_sums[:, 0] == stack[:, 0::2].sum(axis=1)).all()


def test_other_frames_than_the_means_are_refused() -> None:
    stack = np.ones((3, 4, 4), np.uint16)
    mean = FrameSums((4, 4)).add(stack).mean_frame()
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    with pytest.raises(ValueError, match="the mean is of 3 frames, and 2 came"):
        look_again(iter(stack[:2]), mean, 1.0, none)
