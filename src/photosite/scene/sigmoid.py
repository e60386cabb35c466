"""Smooth reflectances from colors, after Jakob and Hanika: a sigmoid of a parabola over wavelength.

Such a reflectance has three coefficients, is between 0 and 1, and has at most one maximum or minimum.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.colorimetry import PUBLISHED_XYZ_FROM_SRGB, color_matching_functions
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import integration_weights, wavelength_grid
from photosite.errors import InputError
from photosite.scene.weights import principal_spectra

Array = NDArray[np.float64]

_BLOCK = 1 << 15
"""Colors solved together; their (colors, wavelengths) arrays take tens of megabytes."""

_RAISED_NM = np.arange(380.0, 781.0, 5.0)
_STEPS = 100
_CLOSE = 1e-6
"""Largest accepted error of a tristimulus value, relative to the white's Y."""

_EXTREME = 1e-5
"""Fraction of mid-gray mixed into a color: black and white would need infinite coefficients."""

_CENTER_NM, _HALF_NM = 570.0, 210.0
"""The parabola's variable is -1 at 360 nm, 1 at 780 nm."""


def sigmoid_reflectance(coefficients: ArrayLike, wavelength_nm: ArrayLike) -> Array:
    """Return reflectances (..., wavelengths) of coefficients (..., 3): 1/2 + x / (2 sqrt(1 + x^2)).

    In it, x = c0 t^2 + c1 t + c2 and t = (wavelength - 570) / 210.

    Notes
    -----
    W. Jakob and J. Hanika, "A Low-Dimensional Function Space for Efficient Spectral Upsampling", Eurographics 2019,
    equation 3.

    Examples
    --------
    >>> sigmoid_reflectance([0.0, 0.0, 0.0], [400.0, 700.0])
    array([0.5, 0.5])
    """
    x = np.asarray(coefficients, dtype=np.float64) @ _powers(wavelength_grid(wavelength_nm))
    reflectance: Array = 0.5 + 0.5 * x / np.sqrt(1.0 + x * x)
    return reflectance


def sigmoid_coefficients(tristimulus: ArrayLike, weights: ArrayLike, wavelength_nm: ArrayLike) -> Array:
    """Return the coefficients (n, 3) of reflectances with given tristimulus values.

    Parameters
    ----------
    tristimulus
        (n, 3), where Y of the perfect white is 1: X, Y, Z, or others defined by the weights.
    weights
        (3, wavelengths): `reflectance @ weights.T` are the tristimulus values; light times observer times step.
    wavelength_nm
        (wavelengths,).

    Raises
    ------
    InputError
        If a color has no such reflectance: it is brighter or more saturated than a surface can be.

    Notes
    -----
    The Levenberg-Marquardt method on all colors at once, starting from gray. The error is below 1e-6 of the white,
    after a fraction of 1e-5 of mid-gray is mixed in: black and the perfect white have no finite coefficients.
    """
    wanted = np.asarray(tristimulus, dtype=np.float64)
    weigh = np.asarray(weights, dtype=np.float64)
    powers = _powers(wavelength_grid(wavelength_nm))
    white = weigh.sum(axis=1)
    wanted = (1 - _EXTREME) * wanted + _EXTREME * 0.5 * white
    # Products of the weights with the powers, so that derivatives are one matrix product: (wavelengths, 9).
    jacobian = (weigh[:, None, :] * powers[None, :, :]).reshape(9, -1).T
    coefficients = np.empty((len(wanted), 3))
    for here in _blocks(len(wanted)):
        coefficients[here], error = _solve(_grays(wanted[here], white), wanted[here], weigh, powers, jacobian)
        if (error > _CLOSE).any():
            worst = here.start + int(error.argmax())
            raise InputError(
                f"{int((error > _CLOSE).sum())} colors are brighter or more saturated than a surface can be, the "
                f"first of them X, Y, Z {wanted[worst].round(4).tolist()} where white has {white.round(4).tolist()}"
            )
    return coefficients


def _blocks(count: int) -> list[slice]:
    return [slice(first, first + _BLOCK) for first in range(0, count, _BLOCK)]


def _powers(grid: Array) -> Array:
    t = (grid - _CENTER_NM) / _HALF_NM
    return np.stack([t * t, t, np.ones_like(t)])


def _grays(wanted: Array, white: Array) -> Array:
    """Coefficients (n, 3) of grays of about the colors' lightness."""
    level = 2 * np.clip((wanted / white).mean(axis=1), 0.01, 0.99) - 1
    c = np.zeros_like(wanted)
    c[:, 2] = level / np.sqrt(1 - level * level)
    return c


