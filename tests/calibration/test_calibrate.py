"""The calibration as a whole: slow oracles for its parts, missing values and their reasons, and the result."""

import gc
import json
import random
import re
import weakref
from dataclasses import fields, replace

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.parameters import PARAMETER_LABELS, Parameters
from photosite.calibration.reduction import frame_reader
from photosite.calibration.spatial.line_noise import LINE_FRAMES
from photosite.errors import CalibrationError
from photosite.files.yaml import read_yaml
from photosite.frames.frame_set import FrameSet
from photosite.sensor.io.sensor_file import dump_sensor, load_sensor, parse_sensor
from photosite.sensor.new_sensor import new_sensor_file


@pytest.fixture(scope="module")
def mono(virtual):
    sensor = virtual.sensor(3)
    return sensor, virtual.frame_set(sensor, 3)


@pytest.fixture(scope="module")
def calibration(mono):
    return calibrate(mono[1])


def means(group):
    return np.stack(list(group)).astype(float).mean(0)


def temporal(group):
    """Two-way residual variance, written out."""
    y = np.stack(list(group)).astype(float)
    n, pixels = len(y), y[0].size
    residual = y - y.mean(0) - y.mean((1, 2), keepdims=True) + y.mean()
    return (residual**2).sum() / ((n - 1) * (pixels - 1))


def spread_at_zero(darks):
    """Variance of the reference dark frames extrapolated to exposure zero, less temporal noise."""
    t, n = np.array([g.exposure_s for g in darks]), np.array([len(g) for g in darks])
    stack, best = np.stack([means(g) for g in darks]), int(n.argmax())
    slopes = np.polyfit(t, stack.reshape(len(t), -1), 1, w=np.sqrt(n))[0].reshape(stack[0].shape)
    centred = t - np.average(t, weights=n)
    weights = (np.arange(len(t)) == best) - t[best] * centred * n / (centred**2 * n).sum()
    noise = sum(w**2 * temporal(g) / len(g) for w, g in zip(weights, darks, strict=True))
    return (stack[best] - t[best] * slopes).var(ddof=1) - noise


def test_read_noise_and_dsnu_match_the_textbook(mono, calibration):
    sensor, frames = mono
    group = max(frames.of_kind("dark"), key=len)
    v = temporal(group)
    dark_shot = calibration.system_gain_dn_per_e.value**2 * calibration.dark_current_e_per_s.value * group.exposure_s
    assert calibration.read_noise_dn.value == pytest.approx(np.sqrt(v - 1 / 12 - dark_shot), rel=1e-9)
    assert calibration.dsnu_dn.value == pytest.approx(np.sqrt(spread_at_zero(frames.of_kind("dark"))), rel=1e-9)
    assert calibration.read_noise_mv.value == pytest.approx(
        calibration.read_noise_dn.value * sensor.mv_per_dn, rel=1e-12
    )


def test_prnu_is_the_spread_of_pixel_slopes(mono, calibration):
    """`np.polyfit` over every pixel's means, weighted, less the noise and the dark slopes."""
    _, frames = mono
    found = calibration.linear_range["M"]
    lights = [g for g in frames.of_kind("light") if found.lowest <= g.photons_per_pixel <= found.highest]
    assert len(lights) == found.levels
    variance = np.array([temporal(g) / len(g) for g in lights])
    x = np.array([g.photons_per_pixel for g in lights])
    stack = np.stack([means(g) for g in lights])
    slopes = np.polyfit(x, stack.reshape(len(x), -1), 1, w=1 / np.sqrt(variance))[0]
    centred = x - np.average(x, weights=1 / variance)
    coefficients = centred / variance / (centred**2 / variance).sum()
    noise = (coefficients**2 * variance).sum()

    darks = frames.of_kind("dark")
    t, n = np.array([g.exposure_s for g in darks]), np.array([len(g) for g in darks])
    dark_stack = np.stack([means(g) for g in darks])
    dark_slopes = np.polyfit(t, dark_stack.reshape(len(t), -1), 1, w=np.sqrt(n))[0]
    tc = t - np.average(t, weights=n)
    c = tc * n / (tc**2 * n).sum()
    dark_noise = (c**2 * np.array([temporal(g) for g in darks]) / n).sum()

    seconds = coefficients @ np.array([g.exposure_s for g in lights])
    spread = slopes.var(ddof=1) - noise - seconds**2 * (dark_slopes.var(ddof=1) - dark_noise)
    mean = slopes.mean() - seconds * dark_slopes.mean()
    assert calibration.prnu_percent.value == pytest.approx(100 * np.sqrt(spread) / mean, rel=1e-7)
    assert calibration.dcnu_percent.value == pytest.approx(
        100
        * np.sqrt(dark_slopes.var(ddof=1) - dark_noise)
        / (calibration.dark_current_e_per_s.value * calibration.system_gain_dn_per_e.value),
        rel=1e-7,
    )


