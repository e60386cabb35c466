"""Frames of a virtual camera against simulations with true and with wrong conditions.

The measured chip is never the simulated one: another serial, so another fixed pattern, and other noise.
"""

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import kstest

import photosite as ps
from photosite.errors import InputError
from photosite.scene.charts import MACBETH_NAMES, macbeth
from photosite.scene.placement import in_perspective
from photosite.validation.fill_factor import fit_fill_factor
from photosite.validation.frame_validation import CaptureConditions, validate_frames
from photosite.validation.lamp import Lamp
from photosite.values.cfa import NAMED

SHAPE = (150, 224)
CORNERS = ((10.0, 22.0), (4.0, 214.0), (144.0, 206.0), (132.0, 12.0))
LENS = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
SENSOR = ps.load_sensor("nikon-d200").with_(black_level_dn=64)
CONDITIONS = CaptureConditions(SENSOR, LENS, Lamp.from_name("A"), luminance_cd_m2=40.0)


@lru_cache
def light(illuminant="A", luminance=40.0, uneven=0.0):
    """Mean electrons in 1 s at fill factor 0.9."""
    scene = in_perspective(macbeth(illuminant, luminance), CORNERS, SHAPE)
    slope = 1 + uneven * np.linspace(-0.5, 0.5, scene.shape[1])
    scene = replace(scene, weights=(scene.weights * slope).astype(np.float32))
    return camera().mean_electrons(scene, 1.0)


@lru_cache
def camera(serial="measured", **changes):
    return ps.Camera(LENS, SENSOR.with_(rows=SHAPE[0], cols=SHAPE[1], serial=serial, **changes))


def shots(seed, frames=1, *, exposure_s=1 / 3, illuminant="A", luminance=40.0, uneven=0.0, **changes):
    """Frames of a chip of their own."""
    mean = light(illuminant, luminance, uneven) * np.float32(exposure_s)
    mean = mean * np.float32(changes.get("fill_factor", 0.9) / 0.9)
    chip = camera(f"measured {seed}", **changes)
    return [chip.expose(mean, exposure_s, seed=1000 + seed, frame=number) for number in range(frames)]


@pytest.mark.parametrize(
    ("fit", "frames", "chips", "most_misses"),
    [
        # At a false-alarm rate of 0.05, 5 of 12 chips disagree by chance once in 5500, 8 of 40 once in 1100.
        (None, 1, 12, 4),
        pytest.param(None, 1, 40, 7, marks=pytest.mark.slow),
        pytest.param("fill_factor", 2, 40, 7, marks=pytest.mark.slow),
    ],
)
def test_the_right_camera_agrees_at_the_stated_level(fit, frames, chips, most_misses):
    results = [validate_frames(shots(seed, frames), CONDITIONS, CORNERS, fit=fit, seed=seed) for seed in range(chips)]
    assert sum(not result.agrees for result in results) <= most_misses
    # The p-values of the means are uniform (Kolmogorov-Smirnov at 0.001).
    assert kstest([result.validation.means.p_value for result in results], "uniform").pvalue > 1e-3
    if fit is not None:
        assert {result.validation.means.degrees_of_freedom for result in results} == {71}
        inside = [result.fit.interval_95[0] < 0.9 < result.fit.interval_95[1] for result in results]
        assert sum(inside) >= chips - most_misses


