"""The ColorChecker SG: 140 patches of published colour, raised to reflectances."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colour_science import colour_science
from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum, integration_weights, wavelength_grid
from photosite.color.tristimulus import color_matching_functions
from photosite.errors import InputError, did_you_mean
from photosite.scene.charts.patches import reflectance_chart
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.sigmoid import sigmoid_coefficients, sigmoid_reflectance

Edition = Literal["after 2014", "before 2014"]

_TABLES: dict[str, str] = {
    "after 2014": "ColorCheckerSG - After November 2014",
    "before 2014": "ColorCheckerSG - Before November 2014",
}
SG_NAMES: tuple[str, ...] = tuple(f"{letter}{number}" for number in range(1, 11) for letter in "ABCDEFGHIJKLMN")
"""The ColorChecker SG's patches, along the rows from the top left: A1 to N1, A2 to N2 and so on."""

_RAISED_NM = np.arange(380.0, 781.0, 5.0)


def color_checker_sg_reflectance(
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM, edition: Edition = "after 2014"
) -> NDArray[np.float64]:
    """(140, wavelengths) smooth reflectances that have the ColorChecker SG's published colours under D50.

    Their colours under D50 are the chart's; what they are under another light is what a smooth spectrum does, not what
    the chart's pigments do. For that measure a chart (`photosite.scene.charts.reflectance_chart`).

    Parameters
    ----------
    wavelength_nm
        (wavelengths,) from 380 to 780 nm.
    edition
        Of the chart: its pigments changed in November 2014.

    Raises
    ------
    InputError
        If the edition is unknown, or a wavelength lies outside 380 to 780 nm.

    Notes
    -----
    Colours: X-Rite, CIE L*a*b* under D50, 2 degrees, as tabulated in colour-science. Raised as
    `photosite.scene.sigmoid` says; integrated again on a grid of 5 nm they differ by a CIEDE2000 below 0.01.

    Examples
    --------
    >>> values = color_checker_sg_reflectance()
    >>> values.shape, bool(values.min() > 0), bool(values.max() < 1)
    ((140, 41), True, True)
    """
    grid = wavelength_grid(wavelength_nm)
    if edition not in get_args(Edition):
        raise InputError(f"no edition '{edition}'; {did_you_mean(str(edition), get_args(Edition))}")
    if grid[0] < _RAISED_NM[0] or grid[-1] > _RAISED_NM[-1]:
        raise InputError(
            f"the ColorChecker SG's reflectance is known from {_RAISED_NM[0]:g} to {_RAISED_NM[-1]:g} nm, "
            f"not from {grid[0]:g} to {grid[-1]:g} nm"
        )
    return sigmoid_reflectance(_coefficients(edition), grid)


@lru_cache(maxsize=2)
def _coefficients(edition: str) -> NDArray[np.float64]:
    colour = colour_science()
    table = colour.CCS_COLOURCHECKERS[_TABLES[edition]].data
    tristimulus = np.stack([colour.xyY_to_XYZ(table[name]) for name in SG_NAMES])
    light = relative_energy("D50", _RAISED_NM)
    weights = color_matching_functions(_RAISED_NM) * integration_weights(_RAISED_NM) * light
    return sigmoid_coefficients(tristimulus, weights / weights[1].sum(), _RAISED_NM)


def color_checker_sg(
    illuminant: str | float | Spectrum = "A",
    mean_luminance_cd_m2: float = 40.0,
    *,
    edition: Edition = "after 2014",
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """The 140-patch ColorChecker SG, evenly lit, patches parted by black; reflectances raised from its colours.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`.
    edition
        As for `color_checker_sg_reflectance`, which says what these reflectances are worth.

    Returns
    -------
    Scene
        324 x 452 samples, 140 regions named as `SG_NAMES`.

    Raises
    ------
    InputError
        If the edition or illuminant is unknown, or a wavelength lies outside 380 to 780 nm.

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
        illuminant=illuminant,
        mean_luminance_cd_m2=mean_luminance_cd_m2,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name="ColorChecker SG raised from its colours under D50",
    )