def test_the_order_of_frames_does_not_matter(mono, calibration):
    _, frames = mono
    shuffled = random.Random(1)
    groups = tuple(replace(group, frames=tuple(shuffled.sample(group.frames, len(group)))) for group in frames.groups)
    again = calibrate(replace(frames, groups=groups))
    one, other = again.estimates(), calibration.estimates()
    # Covariances of neighboring pixels are those of pairs of successive frames.
    coupling, same = one.pop("interpixel_coupling_percent"), other.pop("interpixel_coupling_percent")
    assert abs(coupling.value - same.value) < 4 * same.standard_uncertainty
    assert one == other
    assert again.frames_sha256 == calibration.frames_sha256


def test_every_estimate_has_a_value_or_a_reason_and_a_method(calibration, mono):
    without = calibrate(replace(mono[1], sensor=None))
    for estimate in [*calibration.estimates().values(), *without.estimates().values()]:
        assert estimate.method
        if estimate.value is None:
            assert estimate.reason
            assert estimate.standard_uncertainty is None
            assert estimate.interval_95 is None
        else:
            assert np.isfinite([estimate.value, estimate.standard_uncertainty]).all()
    assert without.read_noise_mv.value is None
    assert without.read_noise_mv.reason_id == "no-sensor-file"
    assert without.read_noise_e == calibration.read_noise_e


def test_json_is_complete_and_plain(calibration):
    data = json.loads(json.dumps(calibration.to_dict()))
    assert set(data["parameters"]) == set(PARAMETER_LABELS) == {field.name for field in fields(Parameters)}
    entry = data["parameters"]["read_noise_dn"]
    assert entry["value"] == calibration.read_noise_dn.value
    assert entry["standard_uncertainty"] == calibration.read_noise_dn.standard_uncertainty
    assert data["channels"] == {}
    assert data["warnings"] == list(calibration.warnings)


def test_progress_counts_every_frame_read(mono, monkeypatch):
    _, frames = mono
    seen = []
    calibrate(frames, progress=lambda done, expected: seen.append((done, expected)))
    assert seen == [(done, frames.frame_count) for done in range(1, frames.frame_count + 1)]

    monkeypatch.setattr(frame_reader, "KEPT_BYTES", 0)
    seen.clear()
    calibrate(frames, progress=lambda done, expected: seen.append((done, expected)))
    assert [done for done, _ in seen] == list(range(1, len(seen) + 1))
    assert seen[-1][0] == seen[-1][1] > frames.frame_count
    # Only the flats of the linear range are read twice.
    assert seen[-1][0] < 1.6 * frames.frame_count


@pytest.mark.parametrize("kept_bytes", [0, 2 * 96 * 128 * 3])
def test_mean_frames_kept_or_read_again_are_the_same(mono, calibration, monkeypatch, kept_bytes):
    """Memory for none of the mean frames, and for some of them."""
    _, frames = mono
    monkeypatch.setattr(frame_reader, "KEPT_BYTES", kept_bytes)
    assert calibrate(frames).to_dict() == calibration.to_dict()


