"""Least-squares fits weighted by sampling, and by the scatter of the points beyond it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.roots import brentq
from photosite.values.uncertain import Uncertain, correlated

Array = NDArray[np.float64]

SCATTER_P_VALUE = 1.0 / 6.0
"""Fraction of ideal measurements whose scatter counts as beyond sampling: one standard deviation, one side."""


@dataclass(frozen=True)
class Fit:
    """A linear fit, y = design @ parameters.

    Parameters
    ----------
    parameters, covariance, estimator
        (p,), (p, p) and (p, m): parameters = estimator @ y, with the final weights.
    extra_variance
        Variance added to every point to explain the scatter about the line.
    chi_square, degrees_of_freedom
        Sum of squared residuals over the points' variances, before any was added; points less parameters.
    """

    parameters: Array
    covariance: Array
    estimator: Array
    extra_variance: float
    chi_square: float
    degrees_of_freedom: int

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the covariance (Welch and Satterthwaite); infinite where sampling explains the scatter.

        The part estimated from the residuals is 1 - (degrees of freedom) / (chi square) of the whole.
        """
        if self.extra_variance == 0.0:
            return math.inf
        return self.degrees_of_freedom / (1.0 - self.degrees_of_freedom / self.chi_square) ** 2

    @property
    def uncertain(self) -> tuple[Uncertain, ...]:
        """The parameters as new inputs with their covariance."""
        return correlated(self.parameters, self.covariance, self.freedom)


def _solve(design: Array, y: Array, covariance: Array) -> tuple[Array, Array, Array, float]:
    """Return parameters, covariance, estimator and chi square of generalised least squares."""
    root = np.linalg.cholesky(covariance)
    x = np.linalg.solve(root, design)
    normal = np.linalg.inv(x.T @ x)
    estimator = np.linalg.solve(root.T, x @ normal).T
    parameters = estimator @ y
    residual = np.linalg.solve(root, y - design @ parameters)
    return parameters, normal, estimator, float(residual @ residual)


def fit_linear(design: Array, y: Array, covariance: Array, *, plain: bool = False) -> Fit:
    """Fit by least squares, weighted by the covariance of the points and, where they scatter more, an extra variance.

    The extra variance, equal for all points, is the one at which chi square equals its expectation, the degrees of
    freedom (Mandel and Paule, Anal. Chem. 42 (1970) 1194; random effects). It is zero where at least a sixth of ideal
    data sets have such a chi square or a larger one. Half of them exceed the expectation, and widening all of those
    made 95 % intervals cover 97 % (docs/validation/coverage.md). With ideal points the weights are optimal. Where
    scatter far above the sampling error dominates (drifting lamp, uneven converter steps), all points have nearly the
    same weight, as in EMVA 1288's plain least squares. The covariance of the parameters includes the extra variance.

    Parameters
    ----------
    design, y, covariance
        (m, p) design matrix; (m,) measured points; their (m, m) covariance, positive definite.
    plain
        Weight all points equally, as EMVA 1288 does. The covariance of the parameters is still that of the points.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the points do not determine the parameters, or the covariance is not positive definite.

    Examples
    --------
    >>> x = np.array([1.0, 2.0, 3.0])
    >>> fit = fit_linear(x[:, None], 2.0 * x, np.eye(3))
    >>> fit.parameters.round(12).tolist(), fit.extra_variance
    ([2.0], 0.0)
    """
    from scipy.special import chdtri

    m, p = design.shape
    freedom = m - p
    parameters, normal, estimator, chi_square = _solve(design, y, covariance)
    extra = 0.0
    if freedom > 0 and chi_square > float(chdtri(freedom, SCATTER_P_VALUE)):
        extra = _extra_variance(design, y, covariance)
        parameters, normal, estimator, _ = _solve(design, y, covariance + extra * np.eye(m))
    if plain:
        estimator = np.asarray(np.linalg.solve(design.T @ design, design.T), np.float64)
        parameters, normal = estimator @ y, estimator @ (covariance + extra * np.eye(m)) @ estimator.T
    return Fit(parameters, normal, estimator, extra, chi_square, freedom)


def _extra_variance(design: Array, y: Array, covariance: Array) -> float:
    """Return the extra variance v at which chi square has no excess over its expectation.

    With an orthonormal basis of the residuals, and there the eigenvalues w of the covariance and the components z of
    the points along its eigenvectors, chi square is the sum of z^2 / (w + v).
    """
    basis = np.linalg.qr(design, mode="complete")[0][:, design.shape[1] :]
    variances, axes = np.linalg.eigh(basis.T @ covariance @ basis)
    squares: Array = (axes.T @ (basis.T @ y)) ** 2

    def excess(more: float) -> float:
        return float((squares / (variances + more)).sum()) - len(squares)

    low, high = 0.0, float(np.trace(covariance)) / len(covariance)
    while excess(high) > 0.0:
        low, high = high, 4.0 * high
        if not math.isfinite(high):
            raise np.linalg.LinAlgError("no extra variance explains the scatter")
    return float(brentq(excess, low, high, xtol=1e-12 * high, rtol=1e-12))
