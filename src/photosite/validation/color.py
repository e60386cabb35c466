"""Measured and simulated patches as colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.difference import delta_e_76, delta_e_94, delta_e_2000
from photosite.develop.color_matrix import ColorMatrix, fit_color_matrix


@dataclass(frozen=True, eq=False)
class ColorComparison:
    """Colour differences between measured and simulated patches, both through one colour matrix.

    Parameters
    ----------
    names
        The patches, those with a saturated channel left out.
    delta_e_76, delta_e_94, delta_e_2000
        (patches,), between measured, which is CIE 1994's reference, and simulated.
    matrix
        Camera RGB in DN above black to XYZ under D65, fitted to the simulated patches, with what it leaves
        against the patches' true colours.
    """

    names: tuple[str, ...]
    delta_e_76: NDArray[np.float64]
    delta_e_94: NDArray[np.float64]
    delta_e_2000: NDArray[np.float64]
    matrix: ColorMatrix


def compare_colors(
    names: tuple[str, ...], measured_rgb: ArrayLike, simulated_rgb: ArrayLike, reference_xyz: ArrayLike
) -> ColorComparison:
    """Colour differences between measured and simulated patch means.

    The matrix is fitted to the simulated patches and serves both, exposure included: a measured chart that is
    uniformly brighter differs in colour too.

    Parameters
    ----------
    names
        The patches.
    measured_rgb, simulated_rgb
        (patches, 3), mean camera red, green and blue above black.
    reference_xyz
        (patches, 3), the patches under D65, Y = 1 for the perfect white.

    Returns
    -------
    ColorComparison

    Raises
    ------
    InputError
        As `fit_color_matrix`.

    Examples
    --------
    >>> camera = np.random.default_rng(5).uniform(200, 3000, (24, 3))
    >>> names = tuple("abcdefghijklmnopqrstuvwx")
    >>> result = compare_colors(names, camera, camera, camera / 3000)
    >>> float(result.delta_e_2000.max()), result.delta_e_2000.shape
    (0.0, (24,))
    """
    matrix = fit_color_matrix(simulated_rgb, reference_xyz)
    measured_xyz, simulated_xyz = matrix.apply(measured_rgb), matrix.apply(simulated_rgb)
    return ColorComparison(
        names=tuple(names),
        delta_e_76=delta_e_76(measured_xyz, simulated_xyz),
        delta_e_94=delta_e_94(measured_xyz, simulated_xyz),
        delta_e_2000=delta_e_2000(measured_xyz, simulated_xyz),
        matrix=matrix,
    )