WRONG = {
    "exposure": (replace(CONDITIONS, exposure_s=0.32), CORNERS, 1 / 3 / 0.32),
    "level of light": (replace(CONDITIONS, luminance_cd_m2=41.0), CORNERS, 40 / 41),
    "f-number": (replace(CONDITIONS, optics=ps.DiffractionLimited(f_number=7.1, focal_length_mm=50)), CORNERS, None),
    "fill factor": (replace(CONDITIONS, sensor=SENSOR.with_(fill_factor=0.88)), CORNERS, 0.9 / 0.88),
    "gain": (replace(CONDITIONS, sensor=SENSOR.with_(conversion_gain_uv_per_e=31.0)), CORNERS, 30 / 31),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_common_scale_is_reported_with_its_size(wrong):
    conditions, corners, ratio = WRONG[wrong]
    result = validate_frames(shots(50), conditions, corners, seed=50)
    assert not result.agrees
    slope = result.validation.regression.slope_through_origin
    if ratio is not None:  # 2e-3 is four standard errors of the ratio of patches of this size
        assert slope.value == pytest.approx(ratio, abs=2e-3)
    assert abs(slope.value - 1) > 0.01
    assert "all channels share the ratio" in result.diagnosis[-1]


def test_a_wrong_lamp_is_reported():
    for name, fit in (("3000K", "fill_factor"), ("FL4", "light")):  # no level of light makes up for a spectrum
        result = validate_frames(shots(60), replace(CONDITIONS, lamp=Lamp.from_name(name)), CORNERS, fit=fit)
        assert not result.validation.agrees, name
    result = validate_frames(shots(60), replace(CONDITIONS, lamp=Lamp.from_name("D65")), CORNERS)
    ratios = {name: line.slope_through_origin.value for name, line in result.validation.regression_by_channel.items()}
    assert ratios["R"] > 1.3
    assert ratios["B"] < 0.5
    assert "the channels have different ratios" in result.diagnosis[-1]


def test_a_wrong_sensor_is_reported():
    result = validate_frames(shots(61), replace(CONDITIONS, sensor=ps.load_sensor("vendor-2.2um")), CORNERS)
    assert not result.agrees
    assert any("bit depths differ: 12 bits in the frames, 10 in the sensor file" in line for line in result.reasons)
    assert any("channel G: measured is" in line for line in result.reasons)
    noisy = validate_frames(shots(62), replace(CONDITIONS, sensor=SENSOR.with_(prnu_percent=1.7)), CORNERS)
    assert not noisy.agrees
    assert noisy.validation.noise.p_value < 1e-3 < noisy.validation.means.p_value
    assert noisy.diagnosis == ()


def test_frame_to_frame_noise_is_separate_from_the_fixed_pattern():
    # Read noise and DSNU exchanged: the same spread over pixels, not the same from frame to frame.
    conditions = replace(CONDITIONS, sensor=SENSOR.with_(read_noise_mv=1.8, dsnu_mv=0.52))
    result = validate_frames(shots(63, frames=4, read_noise_mv=0.52, dsnu_mv=1.8), conditions, CORNERS)
    assert result.validation.temporal_noise.p_value < 1e-6
    assert result.validation.noise.p_value > 1e-2
    assert "noise from frame to frame differ" in "; ".join(result.reasons)
    right = validate_frames(shots(63, frames=4), CONDITIONS, CORNERS)
    assert right.agrees
    assert len(right.validation.tests) == 3


def test_another_cfa_is_reported():
    frames = shots(64)
    conditions = replace(CONDITIONS, sensor=SENSOR.with_(cfa="gbrg"))
    result = validate_frames(frames, conditions, CORNERS)
    assert not result.agrees
    assert result.contradictions[0].startswith("the color filter arrays differ: RG/GB")
    assert result.diagnosis[0].startswith("the color filter array is RG/GB: ")
    # Files without a CFA: no contradiction, but the same diagnosis.
    bare = [replace(frame, cfa=NAMED["mono"]) for frame in frames]
    without_cfa = validate_frames(bare, conditions, CORNERS)
    assert without_cfa.contradictions == ()
    assert not without_cfa.agrees
    assert without_cfa.diagnosis == result.diagnosis
    assert validate_frames(bare, CONDITIONS, CORNERS).agrees


@pytest.mark.parametrize(
    ("turn", "orientation"),
    [((3, 0, 1, 2), "turned by 90 degrees clockwise"), ((1, 0, 3, 2), "mirrored, left for right")],
)
def test_another_orientation_of_the_chart_is_reported(turn, orientation):
    corners = tuple(CORNERS[i] for i in turn)
    result = validate_frames(shots(65), CONDITIONS, corners)
    assert not result.agrees
    assert result.diagnosis[0].startswith(f"the chart is {orientation}: ")


def test_corners_half_a_patch_off_do_not_agree():
    shifted = tuple((row, col + 4.0) for row, col in CORNERS)
    assert validate_frames(shots(66), CONDITIONS, shifted).agrees  # the middles of patches are still patches
    beside = tuple((row, col + 9.0) for row, col in CORNERS)
    result = validate_frames(shots(66), CONDITIONS, beside)
    assert not result.agrees
    assert any("corners" in line for line in result.diagnosis)


def test_uneven_light_differs_unless_it_is_within_the_tolerance():
    # 3 % from left to right: patches differ by up to 1.5 %.
    frames = shots(67, uneven=0.03)
    assert not validate_frames(frames, CONDITIONS, CORNERS).agrees
    assert validate_frames(frames, CONDITIONS, CORNERS, tolerance_percent=2).agrees


def test_the_fitted_fill_factor_is_the_hidden_one():
    result = validate_frames(shots(68, frames=3, fill_factor=0.83), CONDITIONS, CORNERS, fit="fill_factor")
    assert result.agrees
    # One in 2000 is farther out than 3.5 standard errors.
    assert abs(result.fit.value - 0.83) < 3.5 * result.fit.standard_error < 3e-3
    assert result.fit.simulated_with == 0.9
    # The error to two digits, and the value to the error's last.
    assert f"fitted: fill factor {result.fit.value:.5f} ± {result.fit.standard_error:.5f} " in result.fit_summary
    assert 9.5e-5 < result.fit.standard_error < 9.5e-4
    again = fit_fill_factor(result.validation.measured, result.validation.simulated, result.fit.value)
    assert again.value == pytest.approx(result.fit.value, rel=1e-3)  # what was simulated in the end is the fit


def test_a_fill_factor_above_one_is_a_contradiction():
    conditions = replace(CONDITIONS, exposure_s=0.25)
    result = validate_frames(shots(69), conditions, CORNERS, fit="fill_factor")
    assert result.validation.agrees  # the patches do, at 1.2
    assert not result.agrees
    assert "is above 1" in result.contradictions[0]


def test_the_level_of_light_fitted():
    conditions = replace(CONDITIONS, luminance_cd_m2=None)
    result = validate_frames(shots(70), conditions, CORNERS, fit="light")
    assert result.agrees
    assert result.conditions.luminance_cd_m2 == pytest.approx(40, rel=2e-3)
    assert "mean luminance of the patches" in result.fit_summary
    assert "cd/m2" in result.fit_summary
    with pytest.raises(InputError) as caught:
        validate_frames(shots(70), conditions, CORNERS)
    assert set(caught.value.arguments) == {"luminance_cd_m2", "fit"}


def test_the_simulated_chip_is_another_than_any():
    # Measured by a chip of the sensor file's own serial, whose fixed pattern a simulation could have by accident.
    own = ps.Camera(LENS, SENSOR.with_(rows=SHAPE[0], cols=SHAPE[1]))
    result = validate_frames([own.expose(light() / np.float32(3), 1 / 3, seed=5)], CONDITIONS, CORNERS)
    assert result.simulated.metadata["serial"] != own.sensor.serial
    # The same pattern in both would bring the sum to half of its degrees of freedom or less.
    assert result.validation.means.p_value < 0.999


def test_notes_list_assumptions():
    small = SENSOR.with_(rows=SHAPE[0], cols=SHAPE[1])
    assert validate_frames(shots(71), replace(CONDITIONS, sensor=small), CORNERS).notes == ()
    notes = " ".join(validate_frames(shots(71), CONDITIONS, CORNERS).notes)
    assert "the frames have 150 x 224 pixels and the sensor file 2592 x 3872" in notes
    other = replace(CONDITIONS, sensor=small.with_(black_level_dn=0))
    assert "black level is 64 DN, the sensor file's 0 DN" in validate_frames(shots(71), other, CORNERS).notes[0]


def test_the_dictionary_is_strict_json():
    result = validate_frames(shots(72, frames=2), CONDITIONS, CORNERS, fit="fill_factor")
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["agrees"] is result.agrees
    assert data["patches"] == list(MACBETH_NAMES)
    assert data["fit"]["value"] == result.fit.value
    assert (data["fitted"], data["frames"], data["exposure_s"]) == ("fill_factor", [2, 2], 1 / 3)
    assert data["temporal_noise"]["degrees_of_freedom"] == 72


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"measured": []}, "measured"),
        ({"fit": "read_noise"}, "fit"),
        ({"corners": ((10, 22), (4, 230), (144, 206), (132, 12))}, "corner"),
        ({"corners": ((10, 22), (144, 206), (4, 214), (132, 12))}, "corners"),
        ({"conditions": replace(CONDITIONS, exposure_s=0.0)}, "exposure"),
    ],
)
def test_invalid_calls(change, what):
    arguments = {"measured": shots(73), "conditions": CONDITIONS, "corners": CORNERS} | change
    with pytest.raises(InputError) as caught:
        validate_frames(**arguments)
    assert what in caught.value.what


def test_frames_without_an_exposure_time():
    frames = [replace(frame, exposure_s=None) for frame in shots(74)]
    with pytest.raises(InputError) as caught:
        validate_frames(frames, CONDITIONS, CORNERS)
    assert set(caught.value.arguments) == {"exposure_s"}
    assert validate_frames(frames, replace(CONDITIONS, exposure_s=1 / 3), CORNERS).agrees
