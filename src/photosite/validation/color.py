"""Color differences between measured and simulated patches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import delta_e_76, delta_e_94, delta_e_2000
from photosite.develop.color_matrix import ColorMatrix, fit_color_matrix
from photosite.errors import InputError


@dataclass(frozen=True, eq=False)
class ColorComparison:
    """Color differences between measured and simulated patches, both through one color matrix.

    Parameters
    ----------
    names
        The patches, without those that have a saturated channel.
    delta_e_76, delta_e_94, delta_e_2000
        (patches,) differences between measured and simulated; measured is the reference of CIE 1994.
    matrix
        Camera RGB in DN above black to XYZ under D65, fitted to the simulated patches, with its residuals against the
        patches' true colors.
    """

    names: tuple[str, ...]
    delta_e_76: NDArray[np.float64]
    delta_e_94: NDArray[np.float64]
    delta_e_2000: NDArray[np.float64]
    matrix: ColorMatrix


def compare_colors(
    names: tuple[str, ...],
    channels: tuple[str, ...],
    means: tuple[NDArray[np.float64], NDArray[np.float64]],
    used: NDArray[np.bool_],
    reference_xyz: NDArray[np.float64] | None,
    notes: list[str],
) -> ColorComparison | None:
    """Return the color differences of the patches that have no saturated channel.

    The matrix is fitted to the simulated patches and applied to both without rescaling. A measured chart that is
    uniformly brighter therefore differs in color.

    Parameters
    ----------
    names, channels
        Patches and channels.
    means
        Means above black, measured and simulated, each (patches, channels).
    used
        (patches, channels), false where a value is saturated.
    reference_xyz
        (patches, 3) tristimulus values under D65, Y = 1 for the perfect white; None if the colors are unknown.
    notes
        List that gets the reason if there are no color differences.

    Examples
    --------
    >>> camera = np.random.default_rng(5).uniform(200, 3000, (24, 3))
    >>> names, used = tuple("abcdefghijklmnopqrstuvwx"), np.ones((24, 3), bool)
    >>> result = compare_colors(names, ("R", "G", "B"), (camera, camera), used, camera / 3000, [])
    >>> float(result.delta_e_2000.max()), result.delta_e_2000.shape
    (0.0, (24,))
    """
    try:
        if set(channels) != {"R", "G", "B"}:
            raise InputError("the channels are not R, G and B")
        if reference_xyz is None:
            raise InputError("the patches' colors are unknown")
        order = [channels.index(name) for name in "RGB"]
        whole = np.flatnonzero(used.all(axis=1))
        measured_rgb, simulated_rgb = (mean[whole][:, order] for mean in means)
        matrix = fit_color_matrix(simulated_rgb, reference_xyz[whole])
    except InputError as reason:
        notes.append(f"no color differences: {reason}")
        return None
    xyz = matrix.apply(measured_rgb), matrix.apply(simulated_rgb)
    chosen = tuple(names[patch] for patch in whole)
    return ColorComparison(chosen, delta_e_76(*xyz), delta_e_94(*xyz), delta_e_2000(*xyz), matrix)
