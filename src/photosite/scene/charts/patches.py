"""Charts of patches: any reflectances, and greys over many decades."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.color.tristimulus import luminance_cd_m2
from photosite.errors import InputError
from photosite.scene.charts.grey import check_range, grey_scene
from photosite.scene.reduction import few_spectra
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene, light_title
from photosite.values.region import Region

# Geometry in samples, the ColorChecker's: patches of 28 with 4 of black round them.
PATCH, _GAP, _INSET = 28, 4, 4

_PATCH_TOLERANCE = 1e-5
"""RMS that a chart's few basis spectra leave out of its reflectances, in parts of theirs."""


def patch_grid(rows: int, cols: int) -> tuple[tuple[int, int], list[tuple[int, int]]]:
    """Shape of a chart in samples, and first row and column of each of its patches, along the rows."""
    corners = [(_GAP + (PATCH + _GAP) * r, _GAP + (PATCH + _GAP) * c) for r in range(rows) for c in range(cols)]
    return (rows * (PATCH + _GAP) + _GAP, cols * (PATCH + _GAP) + _GAP), corners


def patch_regions(names: Sequence[str], corners: Sequence[tuple[int, int]]) -> tuple[Region, ...]:
    """The insides of the patches, so that blur at their borders stays outside."""
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
    illuminant: str | float | Spectrum = "A",
    mean_luminance_cd_m2: float = 40.0,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
    name: str = "chart",
) -> Scene:
    """Patches of any reflectances, evenly lit, parted by black.

    Parameters
    ----------
    reflectance
        (patches, wavelengths), along the rows of the chart from the top left; places left over stay black. Above 1 for
        patches that fluoresce or shine.
    wavelength_nm
        (wavelengths,), and the scene's.
    rows, cols
        Patches down and across.
    names
        Of the patches, all different; None numbers them from 1.
    illuminant
        As for `photosite.color.illuminants.illuminant`.
    mean_luminance_cd_m2
        Mean luminance of the patches (of the patches, not of the black between them).
    distance_m
        From the lens to the chart.
    width_m
        Width of the chart with its border; None fills the sensor.
    rule
        Integration rule of the luminance.
    name
        What to call it.

    Returns
    -------
    Scene
        (32 rows + 4, 32 cols + 4) samples, a region for each patch. Its basis is the fewest spectra that make all
        reflectances to an RMS of 1e-5 of theirs.

    Raises
    ------
    InputError
        If shapes do not fit, a reflectance is negative or not finite, all are 0, or two patches have one name.

    Examples
    --------
    >>> grid = np.arange(400.0, 701.0, 10)
    >>> greys = np.array([0.1, 0.2, 0.4, 0.8])[:, None] * np.ones(grid.size)
    >>> chart = reflectance_chart(greys, grid, rows=2, cols=2, names=["a", "b", "c", "d"])
    >>> chart.shape, chart.weights.shape[0], [region.name for region in chart.regions]
    ((68, 68), 1, ['a', 'b', 'c', 'd'])
    """
    grid = wavelength_grid(wavelength_nm)
    values = _checked(reflectance, grid, rows, cols)
    titles = _titles(names, len(values))
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    shape, corners = patch_grid(rows, cols)
    weights, basis = few_spectra(values, _PATCH_TOLERANCE)
    samples = np.zeros((len(basis), *shape), np.float32)
    for patch, (r, c) in zip(weights, corners, strict=False):
        samples[:, r : r + PATCH, c : c + PATCH] = patch[:, None, None]
    chart = Scene(
        samples,
        basis * light,
        grid,
        distance_m,
        width_m,
        patch_regions(titles, corners),
        f"{name}, illuminant {light_title(illuminant)}",
        basis,
        float(np.linalg.norm(values - weights @ basis) / np.linalg.norm(values)) if values.any() else 0.0,
        patches=True,
    )
    # The patches have equal areas, so their mean luminance is that of the mean spectrum.
    mean = float(luminance_cd_m2(values.mean(axis=0) * light, grid, rule))
    if mean <= 0:
        raise InputError(f"'{name}' reflects no light that the eye sees, so it cannot be given a luminance")
    check_range("a mean luminance", mean_luminance_cd_m2, 0.0, math.inf, "cd/m2")
    return chart.scaled(mean_luminance_cd_m2 / mean)


