"""Colour differences between measured and simulated patches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.difference import delta_e_76, delta_e_94, delta_e_2000
from photosite.develop.color_matrix import ColorMatrix, fit_color_matrix
from photosite.errors import InputError


@dataclass(frozen=True, eq=False)
class ColorComparison:
    """Colour differences between measured and simulated patches, both through one colour matrix.

    Parameters
    ----------
    names
        The patches, without those that have a saturated channel.
    delta_e_76, delta_e_94, delta_e_2000
        (patches,) differences between measured and simulated; measured is the reference of CIE 1994.
    matrix
        Camera RGB in DN above black to XYZ under D65, fitted to the simulated patches, with its residuals against the
        patches' true colours.
    """

    names: tuple[str, ...]
    delta_e_76: NDArray[np.float64]
    delta_e_94: NDArray[np.float64]
    delta_e_2000: NDArray[np.float64]
    matrix: ColorMatrix


def compare_colors(
    names: tuple[str, ...], measured_rgb: ArrayLike, simulated_rgb: ArrayLike, reference_xyz: ArrayLike
) -> ColorComparison:
    """Return colour differences between measured and simulated patch means.

    The matrix is fitted to the simulated patches and applied to both without rescaling. A measured chart that is
    uniformly brighter therefore differs in colour.

    Parameters
    ----------
    names
        The patches.
    measured_rgb, simulated_rgb
        (patches, 3) mean camera red, green and blue above black.
    reference_xyz
        (patches, 3) tristimulus values under D65, Y = 1 for the perfect white.

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


def compare_patch_colors(
    names: tuple[str, ...],
    channels: tuple[str, ...],
    means: tuple[NDArray[np.float64], NDArray[np.float64]],
    used: NDArray[np.bool_],
    reference_xyz: NDArray[np.float64] | None,
) -> tuple[ColorComparison | None, str | None]:
    """Return the colour differences of the patches that have no saturated channel, or the reason why there are none.

    Parameters
    ----------
    names, channels
        Patches and channels.
    means
        Measured and simulated, each (patches, channels).
    used
        (patches, channels).
    reference_xyz
        (patches, 3), or None where the patches' colours are unknown.
    """
    if set(channels) != {"R", "G", "B"}:
        return None, "no colour differences: the channels are not R, G and B"
    if reference_xyz is None:
        return None, "no colour differences: the patches' colours are unknown"
    order = [channels.index(name) for name in "RGB"]
    whole = np.asarray(used.all(axis=1), dtype=np.bool_)
    chosen = tuple(names[patch] for patch in np.flatnonzero(whole))
    measured, simulated = (mean[whole][:, order] for mean in means)
    try:
        return compare_colors(chosen, measured, simulated, reference_xyz[whole]), None
    except InputError as reason:
        return None, f"no colour differences: {reason}"