@pytest.mark.parametrize("thread_safe", [False, True])
def test_few_frames_are_held_at_a_time(mono, calibration, monkeypatch, thread_safe):
    """Sources that are not thread-safe are read in the caller's thread."""
    import threading
    import weakref

    _, frames = mono
    monkeypatch.setattr(frame_reader, "_BATCH_FRAMES", 3)
    monkeypatch.setattr(frame_reader, "_AHEAD", 2)
    alive, held, threads = [], [], set()

    def guard(source):
        def read():
            dn = source.read().copy()
            alive.append(weakref.ref(dn))
            held.append(sum(reference() is not None for reference in alive))
            threads.add(threading.current_thread())
            return dn

        return replace(source, read=read, thread_safe=thread_safe)

    groups = tuple(replace(group, frames=tuple(map(guard, group.frames))) for group in frames.groups)
    assert calibrate(replace(frames, groups=groups)).to_dict() == calibration.to_dict()
    # Read again: two stacks for the row and column noise; for the noise structure the longest stack of dark frames and
    # the flat fields of linear levels, all of them because the frames are small.
    linear = calibration.linear_range["M"]
    dark = max(len(group.frames) for group in groups if group.kind == "dark")
    light = sum(
        len(group.frames) for group in groups if linear.lowest <= (group.photons_per_pixel or 0.0) <= linear.highest
    )
    assert frames.frame_count + 2 * LINE_FRAMES < len(alive) <= frames.frame_count + 2 * LINE_FRAMES + dark + light
    assert max(held) <= 3 + 2 + 2  # summed together, read ahead, and one at either end of the queue
    assert (threads == {threading.main_thread()}) is not thread_safe


@pytest.mark.usefixtures("calibration")  # compilation, which leaves reference cycles, has ended
def test_a_dropped_calibration_frees_its_frames_at_once(virtual):
    """Not at the next search for cycles: the frames of several cameras in one process would add up."""
    frames = virtual.frame_set(virtual.sensor(3), 3)
    group = weakref.ref(frames.groups[0])
    gc.collect()
    gc.disable()
    try:
        found = calibrate(frames)
        del found, frames
        assert group() is None
    finally:
        gc.enable()


def test_without_saturation_all_levels_are_linear(virtual):
    sensor = virtual.sensor(5, rows=64, cols=80)
    calibration = calibrate(virtual.frame_set(sensor, 5, top=0.6))
    found = calibration.linear_range["M"]
    assert found.levels == found.levels_measured
    for name in ("saturation_dn", "saturation_capacity_e", "snr_max_db", "dynamic_range_db"):
        assert getattr(calibration, name).value is None
        assert getattr(calibration, name).reason_id == "no-saturation"
    assert calibration.prnu1288_percent.reason_id == "no-saturation"
    assert "no-saturation" in limits(calibration)
    assert calibration.system_gain_dn_per_e.value == pytest.approx(sensor.system_gain_dn_per_e, rel=0.02)


@pytest.fixture(scope="module")
def green_saturates(virtual):
    """Frames of a Bayer sensor of which R and B stay below saturation."""
    return virtual.frame_set(virtual.sensor(5, cfa="rggb", rows=80, cols=96), 5)


def test_the_method_names_the_channels_of_a_partial_mean(green_saturates):
    calibration = calibrate(green_saturates)
    for name in ("prnu1288_percent", "prnu1288_row_percent", "prnu1288_unfiltered_percent", "saturation_dn"):
        pooled, green = getattr(calibration, name), getattr(calibration.channels["G"], name)
        assert calibration.channels["R"].estimates()[name].value is None
        assert calibration.channels["B"].estimates()[name].value is None
        assert pooled.value == pytest.approx(green.value)
        assert pooled.method == f"{green.method}; channel G only, not R, B"
    for name in ("saturation_capacity_photons", "saturation_capacity_e", "snr_max_db", "dynamic_range_db"):
        assert getattr(calibration.by_line, name).method.endswith("; channel G, the first to saturate")
        assert getattr(calibration, name).method.endswith("; channel G only, not R, B")
    others = {name for name, entry in calibration.estimates().items() if "channel" not in entry.method}
    assert {"prnu_percent", "dsnu_dn", "dsnu1288_e", "responsivity_dn_per_photon", "black_level_dn"} <= others
    assert not any("channel" in entry.method for entry in calibration.channels["G"].estimates().values())


