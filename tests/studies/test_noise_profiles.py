"""Profiles of virtual cameras made as darktable makes them: the scale of a and b, and the coverage of the gain."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from photosite.frames.io.darktable_scale import BINS, DEMOSAICING
from photosite.studies.noise_profiles import (
    VirtualCamera,
    coverage_table,
    green_plane,
    profile_camera,
    profile_line,
    raw_frame,
)

CAMERA = VirtualCamera(4000.0, 3.0, 0.0, 0.6, 0.7, "PPG")


def test_the_line_of_noise_without_demosaicing_is_a_quarter_of_its_variance() -> None:
    """Haar details keep 1/4 of white noise. The brightness is the lower edge of its bin, half a bin too small.

    250 000 details, whose medians have an efficiency of 37 %: 1 % for the slope, 4.5 of those.
    """
    rng = np.random.default_rng(3)
    x = np.linspace(0.0, 1.0, 1000)[None, :]
    a, b = profile_line(x + rng.standard_normal((1000, 1000)) * np.sqrt(1e-3 * x + 1e-4))
    assert a == pytest.approx(1e-3 / 4, rel=0.045)
    assert b == pytest.approx((1e-4 + 1e-3 / (2 * BINS)) / 4, rel=0.045)


def test_bilinear_green_keeps_three_sixtyfourths() -> None:
    """In closed form: of the 2 x 2 greens two are measured and two are means of four neighbors."""
    green = green_plane(raw_frame(CAMERA, np.random.default_rng(4), (768, 1024)), "bilinear")
    assert profile_line(green)[0] * 4000.0 == pytest.approx(3 / 64, rel=0.05)


@pytest.mark.parametrize("way", DEMOSAICING)
def test_factors_of_the_ways_to_demosaic(way: str) -> None:
    """The table's factors; the sampling error of a frame of this size is 1.5 %, the table's spread up to 4.6 %."""
    green = green_plane(raw_frame(CAMERA, np.random.default_rng(5), (768, 1024)), way)
    spread = math.hypot(0.015, DEMOSAICING[way].relative_spread)
    assert profile_line(green)[0] * 4000.0 == pytest.approx(DEMOSAICING[way].factor, rel=4 * spread)


def test_nonuniformity_adds_to_the_slope() -> None:
    """0.86 p^2, for 0.8 % and 40 000 electrons more than twice the photon noise."""
    camera = dataclasses.replace(CAMERA, electrons_at_white=40_000.0, prnu_percent=0.8)
    green = green_plane(raw_frame(camera, np.random.default_rng(6), (768, 1024)), "bilinear")
    expected = 3 / 64 * (1 / 40_000 + 0.86 * 0.008**2)
    assert profile_line(green)[0] == pytest.approx(expected, rel=0.2)


def test_intervals_of_a_few_cameras_contain_gain_and_offset() -> None:
    """24 cameras: fewer than 19 covered has a probability of 0.001.

    15 gains are covered without the nonuniformity, and 14 with PPG as the only way to demosaic.
    """
    cameras = [profile_camera(seed, shape=(256, 384)) for seed in range(24)]
    assert sum(one.covered for one in cameras) >= 19
    assert sum(one.offset_covered for one in cameras) >= 19
    assert coverage_table(cameras)[0]["cameras"] == 24


@pytest.mark.slow
def test_intervals_contain_gain_and_offset_in_95_of_100_cameras() -> None:
    """400 cameras: 93 to 97 % is 1.8 standard deviations of the binomial distribution; the seeds are fixed."""
    cameras = [profile_camera(seed) for seed in range(400)]
    everything = coverage_table(cameras)[0]
    assert 0.93 <= everything["covered"] <= 0.97
    assert 0.93 <= everything["offset_covered"] <= 0.97
