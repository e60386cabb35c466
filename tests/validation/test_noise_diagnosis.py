"""Differences of noise are reported with their size and likely cause."""

import numpy as np
import pytest

from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_statistics
from photosite.validation.validate import compare_patches
from photosite.values.region import Region

LEVELS = np.geomspace(20, 3000, 12)
PATCHES = [Region(f"gray {i}", 30 * i, 30 * i + 30, 0, 40) for i in range(12)]


def patches(seed, read=6.0, prnu=0.01, noise=1.0, frames=3):
    rng = np.random.default_rng(seed)
    mean = np.repeat(LEVELS, 30)[:, None] * (1 + prnu * noise * rng.normal(size=(360, 40)))
    spread = noise * np.sqrt(read**2 + 0.2 * np.abs(mean))
    shots = [np.rint(100 + rng.normal(mean, spread)).astype(np.uint16) for _ in range(frames)]
    return patch_statistics([RawFrame(dn, 14, black_level_dn=100) for dn in shots], PATCHES)


def noise_lines(**changes):
    result = compare_patches(patches(1, **changes), patches(2))
    assert not result.agrees
    return [line for line in result.reasons if line.startswith("noise") and "chi-square" not in line]


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"read": 9.0}, "dark patches differ most"),
        ({"prnu": 0.02}, "bright patches differ most"),
        ({"noise": 1.2}, "dark and bright patches differ alike"),
    ],
)
def test_the_cause_is_what_was_changed(changes, cause):
    assert any(line.startswith("noise over pixels: " + cause) for line in noise_lines(**changes))


def test_the_ratio_and_the_largest_difference_are_reported():
    line = next(
        line for line in noise_lines(noise=1.2) if line.startswith("noise over pixels, measured over simulated: ")
    )
    value, low, _, high = line.split(": ")[1].split()[1:5]
    assert float(value) == pytest.approx(1.2, abs=0.03)
    assert float(low.strip("(")) < float(value) < float(high.strip("),"))
    assert "the largest difference is +2" in line
    assert "(gray " in line


def test_noise_from_frame_to_frame_is_separate_from_the_pattern():
    lines = noise_lines(prnu=0.02)
    assert not any(line.startswith("noise from frame to frame") for line in lines)
    assert any(line.startswith("noise from frame to frame: dark patches differ most") for line in noise_lines(read=9.0))
    assert not any(line.startswith("noise from") for line in noise_lines(read=9.0, frames=1))


def test_noise_that_agrees_is_not_spoken_of():
    assert not any("measured over simulated: " in line for line in compare_patches(patches(1), patches(2)).reasons)
