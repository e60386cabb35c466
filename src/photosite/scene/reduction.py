"""Many spectra as weights over few: truncated singular value decomposition, through the small Gram matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def few_spectra(spectra: NDArray[np.float64], tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights (n, K), at most 1 in size, and basis (K, wavelengths), the fewest that make (n, wavelengths) spectra.

    To an RMS error of `tolerance` of their RMS, by truncated singular value decomposition.

    Examples
    --------
    >>> weights, basis = few_spectra(np.outer([1.0, 2.0, 4.0], [0.5, 0.25]), 1e-6)
    >>> weights.shape, basis.shape, (weights @ basis).round(6).tolist()
    ((3, 1), (1, 2), [[0.5, 0.25], [1.0, 0.5], [2.0, 1.0]])
    """
    vectors = principal_spectra(spectra.T @ spectra, tolerance)
    weights = spectra @ vectors.T
    scale = np.abs(weights).max(axis=0)
    scale[scale == 0] = 1.0  # darkness: weights stay zero
    return weights / scale, scale[:, None] * vectors


def principal_spectra(
    gram: NDArray[np.float64], tolerance: float, also: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """(K, wavelengths), orthonormal: the fewest that keep spectra of a (wavelengths, wavelengths) Gram matrix.

    To an RMS error of `tolerance` of their RMS, also of the spectra multiplied by `also` (wavelengths,) where that is
    given. They are the right singular vectors of the tall matrix of spectra.
    """
    power, vectors = np.linalg.eigh(gram)
    power, vectors = np.maximum(power[::-1], 0.0), vectors[:, ::-1]  # below 0 by rounding only: a Gram matrix
    if power[0] == 0.0:
        return np.ascontiguousarray(vectors[:, :1].T)
    K = _kept(power, tolerance)
    if also is not None:
        K = max(K, _kept(power * ((also[:, None] * vectors) ** 2).sum(axis=0), tolerance))
    return np.ascontiguousarray(vectors[:, :K].T)


def _kept(power: NDArray[np.float64], tolerance: float) -> int:
    """How many of the first entries leave at most tolerance^2 of the sum to the others."""
    left_over = np.append(np.cumsum(power[::-1])[::-1][1:], 0.0)  # summed from the small end: nothing cancels
    return int(np.argmax(left_over <= tolerance**2 * power.sum())) + 1
