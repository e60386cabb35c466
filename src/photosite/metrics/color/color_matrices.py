"""Matrices from camera channels to XYZ: least squares, and least squares drawn to a white balance alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import XYZ_FROM_SRGB
from photosite.errors import InputError

Array = NDArray[np.float64]

_STRENGTHS = np.logspace(-6.0, 1.0, 29)
"""Strengths of the regularization that are tried, relative to the mean square of the channels."""


def fitted_xyz(
    camera: Array, xyz: Array, strength: float | Array = 0.0, prior: Array | None = None
) -> tuple[Array, Array]:
    """Return XYZ of the patches by a matrix fitted to all, and by matrices fitted without the patch itself.

    Parameters
    ----------
    camera, xyz
        (..., patches, channels) camera values, and (patches, 3) colors.
    strength, prior
        Of the regularization: the sum of squared differences from a prior (channels, 3) matrix is added, times
        strength, one or (...), number of patches and mean square of the channels. 0: ordinary least squares.

    Raises
    ------
    InputError
        If the camera's colors, with or without one patch, lie in a plane.

    Notes
    -----
    The residual of a patch that is left out is that of the fit divided by 1 - h, with h its diagonal entry of the hat
    matrix (D. M. Allen, Technometrics 16, 1974). It is exact for a fixed strength.
    """
    gram = np.swapaxes(camera, -1, -2) @ camera
    channels = camera.shape[-1]
    size = np.trace(gram, axis1=-2, axis2=-1)[..., None, None] / channels
    base = 0.0 if prior is None else camera @ prior
    inverse = np.linalg.pinv(gram + np.asarray(strength)[..., None, None] * size * np.eye(channels))
    leverage = np.einsum("...pc,...cd,...pd->...p", camera, inverse, camera)[..., None]
    if (1.0 - leverage).min() < 1e-9 or (not np.any(strength) and np.linalg.matrix_rank(camera).min() < channels):
        raise InputError("colors of the patches", expected="not in a plane of the camera's channels")
    wanted = xyz - base
    fitted = camera @ (inverse @ (np.swapaxes(camera, -1, -2) @ wanted))
    return base + fitted, base + wanted - (wanted - fitted) / (1.0 - leverage)


def white_balance_matrix(channels: Sequence[str], camera: Array, xyz: Array) -> Array | None:
    """Return the (channels, 3) matrix of a white balance alone: balanced R, G and B are taken as linear sRGB.

    The gains are those with which the channels follow the luminance of gray patches best. None for other channels.

    Parameters
    ----------
    channels, camera, xyz
        Names of the channels, (gray patches, channels) and (gray patches, 3).
    """
    if sorted(channels) != ["B", "G", "R"] or not len(camera):
        return None
    gains = camera.T @ xyz[:, 1] / np.sum(camera**2, axis=0)
    return np.asarray(gains[:, None] * XYZ_FROM_SRGB.T[["RGB".index(name) for name in channels]])


def best_strength(camera: Array, xyz: Array, prior: Array) -> Array:
    """Return the strength of the regularization with the smallest squared error of patches that are left out.

    It follows the camera values without steps: a parabola through the errors of three strengths has its minimum there.

    Parameters
    ----------
    camera, xyz, prior
        (..., patches, channels), (patches, 3) and (channels, 3).

    Returns
    -------
    Array
        (...) strengths.
    """
    errors = np.array(
        [np.sum((fitted_xyz(camera, xyz, each, prior)[1] - xyz) ** 2, axis=(-2, -1)) for each in _STRENGTHS]
    )
    best = np.clip(errors.argmin(axis=0), 1, len(_STRENGTHS) - 2)
    before, at, after = (np.take_along_axis(errors, (best + step)[None], axis=0)[0] for step in (-1, 0, 1))
    bend = before - 2.0 * at + after
    step = np.where(bend > 0.0, 0.5 * (before - after) / np.where(bend > 0.0, bend, 1.0), 0.0)
    places = best + np.clip(step, -1.0, 1.0)
    return np.asarray(10.0 ** np.interp(places, np.arange(len(_STRENGTHS)), np.log10(_STRENGTHS)))
