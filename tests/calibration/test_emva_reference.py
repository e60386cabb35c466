"""300 frames of a real 12-bit CCD camera against the results of the EMVA 1288 reference implementation.

Frames: Basler AG, CC BY-SA 3.0. The figures agree to 0.1 %; docs/validation/emva-reference.md has the table and the
exceptions.
"""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.frames.open import open_frames

REFERENCE_IMPLEMENTATION = {
    "K": 0.28006,
    "eta": 45.249,
    "sigma_d": 10.924,
    "mu_p_min": 25.355,
    "mu_p_sat": 30957.0,
    "mu_e_sat": 14008.0,
    "SNR_max_dB": 41.46,
    "DR_dB": 61.73,
    "DSNU1288": 0.553,
    "PRNU1288_unfiltered": 0.4327,
    "DSNU1288_col": 0.54056,
    "DSNU1288_row": 0.259,
    "LE_min": -0.6157976,
    "LE_max": 0.4804483,
    "mu_I_mean": 28.479107,
    "mu_I_var": 69.971699,
    "PRNU1288_unfiltered_row": 0.32327,
    "PRNU1288_unfiltered_col": 0.11133,
    "PRNU1288_unfiltered_pixel": 0.26521,
}

BETWEEN_EXPOSURES = {"mu_p_sat", "mu_e_sat"}
"""The reference takes the exposure with the largest variance, photosite the middle of the interval in which the maximum
can lie: half of a 2 % step higher, less the effect of the gradual clipping."""


SHIFTS = {"DSNU1288"}
"""The reference counts the shifts of the black level from frame to frame as noise of the pixels, and subtracts them."""


@pytest.fixture(scope="module")
def calibration(emva_frames):
    return calibrate(open_frames(emva_frames))


def test_agrees_with_the_reference_implementation(calibration):
    """The figures are the standard's arithmetic: pairs of frames, equal weights, variances of single pixels."""
    for name, value in REFERENCE_IMPLEMENTATION.items():
        estimate = calibration.emva1288[name]
        tolerance = 1e-2 if name in BETWEEN_EXPOSURES else 2e-3 if name in SHIFTS else 1e-3
        assert estimate.value == pytest.approx(value, rel=tolerance), name
        low, high = estimate.interval_95
        assert low < value < high, name
    assert "implausible" not in limits(calibration)


def test_the_line_of_linearity_equals_the_reference(calibration):
    fit = calibration.linearity["M"].relative
    assert (fit.slope, fit.intercept) == pytest.approx((0.12629093, 5.120069), rel=1e-6)


def test_row_noise_is_not_a_row_pattern(calibration):
    """The reference's pixel part is the root of -0.0042 DN^2, its row part 0.26 e-: it subtracts the row noise left in
    the mean of 50 frames from the pixels."""
    for part, most in (("pixel", 0.3), ("row", 0.13)):
        low, high = calibration.estimates()[f"dsnu1288_{part}_e"].interval_95
        assert 0.0 < high < most
        assert low < 0.1
    assert "negative-variance" not in limits(calibration)


def test_spectrograms_equal_the_reference(calibration):
    """Square roots of power: first frequency, 1/4, last, median."""
    dark, light = calibration.spatial["M"].dark, calibration.spatial["M"].light
    for found, wanted in (
        (dark.horizontal, (1.21375056, 0.75840644, 0.59223818, 0.43390405)),
        (dark.vertical, (0.44246948, 0.71024420, 0.45246829, 0.43354831)),
    ):
        root = np.sqrt(found.power)
        some = root[1], root[(len(root) - 1) // 2], root[-1], np.median(root[1:])
        assert some == pytest.approx(wanted, rel=1e-7)
        assert found.frequency[(len(root) - 1) // 2] == 0.25
    per_dn = light.mean_dn / 100.0
    assert np.median(np.sqrt(light.horizontal.power[1:])) * per_dn == pytest.approx(6.23232503, rel=1e-7)
    assert np.sqrt(light.vertical.power[1]) * per_dn == pytest.approx(86.6963113, rel=1e-7)


def test_profiles_equal_the_reference(calibration):
    dark, light = calibration.spatial["M"].dark, calibration.spatial["M"].light
    some = light.along_columns.mean[[0, 320, 639]], light.along_rows.mean[[0, 240, 479]]
    np.testing.assert_allclose(some[0], [1996.33304167, 1965.10416667, 1968.58925], rtol=1e-10)
    np.testing.assert_allclose(some[1], [1975.4441875, 1962.2676875, 1986.5608125], rtol=1e-10)
    extremes = light.along_columns.lowest.min(), light.along_columns.highest.max(), light.along_columns.middle[320]
    assert extremes == pytest.approx((1929.06, 2016.80, 1960.14))
    extremes = dark.along_columns.lowest.min(), dark.along_columns.highest.max(), dark.along_columns.middle[320]
    assert extremes == pytest.approx((12.08, 16.86, 15.02))


def test_the_dark_histogram_equals_the_reference(calibration):
    found = calibration.spatial["M"].dark.histogram
    assert (len(found.count), found.count.sum(), found.count.max()) == (240, 307_200, 5525)
    ends = found.lower[0], found.lower[-1], found.width, found.lower[found.count.argmax()]
    assert ends == pytest.approx((-2.68034863, 2.09965137, 0.02, -0.00034863), abs=1e-7)
    # The reference counts deviations from the mean rounded to a step of 0.02 DN.
    at = int(np.searchsorted(found.deviation, 2.0))
    assert found.percent_beyond[at] == pytest.approx(0.040364583, rel=1e-6)


def test_the_high_pass_removes_the_uneven_light(calibration):
    """The unfiltered value includes the shading of the illumination."""
    found = calibration.emva1288
    assert found["PRNU1288"].value == pytest.approx(0.260, abs=0.002)
    assert found["PRNU1288"].value < 0.65 * found["PRNU1288_unfiltered"].value


def test_the_paper_s_prnu_includes_the_shading(calibration):
    assert calibration.prnu_percent.value == pytest.approx(calibration.prnu1288_unfiltered_percent.value, rel=0.02)


def test_the_bend_of_the_response_is_found(calibration):
    """Photon transfer points give 0.289 DN/e- at little light and 0.277 at 70 % of saturation; the line gives 0.280."""
    gain = calibration.system_gain_dn_per_e
    assert gain.value == pytest.approx(0.290, abs=0.002)
    assert gain.standard_uncertainty < 0.003
    levels = [level for level in calibration.curves["M"]["photon_transfer"].x if 100.0 < level < 500.0]
    points = calibration.curves["M"]["photon_transfer"]
    at_small_signal = np.mean([points.y[points.x == level][0] / level for level in levels])
    assert gain.interval_95[0] < at_small_signal < gain.interval_95[1]
    assert "bent-response" in limits(calibration)


def test_all_frames_are_used(calibration):
    assert calibration.frame_count == 300
    assert calibration.rejected == ()
    assert calibration.saturation_dn.value == 4095.0
    assert calibration.linear_range["M"].levels == 27


def test_scatter_beyond_sampling_gives_a_warning(calibration):
    """Steps of the converter that differ by up to 10 %, and the bend."""
    line = calibration.curves["M"]["photon_transfer"]
    assert line.extra_variance > 4.0 * float(np.median(line.y_uncertainty[line.used])) ** 2
    assert limits(calibration)["scattered-photon-transfer"] > 2.0


def test_unequal_steps_of_the_converter_are_no_digital_gain(calibration):
    assert "digital-gain" not in limits(calibration)
