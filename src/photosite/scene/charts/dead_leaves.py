"""Dead leaves: discs of random size and grey that hide one another, as texture that no filter can foresee."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum
from photosite.errors import InputError
from photosite.scene.charts.grey import between, check_size, dark_share, grey_scene
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene

_MOST_POINTS = 1 << 28
_BATCH = 1 << 13
"""Leaves drawn together; those that nothing would be seen of are put aside before the next look at each."""


def dead_leaves(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    smallest_radius: float = 1.0,
    largest_radius: float | None = None,
    contrast: float = 4.0,
    seed: int = 0,
    supersampling: int = 8,
    rows: int = 384,
    cols: int = 384,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Grey discs that hide one another until they cover the field (after ISO/TS 19567-2).

    Their radii have the probability density of r^-3, so that the texture looks alike at every scale between the
    smallest and the largest; their greys are uniform. Whether a camera keeps such texture or smooths it away tells what
    its noise reduction does.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    smallest_radius, largest_radius
        In samples, 0.5 or more. None: a quarter of the field's smaller side.
    contrast
        Radiance of the brightest leaves over that of the darkest, above 1; `math.inf` for black. Greys are uniform in
        between.
    seed
        0 or more; the same seed gives the same leaves.
    supersampling
        Points along a sample's side at which it is looked which leaf lies on top, from 1 to 32.
    rows, cols
        Samples.

    Returns
    -------
    Scene
        Samples that borders of leaves cut hold the mean of their points. Over a field of leaves from 1 sample on, the
        RMS of what that is off, against 32 points a side, is 1.0 % of the greys' range at 4 points a side and 0.36 %
        at 8 (`tests/scene/charts/test_dead_leaves.py`).

    Raises
    ------
    InputError
        If the radii, contrast, seed or supersampling cannot be.

    Notes
    -----
    Two points at a distance x lie on one leaf with the probability g(x) / (2 g(0) - g(x)), where g is the mean area
    that a leaf and itself moved by x share; the covariance of the greys is that times their variance (J. Serra, Image
    Analysis and Mathematical Morphology, 1982; A. Lee, D. Mumford and J. Huang, IJCV 41, 2001). Random numbers are
    NumPy's Philox, keyed by the seed.

    Examples
    --------
    >>> leaves = dead_leaves(rows=48, cols=64, contrast=4, seed=3)
    >>> leaves.shape, bool((leaves.weights >= 0.25).all() and (leaves.weights <= 1).all())
    ((48, 64), True)
    """
    check_size(rows, cols)
    largest = min(rows, cols) / 4 if largest_radius is None else largest_radius
    dark_share(contrast)  # before the work
    _check(smallest_radius, largest, seed, supersampling, rows, cols)
    random = np.random.Generator(np.random.Philox(key=seed))
    share = _leaves(rows, cols, smallest_radius, largest, supersampling, random)
    return grey_scene(
        between(share, contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"dead leaves of {smallest_radius:g} to {largest:g} samples, seed {seed}",
    )


def _check(smallest: float, largest: float, seed: int, supersampling: int, rows: int, cols: int) -> None:
    if not 0.5 <= smallest < largest < math.inf:
        raise InputError(
            f"the radii of leaves rise from 0.5 samples or more to a larger one, not from {smallest} to {largest}"
        )
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 1 << 128:
        raise InputError(f"a seed is a whole number from 0 on, not {seed}")
    if not isinstance(supersampling, int | np.integer) or not 1 <= supersampling <= 32:
        raise InputError(f"supersampling is a whole number of points along a side from 1 to 32, not {supersampling}")
    if rows * cols * supersampling**2 > _MOST_POINTS:
        raise InputError(
            f"{rows} x {cols} samples of {supersampling} x {supersampling} points are too many; "
            "ask for fewer samples or less supersampling"
        )


def _leaves(
    rows: int, cols: int, smallest: float, largest: float, fine: int, random: np.random.Generator
) -> NDArray[np.float64]:
    """(rows, cols) mean greys from 0 to 1, laid from the front: a leaf is seen where none before it lies."""
    bare = np.ones((rows * fine, cols * fine), np.bool_)
    grey = np.empty(bare.shape, np.float32)
    while bare.any():
        down = random.uniform(-largest, rows + largest, _BATCH)
        along = random.uniform(-largest, cols + largest, _BATCH)
        # The share of leaves larger than r falls with r^-2 from the smallest to the largest.
        rest = random.uniform(0.0, 1.0, _BATCH)
        radius = (smallest**-2 - rest * (smallest**-2 - largest**-2)) ** -0.5
        shade = random.uniform(0.0, 1.0, _BATCH).astype(np.float32)
        seen = np.nonzero(_touches(bare, fine, down, along, radius))[0]
        for leaf in seen:
            _lay(bare, grey, down[leaf] * fine, along[leaf] * fine, radius[leaf] * fine, shade[leaf])
    share: NDArray[np.float64] = grey.reshape(rows, fine, cols, fine).mean(axis=(1, 3), dtype=np.float64)
    return share


def _touches(
    bare: NDArray[np.bool_],
    fine: int,
    down: NDArray[np.float64],
    along: NDArray[np.float64],
    radius: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Whether the rectangle round each leaf holds a sample with a bare point: sums over rectangles from one table."""
    rows, cols = bare.shape[0] // fine, bare.shape[1] // fine
    table = np.zeros((rows + 1, cols + 1), np.int64)
    table[1:, 1:] = bare.reshape(rows, fine, cols, fine).any(axis=(1, 3)).cumsum(axis=0).cumsum(axis=1)
    r0, r1 = (np.clip(np.floor(down + side * radius) + max(side, 0), 0, rows).astype(np.intp) for side in (-1, 1))
    c0, c1 = (np.clip(np.floor(along + side * radius) + max(side, 0), 0, cols).astype(np.intp) for side in (-1, 1))
    inside: NDArray[np.bool_] = table[r1, c1] - table[r0, c1] - table[r1, c0] + table[r0, c0] > 0
    return inside


def _lay(
    bare: NDArray[np.bool_], grey: NDArray[np.float32], down: float, along: float, radius: float, shade: np.float32
) -> None:
    r0, r1 = max(math.ceil(down - radius - 0.5), 0), min(math.floor(down + radius - 0.5) + 1, bare.shape[0])
    c0, c1 = max(math.ceil(along - radius - 0.5), 0), min(math.floor(along + radius - 0.5) + 1, bare.shape[1])
    if r0 >= r1 or c0 >= c1:
        return
    y = np.arange(r0, r1) + (0.5 - down)
    x = np.arange(c0, c1) + (0.5 - along)
    part = bare[r0:r1, c0:c1]
    new = (y * y)[:, None] + (x * x)[None, :] <= radius * radius
    new &= part
    grey[r0:r1, c0:c1][new] = shade
    part &= ~new
