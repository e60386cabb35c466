"""Means over pixels of one color, against plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.engine.mosaic_means import mosaic_means


@pytest.mark.parametrize("step", [2, 3, 4, 5])
@pytest.mark.parametrize("tile", [(1, 1), (2, 2), (6, 6)])
def test_each_value_is_the_mean_of_the_nearest_pixels_of_its_color(tile: tuple[int, int], step: int) -> None:
    values = np.random.default_rng(4).integers(0, 4096, (62, 77)).astype(np.uint16)
    first, shape = (6, 12), (12, 6)
    found = mosaic_means(values, first, shape, tile, step)
    for i, j in np.ndindex(shape):
        parts = []
        for k, start, size, period in ((i, first[0], 62, tile[0]), (j, first[1], 77, tile[1])):
            same = [p for p in range(-60, 140) if (p - start - k) % period == 0]
            middle = start + (k + 0.5) * step
            # of two sets that are equally near, the one that begins earlier
            nearest = min(
                (same[n : n + step] for n in range(len(same) - step)), key=lambda p: abs(np.mean(p) + 0.5 - middle)
            )
            parts.append([p for p in nearest if 0 <= p < size])
        assert found[i, j] == pytest.approx(values[np.ix_(*parts)].mean(), rel=1e-6)


def test_colors_are_not_displaced() -> None:
    ramp = np.add.outer(np.zeros(40), np.arange(60.0))
    found = mosaic_means(ramp, (0, 0), (4, 12), (2, 2), 5)
    assert np.diff(found[:, 1:-1], axis=1) == pytest.approx(5.0)
    assert np.ptp(found, axis=0) == pytest.approx(0.0)
