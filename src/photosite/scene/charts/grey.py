"""Patterns of grey under one light: from relative reflectances to a scene of a given luminance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.illuminants import illuminant as relative_energy
from photosite.color.spectrum import Rule, Spectrum, photons_from_energy, wavelength_grid
from photosite.errors import InputError
from photosite.scene.scene import Scene, light_title
from photosite.values.region import Region

_MOST_SAMPLES = 1 << 28


def grey_scene(
    pattern: NDArray[np.floating],
    illuminant: str | float | Spectrum,
    mean_luminance_cd_m2: float,
    *,
    wavelength_nm: ArrayLike,
    distance_m: float,
    width_m: float | None,
    rule: Rule,
    name: str,
    regions: Sequence[Region] = (),
) -> Scene:
    """A scene of greys, (rows, cols) reflectances from 0 to 1 that know no wavelength, of a mean luminance."""
    grid = wavelength_grid(wavelength_nm)
    light = photons_from_energy(relative_energy(illuminant, grid), grid)
    scene = Scene(
        pattern[None].astype(np.float32, copy=False),
        light[None],
        grid,
        distance_m,
        width_m,
        tuple(regions),
        f"{name}, illuminant {light_title(illuminant)}",
        np.ones((1, grid.size)),
    )
    return scene.with_mean_luminance(mean_luminance_cd_m2, rule)


def dark_share(contrast: float) -> float:
    """Reflectance of the dark over that of the bright.

    Raises
    ------
    InputError
        If the contrast is not above 1.
    """
    if not contrast > 1:
        raise InputError(f"a pattern's contrast, bright over dark, is above 1, not {contrast}")
    return 0.0 if math.isinf(contrast) else 1.0 / contrast


def between(share: NDArray[np.float64], contrast: float) -> NDArray[np.float64]:
    """Reflectances from shares of bright, 0 to 1: dark is 1 / contrast and bright is 1."""
    dark = dark_share(contrast)
    return dark + (1.0 - dark) * share


def check_size(rows: int, cols: int) -> None:
    """Refuse a number of samples that cannot be.

    Raises
    ------
    InputError
        If it is below 1, no whole number, or more than memory is likely to hold.
    """
    for name, value in (("rows", rows), ("cols", cols)):
        if not isinstance(value, int | np.integer) or value < 1:
            raise InputError(f"a pattern's {name} are a whole number of samples from 1 on, not {value}")
    if rows * cols > _MOST_SAMPLES:
        raise InputError(f"{rows} x {cols} samples are more than {_MOST_SAMPLES}; ask for fewer rows or cols")


def check_range(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Refuse a number outside its range, both ends of which are allowed.

    Raises
    ------
    InputError
        If it lies outside, or is no number.
    """
    if not low <= value <= high:
        upto = f"from {low:g} to {high:g}" if math.isfinite(high) else f"{low:g} or more"
        raise InputError(f"{name} is {upto}{' ' + unit if unit else ''}, not {value}")
