"""Charts of patches: any reflectances, and grays over many decades."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from photosite.color.spectrum import wavelength_grid
from photosite.errors import InputError
from photosite.scene.charts.chart import Chart, gray_chart, lit
from photosite.scene.weights import few_spectra
from photosite.values.region import Region

# Geometry in samples, the ColorChecker's: patches of 28 with 4 of black around them.
PATCH, _GAP, _INSET = 28, 4, 4

_PATCH_TOLERANCE = 1e-5
"""RMS error of a chart's reflectances by its few basis spectra, relative to their RMS."""


def patch_grid(rows: int, cols: int) -> tuple[tuple[int, int], list[tuple[int, int]]]:
    """Return the shape of a chart in samples, and the first row and column of each patch, along the rows."""
    corners = [(_GAP + (PATCH + _GAP) * r, _GAP + (PATCH + _GAP) * c) for r in range(rows) for c in range(cols)]
    return (rows * (PATCH + _GAP) + _GAP, cols * (PATCH + _GAP) + _GAP), corners


def patch_regions(names: Sequence[str], corners: Sequence[tuple[int, int]]) -> tuple[Region, ...]:
    """Return the insides of the patches, which blur at their borders does not reach."""
    inner = PATCH - _INSET
    return tuple(
        Region(name, r + _INSET, r + inner, c + _INSET, c + inner) for name, (r, c) in zip(names, corners, strict=False)
    )


def reflectance_chart(
    reflectance: ArrayLike,
    wavelength_nm: ArrayLike,
    *,
    rows: int,
    cols: int,
    names: Sequence[str] | None = None,
    name: str = "chart",
) -> Chart:
    """Return a chart of patches of any reflectances, with black between them.

    Parameters
    ----------
    reflectance
        (patches, wavelengths), along the rows of the chart from the top left; remaining places stay black. Above 1 for
        patches that fluoresce or shine.
    wavelength_nm
        (wavelengths,), and the scene's.
    rows, cols
        Patches down and across.
    names
        Of the patches, all different; None numbers them from 1.
    name
        Name of the chart.

    Returns
    -------
    Chart
        (32 rows + 4, 32 cols + 4) samples, a region for each patch. Its basis is the fewest spectra that make all
        reflectances to an RMS of 1e-5 of theirs.

    Raises
    ------
    InputError
        If shapes do not fit, a reflectance is negative or not finite, or two patches have one name.

    Examples
    --------
    >>> grid = np.arange(400.0, 701.0, 10)
    >>> grays = np.array([0.1, 0.2, 0.4, 0.8])[:, None] * np.ones(grid.size)
    >>> chart = reflectance_chart(grays, grid, rows=2, cols=2, names=["a", "b", "c", "d"])
    >>> scene = chart.under("D65", 100)
    >>> scene.shape, scene.weights.shape[0], [region.name for region in scene.regions]
    ((68, 68), 1, ['a', 'b', 'c', 'd'])
    """
    grid = wavelength_grid(wavelength_nm)
    values = _checked(reflectance, grid, rows, cols)
    titles = _titles(names, len(values))
    shape, corners = patch_grid(rows, cols)
    weights, basis = few_spectra(values, _PATCH_TOLERANCE)
    samples = np.zeros((len(basis), *shape), np.float32)
    for patch, (r, c) in zip(weights, corners, strict=False):
        samples[:, r : r + PATCH, c : c + PATCH] = patch[:, None, None]
    error = float(np.linalg.norm(values - weights @ basis) / np.linalg.norm(values)) if values.any() else 0.0
    return Chart(
        samples,
        name,
        grid,
        basis,
        patch_regions(titles, corners),
        patches=True,
        patch_reflectance=values.mean(axis=0)[None],
        relative_error=error,
    )


def _checked(reflectance: ArrayLike, grid: NDArray[np.float64], rows: int, cols: int) -> NDArray[np.float64]:
    values = np.asarray(reflectance, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != grid.size or len(values) == 0:
        expected = f"(patches, wavelengths), with {grid.size} wavelengths"
        raise InputError("reflectance", value=values.shape, expected=expected)
    if rows < 1 or cols < 1 or len(values) > rows * cols:
        raise InputError(f"{len(values)} patches do not fit on {rows} rows of {cols}")
    wrong = ~np.isfinite(values) | (values < 0)
    if wrong.any():
        patch, band = np.argwhere(wrong)[0]
        where = f"patch {patch + 1} at {grid[band]:g} nm"
        raise InputError("reflectance", where=where, value=values[patch, band], expected="0 or more")
    return values


def _titles(names: Sequence[str] | None, count: int) -> list[str]:
    if names is None:
        return [str(number + 1) for number in range(count)]
    if len(names) != count:
        raise InputError("names", value=len(names), expected=f"one for each of {count} patches")
    if twice := {name for name in names if list(names).count(name) > 1}:
        raise InputError("names", value=min(twice), expected="different for each patch")
    return list(names)


@lit()
def hdr_patches(
    *, decades: Annotated[float, Field(ge=0.1, le=12)] = 6.0, patches: Annotated[int, Field(ge=2, le=400)] = 36
) -> Chart:
    """Transparent gray patches over many decades of radiance, with black between them.

    Parameters
    ----------
    decades
        Of radiance, from the darkest patch to the brightest: 6 is 1 : 1 000 000, 20 stops.
    patches
        Steps, from 2 to 400, in equal factors. They alternate in direction from row to row, brightest first, so that
        neighbors are alike and the darkest is far from the brightest's stray light. The luminance is the mean of the
        patches; the brightest one is several times that.

    Returns
    -------
    Chart
        A region for each patch, named by its density, the decimal logarithm of the brightest's radiance over its own:
        "density 0.00" to "density 6.00".

    Notes
    -----
    After the transparent charts of ISO 14524 and ISO 15739, whose densities are in steps; not a copy of one.

    Examples
    --------
    >>> chart = hdr_patches(decades=6, patches=4)
    >>> [region.name for region in chart.regions]
    ['density 0.00', 'density 2.00', 'density 4.00', 'density 6.00']
    """
    cols = math.ceil(math.sqrt(1.5 * patches))
    shape, corners = patch_grid(math.ceil(patches / cols), cols)
    in_rows = [corners[first : first + cols] for first in range(0, len(corners), cols)]
    order = [corner for number, row in enumerate(in_rows) for corner in (row[::-1] if number % 2 else row)][:patches]
    density = decades * np.arange(patches) / (patches - 1)
    levels = 10.0**-density
    pattern = np.zeros(shape)
    for level, (r, c) in zip(levels, order, strict=True):
        pattern[r : r + PATCH, c : c + PATCH] = level
    digits = max(2, math.ceil(-math.log10(decades / (patches - 1))) + 1)  # that distinguish neighbors
    names = [f"density {step:.{digits}f}" for step in density]
    return gray_chart(
        pattern,
        f"{patches} grays over {decades:g} decades",
        regions=patch_regions(names, order),
        patches=True,
        luminance_factor=float(pattern.mean() / levels.mean()),
        transmissive=True,
    )
