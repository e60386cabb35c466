"""Test charts as scenes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.cie import colour_science
from photosite.errors import InputError
from photosite.regions import Region
from photosite.scene.placement import place
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene, labelled
from photosite.spectra import (
    DEFAULT_WAVELENGTH_NM,
    Rule,
    Spectrum,
    photons_from_energy,
    wavelength_grid,
)
from photosite.spectra import illuminant as relative_energy

MACBETH_NAMES: tuple[str, ...] = (
    "dark skin",
    "light skin",
    "blue sky",
    "foliage",
    "blue flower",
    "bluish green",
    "orange",
    "purplish blue",
    "moderate red",
    "purple",
    "yellow green",
    "orange yellow",
    "blue",
    "green",
    "red",
    "yellow",
    "magenta",
    "cyan",
    "white",
    "neutral 8",
    "neutral 6.5",
    "neutral 5",
    "neutral 3.5",
    "black",
)
"""The ColorChecker's patches, along the rows from the top left."""

# Geometry in samples: patches of 28 with 4 of black round them, on a 4 x 6 grid; 132 x 196 samples, nearly 3 : 2.
_PATCH, _GAP = 28, 4
_SHAPE = (4 * (_PATCH + _GAP) + _GAP, 6 * (_PATCH + _GAP) + _GAP)
_INSET = 4
"""Samples left out on each side of a patch's region, so that blur at its edges stays outside."""


def _corners() -> list[tuple[int, int]]:
    """First row and column of each patch."""
    return [(_GAP + (_PATCH + _GAP) * r, _GAP + (_PATCH + _GAP) * c) for r in range(4) for c in range(6)]


def _regions() -> tuple[Region, ...]:
    inner = _PATCH - _INSET
    return tuple(
        Region(name, r + _INSET, r + inner, c + _INSET, c + inner)
        for name, (r, c) in zip(MACBETH_NAMES, _corners(), strict=True)
    )


@lru_cache(maxsize=1)
def _macbeth_table() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    chart = colour_science().SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    patches = list(chart.values())
    return np.asarray(patches[0].wavelengths, np.float64), np.array([p.values for p in patches], np.float64)


