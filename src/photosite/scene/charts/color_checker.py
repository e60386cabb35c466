"""The ColorChecker Classic: 24 patches of measured reflectance."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colour_science import colour_science
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.errors import InputError
from photosite.scene.charts.patches import PATCH, patch_grid, patch_regions
from photosite.scene.placement import place
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene, light_title
from photosite.values.region import Region

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

_ROWS, _COLS = 4, 6
_SHAPE, _CORNERS = patch_grid(_ROWS, _COLS)
"""132 x 196 samples, nearly 3 : 2."""


def _regions() -> tuple[Region, ...]:
    return patch_regions(MACBETH_NAMES, _CORNERS)


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
        As for `photosite.color.illuminants.illuminant`; "A" is the paper's tungsten light.
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
    weights = np.zeros((len(spectra), *_SHAPE), np.float32)
    for patch, (r, c) in enumerate(_CORNERS):
        weights[patch, r : r + PATCH, c : c + PATCH] = 1.0
    chart = Scene(
        weights,
        spectra,
        grid,
        distance_m,
        width_m,
        _regions(),
        f"ColorChecker, illuminant {light_title(illuminant)}",
        reflectance,
        patches=True,
    )
    # The patches have equal areas, so their mean luminance is that of the mean spectrum.
    patches = Scene.uniform(spectra.mean(axis=0), grid).mean_luminance_cd_m2(rule)
    if not (np.isfinite(mean_luminance_cd_m2) and mean_luminance_cd_m2 >= 0):
        raise InputError(f"a mean luminance is 0 cd/m2 or more, not {mean_luminance_cd_m2}")
    if not patches > 0:
        raise InputError("the illuminant has no light that the eye sees, so the chart cannot be given a luminance")
    return chart.scaled(mean_luminance_cd_m2 / patches)


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
