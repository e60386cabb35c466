"""Smooth reflectances of many colours, reduced to few spectra."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.color.colour_science import colour_science
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import integration_weights
from photosite.color.tristimulus import color_matching_functions
from photosite.errors import InputError
from photosite.scene.reduction import principal_spectra
from photosite.scene.sigmoid import sigmoid_coefficients, sigmoid_reflectance

Array = NDArray[np.float64]

_RAISED_NM = np.arange(380.0, 781.0, 5.0)
_BLOCK = 1 << 15
"""Colours whose spectra are processed together."""


def raised(linear: Array, grid: Array, tolerance: float) -> tuple[NDArray[np.float32], Array, float]:
    """Return weights (K, rows, cols), reflectances (K, wavelengths) and relative RMS error of linear sRGB.

    Raises
    ------
    InputError
        If a colour has no smooth reflectance, or the tolerance is not between 0 and 1.

    Examples
    --------
    >>> weights, reflectance, _ = raised(np.full((2, 3, 3), 0.5), _RAISED_NM, 1e-4)
    >>> weights.shape, reflectance.shape, bool(abs(weights[:, 0, 0] @ reflectance[:, 30] - 0.5) < 0.01)
    ((4, 2, 3), (4, 81), True)
    """
    if not 0 < tolerance < 1:
        raise InputError("tolerance", value=tolerance, expected="between 0 and 1")
    colours, place, count = np.unique(linear.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True)
    coefficients = sigmoid_coefficients(*_seen(colours), _RAISED_NM)
    blocks = [slice(first, first + _BLOCK) for first in range(0, len(colours), _BLOCK)]
    gram = np.zeros((grid.size, grid.size))
    for here in blocks:
        spectra = sigmoid_reflectance(coefficients[here], grid)
        gram += spectra.T @ (spectra * count[here, None])
    vectors = _kept_spectra(gram, grid, tolerance)
    weights = np.empty((len(colours), len(vectors)), np.float32)
    for here in blocks:
        weights[here] = sigmoid_reflectance(coefficients[here], grid) @ vectors.T
    lost = max(0.0, 1.0 - float(np.einsum("ki,ij,kj->", vectors, gram, vectors) / np.trace(gram)))  # rounding
    shape = (len(vectors), *linear.shape[:2])
    return weights.T[:, place.ravel()].reshape(shape), vectors, math.sqrt(lost)


def _kept_spectra(gram: Array, grid: Array, tolerance: float) -> Array:
    """(K, wavelengths), orthonormal: the three that span the observer's weights under D65, and the fewest others.

    Spectra projected on them keep their colours under D65, whatever the tolerance.
    """
    carriers = color_matching_functions(grid) * integration_weights(grid) * illuminant("D65", grid)
    # A complete orthonormal basis, whose first three are those; the rest is reduced separately.
    whole = np.linalg.qr(carriers.T, mode="complete")[0].T
    seen, unseen = whole[: len(carriers)], whole[len(carriers) :]
    rest = unseen @ gram @ unseen.T
    share = math.sqrt(max(float(np.trace(rest)), 0.0) / float(np.trace(gram)))
    if share <= tolerance:
        return seen
    return np.concatenate([seen, principal_spectra(rest, tolerance / share) @ unseen])


def _seen(colours: Array) -> tuple[Array, Array]:
    """Tristimulus values under D65, and the weights that define them, for the white of the grid."""
    matrix = np.asarray(colour_science().RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ, dtype=np.float64)
    light = illuminant("D65", _RAISED_NM)
    weights = color_matching_functions(_RAISED_NM) * integration_weights(_RAISED_NM) * light
    weights /= weights[1].sum()
    return colours @ matrix.T * (weights.sum(axis=1) / matrix.sum(axis=1)), weights
