"""Smooth positive responses from few measurements: closed forms, and coverage over many true responses."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.spectral.smooth_prior import _matern, smooth_positive_estimate
from photosite.engine.truncated_normal import positive_normal_draws
from photosite.errors import InputError

NM = np.arange(400.0, 701.0, 20.0)


def _response(rng, length_nm=30.0):
    """Draw a positive response from the prior, with standard deviation 0.3."""
    root = 0.3 * np.linalg.cholesky(_matern(NM, length_nm))
    return positive_normal_draws(np.zeros(NM.size), root, rng.standard_normal((20, NM.size)))[-1]


def _bumps(rng):
    """Draw two or three Gaussian bumps of 25 to 60 nm, smoother than the prior."""
    truth = np.zeros(NM.size)
    for _ in range(rng.integers(2, 4)):
        truth += rng.uniform(0.1, 0.6) * np.exp(-0.5 * ((NM - rng.uniform(420, 680)) / rng.uniform(25, 60)) ** 2)
    return truth


def _broad(rng, rows=16):
    """Draw overlapping measurements, such as a chart's: wide smooth bands."""
    centres, widths = rng.uniform(400, 700, rows), rng.uniform(20, 80, rows)
    return np.exp(-0.5 * ((NM - centres[:, None]) / widths[:, None]) ** 2)


def test_many_exact_measurements_determine_the_response():
    rng = np.random.default_rng(0)
    truth = _bumps(rng)
    found = smooth_positive_estimate(np.eye(NM.size), truth, 1e-8 * np.eye(NM.size), NM, draws=500)
    assert np.abs(found.mean - truth).max() < 5e-4
    assert found.determined == pytest.approx(NM.size, abs=0.5)


def test_interval_without_measurements_is_that_of_the_prior():
    """Measurements at 400 to 500 nm only: far above, the interval is that of the prior and begins near 0."""
    seen = NM <= 500
    truth = np.exp(-0.5 * ((NM - 450.0) / 30.0) ** 2)
    found = smooth_positive_estimate(np.eye(NM.size)[seen], truth[seen], 1e-6 * np.eye(seen.sum()), NM)
    width = found.upper_95 - found.lower_95
    assert width[seen].max() < 0.01
    assert width[-5:].min() > 0.3
    assert found.lower_95[-5:].max() < 0.1 * width[-5:].min()


def test_far_from_zero_it_is_gaussian_process_regression():
    """Far from 0, for one length, spread and misfit: Gaussian process regression (Rasmussen and Williams, 2.25)."""
    import photosite.calibration.spectral.smooth_prior as module

    rng = np.random.default_rng(2)
    design = _broad(rng)
    measured = design @ (5.0 + 0.1 * np.sin(NM / 40.0))
    noise = 1e-4 * np.eye(len(design))
    setting = next(iter(module._settings(design, measured, (noise,), NM)))
    prior = setting.spread**2 * _matern(NM, setting.length_nm)
    gain = prior @ design.T @ np.linalg.inv(design @ prior @ design.T + noise)
    assert np.allclose(setting.mean, gain @ measured, rtol=1e-5)
    covariance = prior - gain @ design @ prior
    assert np.allclose(setting.factor @ setting.factor.T, covariance, atol=1e-6 * prior[0, 0])
    whole = design @ prior @ design.T + noise
    logdet = np.linalg.slogdet(whole).logabsdet
    assert setting.log_evidence == pytest.approx(
        -0.5 * (measured @ np.linalg.solve(whole, measured) + logdet), rel=1e-6
    )


