"""Covariances of noise between neighboring pixels, against closed forms and on clean frames."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.signal import correlate2d

from photosite.calibration.photon_transfer.summed_covariance import (
    FramePair,
    find_shared_noise,
    noise_covariances,
)
from photosite.values.uncertain import Missing, Uncertain

MONOCHROME = np.zeros((1, 1), np.int64)
BAYER = np.array([[0, 1], [1, 2]])
CROSSTALK = np.array([[0.0, 0.03, 0.0], [0.02, 0.90, 0.02], [0.0, 0.03, 0.0]])
SMOOTHING = np.array([[1.0, 2.0, 1.0], [2.0, 30.0, 2.0], [1.0, 2.0, 1.0]]) / 42.0


def pairs(
    rng: np.random.Generator,
    electrons: float,
    count: int = 4,
    shape: tuple[int, int] = (128, 160),
    charge: NDArray[np.float64] | None = None,
    numbers: NDArray[np.float64] | None = None,
    light: float = 0.0,
    row_dn: float = 0.0,
) -> list[FramePair]:
    """Return pairs of frames with 0.5 DN/e-, 3 DN of read noise and shading, and the stated weights."""
    shading = 1.0 + 0.3 * np.linspace(-1.0, 1.0, shape[1])

    def frame() -> NDArray[np.uint16]:
        e = rng.poisson(electrons * shading * (1.0 + light * rng.normal()), shape).astype(float)
        if charge is not None:
            e = convolve(e, charge, mode="wrap")
        dn = 100.0 + 0.5 * e + rng.normal(0.0, 3.0, shape) + row_dn * rng.normal(size=(shape[0], 1))
        if numbers is not None:
            dn = convolve(dn, numbers, mode="wrap")
        return np.rint(dn).astype(np.uint16)

    return [(frame(), frame()) for _ in range(count)]


@pytest.mark.parametrize("tile", [MONOCHROME, BAYER], ids=["monochrome", "bayer"])
def test_covariances_are_the_autocorrelation_of_the_weights(tile: NDArray[np.int64]) -> None:
    rng = np.random.default_rng(1)
    light = noise_covariances(pairs(rng, 4000.0, 16, charge=CROSSTALK), tile)
    expected = 0.25 * 4000.0 * correlate2d(CROSSTALK, CROSSTALK)
    expected[2, 2] += 9.0 + 1.0 / 12.0
    for channel in light:
        scores = (channel.covariance - expected) / channel.uncertainty
        # 25 normal scores: the largest is above 4 in 1 of 600 correct implementations.
        assert np.abs(scores).max() < 4.0


def test_light_rows_and_shading_leave_no_covariance() -> None:
    rng = np.random.default_rng(2)
    (found,) = noise_covariances(pairs(rng, 4000.0, 8, light=0.02, row_dn=4.0), MONOCHROME)
    # 25 correlated scores; 1 in 600 by chance.
    assert np.abs(found.scores()).max() < 4.0
    # 128 rows of 16 frames: a standard deviation of 16 DN² is known to 3 %.
    assert found.row == pytest.approx(16.0, abs=4.0 * found.row_uncertainty)
    # The mean of 160 pixels adds their noise, 1009 DN², over 160.
    assert found.row_uncertainty == pytest.approx((16.0 + 1009.0 / 160.0) * np.sqrt(2.0 / (128 * 8)), rel=0.1)


def test_shared_charge_gives_the_factor_of_photon_transfer() -> None:
    rng = np.random.default_rng(3)
    found = find_shared_noise(
        noise_covariances(pairs(rng, 4000.0, 16, charge=CROSSTALK), MONOCHROME),
        noise_covariances(pairs(rng, 0.0), MONOCHROME),
    )
    assert found is not None
    (factor,) = found.factors
    assert isinstance(factor, Uncertain)
    assert factor.value == pytest.approx(1.0 / np.sum(CROSSTALK**2), abs=3.0 * factor.standard_uncertainty)
    assert factor.relative < 0.01


def test_a_filter_shows_in_dark_frames() -> None:
    rng = np.random.default_rng(4)
    found = find_shared_noise(
        noise_covariances(pairs(rng, 4000.0, numbers=SMOOTHING), BAYER),
        noise_covariances(pairs(rng, 0.0, numbers=SMOOTHING), BAYER),
    )
    assert found is not None
    assert all(isinstance(factor, Missing) for factor in found.factors)
    assert min(found.correlation) > 0.05


def clean_frames_found(seeds: range) -> int:
    found = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        tile = (MONOCHROME, BAYER)[seed % 2]
        light, dark = (noise_covariances(pairs(rng, e, 2, (66, 98)), tile) for e in (3000.0, 0.0))
        found += find_shared_noise(light, dark) is not None
    return found


def test_clean_frames_are_not_reported() -> None:
    # 60 stacks at 5 in 10 000: a correct implementation fails in 3 % of seeds; these seeds were tried once.
    assert clean_frames_found(range(60)) == 0


@pytest.mark.slow
def test_clean_frames_are_reported_in_fewer_than_one_of_a_thousand() -> None:
    # Expected: at most 1 of 2000; more than 4 has a probability of 0.4 %.
    assert clean_frames_found(range(1000, 3000)) <= 4
