"""Charts that validation supports: the positions and colors of their patches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, did_you_mean
from photosite.values.region import Region
from photosite.values.validated import check_choice

Chart = Literal["macbeth"]


def chart_regions(chart: str, rows: int, cols: int) -> tuple[Region, ...]:
    """Return the patches of a chart that fills the frame; `InputError` if it is unknown or the frame too small.

    Examples
    --------
    >>> len(chart_regions("macbeth", 300, 450))
    24
    """
    from photosite.scene.charts import macbeth_regions

    check_choice("chart", chart, Chart)
    return macbeth_regions(rows, cols)


def chart_xyz_d65(chart: str, names: Sequence[str]) -> NDArray[np.float64]:
    """Return tristimulus values of some of a chart's patches under D65, with Y = 1 for the perfect white.

    Returns
    -------
    numpy.ndarray
        (patches, 3), CIE 1931 observer, from the reflectance spectra at 5 nm, trapezoidal rule.

    Raises
    ------
    InputError
        If the chart or a patch is unknown.

    Examples
    --------
    >>> chart_xyz_d65("macbeth", ["white", "neutral 5"])[:, 1].round(3)
    array([0.887, 0.203])
    """
    from photosite.color.illuminants import illuminant
    from photosite.color.spectrum import photons_from_energy
    from photosite.color.tristimulus import xyz
    from photosite.scene.charts import MACBETH_NAMES, macbeth_reflectance

    check_choice("chart", chart, Chart)
    if unknown := [name for name in names if name not in MACBETH_NAMES]:
        where, hint = f"chart '{chart}'", did_you_mean(unknown[0], MACBETH_NAMES)
        raise InputError("names", where=where, value=unknown[0], expected="names of its patches", hint=hint)
    grid = np.arange(380.0, 781.0, 5.0)
    light = photons_from_energy(illuminant("D65", grid), grid)
    chosen = macbeth_reflectance(grid)[[MACBETH_NAMES.index(name) for name in names]]
    return np.asarray(xyz(chosen * light, grid) / xyz(light, grid)[1])
