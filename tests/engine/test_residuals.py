"""Residuals of frames against NumPy."""

from __future__ import annotations

import numpy as np

from photosite.engine.residuals import add_residuals


def test_fourth_powers_and_histogram_are_numpys() -> None:
    rng = np.random.default_rng(3)
    frames = rng.integers(50, 90, (6, 37, 21)).astype(np.uint16)
    frames[0, 5, 7] = 60_000  # beyond the last bin
    total = frames.sum(axis=0, dtype=np.uint32)
    rows, columns = rng.normal(0, 1, (6, 37)), rng.normal(0, 1, (6, 21))
    fourth, histogram = np.zeros((37, 21), np.float32), np.zeros((5, 100), np.int64)
    for frame, row, column in zip(frames, rows, columns, strict=True):
        add_residuals(frame, total, 6, row, column, 2.5, fourth, histogram)

    residual = frames - total / 6
    np.testing.assert_allclose(fourth, (residual**4).sum(axis=0), rtol=1e-5)
    shifted = residual - rows[:, :, None] - columns[:, None, :]
    edges = (np.arange(101) - 50) / 2.5
    edges[0], edges[-1] = -np.inf, np.inf
    for block in range(5):
        mine = shifted[:, block * 37 // 5 : (block + 1) * 37 // 5]
        assert histogram[block].tolist() == np.histogram(mine, edges)[0].tolist()
