"""Covariances of a pixel's temporal noise between successive frames: image lag, or noise reduction over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

FRAME_REACH = 2
"""Frames to the farthest frame whose covariance is estimated."""

LEAST_RUN = 4
"""Successive frames that the estimate needs."""

PART = 1 << 18
"""Pixels of a frame that are compared at once."""

BLOCK = 8
"""Rows and columns of the blocks whose means are subtracted, because shading that drifts is smooth."""


@dataclass(frozen=True)
class FrameCovariance:
    """Covariance of the temporal noise of a pixel with itself in later frames.

    Noise that rows, columns, blocks of pixels or frames share is not contained.

    Parameters
    ----------
    values, covariance
        (FRAME_REACH,) covariances with the next frames, DN^2, and their covariance matrix for independent frames; both
        empty where they are not known.
    """

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @property
    def uncertainty(self) -> NDArray[np.float64]:
        """Standard uncertainty of each covariance for independent frames, DN^2."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def sum_uncertainty(self) -> float:
        """That of the sum, DN^2."""
        return float(np.sqrt(self.covariance.sum()))

    def __sub__(self, other: FrameCovariance) -> FrameCovariance:
        """Return the covariances of the noise that another level does not have."""
        if not (len(self.values) and len(other.values)):
            return UNKNOWN
        return FrameCovariance(self.values - other.values, self.covariance + other.covariance)


UNKNOWN = FrameCovariance(np.empty(0), np.empty((0, 0)))
"""Fewer than `LEAST_RUN` successive frames."""


class FrameProducts:
    """Products of the noise of successive frames of one channel, from which `FrameCovariance` is estimated.

    The mean over a run of frames is the fixed pattern. A frame's part in proportion to it, a change of the light, is
    subtracted. The products of the residuals of m frames have the expectation P T P, where T is the matrix of the
    covariances by their distance in frames, and P subtracts the mean of m values. T is fitted to the products by least
    squares.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> charge = rng.poisson(1000.0, (9, 256, 256))
    >>> products = FrameProducts()
    >>> products.add(np.uint16(0.9 * charge[1:] + 0.1 * charge[:-1] + 0.5))
    >>> found = products.covariance()
    >>> found.values.round(-1) + 0.0, found.uncertainty.round()
    (array([90.,  0.]), array([1., 2.]))
    """

    def __init__(self) -> None:
        self._fitted = np.zeros(FRAME_REACH + 1)
        self._normal = np.zeros((FRAME_REACH + 1, FRAME_REACH + 1))
        self._square, self._freedom = 0.0, 0.0

    def add(self, run: Sequence[NDArray[np.unsignedinteger]]) -> None:
        """Add a run of (rows, cols) frames; fewer than `LEAST_RUN` are ignored."""
        m = len(run)
        if m < LEAST_RUN:
            return
        center = np.eye(m) - 1.0 / m
        basis = [center @ toeplitz(np.arange(m) == lag) @ center for lag in range(FRAME_REACH + 1)]
        for residual in _residuals(run):
            products, pixels = residual @ residual.T, residual.shape[1]
            self._fitted += [float(np.vdot(each, products)) for each in basis]
            self._normal += [[pixels * float(np.vdot(a, b)) for b in basis] for a in basis]
            self._square += float(np.trace(products))
            self._freedom += pixels * (m - 1)

    def covariance(self) -> FrameCovariance:
        """Return the estimate; `UNKNOWN` without a run."""
        if not self._freedom:
            return UNKNOWN
        inverse = np.linalg.inv(self._normal).astype(np.float64)
        variance = self._square / self._freedom
        covariance: NDArray[np.float64] = 2.0 * variance**2 * inverse[1:, 1:]
        return FrameCovariance((inverse @ self._fitted)[1:], covariance)


def _residuals(run: Sequence[NDArray[np.unsignedinteger]]) -> Iterator[NDArray[np.float64]]:
    """Yield (frames, pixels) noise without fixed pattern, changes of the light, lines and smooth drift, in parts."""
    rows, cols = (length // BLOCK * BLOCK for length in run[0].shape)
    step = max(PART // max(cols, 1) // BLOCK, 1) * BLOCK
    for start in range(0, rows if cols else 0, step):
        stack = np.stack([dn[start : min(start + step, rows), :cols] for dn in run]).astype(np.float64)
        stack -= stack.mean(axis=2, keepdims=True)
        stack -= stack.mean(axis=1, keepdims=True)
        blocks = stack.reshape(len(run), -1, BLOCK, cols // BLOCK, BLOCK)
        blocks -= blocks.mean(axis=(2, 4), keepdims=True)
        residual = stack.reshape(len(run), -1)
        pattern = residual.mean(axis=0)
        residual -= pattern
        if spread := float(pattern @ pattern):
            residual -= np.outer(residual @ pattern / spread, pattern)
        yield residual
