"""First-order propagation against exact cases and simulation."""

import math

import numpy as np
import pytest

from photosite.values.uncertain import (
    JointCovariance,
    Missing,
    Source,
    Uncertain,
    combined,
    correlated,
    derive,
    weighted_mean,
)


def test_shared_uncertainty_cancels():
    k = Uncertain.of(0.28, 0.01)
    a, b = 5.0 / k, 7.0 / k
    assert (a / b).standard_uncertainty == pytest.approx(0.0, abs=1e-15)
    assert (a - b * (5 / 7)).standard_uncertainty == pytest.approx(0.0, abs=1e-15)
    assert (a + b).standard_uncertainty == pytest.approx(12 * 0.01 / 0.28**2)


def test_a_combination_keeps_correlations():
    gain = Uncertain.of(2.0, 0.1)
    assert combined([gain, gain], [3.0, -3.0]).standard_uncertainty == 0.0


def test_independent_inputs_add_in_squares():
    a, b = Uncertain.of(3.0, 0.3), Uncertain.of(4.0, 0.4)
    assert (a + b).standard_uncertainty == pytest.approx(0.5)
    assert (a * b).relative == pytest.approx(math.hypot(0.1, 0.1))
    assert (a / b).relative == pytest.approx(math.hypot(0.1, 0.1))


def test_propagation_agrees_with_simulation():
    """A result like the dynamic range, against 200 000 draws: 0.5 % is five standard errors of a standard deviation."""
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


def test_a_missing_result_has_the_first_reason():
    missing = derive(lambda a, b: a + b, Uncertain.of(1.0), Missing("no light frames"))
    assert missing == Missing("no light frames")


def test_the_interval_of_a_mean_square_is_that_of_chi_square():
    """40 000 variances of 8 frames: 95 % within 0.55 % (five standard errors), 2.5 % on either side within 0.4 %."""
    rng = np.random.default_rng(3)
    below = above = 0
    source = Source.mean_square(7.0)
    for found in rng.chisquare(7, 40_000) / 7:
        low, high = Uncertain.of(float(found), float(found) * math.sqrt(2 / 7), source).interval_95
        below, above = below + (high < 1.0), above + (low > 1.0)
    assert 1 - (below + above) / 40_000 == pytest.approx(0.95, abs=0.0055)
    assert below / 40_000 == pytest.approx(0.025, abs=0.004)


def test_the_interval_of_a_difference_of_mean_squares_covers():
    """Row variance less pixel variance, as for the parts of the fixed pattern: 19 rows, 1000 pixels, truth 1.5.

    20 000 draws, 95 % within 1 %: the method is slightly conservative. Normal intervals with the same uncertainties
    miss the truth twice as often as they should.
    """
    rng = np.random.default_rng(4)
    covered = normal = 0
    for rows, pixels in zip(2.5 * rng.chisquare(19, 20_000) / 19, rng.chisquare(1000, 20_000) / 1000, strict=True):
        sources = Source.mean_square(19.0), Source.mean_square(1000.0)
        found = Uncertain.of(float(rows), float(rows) * math.sqrt(2 / 19), sources[0])
        part = found - Uncertain.of(float(pixels), float(pixels) * math.sqrt(2 / 1000), sources[1])
        low, high = part.interval_95
        covered += low < 1.5 < high
        normal += abs(part.value - 1.5) < 1.96 * part.standard_uncertainty
    assert covered / 20_000 == pytest.approx(0.95, abs=0.01)
    assert normal / 20_000 < 0.925


def test_the_interval_of_few_degrees_of_freedom():
    value = Uncertain.of(3.0, 0.1, Source.student(4.0))
    assert value.interval_95 == pytest.approx((3.0 - 0.2776, 3.0 + 0.2776), abs=1e-4)
    assert (value * -2.0).interval_95 == pytest.approx((-6.5553, -5.4447), abs=1e-4)


def test_a_negative_factor_swaps_the_sides_of_an_interval():
    square = Uncertain.of(4.0, 1.0, Source(below=1.0, above=5.0))
    assert square.interval_95 == pytest.approx((3.0, 9.0))
    assert (10.0 + square * -1.0).interval_95 == pytest.approx((1.0, 7.0))


def test_joint_covariance_is_that_of_draws():
    """200 000 draws: each entry to five standard errors, 1.6 % of the product of the two uncertainties."""
    rng = np.random.default_rng(6)
    k, v = rng.normal(2.0, 0.02, 200_000), rng.normal(9.0, 0.1, 200_000)
    gain, variance = Uncertain.of(2.0, 0.02), Uncertain.of(9.0, 0.1)
    joint = JointCovariance.of({"k": gain, "e": variance.sqrt() / gain, "v": variance})
    drawn = np.cov([k, np.sqrt(v) / k, v])
    scale = np.sqrt(np.diag(drawn))
    assert np.abs(joint.matrix - drawn).max() < 0.016 * np.outer(scale, scale).max()
    np.testing.assert_allclose(joint.matrix / np.outer(scale, scale), drawn / np.outer(scale, scale), atol=0.016)
