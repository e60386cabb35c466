"""Eight dark frames against closed forms, and against more frames."""

from __future__ import annotations

from dataclasses import replace

import pytest

from photosite.calibration.calibrate import calibrate
from photosite.studies.farrell2008.cameras import VENDOR, MeasuredCamera
from photosite.studies.farrell2008.eight_frames import EightFrames, eight_frames
from photosite.studies.protocol import ShootingProtocol, Step, paper_vendor_protocol
from photosite.studies.virtual_lab import virtual_lab

ROWS, COLS = 256, 384


def evaluated(count: int, dsnu_mv: float = 6.0) -> EightFrames:
    steps = paper_vendor_protocol().steps
    protocol = ShootingProtocol("darks", (replace(steps[0], count=count), *steps[1:]))
    sensor = MeasuredCamera(VENDOR, 5).sensor(ROWS, COLS).with_(dsnu_mv=dsnu_mv)
    lab = virtual_lab(sensor, protocol, seed=5)
    return eight_frames(lab, calibrate(lab.frame_set()))


@pytest.fixture(scope="module")
def eight() -> EightFrames:
    return evaluated(8)


def test_residual_read_noise(eight: EightFrames) -> None:
    """Closed forms with 4.58 and 6 mV and rounding of 0.977 mV; each measured value within 4 standard errors (0.01 %).

    98 304 pixels give a standard deviation to 0.23 %, a correlation to (1 - 0.965^2) / 313 = 0.0002, and the relative
    standard deviation of chi-square values with 7 degrees of freedom to 0.5 %.
    """
    left = (4.58**2 + (1000 / 1024) ** 2 / 12) / 8
    assert eight.frames == 8
    assert eight.pixels == ROWS * COLS
    assert eight.naive_dsnu_mv == pytest.approx((36 + left) ** 0.5, rel=0.01)
    assert eight.naive_dsnu_mv == pytest.approx(eight.naive_expected_mv, rel=1e-3)
    assert eight.noise_left_share == pytest.approx(left / (36 + left), rel=0.02)
    assert eight.pixel_offset_error_mv == pytest.approx(left**0.5, rel=0.01)
    assert eight.map_correlation == pytest.approx((36 / (36 + left)) ** 0.5, abs=8e-4)
    assert eight.map_correlation_expected == pytest.approx((36 / (36 + left)) ** 0.5, abs=8e-4)
    assert eight.pixel_variance_scatter == pytest.approx((2 / 7) ** 0.5, rel=0.02)
    assert eight.frames_for_a_tenth in (58, 59, 60)
    assert abs(eight.dsnu_mv - eight.chip_spread_mv) < 4 * eight.dsnu_uncertainty_mv


def test_chi_square_limits(eight: EightFrames) -> None:
    """7 degrees of freedom: 1.690 and 16.013 at 2.5 and 97.5 %, 24.322 at 99.9 %."""
    assert eight.frame_level_low == pytest.approx((7 / 16.013) ** 0.5, rel=1e-3)
    assert eight.frame_level_high == pytest.approx((7 / 1.690) ** 0.5, rel=1e-3)
    assert eight.noisy_pixel_factor == pytest.approx((24.322 / 7) ** 0.5, rel=1e-3)


def test_more_frames_determine_pixels_better_but_hardly_the_chip(eight: EightFrames) -> None:
    many = evaluated(64)
    assert many.pixel_offset_error_mv == pytest.approx(eight.pixel_offset_error_mv / 8**0.5, rel=0.02)
    assert many.pixel_offset_error_mv < 0.1 * 6.0
    assert many.map_correlation > 0.99
    assert 0.9 < many.dsnu_uncertainty_mv / eight.dsnu_uncertainty_mv < 1


def test_a_tenth_of_the_dsnu_is_detected(eight: EightFrames) -> None:
    """0.6 mV is above the detection limit, although the mean frame is mostly noise."""
    faint = evaluated(8, dsnu_mv=0.6)
    assert eight.smallest_dsnu_mv < 0.2
    assert faint.dsnu_mv == pytest.approx(0.6, abs=4 * faint.dsnu_uncertainty_mv)
    assert faint.dsnu_mv > 5 * faint.dsnu_uncertainty_mv
    assert faint.map_correlation < 0.5


def test_the_words_contain_the_numbers(eight: EightFrames) -> None:
    content = eight.to_dict()
    whole = " ".join((*content["can"], *content["cannot"]))
    for number in (f"{eight.dsnu_mv:.4f}", f"{eight.map_correlation:.3f}", f"{eight.frames_for_a_tenth} frames"):
        assert number in whole
    assert Step("dark", 0.01, 8) == paper_vendor_protocol().steps[0]