def _solve(c: Array, wanted: Array, weigh: Array, powers: Array, jacobian: Array) -> tuple[Array, Array]:
    """Improved coefficients (n, 3), and the largest error of each color (n,)."""
    damping = np.full(len(wanted), 1e-2)
    residual, slope = _error(c, wanted, weigh, powers)
    size = (residual**2).sum(axis=1)
    open_ = np.arange(len(wanted))
    for _ in range(_STEPS):
        open_ = open_[np.abs(residual[open_]).max(axis=1) > _CLOSE]
        if open_.size == 0:
            break
        J = (slope[open_] @ jacobian).reshape(-1, 3, 3)
        normal = np.einsum("nij,nik->njk", J, J)
        gradient = np.einsum("nij,ni->nj", J, residual[open_])
        # Damping by each coefficient's own scale keeps flat directions of dark and saturated colors moving.
        diagonal = np.einsum("njj->nj", normal)
        scale = diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-30
        normal[:, [0, 1, 2], [0, 1, 2]] += damping[open_, None] * scale
        step = np.linalg.solve(normal, gradient[..., None])[..., 0]
        trial = c[open_] - step
        new_residual, new_slope = _error(trial, wanted[open_], weigh, powers)
        new_size = (new_residual**2).sum(axis=1)
        better = new_size < size[open_]
        took = open_[better]
        c[took], size[took] = trial[better], new_size[better]
        residual[took], slope[took] = new_residual[better], new_slope[better]
        damping[open_] = np.where(better, np.maximum(damping[open_] / 5, 1e-9), np.minimum(damping[open_] * 4, 1e9))
    return c, np.abs(residual).max(axis=1)


def _error(c: Array, wanted: Array, weigh: Array, powers: Array) -> tuple[Array, Array]:
    """Tristimulus errors (n, 3), and the sigmoid's slope (n, wavelengths)."""
    x = c @ powers
    root = 1.0 / np.sqrt(1.0 + x * x)
    return (0.5 + 0.5 * x * root) @ weigh.T - wanted, 0.5 * root**3


def raised(linear: Array, grid: Array, tolerance: float) -> tuple[NDArray[np.float32], Array, float]:
    """Return weights (K, rows, cols), smooth reflectances (K, wavelengths) and relative RMS error of linear sRGB.

    Examples
    --------
    >>> weights, reflectance, _ = raised(np.full((2, 3, 3), 0.5), _RAISED_NM, 1e-4)
    >>> weights.shape, reflectance.shape, bool(abs(weights[:, 0, 0] @ reflectance[:, 30] - 0.5) < 0.01)
    ((4, 2, 3), (4, 81), True)
    """
    if not 0 < tolerance < 1:
        raise InputError("tolerance", value=tolerance, expected="between 0 and 1")
    colors, place, count = np.unique(linear.reshape(-1, 3), axis=0, return_inverse=True, return_counts=True)
    coefficients = sigmoid_coefficients(*_seen(colors), _RAISED_NM)
    blocks = _blocks(len(colors))
    gram = np.zeros((grid.size, grid.size))
    for here in blocks:
        spectra = sigmoid_reflectance(coefficients[here], grid)
        gram += spectra.T @ (spectra * count[here, None])
    vectors = _kept_spectra(gram, grid, tolerance)
    weights = np.empty((len(colors), len(vectors)), np.float32)
    for here in blocks:
        weights[here] = sigmoid_reflectance(coefficients[here], grid) @ vectors.T
    lost = max(0.0, 1.0 - float(np.einsum("ki,ij,kj->", vectors, gram, vectors) / np.trace(gram)))  # rounding
    shape = (len(vectors), *linear.shape[:2])
    return weights.T[:, place.ravel()].reshape(shape), vectors, math.sqrt(lost)


def _kept_spectra(gram: Array, grid: Array, tolerance: float) -> Array:
    """(K, wavelengths), orthonormal: the three that span the observer's weights under D65, and the fewest others.

    Spectra projected on them keep their colors under D65, whatever the tolerance.
    """
    carriers = color_matching_functions(grid) * integration_weights(grid) * illuminant("D65", grid)
    # A complete orthonormal basis, whose first three are those; the rest is reduced separately.
    whole = np.linalg.qr(carriers.T, mode="complete")[0].T
    seen, unseen = whole[: len(carriers)], whole[len(carriers) :]
    rest = unseen @ gram @ unseen.T
    fraction = math.sqrt(max(float(np.trace(rest)), 0.0) / float(np.trace(gram)))
    if fraction <= tolerance:
        return seen
    return np.concatenate([seen, principal_spectra(rest, tolerance / fraction) @ unseen])


def _seen(colors: Array) -> tuple[Array, Array]:
    """Tristimulus values under D65, and the weights that define them, for the white of the grid."""
    matrix = PUBLISHED_XYZ_FROM_SRGB
    light = illuminant("D65", _RAISED_NM)
    weights = color_matching_functions(_RAISED_NM) * integration_weights(_RAISED_NM) * light
    weights /= weights[1].sum()
    return colors @ matrix.T * (weights.sum(axis=1) / matrix.sum(axis=1)), weights
