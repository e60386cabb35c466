"""Dead leaves: discs of random size and gray that occlude one another, a texture without regularity."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.errors import InputError
from photosite.scene.charts.chart import Chart, Contrast, Samples, between, gray_chart, lit

_MOST_POINTS = 1 << 28
_BATCH = 1 << 13
"""Leaves drawn together; hidden ones are discarded before each is drawn."""

Array = NDArray[np.float64]
Radius = Annotated[float, Field(ge=0.5, allow_inf_nan=False)]


@lit()
def dead_leaves(
    *,
    smallest_radius: Radius = 1.0,
    largest_radius: Radius | None = None,
    contrast: Contrast = 4.0,
    seed: Annotated[int, Field(ge=0, lt=1 << 128)] = 0,
    supersampling: Annotated[int, Field(ge=1, le=32)] = 8,
    rows: Samples = 384,
    cols: Samples = 384,
) -> Chart:
    """Dead leaves: gray discs that occlude one another until they cover the field (after ISO/TS 19567-2).

    Their radii have the probability density r^-3, so that the texture is alike at every scale between the smallest and
    the largest; their grays are uniform. The camera's rendering of such texture measures its noise reduction.

    Parameters
    ----------
    smallest_radius, largest_radius
        In samples, 0.5 or more. None: a quarter of the field's smaller side.
    contrast
        Radiance of the brightest leaves over that of the darkest, above 1; `math.inf` for black. Grays are uniform in
        between.
    seed
        0 or more; the same seed gives the same leaves.
    supersampling
        Points along a sample's side at which the top leaf is found, from 1 to 32.
    rows, cols
        Samples.

    Returns
    -------
    Chart
        Samples that borders of leaves cut hold the mean of their points. With leaves of 1 sample and more, the RMS
        error of that, against 32 points a side, is 1.0 % of the grays' range at 4 points a side and 0.36 % at 8
        (`tests/scene/charts/test_dead_leaves.py`).

    Notes
    -----
    Two points at a distance x are on one leaf with the probability g(x) / (2 g(0) - g(x)), where g is the mean area
    that a leaf and itself moved by x share; the covariance of the grays is that times their variance (J. Serra, Image
    Analysis and Mathematical Morphology, 1982; A. Lee, D. Mumford and J. Huang, IJCV 41, 2001). Random numbers are
    NumPy's Philox, keyed by the seed.

    Examples
    --------
    >>> leaves = dead_leaves(rows=48, cols=64, contrast=4, seed=3)
    >>> leaves.shape, bool((leaves.weights >= 0.25).all() and (leaves.weights <= 1).all())
    ((48, 64), True)
    """
    largest = min(rows, cols) / 4 if largest_radius is None else largest_radius
    if not smallest_radius < largest:
        raise InputError("largest_radius", value=largest, expected=f"above smallest_radius, {smallest_radius:g}")
    if rows * cols * supersampling**2 > _MOST_POINTS:
        what = f"{rows} x {cols} samples of {supersampling} x {supersampling} points are too many"
        raise InputError(what, hint="Use fewer samples or less supersampling")
    random = np.random.Generator(np.random.Philox(key=seed))
    fraction = _leaves(rows, cols, smallest_radius, largest, supersampling, random)
    name = f"dead leaves of {smallest_radius:g} to {largest:g} samples, seed {seed}"
    return gray_chart(between(fraction, contrast), name)


def _leaves(rows: int, cols: int, smallest: float, largest: float, fine: int, random: np.random.Generator) -> Array:
    """(rows, cols) mean grays from 0 to 1, from the front: a leaf is visible where no earlier one is."""
    bare = np.ones((rows * fine, cols * fine), np.bool_)
    gray = np.empty(bare.shape, np.float32)
    while bare.any():
        down = random.uniform(-largest, rows + largest, _BATCH)
        along = random.uniform(-largest, cols + largest, _BATCH)
        # The fraction of leaves larger than r decreases as r^-2 from the smallest to the largest.
        rest = random.uniform(0.0, 1.0, _BATCH)
        radius = (smallest**-2 - rest * (smallest**-2 - largest**-2)) ** -0.5
        shade = random.uniform(0.0, 1.0, _BATCH).astype(np.float32)
        seen = np.nonzero(_touches(bare, fine, down, along, radius))[0]
        for leaf in seen:
            _lay(bare, gray, down[leaf] * fine, along[leaf] * fine, radius[leaf] * fine, shade[leaf])
    fraction: Array = gray.reshape(rows, fine, cols, fine).mean(axis=(1, 3), dtype=np.float64)
    return fraction


def _touches(bare: NDArray[np.bool_], fine: int, down: Array, along: Array, radius: Array) -> NDArray[np.bool_]:
    """Whether the rectangle around each leaf holds a sample with a bare point, from a summed-area table."""
    rows, cols = bare.shape[0] // fine, bare.shape[1] // fine
    table = np.zeros((rows + 1, cols + 1), np.int64)
    table[1:, 1:] = bare.reshape(rows, fine, cols, fine).any(axis=(1, 3)).cumsum(axis=0).cumsum(axis=1)
    r0, r1 = (np.clip(np.floor(down + side * radius) + max(side, 0), 0, rows).astype(np.intp) for side in (-1, 1))
    c0, c1 = (np.clip(np.floor(along + side * radius) + max(side, 0), 0, cols).astype(np.intp) for side in (-1, 1))
    inside: NDArray[np.bool_] = table[r1, c1] - table[r0, c1] - table[r1, c0] + table[r0, c0] > 0
    return inside


def _lay(
    bare: NDArray[np.bool_], gray: NDArray[np.float32], down: float, along: float, radius: float, shade: np.float32
) -> None:
    r0, r1 = max(math.ceil(down - radius - 0.5), 0), min(math.floor(down + radius - 0.5) + 1, bare.shape[0])
    c0, c1 = max(math.ceil(along - radius - 0.5), 0), min(math.floor(along + radius - 0.5) + 1, bare.shape[1])
    if r0 >= r1 or c0 >= c1:
        return
    part = bare[r0:r1, c0:c1]
    if not part.any():
        return
    y = np.arange(r0, r1) + (0.5 - down)
    x = np.arange(c0, c1) + (0.5 - along)
    new = (y * y)[:, None] + (x * x)[None, :] <= radius * radius
    new &= part
    gray[r0:r1, c0:c1][new] = shade
    part &= ~new
