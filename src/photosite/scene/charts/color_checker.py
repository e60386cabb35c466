"""The ColorChecker Classic, of measured reflectances, and the ColorChecker SG, of published colors."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import color_matching_functions
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, integration_weights, wavelength_grid
from photosite.color.tables import rows, spectra
from photosite.errors import InputError
from photosite.scene.charts.chart import Chart, lit
from photosite.scene.charts.patches import PATCH, patch_grid, patch_regions, reflectance_chart
from photosite.scene.placement import place
from photosite.scene.sigmoid import sigmoid_coefficients, sigmoid_reflectance
from photosite.values.choice import check_choice
from photosite.values.region import Region

MACBETH_NAMES: tuple[str, ...] = (
    *("dark skin", "light skin", "blue sky", "foliage", "blue flower", "bluish green"),
    *("orange", "purplish blue", "moderate red", "purple", "yellow green", "orange yellow"),
    *("blue", "green", "red", "yellow", "magenta", "cyan"),
    *("white", "neutral 8", "neutral 6.5", "neutral 5", "neutral 3.5", "black"),
)
"""The ColorChecker's patches, along the rows from the top left."""

SG_NAMES: tuple[str, ...] = tuple(f"{letter}{number}" for number in range(1, 11) for letter in "ABCDEFGHIJKLMN")
"""The ColorChecker SG's patches, along the rows from the top left: A1 to N1, A2 to N2 and so on."""

Edition = Literal["after 2014", "before 2014"]

_ROWS, _COLS = 4, 6
_SHAPE, _CORNERS = patch_grid(_ROWS, _COLS)
_FIELD = _CORNERS[-1][0] + PATCH - _CORNERS[0][0], _CORNERS[-1][1] + PATCH - _CORNERS[0][1]
"""132 x 196 samples, nearly 3 : 2."""

_TABLES: dict[str, str] = {"after 2014": "color_checker_sg_after_2014", "before 2014": "color_checker_sg_before_2014"}
_SG_WAVELENGTH_NM = np.arange(380.0, 781.0, 5.0)


def _check_range(name: str, grid: NDArray[np.float64], table: NDArray[np.float64]) -> None:
    if grid[0] < table[0] or grid[-1] > table[-1]:
        expected = f"within {table[0]:g} to {table[-1]:g} nm for the {name}"
        raise InputError("wavelength_nm", value=(float(grid[0]), float(grid[-1])), expected=expected)


def macbeth_reflectance(wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> NDArray[np.float64]:
    """Return the reflectance (24, wavelengths) of the ColorChecker's patches, along the rows.

    Linear between the 5 nm entries of the table.

    Raises
    ------
    InputError
        If a wavelength is outside 380 to 780 nm.

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
    patches = list(spectra("color_checker").values())
    _check_range("ColorChecker", grid, patches[0].wavelength_nm)
    return np.stack([patch.at(grid) for patch in patches])


@lit("A")
def macbeth(*, wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> Chart:
    """ColorChecker Classic: 24 patches with black between them, by default under the 2008 paper's tungsten light.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,) of the scene, from 380 to 780 nm.

    Returns
    -------
    Chart
        132 x 196 samples, 24 regions named as `MACBETH_NAMES`.

    Examples
    --------
    >>> chart = macbeth("D65", 100)
    >>> chart.shape, len(chart.regions), chart.regions[18].name
    ((132, 196), 24, 'white')
    """
    reflectance = macbeth_reflectance(wavelength_nm)
    weights = np.zeros((len(reflectance), *_SHAPE), np.float32)
    for patch, (r, c) in enumerate(_CORNERS):
        weights[patch, r : r + PATCH, c : c + PATCH] = 1.0
    regions = patch_regions(MACBETH_NAMES, _CORNERS)
    grid = wavelength_grid(wavelength_nm)
    return Chart(weights, "ColorChecker", grid, reflectance, regions, patches=True, patch_reflectance=reflectance)


def macbeth_regions(rows: int, cols: int) -> tuple[Region, ...]:
    """Return the regions of the 24 patches in a frame of (rows, cols) pixels that a ColorChecker fills.

    Raises
    ------
    InputError
        If the frame is too small to hold the patches.

    Examples
    --------
    >>> macbeth_regions(1296, 1936)[0].name
    'dark skin'
    """
    return place(_SHAPE, (rows, cols), content=_FIELD).regions(patch_regions(MACBETH_NAMES, _CORNERS))


def color_checker_sg_reflectance(
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM, edition: Edition = "after 2014"
) -> NDArray[np.float64]:
    """Return smooth reflectances (140, wavelengths) with the ColorChecker SG's published colors under D50.

    Under another light their colors are those of smooth spectra, not of the chart's pigments. For these, measure a
    chart (`photosite.scene.charts.reflectance_chart`).

    Parameters
    ----------
    wavelength_nm
        (wavelengths,) from 380 to 780 nm.
    edition
        Of the chart: its pigments changed in November 2014.

    Raises
    ------
    InputError
        If the edition is unknown, or a wavelength is outside 380 to 780 nm.

    Notes
    -----
    Colors: X-Rite, CIE L*a*b* under D50, 2 degrees, as tabulated in colour-science, converted by
    `photosite.scene.sigmoid`. Integrated again on a grid of 5 nm they differ by a CIEDE2000 below 0.01.

    Examples
    --------
    >>> values = color_checker_sg_reflectance()
    >>> values.shape, bool(values.min() > 0), bool(values.max() < 1)
    ((140, 41), True, True)
    """
    grid = wavelength_grid(wavelength_nm)
    check_choice("edition", edition, Edition)
    _check_range("ColorChecker SG", grid, _SG_WAVELENGTH_NM)
    return sigmoid_reflectance(_sg_coefficients(edition), grid)


@lru_cache(maxsize=2)
def _sg_coefficients(edition: str) -> NDArray[np.float64]:
    table = rows(_TABLES[edition])
    x, y, luminance = np.stack([table[name] for name in SG_NAMES], axis=1)
    tristimulus = np.stack([x * (luminance / y), luminance, (1 - (x + y)) * (luminance / y)], axis=1)
    light = relative_energy("D50", _SG_WAVELENGTH_NM)
    weights = color_matching_functions(_SG_WAVELENGTH_NM) * integration_weights(_SG_WAVELENGTH_NM) * light
    return sigmoid_coefficients(tristimulus, weights / weights[1].sum(), _SG_WAVELENGTH_NM)


@lit("A")
def color_checker_sg(*, edition: Edition = "after 2014", wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM) -> Chart:
    """ColorChecker SG: 140 patches of smooth reflectances from published colors, with black between them.

    Parameters
    ----------
    edition, wavelength_nm
        As for `color_checker_sg_reflectance`, which says how far these reflectances can be trusted.

    Returns
    -------
    Chart
        324 x 452 samples, 140 regions named as `SG_NAMES`.

    Examples
    --------
    >>> chart = color_checker_sg("D50", 100)
    >>> chart.shape, chart.regions[14].name
    ((324, 452), 'A2')
    """
    return reflectance_chart(
        color_checker_sg_reflectance(wavelength_nm, edition),
        wavelength_nm,
        rows=10,
        cols=14,
        names=SG_NAMES,
        name="ColorChecker SG raised from its colors under D50",
    )
