"""Measured and simulated frames that share a fixed pattern or their noise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import warns

from photosite.frames.raw_frame import RawFrame
from photosite.validation.validate import validate
from photosite.values.region import Region

ROWS, COLS = 40, 2400
PATCHES = [Region(str(i), 0, ROWS, 20 * i, 20 * i + 20) for i in range(120)]


def pattern(seed: int, spread: float) -> NDArray[np.float64]:
    return np.random.default_rng([seed, 1]).normal(1000.0, spread, (ROWS, COLS))


def stack(
    chip: NDArray[np.float64], key: int, frames: int = 1, noise: float = 6.0, **metadata: object
) -> list[RawFrame]:
    rng = np.random.default_rng([key, 2])
    return [
        RawFrame(np.rint(chip + rng.normal(0.0, noise, chip.shape)).astype(np.uint16), 12, metadata=metadata)
        for _ in range(frames)
    ]


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("same_chip", [True, False])
def test_chi_squares_average_to_one(same_chip: bool, frames: int) -> None:
    """120 chi-squares of one degree of freedom: the mean is known to 0.13; 3.5 of these are 1 in 2000."""
    chip = pattern(1, 20.0)
    other = chip if same_chip else pattern(2, 20.0)
    found = validate(stack(chip, 3, frames), stack(other, 4, frames), chart=None, regions=PATCHES)
    assert len(found.tests) == (3 if frames > 1 else 2)
    for test in found.tests:
        assert test.statistic / test.degrees_of_freedom == pytest.approx(1.0, abs=0.45)
    assert not any("random numbers" in note for note in found.notes)


def test_a_shared_pattern_hides_no_difference() -> None:
    """The frames differ by 0.15 % in signal and 10 % in noise, small against a fixed pattern of 2 %."""
    chip = pattern(5, 20.0)
    found = validate(stack(chip, 6, 3), stack(1.0015 * chip, 7, 3, noise=6.6), chart=None, regions=PATCHES)
    assert found.temporal_noise is not None
    assert max(found.means.p_value, found.temporal_noise.p_value) < 1e-6


def test_the_same_frames_give_a_warning() -> None:
    frames = stack(pattern(1, 20.0), 3)
    with warns("measured and simulated frames"):
        found = validate(frames, frames, chart=None, regions=PATCHES)
    assert found.means.statistic == 0.0
    assert found.noise.statistic == 0.0
    assert "the same in every pixel" in found.notes[0]


@pytest.mark.parametrize("frames", [1, 2])
def test_frames_of_one_seed_are_tested_as_independent(frames: int) -> None:
    """A signal that is 0.02 % higher, 0.2 standard errors of a patch, is not significant because noise is shared.

    The patches' errors, sqrt(2 (20^2 + 6^2) / 800) = 1 DN, still find 0.5 %, and twice the noise.
    """
    chip = pattern(1, 20.0)
    shot = stack(chip, 3, frames, seed=7, frame=0)
    for factor, agrees in ((1.0002, True), (1.005, False)):
        other = stack(factor * chip, 3, frames, seed=7, frame=0)
        with warns("measured and simulated frames"):
            found = validate(shot, other, chart=None, regions=PATCHES)
        assert found.agrees is agrees
        assert found.means.statistic / found.means.degrees_of_freedom < 0.1 or not agrees
    noisier = stack(chip, 3, frames, noise=12.0, seed=7, frame=0)
    with warns("measured and simulated frames"):
        found = validate(shot, noisier, chart=None, regions=PATCHES)
    assert found.noise.p_value < 1e-6


def test_frames_of_one_seed_give_a_warning() -> None:
    """Seeds that a file states are text."""
    one = stack(pattern(1, 20.0), 3, seed=7, frame=0)
    other = stack(pattern(2, 20.0), 3, seed="7", frame="0")
    with warns("measured and simulated frames"):
        found = validate(one, other, chart=None, regions=PATCHES)
    assert "seed 7" in found.notes[0]
    for metadata in ({"seed": 8, "frame": 0}, {"seed": 7, "frame": 1}, {"seed": 7}, {}):
        found = validate(one, stack(pattern(2, 20.0), 4, **metadata), chart=None, regions=PATCHES)
        assert not any("seed" in note for note in found.notes)
