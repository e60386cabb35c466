"""300 frames of a real 12-bit CCD camera against the results of the EMVA 1288 reference implementation.

Frames: Basler AG, CC BY-SA 3.0. Results of the same definition agree to 0.5 % (table in docs/emva-reference.md).
"""

from dataclasses import replace

import numpy as np
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
    "dsnu1288_column_e": 0.54056,
    "prnu1288_unfiltered_row_percent": 0.32327,
    "prnu1288_unfiltered_column_percent": 0.11133,
    "prnu1288_unfiltered_pixel_percent": 0.26521,
}

PAIRS_ALONE = {
    "linearity_error_min_percent": -0.6157976,
    "linearity_error_max_percent": 0.4804483,
}
"""The reference's results from two frames per level; it uses its 50 frames for the spatial parameters only."""


BETWEEN_EXPOSURES = {"saturation_capacity_photons", "saturation_capacity_e"}
"""The reference takes the exposure with the largest variance, photosite the middle of the interval in which the maximum
can lie: half of a 2 % step higher, less the effect of the gradual clipping."""


@pytest.fixture(scope="module")
def calibration(emva_frames):
    return calibrate(open_frames(emva_frames))


def test_agrees_with_the_reference_implementation(calibration):
    for name, value in REFERENCE_IMPLEMENTATION.items():
        estimate = getattr(calibration, name)
        assert estimate.value == pytest.approx(value, rel=1e-2 if name in BETWEEN_EXPOSURES else 5e-3), name
        low, high = estimate.interval_95
        assert low < value < high, name


@pytest.fixture(scope="module")
def pairs_alone(emva_frames):
    frames = open_frames(emva_frames)
    return calibrate(replace(frames, groups=tuple(group for group in frames.groups if len(group) == 2)))


def test_linearity_of_the_same_frames_equals_the_reference(pairs_alone):
    for name, value in PAIRS_ALONE.items():
        assert getattr(pairs_alone, name).value == pytest.approx(value, rel=1e-6)
    fit = pairs_alone.linearity["M"].relative
    assert (fit.slope, fit.intercept) == pytest.approx((0.12629093, 5.120069), rel=1e-6)


def test_linearity_with_the_stack_among_the_levels(calibration):
    """One additional level in the middle shifts the line slightly."""
    for name, value in PAIRS_ALONE.items():
        assert getattr(calibration, name).value == pytest.approx(value, rel=8e-3)
    assert calibration.linearity_error_percent.value == pytest.approx(0.2925, abs=1e-3)
    assert calibration.linearity["M"].used.sum() == 34


def test_dark_current_intervals_contain_the_reference(calibration, pairs_alone):
    """The reference weights all exposures equally: plain least squares through the same points gives its values."""
    for kind, power, name, value in (
        ("dark_signal", 1, "dark_current_e_per_s", 28.479107),
        ("dark_variance", 2, "dark_current_from_variance_e_per_s", 69.971699),
    ):
        curve = pairs_alone.curves["M"][kind]
        plain = np.polyfit(curve.x, curve.y, 1)[0] / 0.28006265**power
        assert plain == pytest.approx(value, rel=1e-5)
        low, high = getattr(calibration, name).interval_95
        assert low < value < high
    assert not any("and from the variance" in warning for warning in calibration.warnings)


def test_row_noise_is_not_a_row_pattern(calibration):
    """The reference's pixel part is the root of -0.0042 DN^2, its row part 0.26 e-: it subtracts the row noise left in
    the mean of 50 frames from the pixels."""
    for part, most in (("pixel", 0.3), ("row", 0.13)):
        low, high = getattr(calibration, f"dsnu1288_{part}_e").interval_95
        assert 0.0 < high < most
        assert low < 0.1
    assert not any("negative" in warning for warning in calibration.warnings)


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
    assert calibration.prnu1288_percent.value == pytest.approx(0.260, abs=0.002)
    assert calibration.prnu1288_percent.value < 0.65 * calibration.prnu1288_unfiltered_percent.value


def test_the_paper_s_prnu_includes_the_shading(calibration):
    assert calibration.prnu_percent.value == pytest.approx(calibration.prnu1288_unfiltered_percent.value, rel=0.02)


def test_all_frames_are_used(calibration):
    assert calibration.frame_count == 300
    assert calibration.rejected == ()
    assert calibration.saturation_dn.value == 4095.0
    assert calibration.linear_range["M"].levels == 27


def test_scatter_beyond_sampling_gives_a_warning(calibration):
    assert any("scatter" in warning for warning in calibration.warnings)
