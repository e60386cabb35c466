"""300 frames of a real 12-bit CCD camera against the EMVA 1288 reference implementation's figures.

Frames: Basler AG, CC BY-SA 3.0. Where the definition is the same, 0.5 % (docs/emva-reference.md has the table).
"""

import pytest

from photosite.calibration.calibrate import calibrate
from photosite.frames.open import open_frames

REFERENCE_IMPLEMENTATION = {
    "system_gain_dn_per_e": 0.28006,
    "quantum_efficiency_percent": 45.249,
    "temporal_dark_noise_e": 10.924,
    "sensitivity_threshold_photons": 25.355,
    "saturation_capacity_photons": 30957.0,
    "saturation_capacity_e": 14008.0,
    "snr_max_db": 41.46,
    "dynamic_range_db": 61.73,
    "dsnu1288_e": 0.553,
    "prnu1288_unfiltered_percent": 0.4327,
}


BETWEEN_EXPOSURES = {"saturation_capacity_photons", "saturation_capacity_e"}
"""The reference takes the exposure with the largest variance, photosite the middle of where the largest variance can
lie: half of a 2 % step higher, less what the clipping's gentle beginning takes."""


@pytest.fixture(scope="module")
def calibration(reference):
    return calibrate(open_frames(reference / "emva1288_ccd12" / "EMVA1288_Data.txt"))


@pytest.mark.parametrize("name", REFERENCE_IMPLEMENTATION)
def test_agrees_with_the_reference_implementation(calibration, name):
    estimate = getattr(calibration, name)
    tolerance = 1e-2 if name in BETWEEN_EXPOSURES else 5e-3
    assert estimate.value == pytest.approx(REFERENCE_IMPLEMENTATION[name], rel=tolerance)
    low, high = estimate.interval_95
    assert low < REFERENCE_IMPLEMENTATION[name] < high


def test_the_high_pass_takes_the_uneven_light_off(calibration):
    """The unfiltered figure holds the shading of the illumination; what is left is the pixels' own."""
    assert calibration.prnu1288_percent.value == pytest.approx(0.260, abs=0.002)
    assert calibration.prnu1288_percent.value < 0.65 * calibration.prnu1288_unfiltered_percent.value


def test_the_paper_s_prnu_sees_the_shading_too(calibration):
    assert calibration.prnu_percent.value == pytest.approx(calibration.prnu1288_unfiltered_percent.value, rel=0.02)


def test_all_frames_are_used(calibration):
    assert calibration.frame_count == 300
    assert calibration.rejected == ()
    assert calibration.saturation_dn.value == 4095.0
    assert calibration.linear_range["M"].levels == 27


def test_scatter_beyond_sampling_is_told(calibration):
    assert any("scatter" in warning for warning in calibration.warnings)
