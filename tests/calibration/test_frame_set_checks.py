"""Bad input: one line that says what is wrong, where, and what to do; and nothing refused that is good."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.groups import CLIPPED_DARK_SHARE, Level, clipping_bias
from photosite.engine.frame_sums import FrameSums
from photosite.errors import CalibrationError, FileError, InputError
from photosite.frames.frame_set import FrameGroup, FrameSource, frame_set_from_arrays


def stack(level, *, noise=2.0, n=4, shape=(24, 32), seed=0):
    rng = np.random.default_rng([seed, int(10 * abs(level))])
    return [np.clip(np.round(rng.normal(level, noise, shape)), 0, 4095).astype(np.uint16) for _ in range(n)]


def measurement(dark=64.0, lights=((0.01, 500.0), (0.02, 1000.0)), n=4, dark_frames=4, exposures=(0.01, 0.02)):
    frames = [("dark", t, dn) for t in exposures for dn in stack(dark, n=dark_frames, seed=round(1e4 * t))]
    frames += [("light", t, dn) for t, level in lights for dn in stack(level, noise=15, n=n)]
    return frames


def frame_set(frames, **options):
    return frame_set_from_arrays(frames, bits=12, **options)


def one_line(error):
    return "\n" not in str(error.value)


def test_a_good_measurement_passes():
    calibration = calibrate(frame_set(measurement()))
    assert calibration.read_noise_dn.value == pytest.approx(2.0, rel=0.1)
    assert calibration.rejected == ()


@pytest.mark.parametrize("black", [0.0, 2.0, 4.0])
def test_clipped_blacks_are_calibrated_and_it_is_said(black):
    calibration = calibrate(frame_set(measurement(dark=black, n=8, dark_frames=8)))
    for name, truth in (("read_noise_dn", 2.0), ("black_level_dn", black)):
        entry = getattr(calibration, name)
        assert abs(entry.value - truth) < 3.3 * entry.standard_uncertainty, name
        assert "censored maximum likelihood" in entry.method
    assert any("the darks are clipped at 0" in warning for warning in calibration.warnings)


def test_blacks_of_which_too_little_is_left_are_refused():
    with pytest.raises(
        CalibrationError, match=r"clipped at 0 DN.*too little is left.*raise the camera's black"
    ) as error:
        calibrate(frame_set(measurement(dark=-6.0)))
    assert one_line(error)
    assert "dark frames at 0.01 s" in str(error.value)


def test_a_handful_of_zeros_passes_and_widens_the_uncertainty():
    frames = measurement()
    frames[0][2][0, :2] = 0
    clean = calibrate(frame_set(measurement()))
    calibration = calibrate(frame_set(frames))
    assert calibration.read_noise_dn.standard_uncertainty > clean.read_noise_dn.standard_uncertainty


def test_the_bound_on_clipping_is_that_of_a_clipped_normal():
    """Against 10 million draws (four standard errors); what is let through makes the read noise 0.5 % low at most."""
    x = np.random.default_rng(0).normal(size=10_000_000)
    for fraction in (CLIPPED_DARK_SHARE, 0.05, 0.3):
        clipped = np.maximum(x, np.quantile(x, fraction))
        assert clipping_bias(fraction) == pytest.approx(clipped.var() / x.var() - 1, abs=1e-3)
    assert 1 - np.sqrt(1 + clipping_bias(CLIPPED_DARK_SHARE)) == pytest.approx(0.0045, abs=1e-4)


def test_a_mosaic_names_the_clipped_channel():
    frames = measurement(dark=64.0)
    for _, _, dn in frames[:4]:
        dn[1::2, 1::2] = 0
    with pytest.raises(CalibrationError, match=r"channel B: all numbers are clipped at 0 DN"):
        calibrate(frame_set(frames, cfa=(("R", "G"), ("G", "B"))))


def test_one_exposure_only_is_refused():
    frames = measurement(lights=((0.01, 500.0),), exposures=(0.01,))
    with pytest.raises(CalibrationError, match=r"all 8 frames have one exposure, 0.01 s") as error:
        calibrate(frame_set(frames))
    assert one_line(error)


def test_several_gain_settings_are_refused_and_one_of_them_passes():
    frames = [(*entry, None, gain) for gain in (100.0, 400.0) for entry in measurement()]
    with pytest.raises(
        CalibrationError, match=r"2 gain settings \(100, 400\).*at_gain\(setting\), or calibrate_series"
    ) as e:
        calibrate(frame_set(frames))
    assert one_line(e)
    one = calibrate(frame_set(frames).at_gain(400))
    assert one.read_noise_dn == calibrate(frame_set(measurement())).read_noise_dn


def test_what_was_noted_of_the_frames_is_among_the_warnings():
    noted = replace(frame_set(measurement()), notes=("the lamp hummed",))
    assert calibrate(noted).warnings[0] == "the lamp hummed"


def test_one_light_exposure_is_refused():
    with pytest.raises(CalibrationError, match=r"all light frames have one exposure, 0\.01 s"):
        calibrate(frame_set(measurement(lights=((0.01, 500.0),))))


def test_one_exposure_with_several_photon_counts_is_a_measurement():
    """EMVA 1288 allows a constant exposure and a lamp that varies."""
    frames = [("dark", 0.01, dn, 0.0) for dn in stack(64.0)]
    frames += [("light", 0.01, dn, p) for p, y in ((1e3, 500.0), (2e3, 936.0)) for dn in stack(y, noise=15)]
    calibration = calibrate(frame_set(frames))
    assert calibration.quantum_efficiency_percent.value is not None
    assert calibration.prnu_percent.value is not None
    assert "one exposure only" in calibration.dark_voltage_mv_per_s.reason


def test_levels_that_all_state_the_same_light_are_refused():
    frames = [("dark", t, dn, 0.0) for t in (0.01, 0.02) for dn in stack(64.0)]
    frames += [("light", t, dn, 1e3) for t, y in ((0.01, 500.0), (0.02, 936.0)) for dn in stack(y, noise=15)]
    with pytest.raises(CalibrationError, match=r"all 2 light levels state the same light, 1000 photons.*leave") as e:
        calibrate(frame_set(frames))
    assert one_line(e)


def test_no_darks_are_refused():
    with pytest.raises(CalibrationError, match="no dark frames"):
        calibrate(frame_set([f for f in measurement() if f[0] == "light"]))


def test_darks_taken_once_are_refused():
    with pytest.raises(CalibrationError, match="every dark exposure was taken once"):
        calibrate(frame_set(measurement(dark_frames=1)))


def test_copies_are_left_out_and_named():
    frames = measurement()
    kind, exposure, dn = frames[1]
    frames.insert(2, (kind, exposure, dn.copy()))
    calibration = calibrate(frame_set(frames))
    assert len(calibration.rejected) == 1
    assert "repeats" in calibration.rejected[0]
    assert any("1 repeated or broken frames were left out" in warning for warning in calibration.warnings)
    clean = calibrate(frame_set(measurement()))
    assert calibration.read_noise_dn == clean.read_noise_dn
    assert calibration.frames_sha256 == clean.frames_sha256


def test_darks_that_are_all_copies_are_refused():
    frames = [(kind, t, stack(64.0, n=1)[0] if kind == "dark" else dn) for kind, t, dn in measurement()]
    with pytest.raises(CalibrationError, match="without repeated files no dark exposure has two frames"):
        calibrate(frame_set(frames))


def test_copies_of_saturated_frames_are_no_copies():
    frames = measurement()
    white = np.full((24, 32), 4095, np.uint16)
    frames += [("light", 0.1, white.copy()) for _ in range(3)]
    calibration = calibrate(frame_set(frames))
    assert calibration.rejected == ()
    assert calibration.saturation_dn.value == 4095.0


def test_lights_darker_than_darks_are_refused():
    swapped = [("light" if kind == "dark" else "dark", t, dn) for kind, t, dn in measurement()]
    with pytest.raises(CalibrationError, match="no more than the darks'"):
        calibrate(frame_set(swapped))


def test_saturated_darks_are_refused():
    with pytest.raises(CalibrationError, match="dark frames cannot be saturated"):
        calibrate(frame_set(measurement(dark=4094.0)))


def set_with_a_bad_frame(dn):
    frames = frame_set(measurement())
    bad = FrameSource("bad.tif", lambda: dn)
    group = frames.groups[0]
    changed = FrameGroup(group.kind, group.exposure_s, (*group.frames[:-1], bad), group.photons_per_pixel)
    return replace(frames, groups=(changed, *frames.groups[1:]))


def test_a_frame_of_another_size_is_a_file_error():
    with pytest.raises(FileError, match=r"bad.tif: holds \(24, 30\) of uint16; the other frames hold \(24, 32\)"):
        calibrate(set_with_a_bad_frame(np.full((24, 30), 64, np.uint16)))


def test_a_frame_above_the_converter_s_range_is_a_file_error():
    with pytest.raises(FileError, match=r"bad.tif: holds 5000 DN, above 4095"):
        calibrate(set_with_a_bad_frame(np.full((24, 32), 5000, np.uint16)))


def test_a_sensor_that_did_not_take_the_frames_is_refused(virtual):
    with pytest.raises(InputError, match="has 10 bits, the frames have 12"):
        calibrate(frame_set(measurement()), virtual.sensor(0, bits=10))
    with pytest.raises(InputError, match="colour filter array RG/GB, the frames have M"):
        calibrate(frame_set(measurement()), virtual.sensor(0, cfa="rggb"))


def test_an_unsteady_lamp_is_told_and_does_not_count_as_noise():
    steady, unsteady = measurement(), []
    for index, (kind, t, dn) in enumerate(measurement()):
        unsteady.append((kind, t, dn + np.uint16(40 * (index % 2)) if kind == "light" else dn))
    a, b = calibrate(frame_set(steady)), calibrate(frame_set(unsteady))
    assert any("the light was unsteady" in warning for warning in b.warnings)
    assert not any("unsteady" in warning for warning in a.warnings)
    curve_a, curve_b = (c.curves["M"]["photon_transfer"] for c in (a, b))
    np.testing.assert_allclose(curve_b.y, curve_a.y, rtol=1e-9)


def small_chip(seed, ripple=0.0):
    """64 pixels of noise 15 DN: the mean of a frame scatters by 1.9 DN, a fifteenth of the weakest signal of 28 DN."""
    rng = np.random.default_rng([seed, 7])
    frames = [("dark", t, rng.normal(64, 2, (8, 8))) for t in (0.01, 0.02) for _ in range(4)]
    for index in range(32):
        signal = 28 * 2 ** (index // 4) * (1 + ripple * (-1) ** index)
        frames.append(("light", 0.01 * 2 ** (index // 4), rng.normal(64 + signal, 15, (8, 8))))
    return frame_set([(kind, t, np.rint(dn).astype(np.uint16)) for kind, t, dn in frames])


def told_unsteady(frames):
    return any("the light was unsteady" in warning for warning in calibrate(frames).warnings)


def test_a_steady_lamp_on_a_small_chip_is_not_called_unsteady():
    """At most 1 calibration of 1000 may be: 2 and more of 60 come by chance once in 600. Three in four have a level
    whose frame means scatter by more than the 1 % that is worth a warning."""
    assert sum(told_unsteady(small_chip(seed)) for seed in range(60)) <= 1


def test_an_unsteady_lamp_on_a_small_chip_is_told():
    """3 % from frame to frame: at the brightest level, of 3584 DN, over 50 times what chance does."""
    assert all(told_unsteady(small_chip(seed, ripple=0.03)) for seed in range(8))


def test_the_scatter_of_frame_means_is_judged_at_the_rate_it_says():
    """Steady frames at a rate of 0.05: of 600 groups 30 +- 5.3; four standard errors either way, whatever the size."""
    rng = np.random.default_rng(5)
    for frames, shape in ((2, (4, 4)), (6, (4, 8))):
        alarms = 0
        for _ in range(600):
            sums = FrameSums(shape, np.zeros((1, 1), dtype=np.int64), white=4095)
            sums.add(list(np.rint(rng.normal(500, 15, (frames, *shape))).astype(np.uint16)))
            alarms += Level.of(sums.label_totals()[0]).shifts_beyond_chance(0.05)
        # The variance under the frame means is itself known from few pixels (Fisher's F).
        assert abs(alarms - 30) < 22, (frames, shape, alarms)


@pytest.mark.parametrize(
    ("wrong", "hint"),
    [("st", "open_frames('st') makes one"), (Path("st"), "open_frames('st') makes one"), (3, "open_frames makes one")],
)
def test_what_is_no_frame_set_is_refused(wrong, hint):
    with pytest.raises(InputError) as error:
        calibrate(wrong)
    assert str(error.value) == f"calibrate takes a FrameSet; {hint}"
