"""Slanted edges: one, and a star of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum
from photosite.errors import InputError
from photosite.scene.charts import coverage
from photosite.scene.charts.grey import between, check_size, grey_scene
from photosite.scene.charts.sectors import sector_share
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene

_STRIP = 256


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
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
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
    check_size(rows, cols)
    if not abs(angle_deg) < 45:
        raise InputError(f"the edge leans by less than 45 degrees from the vertical, not {angle_deg}")
    slope = math.tan(math.radians(angle_deg))
    # Signed distance (along the row, in samples) of the edge from each sample's left border, at its centre row.
    edge_at = cols / 2 - slope * (np.arange(rows, dtype=np.float64) + 0.5 - rows / 2)
    bright = np.empty((rows, cols), np.float32)
    for first in range(0, rows, _STRIP):  # in double precision a whole frame of cells would be large
        offset = edge_at[first : first + _STRIP, None] - np.arange(cols)[None, :]
        bright[first : first + _STRIP] = between(1.0 - coverage.left_of_line(offset, abs(slope)), contrast)
    return grey_scene(
        bright,
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"slanted edge, {angle_deg:g} degrees, contrast {contrast:g} : 1",
    )


def edge_star(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    cycles: int = 4,
    angle_deg: float = 5.0,
    contrast: float = 4.0,
    rows: int = 400,
    cols: int = 400,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Edges in many directions through one centre: sectors, bright and dark by turns (ISO 12233's slanted star).

    Four cycles turned by 5 degrees have edges 5 degrees from the vertical, the horizontal and both diagonals.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    cycles
        Bright sectors, and as many dark ones, from 1 to 32; see `siemens_star` for more.
    angle_deg
        By which the star is turned clockwise; at 0 an edge stands upright and the sector right of its top is bright.
    contrast
        Radiance of bright over that of dark, above 1; `math.inf` for black. 4 is ISO 12233's.
    rows, cols
        Samples.

    Raises
    ------
    InputError
        If the cycles, angle or contrast cannot be.

    Notes
    -----
    A sample's share is the mean of 16 lines across it, on each of which it is exact: off by up to 5e-4 where an edge
    cuts a sample's corner (`photosite.scene.charts.sectors`).

    Examples
    --------
    >>> star = edge_star(contrast=float("inf"), angle_deg=0, cycles=2, rows=4, cols=4)   # four quadrants
    >>> star.weights[0, 0].tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    check_size(rows, cols)
    if not isinstance(cycles, int | np.integer) or not 1 <= cycles <= 32:
        raise InputError(f"an edge star has a whole number of cycles from 1 to 32, not {cycles}")
    if not math.isfinite(angle_deg):
        raise InputError(f"a star's angle is a number of degrees, not {angle_deg}")
    return grey_scene(
        between(sector_share(rows, cols, int(cycles), angle_deg), contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"star of {2 * cycles} edges, turned by {angle_deg:g} degrees, contrast {contrast:g} : 1",
    )