def _checked(reflectance: ArrayLike, grid: NDArray[np.float64], rows: int, cols: int) -> NDArray[np.float64]:
    values = np.asarray(reflectance, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != grid.size or len(values) == 0:
        raise InputError(
            f"a chart's reflectances are (patches, wavelengths), with {grid.size} wavelengths, not {values.shape}"
        )
    if rows < 1 or cols < 1 or len(values) > rows * cols:
        raise InputError(f"{len(values)} patches do not fit on {rows} rows of {cols}")
    wrong = ~np.isfinite(values) | (values < 0)
    if wrong.any():
        patch, band = np.argwhere(wrong)[0]
        raise InputError(
            f"a reflectance is 0 or more: patch {patch + 1} has {values[patch, band]} at {grid[band]:g} nm"
        )
    return values


def _titles(names: Sequence[str] | None, count: int) -> list[str]:
    if names is None:
        return [str(number + 1) for number in range(count)]
    if len(names) != count:
        raise InputError(f"{len(names)} names for {count} patches")
    if twice := {name for name in names if list(names).count(name) > 1}:
        raise InputError(f"two patches are called '{min(twice)}'; give each a name of its own")
    return list(names)


def hdr_patches(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    decades: float = 6.0,
    patches: int = 36,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Grey patches in equal factors of radiance over many decades, parted by black: a chart shone through.

    Parameters
    ----------
    illuminant, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`.
    mean_luminance_cd_m2
        Mean luminance of the patches; the brightest one is several times that.
    decades
        Of radiance, from the darkest patch to the brightest: 6 is 1 : 1 000 000, 20 stops.
    patches
        Steps, from 2 to 400. They snake along the rows, brightest first, so that neighbours are alike and stray light
        from the brightest falls on the darkest last.

    Returns
    -------
    Scene
        A region for each patch, named by its density, the decimal logarithm of how much darker it is than the
        brightest: "density 0.00" to "density 6.00".

    Raises
    ------
    InputError
        If the decades or the number of patches cannot be.

    Notes
    -----
    After the transparent charts of ISO 14524 and ISO 15739, which stand at densities in steps; not a copy of one.

    Examples
    --------
    >>> chart = hdr_patches(decades=6, patches=4)
    >>> [region.name for region in chart.regions]
    ['density 0.00', 'density 2.00', 'density 4.00', 'density 6.00']
    """
    check_range("the decades of a chart", decades, 0.1, 12.0)
    if not isinstance(patches, int | np.integer) or not 2 <= patches <= 400:
        raise InputError(f"a chart of greys has a whole number of patches from 2 to 400, not {patches}")
    cols = math.ceil(math.sqrt(1.5 * patches))
    rows = math.ceil(patches / cols)
    shape, corners = patch_grid(rows, cols)
    snake = [
        corners[row * cols + (col if row % 2 == 0 else cols - 1 - col)] for row in range(rows) for col in range(cols)
    ][:patches]
    density = decades * np.arange(patches) / (patches - 1)
    levels = 10.0**-density
    pattern = np.zeros(shape)
    for level, (r, c) in zip(levels, snake, strict=True):
        pattern[r : r + PATCH, c : c + PATCH] = level
    names = [f"density {step:.{_digits(decades, patches)}f}" for step in density]
    lit = float(pattern.mean() / levels.mean())  # the share of the chart that its patches are
    chart = grey_scene(
        pattern,
        illuminant,
        mean_luminance_cd_m2 * lit,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"{patches} greys over {decades:g} decades",
        regions=patch_regions(names, snake),
    )
    return replace(chart, patches=True)


def _digits(decades: float, patches: int) -> int:
    """Digits that tell the densities of neighbours apart."""
    return max(2, math.ceil(-math.log10(decades / (patches - 1))) + 1)
