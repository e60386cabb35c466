"""Shape of the response of a channel, from the means of its light levels.

With x the stated light, y the signal and e the electrons, a shape H is defined by e proportional to y exp(H(y)) and
H(0) = 0. It is 0 for a straight response. Under light in proportion to x,

    ln(x / y) = c + H(y).

Signals are given as t, relative to the brightest level in the linear range. H is a straight line through 0 plus an
integrated Wiener process, whose posterior mean is a cubic smoothing spline: any smooth bend, and knees within their
uncertainty (G. Wahba, "Improper priors, spline smoothing and the problem of guarding against model errors in
regression", J. R. Stat. Soc. B 40 (1978) 364). The light has two errors: scatter from level to level, and a
constant amount (shutter delay, stray light), which adds a multiple of 1 / t. Roughness of the bend, scatter and
constant amount have unknown sizes. The result is the mean over a grid of them, weighted by their marginal likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.photon_transfer import LightLevels

Array = NDArray[np.float64]

LEAST_LEVELS = 4
"""Different light levels that a bend needs."""

BY_CHANCE = 1e-3
"""Share of straight responses under proportional light that may be analyzed as bent."""

LEAST_SIGNAL = 20.0
"""Signal of a level, in its standard uncertainties, from which it shows the shape."""

HIGHEST_ORDER = 3
"""Highest power of the signal that is tested for a bend."""

_ROUGHNESS = np.append(0.0, np.geomspace(1e-3, 30.0, 11))
_SCATTER = np.append(0.0, np.geomspace(1e-5, 0.05, 7))
_CONSTANT_LIGHT = np.array([0.0, 1e-4, 1e-3, 1e-2])
_NEGLIGIBLE = 1e-3
"""Weight, relative to the largest, below which a point of the grid is left out."""


@dataclass(frozen=True, eq=False)
class ResponseShape:
    """The shape of a response at n signals.

    Parameters
    ----------
    t
        (n,) signals relative to the brightest level in the linear range.
    bend, slope
        (n,) H, and dH/dt.
    covariance
        (2n, 2n) covariance of both, `bend` first.
    offset, offset_uncertainty
        c: the logarithm of the light for a unit of signal at small signal.
    """

    t: Array
    bend: Array
    slope: Array
    covariance: Array
    offset: float
    offset_uncertainty: float


def find_shape(levels: LightLevels, used: NDArray[np.bool_], signals: Array) -> ResponseShape | None:
    """Return the shape at some signals (n,), DN; None where signals are proportional to the stated light within noise.

    Levels are compared with a constant ln(x / y), and polynomials of t with it. False alarms of all these chi-square
    tests together are `BY_CHANCE` at most.
    """
    variance = np.diag(levels.signal_covariance)
    take = used & levels.trusted & (levels.x > 0.0) & (levels.signal > LEAST_SIGNAL * np.sqrt(variance))
    x, y = levels.x[take], levels.signal[take]
    if len(np.unique(np.round(np.log(x), 6))) < LEAST_LEVELS:
        return None
    unit = float(y.max())
    points = _Points(y / unit, np.log(x / y), levels.signal_covariance[np.ix_(take, take)] / np.outer(y, y))
    return None if points.straight() else points.shape_at(np.maximum(signals, 0.0) / unit)


@dataclass(frozen=True, eq=False)
class _Points:
    """(m,) t and ln(x / y) of the levels, and the (m, m) covariance of the latter from sampling."""

    t: Array
    log_ratio: Array
    covariance: Array

    def straight(self) -> bool:
        from scipy.special import chdtrc

        m = len(self.t)
        orders = range(min(HIGHEST_ORDER, m - 2) + 1)
        squares = [self._chi_square(order) for order in orders]
        chances = [chdtrc(m - 1, squares[0]), *(chdtrc(k, squares[0] - squares[k]) for k in orders[1:])]
        return bool(min(chances) * len(chances) > BY_CHANCE)

    def _chi_square(self, order: int) -> float:
        """Return chi square about the polynomial of an order."""
        root = np.linalg.cholesky(self.covariance)
        design = np.linalg.solve(root, np.vander(self.t, order + 1, increasing=True))
        y = np.linalg.solve(root, self.log_ratio)
        residual = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
        return float(residual @ residual)

    def shape_at(self, t: Array) -> ResponseShape:
        n, m = len(t), len(self.t)
        design = np.column_stack([np.ones(m), self.t])
        wiener = _wiener(self.t, self.t)
        # Rows: c, then H, then dH/dt.
        basis = np.zeros((1 + 2 * n, 2))
        basis[0, 0], basis[1 : n + 1, 1], basis[n + 1 :, 1] = 1.0, t, 1.0
        cross = np.vstack([np.zeros((1, m)), _wiener(t, self.t), _wiener_slope(t, self.t)])
        own = np.zeros((1 + 2 * n, 1 + 2 * n))
        slopes = _wiener_slope(t, t)
        own[1:, 1:] = np.block([[_wiener(t, t), slopes.T], [slopes, np.minimum.outer(t, t)]])
        mean, square = np.zeros(1 + 2 * n), np.zeros_like(own)
        for weight, noise, rough in self._grid(design, wiener):
            whole = noise + rough * wiener
            solved = np.linalg.solve(whole, np.column_stack([design, self.log_ratio, rough * cross.T]))
            normal = design.T @ solved[:, :2]
            line = np.linalg.solve(normal, design.T @ solved[:, 2])
            found = basis @ line + rough * cross @ (solved[:, 2] - solved[:, :2] @ line)
            left = basis - rough * cross @ solved[:, :2]
            covariance = rough * (own - cross @ solved[:, 3:]) + left @ np.linalg.solve(normal, left.T)
            mean += weight * found
            square += weight * (covariance + np.outer(found, found))
        covariance = square - np.outer(mean, mean)
        uncertainty = float(np.sqrt(max(covariance[0, 0], 0.0)))
        return ResponseShape(t, mean[1 : n + 1], mean[n + 1 :], covariance[1:, 1:], float(mean[0]), uncertainty)

    def _grid(self, design: Array, wiener: Array) -> list[tuple[float, Array, float]]:
        """Return weight, (m, m) covariance of the light, and square of the roughness for each point of the grid.

        The likelihood is the restricted one (REML), in which c and the straight part of H have no prior.
        """
        identity, constant = np.eye(len(self.t)), 1.0 / np.outer(self.t, self.t)
        grid, likelihood = [], []
        for rough, scatter, amount in product(_ROUGHNESS**2, _SCATTER**2, _CONSTANT_LIGHT**2):
            noise = self.covariance + scatter * identity + amount * constant
            root = np.linalg.cholesky(noise + rough * wiener)
            solved = np.linalg.solve(root, np.column_stack([design, self.log_ratio]))
            (aa, ab), (_, bb) = normal = solved[:, :2].T @ solved[:, :2]
            line = np.linalg.solve(normal, solved[:, :2].T @ solved[:, 2])
            residual = solved[:, 2] - solved[:, :2] @ line
            likelihood.append(-np.log(np.diag(root)).sum() - 0.5 * (np.log(aa * bb - ab * ab) + residual @ residual))
            grid.append((noise, rough))
        weights = np.exp(np.array(likelihood) - max(likelihood))
        weights[weights < _NEGLIGIBLE] = 0.0
        weights /= weights.sum()
        return [(float(w), noise, float(rough)) for w, (noise, rough) in zip(weights, grid, strict=True) if w > 0.0]


def _wiener(a: Array, b: Array) -> Array:
    """Return the covariance of an integrated Wiener process between places a and b."""
    low, high = np.minimum.outer(a, b), np.maximum.outer(a, b)
    return np.asarray(low**2 * (3.0 * high - low) / 6.0)


def _wiener_slope(a: Array, b: Array) -> Array:
    """Return the covariance of its slope at a with its value at b."""
    low = np.minimum.outer(a, b)
    return np.asarray(low * b[None, :] - 0.5 * low**2)
