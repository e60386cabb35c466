"""First-order propagation against exact cases and simulation."""

import math

import numpy as np
import pytest

from photosite.calibration.uncertain import (
    Missing,
    Uncertain,
    correlated,
    derive,
    signed_root,
    spread,
    upper_limit_95,
    weighted_mean,
)


def test_what_two_results_share_cancels():
    k = Uncertain.of(0.28, 0.01)
    a, b = 5.0 / k, 7.0 / k
    assert (a / b).standard_uncertainty == pytest.approx(0.0, abs=1e-15)
    assert (a - b * (5 / 7)).standard_uncertainty == pytest.approx(0.0, abs=1e-15)
    assert (a + b).standard_uncertainty == pytest.approx(12 * 0.01 / 0.28**2)


def test_independent_inputs_add_in_squares():
    a, b = Uncertain.of(3.0, 0.3), Uncertain.of(4.0, 0.4)
    assert (a + b).standard_uncertainty == pytest.approx(0.5)
    assert (a * b).relative == pytest.approx(math.hypot(0.1, 0.1))
    assert (a / b).relative == pytest.approx(math.hypot(0.1, 0.1))


def test_propagation_agrees_with_simulation():
    """A figure like dynamic range, against 200 000 draws: 0.5 % is five standard errors of a standard deviation."""
    rng = np.random.default_rng(1)
    n = 200_000
    k, v, e = rng.normal(0.3, 0.002, n), rng.normal(9.0, 0.05, n), rng.normal(0.45, 0.004, n)

    def figure(k, v, e, root, log):
        return log(30_000 * e / (root(v / (k * k) + 0.25) + 0.5) * e)

    drawn = figure(k, v, e, np.sqrt, lambda x: 20 * np.log10(x))
    propagated = figure(
        Uncertain.of(0.3, 0.002),
        Uncertain.of(9.0, 0.05),
        Uncertain.of(0.45, 0.004),
        lambda x: x.sqrt(),
        lambda x: x.decibel(20.0),
    )
    assert propagated.value == pytest.approx(drawn.mean(), rel=1e-4)
    assert propagated.standard_uncertainty == pytest.approx(drawn.std(), rel=5e-3)


def test_correlated_inputs_have_their_covariance():
    covariance = np.array([[4.0, -1.5], [-1.5, 1.0]])
    a, b = correlated(np.array([1.0, 2.0]), covariance)
    assert a.standard_uncertainty == pytest.approx(2.0)
    assert b.standard_uncertainty == pytest.approx(1.0)
    assert (a + b).standard_uncertainty == pytest.approx(math.sqrt(4 + 1 - 3))


def test_weighted_mean():
    mean = weighted_mean([Uncertain.of(1.0, 0.1), Uncertain.of(3.0, 0.1)], [1, 3])
    assert mean.value == 2.5
    assert mean.standard_uncertainty == pytest.approx(0.1 * math.hypot(0.25, 0.75))


@pytest.mark.parametrize("true", [0.0, 0.5, 1.0, 3.0, 10.0])
def test_spread_covers_near_and_far_from_zero(true):
    """Intervals of sqrt(v) cover at least 95 % (less 0.5 %, over three standard errors of 20 000 draws)."""
    rng = np.random.default_rng(7)
    covered = 0
    for drawn in rng.normal(true, 1.0, 20_000):
        s = spread(Uncertain.of(float(drawn), 1.0))
        covered += abs(s.value - math.sqrt(true)) <= 1.959964 * s.standard_uncertainty
    assert covered / 20_000 > 0.945


def test_spread_is_first_order_far_from_zero():
    assert spread(Uncertain.of(100.0, 0.1)).standard_uncertainty == pytest.approx(0.1 / 20, rel=2e-3)


def test_a_negative_variance_keeps_its_sign_and_gets_a_limit():
    v = Uncertain.of(-0.3, 0.2)
    assert spread(v).value == -math.sqrt(0.3) == signed_root(-0.3)
    limit = upper_limit_95(v)
    assert 0.0 < limit < math.sqrt(0.2 * 1.96)
    assert upper_limit_95(Uncertain.of(5.0, 1.0)) is None
    assert 0.0 < upper_limit_95(Uncertain.of(-16.0, 1.0)) < 0.5
    assert upper_limit_95(Uncertain.of(-40.0, 1.0)) is None


@pytest.mark.parametrize("true", [0.0, 0.5, 1.5])
def test_the_upper_limit_is_one(true):
    """It is below the truth in at most 5 % of the cases (0.5 %: three standard errors of 20 000 draws)."""
    rng = np.random.default_rng(3)
    limits = [upper_limit_95(Uncertain.of(float(v), 1.0)) for v in rng.normal(true, 1.0, 20_000)]
    assert sum(limit is not None and limit < math.sqrt(true) for limit in limits) / 20_000 < 0.055


def test_what_is_missing_names_the_first_reason():
    missing = derive(lambda a, b: a + b, Uncertain.of(1.0), Missing("no light frames"))
    assert missing == Missing("no light frames")
