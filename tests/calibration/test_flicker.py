"""Flicker seen by calibration: frequency and depth of simulated frames within their intervals, and no false names."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.light.flicker import Flicker, RowLight, with_frequency
from photosite.frames.frame_set import FrameSet

LINE_US = 30.0
LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
STEADY = ps.charts.uniform("D65", 300)
EXPOSURES_S = (0.001, 0.002, 0.003, 0.004, 0.006, 0.007)


def frames_in(light, cfa="mono", **noise):
    """Dark frames and flat fields of a camera with a rolling shutter, recorded at 27 frames per second."""
    d200 = ps.load_sensor("nikon-d200")
    channels = {"M": d200.channels["G"]} if cfa == "mono" else d200.channels
    sensor = d200.with_(
        rows=480,
        cols=64,
        cfa=cfa,
        channels=channels,
        black_level_dn=100,
        line_time_us=LINE_US,
        prnu_percent=0.5,
        **noise,
    )
    camera = ps.Camera(LENS, sensor)
    black = np.zeros((480, 64), np.float32)
    stack = [("dark", 0.001, camera.expose(black, 0.001, seed=1, frame=n).dn) for n in range(8)]
    for k, exposure_s in enumerate(EXPOSURES_S):
        clip = camera.record(light, 6, 27.0, exposure_s, start_s=0.31 * k, seed=2 + k)
        stack += [("light", exposure_s, raw.dn) for raw in clip]
    return FrameSet.from_arrays(stack, bits=12, cfa=sensor.array.cfa, sensor=sensor)


@pytest.mark.parametrize("cfa", ["mono", "rggb"])
def test_flicker_is_named_with_its_frequency_and_depth(cfa) -> None:
    """Limits of 4 standard uncertainties."""
    frames = frames_in(ps.scenes.DynamicScene(STEADY, ps.scenes.SineFlicker(120.0, depth=0.08)), cfa)
    found = ps.calibrate(frames)
    flicker = found.flicker
    assert flicker.frequency_hz.value == pytest.approx(120.0, abs=4 * flicker.frequency_hz.standard_uncertainty)
    assert flicker.frequency_hz.standard_uncertainty < 0.2
    assert flicker.depth.value == pytest.approx(0.08, abs=4 * flicker.depth.standard_uncertainty)
    assert flicker.depth.standard_uncertainty < 0.002
    assert flicker.period_rows == pytest.approx(1e6 / (120 * LINE_US), rel=0.01)
    assert limits(found)["flickering-light"] == flicker.fraction
    assert found.to_dict()["flicker"]["frequency_hz"]["value"] == flicker.frequency_hz.value
    # It is not taken for row noise, and the gain is right.
    assert found.row_noise_dn.upper_limit_95 is not None
    gain = found.system_gain_dn_per_e
    assert gain.value == pytest.approx(frames.sensor.system_gain_dn_per_e, abs=4 * gain.standard_uncertainty)


def test_without_a_line_time_there_is_a_period_only() -> None:
    frames = frames_in(ps.scenes.DynamicScene(STEADY, ps.scenes.SineFlicker(120.0, depth=0.08)))
    flicker = ps.calibrate(frames, frames.sensor.with_(shutter=None)).flicker
    assert flicker.frequency_hz is None
    assert flicker.depth is None
    assert flicker.period_rows == pytest.approx(1e6 / (120 * LINE_US), rel=0.01)


def test_steady_light_and_row_noise_are_not_flicker() -> None:
    found = ps.calibrate(frames_in(STEADY, row_noise_mv=0.3))
    assert found.flicker is None
    assert found.row_noise_dn.upper_limit_95 is None


def bands(rng, depth, rows, lamp=None):
    """Rows of several levels, with shading, a pattern of rows and noise; and the frequency and line time."""
    line_s = np.exp(rng.uniform(np.log(8e-6), np.log(60e-6)))
    cycles = np.exp(rng.uniform(np.log(0.8), np.log(0.2 * rows)))
    frequency = cycles / rows / line_s
    flicker = ps.scenes.SineFlicker(frequency, depth) if lamp is None else lamp(frequency)
    frames, levels = int(rng.integers(3, 13)), []
    for exposure_s in rng.uniform(0.05, 2.4, int(rng.integers(2, 8))) / frequency:
        start_s = rng.random((frames, 1)) + line_s * np.arange(rows)
        factor = flicker.integral_s(start_s, start_s + exposure_s) / exposure_s
        shape = 1000 * (1 - 0.1 * np.linspace(-1, 1, rows) ** 2) * (1 + 0.002 * rng.normal(size=rows))
        levels.append(RowLight(exposure_s, shape * factor + rng.normal(0, 2, factor.shape)))
    return levels, frequency, line_s


def test_pulses_give_their_frequency_and_the_depth_of_their_first_harmonic() -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        levels, frequency, line_s = bands(rng, 0.0, 500, lambda f: ps.scenes.PulseFlicker(f, 0.3))
        found = with_frequency(Flicker(0.1, None), levels, ps.Measured(1e6 * line_s))
        if found.frequency_hz is not None:  # too few cycles for a light with harmonics
            assert found.frequency_hz.value == pytest.approx(frequency, rel=1e-3)
            assert found.depth.value == pytest.approx(2 * np.sinc(0.3), abs=4 * found.depth.standard_uncertainty)
            assert found.depth.standard_uncertainty < 0.1


def covered(seeds):
    """Coverage and bias, in standard uncertainties, of frequency and depth; of all but a tenth of the lamps."""
    scores = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        depth = np.exp(rng.uniform(np.log(0.01), np.log(0.6)))
        levels, frequency, line_s = bands(rng, depth, int(rng.integers(100, 600)))
        found = with_frequency(Flicker(0.1, None), levels, ps.Measured(1e6 * line_s))
        if found.depth is None:  # a depth of few noise levels, in few periods
            continue
        pairs = (found.frequency_hz, frequency), (found.depth, depth)
        scores.append([(entry.value - truth) / entry.standard_uncertainty for entry, truth in pairs])
    z = np.array(scores)
    assert len(z) > 0.9 * len(seeds)
    return (np.abs(z) < 1.96).mean(axis=0), z.mean(axis=0)


@pytest.mark.slow
def test_intervals_of_frequency_and_depth_cover_the_truth() -> None:
    """200 hidden lamps; binomial with a standard deviation of 1.5 %."""
    coverage, bias = covered(range(200))
    assert 0.92 <= coverage[0] <= 0.98
    assert 0.92 <= coverage[1] <= 1.0
    assert np.abs(bias).max() < 0.2


def test_noise_alone_has_no_frequency() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        noise = [RowLight(0.001, rng.normal(1000, 3, (4, 300)))]
        assert with_frequency(Flicker(0.01, None), noise, ps.Measured(10.0)) == Flicker(0.01, None)