def macbeth_reflectance(wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> NDArray[np.float64]:
    """(24, wavelengths) reflectance of the ColorChecker's patches, along the rows; linear between 5 nm entries.

    Raises
    ------
    InputError
        If a wavelength lies outside 380 to 780 nm.

    Notes
    -----
    Source: N. Ohta (1997), as tabulated in colour-science.

    Examples
    --------
    >>> white = macbeth_reflectance()[MACBETH_NAMES.index("white")]
    >>> bool(white[5:].min() > 0.8)
    True
    """
    grid = wavelength_grid(wavelength_nm)
    table, values = _macbeth_table()
    if grid[0] < table[0] or grid[-1] > table[-1]:
        raise InputError(
            f"the ColorChecker's reflectance is known from {table[0]:g} to {table[-1]:g} nm, "
            f"not from {grid[0]:g} to {grid[-1]:g} nm"
        )
    return np.stack([np.interp(grid, table, row) for row in values])


def _title(light: str | float | Spectrum) -> str:
    return "as given" if isinstance(light, Spectrum) else f"{light}"


def macbeth(
    illuminant: str | float | Spectrum = "A",
    mean_luminance_cd_m2: float = 40.0,
    *,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """The 24-patch ColorChecker, evenly lit, patches parted by black.

    Parameters
    ----------
    illuminant
        As for `photosite.spectra.illuminant`; "A" is the paper's tungsten light.
    mean_luminance_cd_m2
        Mean luminance of the 24 patches (of the patches, not of the black between them).
    wavelength_nm
        (wavelengths,) of the scene.
    distance_m
        From the lens to the chart.
    width_m
        Width of the chart with its border; None fills the sensor.
    rule
        Integration rule of the luminance.

    Returns
    -------
    Scene
        132 x 196 samples, 24 regions named as `MACBETH_NAMES`.

    Raises
    ------
    InputError
        If the illuminant is unknown, or a wavelength lies outside 380 to 780 nm.

    Examples
    --------
    >>> chart = macbeth("D65", 100)
    >>> chart.shape, len(chart.regions), chart.regions[18].name
    ((132, 196), 24, 'white')
    """
    grid = wavelength_grid(wavelength_nm)
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    reflectance = macbeth_reflectance(grid)
    spectra = reflectance * light
    labels = np.full(_SHAPE, -1, dtype=np.intp)
    for patch, (r, c) in enumerate(_corners()):
        labels[r : r + _PATCH, c : c + _PATCH] = patch
    chart = labelled(
        labels,
        spectra,
        grid,
        distance_m=distance_m,
        width_m=width_m,
        regions=_regions(),
        name=f"ColorChecker, illuminant {_title(illuminant)}",
        reflectance=reflectance,
    )
    # The patches have equal areas, so their mean luminance is that of the mean spectrum.
    patches = Scene.uniform(spectra.mean(axis=0), grid).mean_luminance_cd_m2(rule)
    if not (np.isfinite(mean_luminance_cd_m2) and mean_luminance_cd_m2 >= 0):
        raise InputError(f"a mean luminance is 0 cd/m2 or more, not {mean_luminance_cd_m2}")
    return chart.scaled(mean_luminance_cd_m2 / patches)


def uniform(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    rule: Rule = "trapezoid",
) -> Scene:
    """A field of one light, of a given luminance.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, rule
        As for `macbeth`.

    Raises
    ------
    InputError
        If the illuminant is unknown or does not reach all the wavelengths.

    Examples
    --------
    >>> round(uniform("A", 12.5).mean_luminance_cd_m2(), 6)
    12.5
    """
    grid = wavelength_grid(wavelength_nm)
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    field = Scene.uniform(light, grid, distance_m, name=f"uniform field, illuminant {_title(illuminant)}")
    field = replace(field, reflectance=np.ones_like(field.basis))
    return field.with_mean_luminance(mean_luminance_cd_m2, rule)


def slanted_edge(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    angle_deg: float = 5.0,
    contrast: float = 4.0,
    rows: int = 400,
    cols: int = 400,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """A straight edge, dark on the left and bright on the right, leaning clockwise by an angle (ISO 12233).

    Each sample holds the exact share of its area on the bright side.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `macbeth`; the mean luminance is that of the whole field.
    angle_deg
        From the vertical, above -45 and below 45 degrees.
    contrast
        Radiance of the bright side over that of the dark side, above 1; `math.inf` for a black side. 4 is ISO 12233's.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the angle or contrast cannot be.

    Examples
    --------
    >>> edge = slanted_edge(rows=40, cols=60, contrast=10)
    >>> edge.shape, round(float(edge.weights.max() / edge.weights.min()), 4)
    ((40, 60), 10.0)
    """
    if not abs(angle_deg) < 45:
        raise InputError(f"the edge leans by less than 45 degrees from the vertical, not {angle_deg}")
    if not contrast > 1:
        raise InputError(f"the edge's contrast is above 1, not {contrast}")
    field = uniform(illuminant, mean_luminance_cd_m2, wavelength_nm=wavelength_nm, distance_m=distance_m, rule=rule)
    slope = math.tan(math.radians(angle_deg))
    # Signed distance (along the row, in samples) of the edge from each sample's left border, at its centre row.
    edge_at = cols / 2 - slope * (np.arange(rows, dtype=np.float64) + 0.5 - rows / 2)
    offset = edge_at[:, None] - np.arange(cols)[None, :]
    bright = 1.0 - _area_left_of_edge(offset, abs(slope))
    dark = 0.0 if math.isinf(contrast) else 1.0 / contrast
    weights = dark + (1.0 - dark) * bright
    edge = replace(
        field,
        weights=weights[None].astype(np.float32),
        width_m=width_m,
        name=f"slanted edge, {angle_deg:g} degrees, contrast {contrast:g} : 1",
    )
    return edge.with_mean_luminance(mean_luminance_cd_m2, rule)


def _area_left_of_edge(offset: NDArray[np.float64], slope: float) -> NDArray[np.float64]:
    """Share of a unit square left of a line that crosses its centre row at `offset` and drifts by `slope` per row.

    The mean over the square's height of clip(offset + slope s, 0, 1), s in -1/2 .. 1/2: the integral of a ramp.
    """

    def integral(x: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = np.clip(x, 0.0, 1.0)
        return inside**2 / 2 + np.maximum(x - 1.0, 0.0)

    if slope == 0.0:
        return np.clip(offset, 0.0, 1.0)
    return (integral(offset + slope / 2) - integral(offset - slope / 2)) / slope


def macbeth_regions(rows: int, cols: int) -> tuple[Region, ...]:
    """Where the 24 patches of a ColorChecker that fills a frame lie, as `macbeth` fills it.

    Parameters
    ----------
    rows, cols
        Size of the frame in pixels.

    Raises
    ------
    InputError
        If the frame is too small to hold the patches.

    Examples
    --------
    >>> macbeth_regions(1296, 1936)[0].name
    'dark skin'
    """
    return place(_SHAPE, (rows, cols)).regions(_regions())