def _held(make, seeds, misfit):
    """Return, per seed, the fraction of wavelengths whose interval contains the truth, and the estimated misfit."""
    held, misfits = [], []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 7])
        truth, design = make(rng), _broad(rng)
        clean = design @ truth
        noise = 1e-3 * clean
        measured = clean * (1.0 + misfit * rng.standard_normal(clean.size)) + noise * rng.standard_normal(clean.size)
        patch = np.arange(clean.size)
        found = smooth_positive_estimate(design, measured, np.diag(noise**2), NM, groups=patch, seed=seed, draws=400)
        held.append(np.mean((found.lower_95 <= truth) & (truth <= found.upper_95)))
        misfits.append(found.misfit)
    return np.array(held), np.array(misfits)


@pytest.mark.parametrize("misfit", [0.0, 0.02])
def test_intervals_cover_responses_of_the_prior(misfit):
    """Pointwise coverage over 24 responses within 3.3 standard errors of 95 %: 1 false alarm in 1000 each."""
    held, misfits = _held(_response, 24, misfit)
    assert abs(held.mean() - 0.95) < 3.3 * max(held.std(ddof=1) / np.sqrt(held.size), 0.005)
    assert np.mean(misfits) == pytest.approx(misfit, abs=0.35 * misfit + 0.002)


def test_intervals_cover_smoother_responses():
    """Smoother responses than the prior's are covered in more than 95 %."""
    held, _ = _held(_bumps, 8, 0.0)
    assert held.mean() > 0.95


@pytest.mark.parametrize("relative", [0.02, 0.2])
def test_common_error_widens_but_does_not_bias(relative):
    """The value stays, and the relative uncertainty adds in quadrature. As noise, 20 % would bias it by two thirds."""
    rng = np.random.default_rng(0)
    design = _broad(rng, 30)
    clean = design @ np.exp(-0.5 * ((NM - 550.0) / 40.0) ** 2)
    noise = 1e-3 * clean + 1e-4
    measured = clean + noise * rng.standard_normal(30)
    alone, both = (
        smooth_positive_estimate(design, measured, np.diag(noise**2), NM, relative=factor)
        for factor in (None, np.full((30, 30), relative**2))
    )
    total = NM == 560.0
    value, widened = alone.mean[total][0], both.mean[total][0]
    assert widened == pytest.approx(value, rel=0.04)
    own = alone.covariance[total, total][0] / value**2
    assert both.covariance[total, total][0] / widened**2 == pytest.approx(own + relative**2, rel=0.15)


def test_the_common_part_of_relative_errors():
    """For lights with independent levels, the variance of a light over their number; for a common error, all of it."""
    import photosite.calibration.spectral.smooth_prior as module

    light = np.repeat(np.arange(3), 5)
    same = (light[:, None] == light).astype(float)
    assert module._common_part(0.04 * same) == pytest.approx(0.04 / 3, rel=1e-6)
    assert module._common_part(np.full((15, 15), 0.04)) == pytest.approx(0.04, rel=1e-6)
    assert module._common_part(np.diag([1.0, 0.5, 0.25])) == pytest.approx(1 / 7, rel=1e-6)
    left = 0.04 * same + 0.01 - module._common_part(0.04 * same + 0.01)
    assert np.linalg.eigvalsh(left).min() > -1e-9


def test_the_same_seed_gives_the_same_numbers():
    rng = np.random.default_rng(5)
    design = _broad(rng)
    measured = design @ _bumps(rng)
    one, other = (smooth_positive_estimate(design, measured, 1e-6 * np.eye(16), NM, seed=3, draws=200) for _ in "ab")
    assert np.array_equal(one.upper_95, other.upper_95)


def test_invalid_input():
    for design, measured, covariance, what in (
        (np.ones((2, NM.size)), np.ones(3), np.eye(2), "the shapes of measured, covariance and wavelength_nm"),
        (np.ones((1, NM.size)), np.array([np.nan]), np.eye(1), "design, measured and covariance"),
        (np.ones((1, NM.size)), np.array([-1.0]), np.eye(1), "the sums of design and measured"),
    ):
        with pytest.raises(InputError) as caught:
            smooth_positive_estimate(design, measured, covariance, NM)
        assert caught.value.what == what
