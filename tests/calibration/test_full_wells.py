"""Levels with full pixels, in photon transfer points of known electrons."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from tests.calibration.test_photon_transfer import levels

from photosite.calibration.photon_transfer.full_well import full_wells
from photosite.calibration.photon_transfer.photon_transfer import LightLevels

GAIN, PIXELS, FRAMES = 0.4, 12_288, 6


def measured(seed: int, means: list[float], *, well: float = np.inf, bend: float = 0.0) -> LightLevels:
    """Return the levels of pixels with a PRNU of 2 %; the signal is lower by `bend` at 10 000 e-."""
    rng = np.random.default_rng([seed, 41])
    response = 1.0 + rng.normal(0.0, 0.02, PIXELS)
    signal, shot = [], []
    for mean in means:
        electrons = np.minimum(rng.poisson(mean * response, (FRAMES, PIXELS)), well)
        dn = GAIN * electrons * (1.0 - bend * electrons / 1e4)
        signal.append(dn.mean())
        shot.append(dn.var(axis=0, ddof=1).mean())
    sigma = np.sqrt(2.0 / (PIXELS * (FRAMES - 1))) * np.array(shot)
    return levels(signal, shot, shot_sigma=sigma)


EVEN = [1000.0 * k for k in range(1, 11)]


@pytest.mark.parametrize(
    ("means", "full"),
    [(EVEN, 1), ([*EVEN[:-1], 9700.0, 9900.0], 2), ([500.0, 900.0, 1400.0, 3000.0, 5000.0, 9800.0], 1)],
)
@pytest.mark.parametrize("bend", [0.0, 0.03])
def test_levels_near_the_well_are_found(means: list[float], full: int, bend: float) -> None:
    """The well is 1 % above the brightest level or less; 16 to 50 % of the electrons of these levels are at it."""
    found, fall = full_wells(measured(1, means, well=1.005 * means[-1], bend=bend))
    assert found.tolist() == list(range(len(means) - full, len(means)))
    assert fall > 0.1


@pytest.mark.parametrize("bend", [0.0, 0.05, -0.05])
def test_straight_and_bent_responses_have_no_full_wells(bend: float) -> None:
    """By chance, one of 10 000 runs fails."""
    of_seed = partial(measured, means=EVEN, bend=bend)
    assert not any(full_wells(of_seed(seed))[0].size for seed in range(40))


def test_one_level_of_four_is_found() -> None:
    found, fall = full_wells(measured(1, [2500.0, 5000.0, 7500.0, 10_000.0], well=10_050.0))
    assert (found.tolist(), fall > 0.1) == ([3], True)


def test_a_few_full_pixels_are_found() -> None:
    """The well is 1.9 standard deviations above the brightest level: 3 % of its electrons are at it."""
    found, fall = full_wells(measured(2, EVEN, well=10_420.0))
    assert (found.tolist(), 0.02 < fall < 0.07) == ([9], True)


@pytest.mark.parametrize("means", [[2500.0, 5000.0, 7500.0, 10_000.0], EVEN[4:], [0.4 * mean for mean in EVEN]])
@pytest.mark.parametrize("bend", [0.0, 0.08, -0.08])
def test_few_levels_have_no_full_wells(means: list[float], bend: float) -> None:
    assert not any(full_wells(measured(seed, means, bend=bend))[0].size for seed in range(40, 60))
