"""Linearity against exact deviations of closed forms, and against the reference implementation's definition."""

import numpy as np
import pytest

from photosite.calibration.photon_transfer.linearity import linearity
from photosite.values.uncertain import Missing


def exact(x):
    return linearity(x, signal := x * (1.0 - 0.1 * x), 1e-12 * np.eye(len(x)), float(signal[-1]))


def test_three_points_of_a_parabola_have_a_deviation_in_closed_form():
    """y = H - 0.1 H^2 at H = 0.2, 0.5, 0.8 (saturation 0.9 at H = 1). Of three points a fit with two parameters leaves
    a multiple of one direction: with weights w, r_i = d / (w_i sum(c^2 / w)) c_i, d = sum c_i y_i, c = (1, -2, 1)."""
    x = np.array([0.2, 0.5, 0.8, 1.0])
    y = x * (1.0 - 0.1 * x)
    c = np.array([1.0, -2.0, 1.0])
    found = exact(x)
    assert found.used.tolist() == [True, True, True, False]
    for fit, weight in ((found.relative, 1.0 / y[:3] ** 2), (found.full_scale, np.ones(3))):
        residual = (c @ y[:3]) / np.sum(c**2 / weight) * c / weight
        scale = y[:3] - residual if fit is found.relative else 0.9 * 0.9
        np.testing.assert_allclose(fit.deviation_percent[:3], 100.0 * residual / scale, rtol=1e-9)
    deviation = found.relative.deviation_percent[:3]
    assert found.relative.error.value == pytest.approx(np.abs(deviation).mean(), rel=1e-12)
    assert found.relative.lowest.value == pytest.approx(deviation.min(), rel=1e-12)
    assert found.relative.highest.value == pytest.approx(deviation.max(), rel=1e-12)
    deviation = found.full_scale.deviation_percent[:3]
    assert found.full_scale.error.value == pytest.approx(0.5 * (deviation.max() - deviation.min()), rel=1e-12)


def test_deviations_of_a_quadratic_response_have_a_closed_form():
    """Plain least squares of y = H - q H^2 over equal steps leaves -q (u^2 - <u^2>), u from the middle of the range:
    over a width of L from -q L^2 / 6 to q L^2 / 12 in the limit, so that LE goes to q L^2 / 8 of the scale."""
    q = 0.1
    x = np.linspace(0.0, 1.0, 401)
    y = x - q * x**2
    fit = (found := linearity(x, y, 1e-12 * np.eye(len(x)), float(y[-1]))).full_scale
    u = x[found.used] - x[found.used].mean()
    scale = 0.9 * y[-1]
    np.testing.assert_allclose(
        fit.deviation_percent[found.used], -100.0 * q * (u**2 - np.mean(u**2)) / scale, atol=1e-10
    )
    assert fit.error.value == pytest.approx(100.0 * q * np.ptp(u) ** 2 / 8.0 / scale, rel=5e-3)


def test_the_relative_line_equals_numpy_with_weights_one_over_signal():
    """EMVA's reference implementation documents this equivalence."""
    rng = np.random.default_rng(1)
    x = np.linspace(1.0, 100.0, 50)
    y = 37.0 * x * (1.0 + 0.01 * rng.normal(size=50))
    found = linearity(x, y, np.eye(50), float(y.max()))
    inside = found.used
    intercept, slope = np.polynomial.polynomial.polyfit(x[inside], y[inside], 1, w=1.0 / y[inside])
    assert found.relative.slope == pytest.approx(slope, rel=1e-10)
    assert found.relative.intercept == pytest.approx(intercept, rel=1e-7)


def test_a_straight_line_has_no_error_and_units_do_not_matter():
    x = np.linspace(0.0, 2.0, 21)
    found = linearity(x, 5.0 + 400.0 * x, 1e-9 * np.eye(21), 805.0)
    assert found.relative.error.value == pytest.approx(0.0, abs=1e-9)
    curved = linearity(x, 400.0 * x - 20.0 * x**2, np.eye(21), 720.0)
    other = linearity(1e-6 * x, 0.1 * (400.0 * x - 20.0 * x**2), 0.01 * np.eye(21), 72.0)
    assert other.relative.error.value == pytest.approx(curved.relative.error.value, rel=1e-9)
    assert other.relative.error.standard_uncertainty == pytest.approx(
        curved.relative.error.standard_uncertainty, rel=1e-9
    )


def test_uncertainties_are_those_of_repeated_measurements():
    """A clearly curved response, measured 2000 times. The spread of 2000 values is known to 1.6 %, so 8 % is five times
    that; linearization and the noise of the weights stay below 2 %. Errors are small against the cubic curvature, so
    that the extremes stay at their levels."""
    rng = np.random.default_rng(2)
    x = np.linspace(0.02, 1.0, 30)
    true = 1000.0 * x * (1.0 - 0.1 * x**2)
    sigma = 0.05 + 0.0001 * true
    found = [linearity(x, true + sigma * rng.normal(size=30), np.diag(sigma**2), 900.0) for _ in range(2000)]
    for fit in ("relative", "full_scale"):
        for name in ("lowest", "error"):
            parts = [getattr(getattr(entry, fit), name) for entry in found]
            spread = np.std([part.value for part in parts])
            stated = np.mean([part.standard_uncertainty for part in parts])
            assert spread == pytest.approx(stated, rel=0.08), (fit, name)


def test_too_few_levels_give_a_reason():
    x = np.array([0.5, 0.9, 1.0, 1.0])
    result = linearity(x, 100.0 * x, np.eye(4), 100.0)
    assert isinstance(result, Missing)
    assert result.reason.startswith("2 light levels lie between 5 and 95 %")


@pytest.mark.parametrize("level", [1, 3, 7])
def test_uncertainties_are_derivatives(level):
    """With one uncertain signal, the uncertainty of each deviation is its derivative by that signal."""
    x = np.linspace(0.05, 1.0, 9)
    y = 1000.0 * x * (1.0 - 0.3 * x)
    alone = np.zeros((9, 9))
    alone[level, level] = 1.0
    found = linearity(x, y, alone, 740.0)
    step = 1e-4 * np.eye(9)[level]
    ends = [linearity(x, y + sign * step, alone, 740.0) for sign in (1.0, -1.0)]
    for fit in ("relative", "full_scale"):
        after, before = (getattr(entry, fit).deviation_percent for entry in ends)
        np.testing.assert_allclose(getattr(found, fit).deviation_uncertainty, np.abs(after - before) / 2e-4, rtol=1e-6)
