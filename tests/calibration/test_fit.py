"""The weighted fit against textbook least squares and simulation."""

import numpy as np
import pytest

from photosite.calibration.photon_transfer.fit import fit_linear


def test_ideal_points_get_textbook_weighted_least_squares():
    rng = np.random.default_rng(0)
    x = np.linspace(1.0, 9.0, 12)
    sigma = 0.01 * x
    y = 2.0 + 0.5 * x + rng.normal(0.0, 0.5 * sigma)  # scatter below the stated one, so no extra variance
    fit = fit_linear(np.column_stack([np.ones_like(x), x]), y, np.diag(sigma**2))
    slope, intercept = np.polyfit(x, y, 1, w=1 / sigma)
    assert fit.extra_variance == 0.0
    assert fit.parameters == pytest.approx([intercept, slope], rel=1e-10)
    _, unscaled = np.polyfit(x, y, 1, w=1 / sigma, cov="unscaled")
    assert fit.covariance == pytest.approx(unscaled[::-1, ::-1], rel=1e-8)
    assert fit.estimator @ y == pytest.approx(fit.parameters)


def test_scatter_far_above_sampling_makes_the_fit_plain_least_squares():
    rng = np.random.default_rng(1)
    x = np.linspace(1.0, 9.0, 40)
    y = 0.5 * x + rng.normal(0.0, 1.0, x.size)
    fit = fit_linear(x[:, None], y, np.diag((1e-3 * x) ** 2))
    assert fit.parameters[0] == pytest.approx(x @ y / (x @ x), rel=1e-5)
    residual = y - fit.parameters[0] * x
    assert fit.extra_variance == pytest.approx(residual @ residual / 39, rel=1e-3)
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(np.sqrt(residual @ residual / 39 / (x @ x)), rel=1e-3)


def test_extra_variance_brings_chi_square_to_its_expectation():
    rng = np.random.default_rng(2)
    x = np.linspace(1.0, 9.0, 15)
    covariance = np.diag(0.1 + 0.05 * x) + 0.05
    y = 0.5 * x + rng.normal(0.0, 2.0, x.size)
    fit = fit_linear(x[:, None], y, covariance)
    residual = y - fit.parameters[0] * x
    chi_square = residual @ np.linalg.solve(covariance + fit.extra_variance * np.eye(15), residual)
    assert chi_square == pytest.approx(fit.degrees_of_freedom, rel=1e-10)
    assert fit.chi_square > fit.degrees_of_freedom


def test_correlated_points_are_weighted_by_their_covariance():
    """Two points that share an error: the generalised mean."""
    covariance = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, 0.0, 1.0]])
    y = np.array([1.0, 2.0, 1.5])
    fit = fit_linear(np.ones((3, 1)), y, covariance)
    weights = np.linalg.inv(covariance).sum(0)
    assert fit.parameters[0] == pytest.approx(weights @ y / weights.sum())


@pytest.mark.parametrize(("extra", "at_least"), [(0.0, 0.92), (2.0, 0.89)])
def test_intervals_cover(extra, at_least):
    """1000 fits of 12 points, seed 5. The expected coverage is 95 % or more without extra scatter and 93 % with it
    (12 points, normal instead of Student quantiles); both limits are over four standard errors (0.7 to 0.8 %) below."""
    rng = np.random.default_rng(5)
    x = np.linspace(1.0, 12.0, 12)
    sigma = 0.2 * np.sqrt(x)
    covered = 0
    for _ in range(1000):
        y = 0.3 * x + rng.normal(0.0, np.hypot(sigma, extra))
        fit = fit_linear(x[:, None], y, np.diag(sigma**2))
        covered += abs(fit.parameters[0] - 0.3) < 1.96 * np.sqrt(fit.covariance[0, 0])
    assert covered / 1000 > at_least


def test_one_point_determines_the_line():
    fit = fit_linear(np.array([[2.0]]), np.array([3.0]), np.array([[0.04]]))
    assert fit.parameters[0] == 1.5
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(0.1)
    assert fit.degrees_of_freedom == 0
