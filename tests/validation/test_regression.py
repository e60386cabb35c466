"""Lines through points: against SciPy and NumPy, and the intervals' coverage."""

import numpy as np
import pytest
from raising import raises
from scipy.stats import linregress

from photosite.errors import InputError
from photosite.validation.regression import regress


def points(seed, count=30):
    rng = np.random.default_rng(seed)
    x = rng.uniform(10, 3000, count)
    variance = 4 + 0.05 * x
    return x, 1.02 * x - 3 + rng.normal(0, np.sqrt(variance)), variance


def test_equal_weights_are_scipys_line():
    x, y, _ = points(1)
    line, wanted = regress(x, y, np.full(x.size, 7.0)), linregress(x, y)
    assert line.slope.value == pytest.approx(wanted.slope, rel=1e-12)
    assert line.slope.standard_error == pytest.approx(wanted.stderr, rel=1e-10)
    assert line.intercept.value == pytest.approx(wanted.intercept, rel=1e-9)
    assert line.intercept.standard_error == pytest.approx(wanted.intercept_stderr, rel=1e-10)


def test_weights_are_numpys():
    x, y, variance = points(2)
    line = regress(x, y, variance)
    wanted, covariance = np.polyfit(x, y, 1, w=1 / np.sqrt(variance), cov=True)
    np.testing.assert_allclose([line.slope.value, line.intercept.value], wanted, rtol=1e-10)
    np.testing.assert_allclose(
        [line.slope.standard_error, line.intercept.standard_error], np.sqrt(np.diag(covariance)), rtol=1e-10
    )


def test_through_the_origin_in_closed_form():
    x, y, variance = points(3)
    slope = np.sum(x * y / variance) / np.sum(x * x / variance)
    error = np.sqrt(np.sum((y - slope * x) ** 2 / variance) / (x.size - 1) / np.sum(x * x / variance))
    found = regress(x, y, variance).slope_through_origin
    assert found.value == pytest.approx(slope, rel=1e-12)
    assert found.standard_error == pytest.approx(error, rel=1e-12)


def test_the_variances_common_factor_changes_nothing():
    x, y, variance = points(4)
    one, other = regress(x, y, variance), regress(x, y, 1e4 * variance)
    assert one.slope.standard_error == pytest.approx(other.slope.standard_error, rel=1e-9)


def test_intervals_cover_the_truth_in_95_percent():
    # 1000 lines through 6 points: the count of hits is 950 +- 6.9; the bounds are five of those, so the test
    # fails by chance once in a million. With the normal quantile in place of Student's t it would be 890.
    lines = [regress(*points(seed, 6)) for seed in range(1000)]
    for name, truth in {"slope": 1.02, "intercept": -3.0}.items():
        ends = [getattr(line, name) for line in lines]
        hits = sum(end.lower_95 <= truth <= end.upper_95 for end in ends)
        assert 916 <= hits <= 984, name


@pytest.mark.parametrize(
    ("simulated", "measured", "variance", "what"),
    [
        ([1, 2], [1, 2], [1, 1], "simulated"),
        ([5, 5, 5], [1, 2, 3], [1, 1, 1], "simulated"),
        ([1, 2, 3], [1, 2, 3], [1, 0, 1], "variance"),
        ([1, 2, 3], [1, 2], [1, 1, 1], "simulated, measured and variance"),
    ],
)
def test_points_without_a_regression(simulated, measured, variance, what):
    with raises(InputError, what):
        regress(simulated, measured, variance)
