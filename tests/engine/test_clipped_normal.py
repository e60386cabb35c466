"""Moments of clipped and rounded normal noise, compared with sums over all digital numbers and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from photosite.engine.clipped_normal import clipped_charge, clipped_moments

Array = NDArray[np.float64]

WELL, WHITE = 253.0, 255.0
CASES = [
    # mean, variance before and after the well, the well's limit
    pytest.param((120.0, 100.0, 9.0, WELL), id="linear"),
    pytest.param((245.0, 100.0, 9.0, 400.0), id="converter"),
    pytest.param((210.0, 100.0, 9.0, 200.0), id="well"),
    pytest.param((250.0, 100.0, 16.0, WELL), id="well just below the converter"),
    pytest.param((260.0, 100.0, 16.0, 258.0), id="well just above the converter"),
    pytest.param((WHITE, 100.0, 16.0, WHITE), id="at equal limits"),
    pytest.param((1.5, 1.0, 2.0, WELL), id="black"),
    pytest.param((0.0, 0.0, 2.0, WELL), id="black without light"),
]


def moments(case: Array | tuple[float, ...]) -> Array:
    mean, before, after, well = case
    found = clipped_moments(np.array([mean]), np.array([before]), after, well, WHITE)
    return np.array([found.mean[0], found.variance[0]])


def summed_moments(mean: float, before: float, after: float, well: float) -> tuple[float, float]:
    """Return mean and variance from the probabilities of all digital numbers, the well's limit by quadrature."""
    charge, fraction = np.array([min(mean, well)]), np.ones(1)
    if before > 0:
        charge = mean + np.sqrt(before) * np.linspace(-10, 10, 4001)
        fraction = norm.pdf(charge, mean, np.sqrt(before))
        fraction /= fraction.sum()
    borders = np.arange(1, WHITE + 1) - 0.5
    at_least = np.array(
        [fraction @ norm.sf((border - np.minimum(charge, well)) / np.sqrt(after)) for border in borders]
    )
    first, second = at_least.sum(), 2 * borders @ at_least
    return first, second - first**2


@pytest.mark.parametrize("case", CASES)
def test_moments_agree_with_the_sum_over_all_numbers(case: tuple[float, ...]) -> None:
    """The density at the white level over 24, which is left out, is at most 0.4 / 24 / 4 for this read noise."""
    mean, variance = moments(case)
    summed_mean, summed_variance = summed_moments(*case)
    assert mean == pytest.approx(summed_mean, abs=0.005)
    assert variance == pytest.approx(summed_variance, rel=1e-3)


@pytest.mark.parametrize("case", CASES)
def test_derivatives_agree_with_finite_differences(case: tuple[float, ...]) -> None:
    mean, before, after, well = case
    found = clipped_moments(np.array([mean]), np.array([before]), after, well, WHITE)
    for n, name in enumerate(("mean", "before", "after", "well")):
        if case[n] == 0 and name == "before":  # has no other side
            continue
        step = 1e-3 * np.eye(4)[n]
        # Fourth order: an error of about 1e-12 for a function that changes over one digital number
        near, far = (moments(case + k * step) - moments(case - k * step) for k in (1, 2))
        slope = (8 * near - far) / 12e-3
        exact = [getattr(found.of_mean, name)[0], getattr(found.of_variance, name)[0]]
        assert exact == pytest.approx(slope, rel=1e-6, abs=1e-7)


def test_without_read_noise_the_well_alone_limits() -> None:
    """The mean of a normal distribution cut at its mean is lower by s / sqrt(2 pi)."""
    mean, variance = moments((200.0, 400.0, 0.0, 200.0))
    assert mean == pytest.approx(200 - 20 / np.sqrt(2 * np.pi), rel=1e-9)
    assert variance == pytest.approx(400 * (0.5 - 0.5 / np.pi) + 1 / 12, rel=1e-6)


def test_saturated_pixels_have_the_noise_behind_the_limit() -> None:
    assert moments((500.0, 400.0, 9.0, 200.0)) == pytest.approx([200.0, 9 + 1 / 12], rel=1e-9)
    assert moments((500.0, 400.0, 9.0, 900.0)) == pytest.approx([WHITE, 0.0], abs=1e-9)


@pytest.mark.parametrize("mean", [100.0, 190.0, 200.0, 230.0])
def test_charge_below_the_well_agrees_with_quadrature_and_finite_differences(mean: float) -> None:
    def kept(case: Array | tuple[float, ...]) -> Array:
        found = clipped_charge(np.array(case[:1]), np.array(case[1:2]), float(case[2]))
        return np.array([found.mean[0], found.variance[0]])

    case = mean, 100.0, 200.0
    charge = mean + 10.0 * np.linspace(-10, 10, 20_001)
    fraction = norm.pdf(charge, mean, 10.0) / norm.pdf(charge, mean, 10.0).sum()
    below = np.minimum(charge, 200.0)
    first = fraction @ below
    assert kept(case) == pytest.approx([first, fraction @ (below - first) ** 2], rel=1e-6)
    found = clipped_charge(np.array([mean]), np.array([100.0]), 200.0)
    for n, name in enumerate(("mean", "before", "well")):
        step = 1e-3 * np.eye(3)[n]
        near, far = (kept(case + k * step) - kept(case - k * step) for k in (1, 2))
        exact = [getattr(found.of_mean, name)[0], getattr(found.of_variance, name)[0]]
        assert exact == pytest.approx((8 * near - far) / 12e-3, rel=1e-6, abs=1e-7)