def test_a_missing_value_has_the_reason_of_the_channel_with_the_most_results(green_saturates):
    top = max(group.photons_per_pixel for group in green_saturates.of_kind("light"))
    groups = tuple(
        group
        for group in green_saturates.groups
        if group.kind == "dark" or not 0.2 * top < group.photons_per_pixel < 0.65 * top
    )
    calibration = calibrate(replace(green_saturates, groups=groups))
    assert calibration.channels["R"].prnu1288_percent.reason_id == "no-saturation"
    assert calibration.channels["G"].prnu1288_percent.reason_id == "no-half-saturation"
    assert calibration.prnu1288_percent.reason_id == "no-half-saturation"


def test_darks_alone_give_the_dark_parameters(virtual, mono):
    sensor, frames = mono
    calibration = calibrate(replace(frames, groups=frames.of_kind("dark")))
    assert calibration.read_noise_mv.value == pytest.approx(sensor.noise.read_noise_mv.value, rel=0.02)
    assert calibration.dsnu_mv.value is not None
    assert calibration.dark_voltage_mv_per_s.value is not None
    gain = calibration.system_gain_dn_per_e  # of the shot noise of 100 electrons and more
    assert abs(gain.value - sensor.system_gain_dn_per_e) < 3.9 * gain.standard_uncertainty < 0.8 * gain.value
    assert calibration.prnu_percent.reason_id == "no-flat-fields"


def test_single_flats_give_slopes_but_no_gain(virtual):
    """One flat per exposure shows the response, but not its noise."""
    sensor = virtual.sensor(8, rows=48, cols=64)
    frames = virtual.frame_set(sensor, 8, repeats=4)
    groups = tuple(replace(g, frames=g.frames[:1]) if g.kind == "light" else g for g in frames.groups)
    calibration = calibrate(replace(frames, groups=groups))
    assert calibration.system_gain_dn_per_e.reason_id == "single-flat-fields"
    assert calibration.prnu_percent.reason_id == "single-flat-fields"
    assert calibration.saturation_dn.value == sensor.white_level_dn
    assert calibration.responsivity_dn_per_photon.value is not None
    assert "single-flat-fields" in limits(calibration)


def test_some_single_flats_take_their_noise_from_the_photon_transfer(virtual):
    sensor = virtual.sensor(9, rows=64, cols=80)
    frames = virtual.frame_set(sensor, 9)
    groups = tuple(
        replace(g, frames=g.frames[:1]) if g.kind == "light" and k % 2 else g for k, g in enumerate(frames.groups)
    )
    calibration = calibrate(replace(frames, groups=groups))
    low, high = calibration.prnu_percent.interval_95
    assert low < sensor.noise.prnu_percent.value < high


def test_a_measured_sensor_needs_a_sensor_known_before(mono):
    darks = replace(mono[1], sensor=None, groups=mono[1].of_kind("dark"))
    with pytest.raises(CalibrationError):
        calibrate(darks).sensor  # noqa: B018


def test_a_negative_spread_enters_the_sensor_file_as_zero_with_a_note(virtual):
    """A chip without DSNU: half of such calibrations find a negative variance."""
    for seed in range(20):
        sensor = virtual.sensor(seed, dsnu_mv=0.0, rows=48, cols=64)
        calibration = calibrate(virtual.frame_set(sensor, seed))
        if calibration.dsnu_mv.value < 0:
            break
    assert calibration.dsnu_mv.value < 0
    assert calibration.dsnu_mv.upper_limit_95 > 0
    written = calibration.sensor.noise.dsnu_mv
    assert written.value == 0.0
    assert written.standard_uncertainty == calibration.dsnu_mv.standard_uncertainty
    assert "not distinguishable from 0" in written.source


def test_hidden_read_noise_is_reported_with_its_limit(virtual):
    """Quantization hides a read noise of 0.2 DN (EMVA 1288's 0.24 DN^2), and the result has a warning."""
    base = virtual.sensor(4, rows=64, cols=80)
    sensor = base.with_(read_noise_mv=0.2 * base.mv_per_dn)
    calibration = calibrate(virtual.frame_set(sensor, 4))
    true_e = sensor.electrons(sensor.noise.read_noise_mv.value)
    assert calibration.temporal_dark_noise_e.upper_limit_95 > true_e
    assert "noise-hidden-by-quantization" in limits(calibration)


