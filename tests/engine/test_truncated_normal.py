"""Truncated normal vectors compared with rejection sampling and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.engine.truncated_normal import positive_normal_draws


def _draws(mean, factor, count, seed=0, burn=50):
    momenta = np.random.default_rng([seed, 3]).standard_normal((count + burn, len(mean)))
    return positive_normal_draws(np.array(mean), factor, momenta)[burn:]


def test_moments_are_those_of_rejection_sampling():
    """Each of 12 moments within five standard errors of both (chains' draws are near independent): 7e-6 by chance."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(3, 3))
    mean = np.array([-0.5, 0.3, -0.2])
    plain = mean + rng.standard_normal((500_000, 3)) @ root.T
    plain = plain[(plain > 0).all(axis=1)]
    chain = _draws(mean, root, 30_000)
    assert (chain > 0).all()
    for power in (1, 2, 3, 4):
        one, other = plain**power, chain**power
        # The chain's draws are correlated a little: its standard error is taken from means of blocks of 100.
        blocks = other.reshape(-1, 100, 3).mean(axis=1)
        error = np.hypot(one.std(axis=0) / np.sqrt(len(one)), blocks.std(axis=0) / np.sqrt(len(blocks)))
        assert (np.abs(one.mean(axis=0) - other.mean(axis=0)) < 5 * error).all()


@pytest.mark.parametrize("mean", [3.0, 0.0, -4.0])
def test_one_dimension_follows_the_closed_form(mean):
    """Distribution function at ten quantiles, each within five standard errors of 40 000 near-independent draws."""
    from scipy.stats import truncnorm

    chain = _draws([mean], np.eye(1), 40_000)[:, 0]
    for fraction in np.linspace(0.05, 0.95, 10):
        limit = truncnorm.ppf(fraction, -mean, np.inf, loc=mean)
        assert abs((chain < limit).mean() - fraction) < 5 * 1.5 * np.sqrt(fraction * (1 - fraction) / chain.size)


def test_far_from_the_walls_it_is_normal():
    factor = np.array([[1.0, 0.0], [0.8, 0.6]])
    chain = _draws([50.0, 60.0], factor, 20_000)
    assert np.allclose(np.cov(chain, rowvar=False), factor @ factor.T, atol=0.05)


def test_equal_momenta_give_equal_draws():
    assert np.array_equal(_draws([0.1, 0.2], np.eye(2), 100), _draws([0.1, 0.2], np.eye(2), 100))


def test_chain_starts_inside_and_near_the_mode():
    """Eight walls, with the mean far behind some: the start is inside, and no inside point is much more probable."""
    from photosite.engine.truncated_normal import _inside

    rng = np.random.default_rng(4)
    factor = np.linalg.cholesky(np.corrcoef(rng.normal(size=(8, 30))) + 0.1 * np.eye(8))
    mean = rng.normal(0.0, 3.0, 8)
    place = _inside(factor, mean)
    clearance = (factor @ place + mean) / np.linalg.norm(factor, axis=1)
    assert clearance.min() > 0.0999
    others = np.linalg.solve(factor, np.abs(rng.normal(0.0, 3.0, (20_000, 8))).T - mean[:, None])
    assert np.sum(place**2) <= np.sum(others**2, axis=0).min() + 0.5
