"""Kurtosis and Tukey lambda shape of known distributions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from photosite.calibration.chip_maps.noise_shape import NORMAL_SHAPE, _block_moments, measure_noise_shape, tukey_shape

SHAPE, FRAMES, WIDTH = (160, 200), 12, 0.25


def sums(stack):
    """Return variance, fourth powers and histograms by block of a stack."""
    residual = stack - stack.mean(axis=0)
    edges = (np.arange(1025) - 512) * WIDTH
    scaled = residual * np.sqrt(len(stack) / (len(stack) - 1))
    rows = stack.shape[1]
    blocks = [scaled[:, b * rows // 16 : (b + 1) * rows // 16] for b in range(16)]
    return (
        stack.var(axis=0, ddof=1).astype(np.float32),
        (residual**4).sum(axis=0).astype(np.float32),
        len(stack),
        np.array([np.histogram(block, edges)[0] for block in blocks]),
        WIDTH,
    )


def test_cumulants_of_a_pixel_are_scipys() -> None:
    rng = np.random.default_rng(1)
    stack = rng.exponential(3, (9, 16, 1))
    variance, fourth, *_ = sums(stack)
    found = _block_moments(variance, fourth, 9)
    for pixel in range(16):
        k2, k4 = (stats.kstat(stack[:, pixel, 0], n) for n in (2, 4))
        assert found[pixel, 1:3] == pytest.approx([k2, k4], rel=1e-4)


def test_squared_variance_has_no_bias() -> None:
    """Exponential noise of variance 9 in 5 frames: mean over 32 000 pixels within 5 standard errors."""
    stack = np.random.default_rng(2).exponential(3, (5, *SHAPE))
    variance, fourth, *_ = sums(stack)
    moments = _block_moments(variance, fourth, 5)
    means = moments[:, 1:] / moments[:, :1]
    for part, true in ((0, 9.0), (1, 6 * 81.0), (2, 81.0)):
        assert means[:, part].mean() == pytest.approx(true, abs=5 * means[:, part].std(ddof=1) / 4)


@pytest.mark.parametrize(
    ("noise", "within", "between"),
    [("normal", 0.0, 0.0), ("laplace", 3.0, 0.0), ("uneven", 0.0, 0.75), ("t", 6.0 / 6.0, 0.0)],
)
def test_kurtosis_is_that_of_the_distribution(noise, within, between) -> None:
    """Each part within 4.5 standard uncertainties of 16 blocks (Student's t with 15: 4e-4 for each of the 12)."""
    rng = np.random.default_rng(3)
    size = (FRAMES, *SHAPE)
    stack = {
        "normal": lambda: rng.normal(0, 4, size),
        "laplace": lambda: rng.laplace(0, 3, size),
        # Variances 10 and 30: 3 var / mean^2 = 3 100 / 400
        "uneven": lambda: rng.normal(0, 1, size) * np.sqrt(np.where(rng.random(SHAPE) < 0.5, 10.0, 30.0)),
        "t": lambda: 3 * rng.standard_t(10, size),
    }[noise]()
    tail = measure_noise_shape(*sums(np.round(stack + 100)))
    for found, true in (
        (tail.within_pixels, within),
        (tail.between_pixels, between),
        (tail.excess_kurtosis, within + between),
    ):
        assert abs(found.value - true) < 4.5 * found.standard_uncertainty
        assert found.standard_uncertainty < 0.2


@pytest.mark.parametrize("shape", [-0.2, -0.05, 0.0, 0.08, 0.3])
def test_shapes_of_tukey_distributions_are_recovered(shape) -> None:
    """Within 4.5 standard uncertainties of 16 blocks, or 1.5 if the subtraction of the mean dominates."""
    p = np.random.default_rng(4).random((40, *SHAPE))
    noise = np.log(p / (1 - p)) if shape == 0 else (p**shape - (1 - p) ** shape) / shape
    found = measure_noise_shape(*sums(2 * noise)).tukey_lambda
    of_mean = 2 / 40 * abs(shape - 0.14)
    assert abs(found.value - shape) < np.hypot(1.5 * of_mean, 4.5 * 0.002)
    assert of_mean < found.standard_uncertainty + 0.002 < 0.025


def test_normal_noise_has_the_normal_shape() -> None:
    edges = np.linspace(-6, 6, 2001)
    assert tukey_shape(np.diff(stats.norm.cdf(edges)), 12 / 2000) == pytest.approx(NORMAL_SHAPE, abs=1e-5)


def test_three_frames_have_no_fourth_moment() -> None:
    tail = measure_noise_shape(*sums(np.random.default_rng(5).normal(0, 4, (3, *SHAPE))))
    assert tail.excess_kurtosis.value is None
    assert "needs at least 4" in tail.within_pixels.reason
    assert tail.tukey_lambda.value is not None