def test_curves_hold_the_points_and_the_line(mono, calibration):
    _, frames = mono
    curves = calibration.curves["M"]
    assert set(curves) == {"dark_signal", "dark_variance", "response", "photon_transfer"}
    transfer = curves["photon_transfer"]
    assert transfer.slope == calibration.by_line.system_gain_dn_per_e.value
    assert transfer.used.sum() == calibration.linear_range["M"].levels
    assert len(curves["response"].x) == len(frames.of_kind("light"))
    assert isinstance(frames, FrameSet)


def test_a_measured_sensor_is_never_named_after_a_preset(calibration):
    preset = load_sensor("nikon-d200")
    measured = replace(calibration, base=preset, source="shots/camera7").sensor
    assert measured.name == "camera7"
    assert replace(calibration, base=preset, source="shots/camera7/protocol.yaml").sensor.name == "camera7"
    assert "#" not in dump_sensor(measured)  # comments of the preset do not apply
    assert replace(calibration, base=preset.with_(name="Mine")).sensor.name == "Mine"


def test_a_measured_sensor_keeps_units_and_comments_of_its_file(calibration):
    text = new_sensor_file(
        "Mine",
        rows=10,
        cols=10,
        bits=12,
        qe_peak=0.6,
        values={"pitch_um": 3.0, "full_well_e": 9000, "read_noise_e": 3.0},
    ).replace("  read_noise_e: 3\n", "  read_noise_e: 3 # data sheet\n")
    base = parse_sensor(text, "mine.yaml").with_(gain_setting=100, gain_settings=[{"setting": 200, "analog_gain": 2}])
    found = replace(calibration, base=base, gain_setting=400.0)
    written = dump_sensor(found.sensor)
    assert re.search(r"read_noise_e: \{value: .*standard_uncertainty: .*\} # data sheet", " ".join(written.split()))
    again = parse_sensor(written, "again.yaml")
    assert (again.name, again.all_gain_settings) == ("Mine", (400,))
    names = ["read_noise_mv", "conversion_gain_uv_per_e"]
    assert [again.measured(n).value for n in names] == pytest.approx([getattr(found, n).value for n in names])
    np.testing.assert_allclose(again.covariance_of(names), found.sensor.covariance_of(names), rtol=1e-4)


def test_sources_hold_in_the_unit_of_their_field(tmp_path):
    """Limits are multiples of the uncertainty: a file in electrons states them with the same text as one in mV."""
    rng = np.random.default_rng(4)
    levels = [("dark", 0.01, 0.0)] + [("light", 0.01 * k, 900.0 * k) for k in range(1, 6)]
    taken = [
        (kind, t, np.uint16(64.5 + 0.5 * (rng.poisson(mean, (48, 64)) + rng.normal(0, 4, (48, 64)))))
        for kind, t, mean in levels
        for _ in range(8)
    ]
    frames = FrameSet.from_arrays(taken, bits=12)
    stated = {"pitch_um": 3.0, "full_well_e": 8000.0, "read_noise_e": 4.0, "system_gain_dn_per_e": 0.5}
    text = new_sensor_file("a", rows=48, cols=64, bits=12, qe_peak=0.6, cfa="mono", values=stated, source=None)
    calibration = calibrate(frames, parse_sensor(text, tmp_path / "a.sensor.yaml"))
    calibration.sensor.save(tmp_path / "b.sensor.yaml")
    noise = read_yaml(tmp_path / "b.sensor.yaml", "a sensor file")["noise"]
    sensor, seen = calibration.sensor, 0
    for name in ("row_noise", "column_noise", "dsnu"):
        entry, estimate = noise[f"{name}_e"], getattr(calibration, f"{name}_mv")
        if entry["value"] == 0.0 and estimate.upper_limit_95 is not None:
            (factor,) = re.findall(r"95 % upper limit (\S+) times the standard uncertainty", entry["source"])
            limit_e = sensor.electrons(estimate.upper_limit_95)
            assert float(factor) * entry["standard_uncertainty"] == pytest.approx(limit_e, rel=0.01)
            seen += 1
    assert seen
