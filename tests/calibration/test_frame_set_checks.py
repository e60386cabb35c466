"""Invalid frame sets give an error with fields; valid ones are calibrated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.setting import calibrate_setting
from photosite.errors import CalibrationError, FileError, InputError
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
from photosite.frames.raw_frame import RawFrame
from photosite.values.diagnostic import Diagnostic


def stack(level, *, noise=2.0, n=4, shape=(24, 32), seed=0):
    rng = np.random.default_rng([seed, int(10 * abs(level))])
    return [np.clip(np.round(rng.normal(level, noise, shape)), 0, 4095).astype(np.uint16) for _ in range(n)]


def measurement(dark=64.0, lights=((0.01, 500.0), (0.02, 1000.0)), n=4, dark_frames=4, exposures=(0.01, 0.02)):
    frames = [("dark", t, dn) for t in exposures for dn in stack(dark, n=dark_frames, seed=round(1e4 * t))]
    frames += [("light", t, dn) for t, level in lights for dn in stack(level, noise=15, n=n)]
    return frames


def frame_set(frames, **options):
    return FrameSet.from_arrays(frames, bits=12, **options)


def error_of(frames, **options):
    with pytest.raises(CalibrationError) as caught:
        calibrate(frame_set(frames, **options))
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.fixture(scope="module")
def clean():
    return calibrate(frame_set(measurement()))


def test_a_valid_measurement_passes(clean):
    assert clean.read_noise_dn.value == pytest.approx(2.0, rel=0.1)
    assert clean.rejected == ()


def at_temperatures(dark_c, light_c):
    celsius = {"dark": dark_c, "light": light_c}
    return frame_set([(kind, t, dn, None, None, celsius[kind]) for kind, t, dn in measurement()])


@pytest.mark.parametrize(("light_c", "size"), [(28.0, 8.0), (14.0, -6.0), (21.5, None), (None, None)])
def test_flat_fields_at_another_stated_temperature_are_named(light_c, size):
    found = {entry.id: entry for entry in calibrate(at_temperatures(20.0, light_c)).diagnostics}
    assert ("other-temperature" in found) == (size is not None)
    if size is not None:
        assert found["other-temperature"].size == pytest.approx(size)
        assert {"prnu_percent", "responsivity_dn_per_photon"} <= set(found["other-temperature"].parameters)


@pytest.mark.parametrize("black", [0.0, 2.0, 4.0])
def test_clipped_blacks_are_calibrated_with_a_warning(black):
    calibration = calibrate(frame_set(measurement(dark=black, n=8, dark_frames=8)))
    for name, truth in (("read_noise_dn", 2.0), ("black_level_dn", black)):
        entry = getattr(calibration, name)
        assert abs(entry.value - truth) < 3.3 * entry.standard_uncertainty, name
    assert "clipped-darks" in limits(calibration)


def test_blacks_clipped_too_far():
    error = error_of(measurement(dark=-6.0))
    assert (error.id, error.where) == ("darks-clipped-too-far", "memory: dark frames at 0.01 s")


def test_a_few_zeros_widen_the_uncertainty():
    frames = measurement(dark=8.0)
    clean = calibrate(frame_set(frames))
    frames[0][2][0, :2] = 0
    calibration = calibrate(frame_set(frames))
    assert calibration.read_noise_dn.standard_uncertainty > clean.read_noise_dn.standard_uncertainty


def test_the_clipped_channel_of_a_mosaic_is_named():
    frames = measurement(dark=64.0)
    for _, _, dn in frames[:4]:
        dn[1::2, 1::2] = 0
    error = error_of(frames, cfa=(("R", "G"), ("G", "B")))
    assert error.where.endswith("channel B")
    assert error.what == "all numbers are clipped at 0 DN"


def equal_photons():
    frames = [("dark", t, dn, 0.0) for t in (0.01, 0.02) for dn in stack(64.0)]
    return frames + [("light", t, dn, 1e3) for t, y in ((0.01, 500.0), (0.02, 936.0)) for dn in stack(y, noise=15)]


def swapped():
    return [("light" if kind == "dark" else "dark", t, dn) for kind, t, dn in measurement()]


@pytest.mark.parametrize(
    ("frames", "problem"),
    [
        (equal_photons(), "all 2 light levels state 1000 photons per pixel"),
        (swapped(), "the brightest light frames at 0.01 s have a mean of"),
        (measurement(dark=4094.0), "dark frames cannot be saturated"),
    ],
)
def test_frames_that_cannot_support_a_calibration(frames, problem):
    error = error_of(frames)
    assert problem in error.what
    assert error.where.startswith("memory")
    assert error.hint


def test_several_gain_settings_are_refused_and_one_of_them_passes(clean):
    frames = [(*entry, None, gain) for gain in (100.0, 400.0) for entry in measurement()]
    with pytest.raises(CalibrationError) as caught:
        calibrate_setting(frame_set(frames))
    assert caught.value.id == "several-gain-settings"
    assert calibrate(frame_set(frames).at_gain(400)).read_noise_dn == clean.read_noise_dn


def test_diagnostics_of_the_frame_set_are_those_of_the_calibration():
    noted = Diagnostic("kind-by-level", "warning", "the lamp hummed")
    found = calibrate(replace(frame_set(measurement()), diagnostics=(noted,)))
    assert found.diagnostics[0] == noted
    assert found.warnings[0] == noted.text


def test_one_exposure_with_several_photon_counts_is_valid():
    """EMVA 1288 allows a constant exposure time and a lamp that varies."""
    frames = [("dark", 0.01, dn, 0.0) for dn in stack(64.0)]
    frames += [("light", 0.01, dn, p) for p, y in ((1e3, 500.0), (2e3, 936.0)) for dn in stack(y, noise=15)]
    calibration = calibrate(frame_set(frames))
    assert calibration.quantum_efficiency_percent.value is not None
    assert calibration.prnu_percent.value is not None
    assert calibration.dark_voltage_mv_per_s.reason_id == "one-dark-exposure"


def test_copies_are_left_out_and_named(clean):
    frames = measurement()
    kind, exposure, dn = frames[1]
    frames.insert(2, (kind, exposure, dn.copy()))
    calibration = calibrate(frame_set(frames))
    assert [entry.id for entry in calibration.diagnostics if entry.severity == "left out"] == ["repeated-frame"]
    assert limits(calibration)["frames-left-out"] == 1
    assert calibration.read_noise_dn == clean.read_noise_dn
    assert calibration.frames_sha256 == clean.frames_sha256


def test_equal_saturated_frames_are_not_copies():
    frames = measurement()
    white = np.full((24, 32), 4095, np.uint16)
    frames += [("light", 0.1, white.copy()) for _ in range(3)]
    calibration = calibrate(frame_set(frames))
    assert calibration.rejected == ()
    assert calibration.saturation_dn.value == 4095.0


@pytest.mark.parametrize(
    ("dn", "problem"),
    [
        (np.full((24, 30), 64, np.uint16), "the frame is (24, 30) of uint16"),
        (np.full((24, 32), 5000, np.uint16), "the frame holds 5000 DN, above 4095 DN"),
    ],
)
def test_a_frame_of_another_size_or_range_is_a_file_error(dn, problem):
    frames = frame_set(measurement())
    group = frames.groups[0]
    bad = FrameSource("bad.tif", lambda: dn)
    changed = FrameGroup(group.kind, group.exposure_s, (*group.frames[:-1], bad), group.photons_per_pixel)
    with pytest.raises(FileError) as caught:
        calibrate(replace(frames, groups=(changed, *frames.groups[1:])))
    assert caught.value.path == "bad.tif"
    assert caught.value.what.startswith(problem)


@pytest.mark.parametrize(("changes", "field", "value"), [({"bits": 10}, "bits", 10), ({"cfa": "rggb"}, "cfa", "RG/GB")])
def test_a_sensor_that_did_not_take_the_frames(virtual, changes, field, value):
    with pytest.raises(InputError) as caught:
        calibrate(frame_set(measurement()), virtual.sensor(0, **changes))
    assert (caught.value.what, caught.value.value) == (field, value)
    assert caught.value.where == "sensor 'virtual 0'"


@pytest.mark.parametrize(("wrong", "hint"), [("st", "'st'"), (Path("st"), "'st'"), (3, "...")])
def test_an_argument_that_is_not_a_frame_set(wrong, hint):
    with pytest.raises(InputError) as caught:
        calibrate(wrong)
    assert (caught.value.what, caught.value.value, caught.value.expected) == (
        "frames",
        wrong,
        "a FrameSet, or one for each capture by name",
    )
    assert f"open_frames({hint})" in caught.value.hint


def labelled(exposure_s):
    """Frames of stated photons, with one exposure time for all."""
    rng = np.random.default_rng(7)
    response = 1.0 + 0.01 * rng.standard_normal((48, 64))
    frames = [("dark", exposure_s, dn, 0.0) for dn in stack(64.0, n=8, shape=(48, 64))]
    for i in range(1, 15):
        for _ in range(4):
            dn = 64.0 + 0.3 * rng.poisson(1100.0 * i * response) + 2.0 * rng.standard_normal((48, 64))
            frames.append(("light", exposure_s, np.clip(np.rint(dn), 0, 4095).astype(np.uint16), 2200.0 * i))
    return frames


def test_exposures_of_zero_with_photons_are_labels():
    """Results do not depend on the label, and none needs a time."""
    zero, stated = (calibrate(frame_set(labelled(t))) for t in (0.0, 0.02))
    for name, estimate in zero.estimates().items():
        other = stated.estimates()[name]
        assert (estimate.value, estimate.interval_95) == (other.value, other.interval_95), name
    for name in ("dark_current_e_per_s", "dark_current_from_variance_e_per_s", "dark_voltage_mv_per_s", "dcnu_percent"):
        assert getattr(zero, name).value is None
    low, high = zero.quantum_efficiency_percent.interval_95
    assert low <= 50.0 <= high
    assert "exposure-unit" not in limits(zero)


def test_exposures_of_zero_and_others():
    frames = labelled(0.0) + [("dark", 0.02, dn, 0.0) for dn in stack(64.0, shape=(48, 64))]
    assert error_of(frames).id == "invalid-exposure-time"
    bias = [("dark", 0.0, dn) for dn in stack(64.0, n=4)]
    assert calibrate(frame_set(bias + measurement())).dark_current_dn_per_s.value is not None


def test_series_of_light_frames_may_start_at_zero(tmp_path):
    """A descriptor whose exposures are 0, 40, ... ms: the shortest flat fields have hardly any light."""
    rng = np.random.default_rng(11)
    response = 1.0 + 0.01 * rng.standard_normal((48, 64))
    lines = ["v 3.0", "n 12 64 48"]
    for number in range(12):
        for command, photons in (("b", 0.7 + 1200.0 * number), ("d", None)):
            lines.append(f"{command} {40e6 * number:.2f}" + (f" {photons:.2f}" if photons is not None else ""))
            for repeat in range(4):
                electrons = rng.poisson((photons or 0.0) * 0.5 * response) + rng.poisson(0.8 * number, response.shape)
                dn = np.rint(64.0 + 0.3 * electrons + 2.0 * rng.standard_normal(response.shape)).astype(np.uint16)
                name = f"{command}_{number}_{repeat}.png"
                RawFrame(dn, 12, (("M",),)).save(tmp_path / name)
                lines.append(f"i {name}")
    (tmp_path / "EMVA1288_Data.txt").write_text("\n".join(lines) + "\n")
    found = calibrate(ps.open_frames(tmp_path / "EMVA1288_Data.txt"))
    truths = {"system_gain_dn_per_e": 0.3, "quantum_efficiency_percent": 50.0, "dark_current_e_per_s": 20.0}
    for name, truth in truths.items():
        entry = getattr(found, name)
        assert abs(entry.value - truth) < 3.9 * entry.standard_uncertainty, name
    assert not {"wrong-light-levels", "constant-light", "light-leak"} & set(limits(found))
