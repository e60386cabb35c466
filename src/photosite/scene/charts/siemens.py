"""The Siemens star: every spatial frequency in every direction, rising towards the centre."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import DEFAULT_WAVELENGTH_NM, Rule, Spectrum
from photosite.errors import InputError, did_you_mean
from photosite.scene.charts import coverage
from photosite.scene.charts.grey import between, check_size, grey_scene
from photosite.scene.charts.sectors import sector_share
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.values import check_flag
from photosite.values.region import Region

Waveform = Literal["sine", "square"]

_RADIUS = 0.45
"""Of the star, in parts of the field's smaller side."""

_PATCH = 0.07
"""Side of a grey patch in the corners, in the same parts: a block of two by two stays clear of the star."""

_LEVELS = 16
_LEAST_SIDE = 96
"""Samples that the smaller side needs for grey patches of 6."""


def siemens_star(
    illuminant: str | float | Spectrum = "D65",
    mean_luminance_cd_m2: float = 40.0,
    *,
    cycles: int = 144,
    waveform: Waveform = "sine",
    contrast: float = math.inf,
    patches: bool = True,
    rows: int = 512,
    cols: int = 512,
    wavelength_nm: ArrayLike = DEFAULT_WAVELENGTH_NM,
    distance_m: float = DEFAULT_DISTANCE_M,
    width_m: float | None = None,
    rule: Rule = "trapezoid",
) -> Scene:
    """Spokes round one centre on grey (ISO 12233's s-SFR star); at r samples from it, cycles / (2 pi r) per sample.

    Parameters
    ----------
    illuminant, mean_luminance_cd_m2, wavelength_nm, distance_m, width_m, rule
        As for `photosite.scene.charts.macbeth`; the mean luminance is that of the whole field.
    cycles
        Round the circle, from 1 to 1024; 144 is ISO 12233's.
    waveform
        "sine", whose modulation a camera lowers and does not otherwise change, or "square".
    contrast
        Radiance of the brightest over that of the darkest, above 1; `math.inf` for full modulation. A sine of contrast
        c has the modulation (c - 1) / (c + 1).
    patches
        Sixteen greys in the corners, in equal steps from the star's darkest to its brightest, from which the camera's
        response can be straightened. They need 96 samples and more on the smaller side.
    rows, cols
        Samples. The star's radius is 0.45 of the smaller side; round it is the mean of bright and dark.

    Returns
    -------
    Scene
        A region for each grey patch, "grey 0" to "grey 15".

    Raises
    ------
    InputError
        If the cycles, waveform, contrast or size cannot be.

    Notes
    -----
    ISO 12233:2017, the sine-based star. A sine's mean over a sample is by Gauss-Legendre quadrature, with points as
    dense as its phase turns: off by less than 1e-9, and 1e-3 in the four samples at the centre, where a hundred cycles
    pass. A square wave's is off by less than 5e-4, as in `edge_star`.

    Examples
    --------
    >>> star = siemens_star(cycles=36, rows=128, cols=128)
    >>> len(star.regions), round(float(star.weights[0, 64, 2]), 6)   # beside the star
    (16, 0.5)
    """
    check_size(rows, cols)
    check_flag("patches", patches)
    if waveform not in get_args(Waveform):
        raise InputError(f"no waveform '{waveform}'; {did_you_mean(str(waveform), get_args(Waveform))}")
    if not isinstance(cycles, int | np.integer) or not 1 <= cycles <= 1024:
        raise InputError(f"a Siemens star has a whole number of cycles from 1 to 1024, not {cycles}")
    if patches and min(rows, cols) < _LEAST_SIDE:
        raise InputError(
            f"a star with grey patches needs {_LEAST_SIDE} rows and cols or more, not {rows} x {cols}; "
            "ask for patches=False"
        )
    spokes = _sine(rows, cols, int(cycles)) if waveform == "sine" else sector_share(rows, cols, int(cycles), 0.0)
    # A sample that the star's border cuts holds its share of spokes, taken as the mean of the whole sample's.
    inside = coverage.disc(rows, cols, rows / 2, cols / 2, _RADIUS * min(rows, cols))
    share = 0.5 + inside * (spokes - 0.5)
    regions = _add_greys(share) if patches else ()
    return grey_scene(
        between(share, contrast),
        illuminant,
        mean_luminance_cd_m2,
        wavelength_nm=wavelength_nm,
        distance_m=distance_m,
        width_m=width_m,
        rule=rule,
        name=f"Siemens star of {cycles} cycles, {waveform}",
        regions=regions,
    )


def _add_greys(share: NDArray[np.float64]) -> tuple[Region, ...]:
    """Paint the greys into the corners; where they lie, less a border for blur."""
    rows, cols = share.shape
    side = int(_PATCH * min(rows, cols))
    inset = max(1, side // 8)
    regions = []
    for level in range(_LEVELS):
        corner, place = divmod(level, 4)
        down = (place // 2) * side if corner < 2 else rows - 2 * side + (place // 2) * side
        along = (place % 2) * side if corner % 2 == 0 else cols - 2 * side + (place % 2) * side
        share[down : down + side, along : along + side] = level / (_LEVELS - 1)
        regions.append(Region(f"grey {level}", down + inset, down + side - inset, along + inset, along + side - inset))
    return tuple(regions)


def _sine(rows: int, cols: int, cycles: int) -> NDArray[np.float64]:
    """(rows, cols) means of 1/2 + 1/2 cos(cycles * angle): as many points a sample as its phase turns through need."""
    row = np.arange(rows) + 0.5 - rows / 2
    col = np.arange(cols) + 0.5 - cols / 2
    radius = np.hypot(row[:, None], col[None, :])
    turn = cycles / np.maximum(radius - math.sqrt(0.5), 1e-3)  # phase across a sample, rad, at its inner corner
    mean = np.empty((rows, cols))
    below = 0.0
    for order, most in ((4, 0.5), (6, 1.5), (10, 6.0), (16, 16.0), (48, 80.0), (128, math.inf)):
        here = np.nonzero((turn > below) & (turn <= most))
        below = most
        nodes, weights = np.polynomial.legendre.leggauss(order)
        total = np.zeros(here[0].size)
        for dy, weight_y in zip(nodes / 2, weights / 2, strict=True):
            for dx, weight_x in zip(nodes / 2, weights / 2, strict=True):
                angle = np.arctan2(col[here[1]] + dx, row[here[0]] + dy)
                total += weight_y * weight_x * np.cos(cycles * angle)
        mean[here] = 0.5 + 0.5 * total
    return mean
