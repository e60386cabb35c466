"""Corrected dark levels: moments against draws, levels against the truth, slopes between them.

Statistical tests have fixed seeds. Of 60 pulls (error over uncertainty) the mean lies within 0.43 and the width within
0.7 to 1.3, 3.3 standard errors; right uncertainties exceed either once in 1000 seeds.
"""

import copy

import numpy as np
import pytest

from photosite.calibration.dark.censored_likelihood import CensoredDark, ClippedCounts, fit_censored
from photosite.calibration.dark.clipped_darks import _moments, _Pixels, _temporal_covariance, correct_clipping
from photosite.calibration.reduction.groups import Level
from photosite.engine.frame_sums import FrameSums
from photosite.values.uncertain import Missing


def level_of(y):
    frames, pixels = y.shape
    return Level.of(FrameSums((16, pixels // 16)).add(y.reshape(frames, 16, -1)).label_totals()[0])


def draw(rng, means, read, frames):
    return np.maximum(np.rint(rng.normal(means, read, (frames, means.size))), 0).astype(np.uint16)


def like(black, dsnu, read):
    return CensoredDark(1, 8, 0.5, black, dsnu**2, read**2, np.eye(3), 1.0, True)


@pytest.mark.parametrize("theta", [(0.0, 5.3, 4.7), (-2.0, 1.0, 9.0), (1.2, 0.1, 0.05), (30.0, 4.0, 6.0)])
def test_moments_are_those_of_clipped_numbers(theta):
    """Against 4 million draws; the tolerance is five standard errors of the coarsest of the three."""
    mu, a, b = theta
    rng = np.random.default_rng(1)
    means = rng.normal(mu, np.sqrt(a), 1_000_000)
    y = np.maximum(np.rint(rng.normal(means, np.sqrt(b), (4, means.size))), 0)
    temporal = y.var(0, ddof=1).mean()
    drawn = [y.mean(), temporal, y.mean(0).var(ddof=1) - temporal / 4]
    np.testing.assert_allclose(_moments(*theta), drawn, atol=5e-3 * max(1.0, a + b))


def test_the_covariance_of_the_moments_is_that_of_draws():
    """2000 measurements of the same pixels: their covariance to 6 standard errors."""
    n, rng = 6, np.random.default_rng(2)
    grid = (np.arange(2000) + 0.5) / 2000
    from scipy.stats import norm

    means = 0.3 + 2.0 * norm.ppf(grid)
    drawn = []
    for _ in range(2000):
        y = draw(rng, means, 2.2, n).astype(float)
        temporal = y.var(0, ddof=1).mean()
        drawn.append([y.mean(), temporal, y.mean(0).var(ddof=1) - temporal / n])
    found = np.cov(np.array(drawn).T) * means.size
    expected = _temporal_covariance(_Pixels.of(0.3, 4.0, 2.2**2), n)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(found - expected) < 6 * scale / np.sqrt(2000)).all()


def reference(seed, black, dsnu, read):
    """A random generator, the pixels' means, their reference frames and the censored fit of these."""
    rng = np.random.default_rng([seed, 3])
    means = rng.normal(black, dsnu, 512)
    first = draw(rng, means, read, 30)
    whole = first.astype(np.int64)
    dark = fit_censored(ClippedCounts.of((whole == 0).sum(0), whole.sum(0), 30, int((whole**2).sum())))
    return rng, means, first, dark


@pytest.mark.parametrize(
    ("black", "dsnu", "read", "frames", "shifts"),
    [
        (0.0, 2.3, 2.17, 10, (0.0, 2.0)),
        pytest.param(-2.0, 2.3, 2.17, 10, (0.5,), marks=pytest.mark.slow),
        pytest.param(2.0, 1.0, 1.5, 1, (-0.5,), marks=pytest.mark.slow),
    ],
)
def test_corrected_levels_and_the_steps_between_them(black, dsnu, read, frames, shifts):
    """A step of the dark signal, such as from dark current, between two clipped levels."""
    references = [reference(seed, black, dsnu, read) for seed in range(60)]
    for shift in shifts:
        check_step(references, read, frames, shift)


def check_step(references, read, frames, shift):
    pulls = []
    for rng, means, first, dark in references:
        second = draw(copy.deepcopy(rng), means + shift, read, frames)
        a, b = correct_clipping(level_of(first), dark), correct_clipping(level_of(second), dark)
        of_step = np.sqrt(a.mean_variance + b.mean_variance + (a.shared_mean - b.shared_mean) ** 2)
        of_noise = np.hypot(a.variance_uncertainty, a.shared_variance)
        pulls.append(
            [
                (b.mean - a.mean - shift) / of_step,
                (a.mean - means.mean()) / np.sqrt(a.mean_variance + a.shared_mean**2),
                (a.variance - read**2 - 1 / 12) / of_noise,
            ]
        )
        # Without correction the step is smaller by the fraction of numbers at 0.
        assert level_of(second).mean - level_of(first).mean < 0.95 * shift or shift <= 0.0
    pulls = np.array(pulls)
    print("mean", pulls.mean(0).round(2), "width", pulls.std(0).round(2))
    assert (np.abs(pulls.mean(0)) < 0.43).all(), pulls.mean(0)
    assert ((pulls.std(0) > 0.7) & (pulls.std(0) < 1.3)).all(), pulls.std(0)


def test_an_unclipped_level_is_unchanged():
    y = draw(np.random.default_rng(4), np.full(512, 60.0), 2.0, 5)
    level = level_of(y)
    assert correct_clipping(level, like(60.0, 1.0, 2.0)) is level


def test_a_level_without_explanation_is_missing():
    """Half of the numbers are zero, and there is no temporal noise."""
    y = np.zeros((6, 512), np.uint16)
    y[:, ::2] = 4
    found = correct_clipping(level_of(y), like(0.0, 2.0, 2.0))
    assert isinstance(found, Missing)
    assert found.id == "darks-clipped-too-far"


def test_moments_of_extreme_noise_take_limited_memory():
    """No digital number is above 2^16: the moments for noise of 10^15 DN use those only, in 50 MB."""
    pixels = _Pixels.of(5.0, 4.0, 1e30)
    assert np.isfinite(pixels.variance).all()
    assert pixels.mean.max() < 1 << 16


@pytest.mark.parametrize("theta", [(10.0, 0.26, 2.8), (14.0, 0.27, 1.7), (40.0, 4.0, 100.0)])
def test_a_level_far_from_the_model_is_restored(theta):
    """The reference level lies at black level 0, the other one has few numbers at 0."""
    mean, temporal, spatial = _moments(*theta)
    level = Level(10**6, 10, mean, 1e-6, temporal, 1e-3, spatial + temporal / 10, 0.5, 1e-5, 0.0)
    corrected = correct_clipping(level, like(0.0, 0.5, 1.25))
    np.testing.assert_allclose([corrected.mean, corrected.variance - 1 / 12], [theta[0], theta[2]], rtol=1e-6)
