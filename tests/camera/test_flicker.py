"""Flicker under global and rolling shutters: bands against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError

LINE_S = 20e-6
SENSOR = ps.load_sensor("nikon-d200").with_(rows=1000, cols=8)
ROLLING = SENSOR.with_(line_time_us=LINE_S * 1e6)
LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
WALL = ps.charts.uniform("D65", 100)
LAMP = ps.scenes.SineFlicker(120.0, depth=0.4, phase_deg=30.0)


def row_factors(sensor, scene, exposure_s, start_s=0.0):
    camera = ps.Camera(LENS, sensor)
    steady = camera.mean_electrons(WALL, exposure_s)
    factors = camera.mean_electrons(scene, exposure_s, start_s=start_s) / steady
    assert np.ptp(factors, axis=1).max() < 1e-6  # all pixels of a row alike
    return factors[:, 0].astype(np.float64)


@pytest.mark.parametrize("exposure_s", [1 / 1000, 1 / 150, 1 / 60 - 1e-6])
def test_bands_have_the_period_and_amplitude_of_the_closed_form(exposure_s) -> None:
    """Amplitude |sinc(f T)| depth and period 1 / (f line_time) rows, from a fit of a sine to the rows."""
    found = row_factors(ROLLING, ps.scenes.DynamicScene(WALL, LAMP), exposure_s) - 1
    period = 1 / (120.0 * LINE_S)
    angle = 2 * np.pi * np.arange(1000) / period
    (a, b, c), residual, *_ = np.linalg.lstsq(np.stack([np.cos(angle), np.sin(angle), np.ones(1000)], 1), found)
    assert np.hypot(a, b) == pytest.approx(0.4 * abs(np.sinc(120 * exposure_s)), rel=0.01, abs=1e-6)
    assert residual[0] < 1e-9
    assert abs(c) < 1e-6


def test_bands_are_the_limit_of_many_snapshots() -> None:
    """Sum of 4000 instants, each its own light, in each row: an independent slow reference."""
    pulses = ps.scenes.PulseFlicker(90.0, duty=0.15, phase_deg=10.0)
    exposure_s, start_s, snapshots = 1 / 700, 0.0321, 4000
    found = row_factors(ROLLING, ps.scenes.DynamicScene(WALL, pulses), exposure_s, start_s)
    total = np.zeros(1000)
    for k in range(snapshots):
        moment = start_s + np.arange(1000) * LINE_S + (k + 0.5) / snapshots * exposure_s
        total += np.where((moment * 90 + 10 / 360) % 1 < 0.15, 1 / 0.15, 0.0)
    assert found == pytest.approx(total / snapshots, abs=2e-3 / 0.15)
    # The fraction of rows with light is duty + f T; full light lasts duty - f T.
    assert np.mean(found[:555] > 0) == pytest.approx(0.15 + 90 * exposure_s, abs=2e-3)
    assert np.mean(found[:555] > 0.999 / 0.15) == pytest.approx(0.15 - 90 * exposure_s, abs=4e-3)


def test_a_global_shutter_has_one_factor_and_bottom_up_mirrors_the_rows() -> None:
    lit = ps.scenes.DynamicScene(WALL, LAMP)
    assert np.ptp(row_factors(SENSOR, lit, 1e-3)) < 1e-6
    down, up = (row_factors(ROLLING.with_(direction=d), lit, 1e-3, 0.7) for d in ("top_down", "bottom_up"))
    assert up == pytest.approx(down[::-1])


def test_steady_light_gives_the_frames_of_a_global_shutter() -> None:
    scene = ps.charts.macbeth("D65", 100)
    small = SENSOR.with_(rows=60, cols=90)
    usual = ps.Camera(LENS, small).capture(scene, 1 / 100, seed=3)
    for camera in (ps.Camera(LENS, small), ps.Camera(LENS, small.with_(line_time_us=30))):
        for shown in (scene, ps.scenes.DynamicScene(scene)):
            raw = camera.capture(shown, 1 / 100, seed=3, start_s=0.4)
            assert (raw.dn == usual.dn).all()
            assert raw.metadata == usual.metadata


def test_a_region_of_a_flickering_frame_equals_the_whole_frame() -> None:
    camera = ps.Camera(LENS, ROLLING)
    lit = ps.scenes.DynamicScene(ps.charts.macbeth("D65", 100), LAMP)
    whole = camera.capture(lit, 1 / 500, seed=3, start_s=0.1)
    part = camera.capture(lit, 1 / 500, seed=3, start_s=0.1, region=(301, 340, 1, 7))
    assert (part.dn == whole.dn[301:340, 1:7]).all()
    bracket = list(camera.stream(lit, [1 / 1000, 1 / 500], start_s=0.1, seed=3))
    assert (bracket[1].dn == camera.capture(lit, 1 / 500, seed=3, frame=1, start_s=0.1).dn).all()


def test_invalid_arguments() -> None:
    with raises(InputError, "start_s"):
        ps.Camera(LENS, SENSOR).capture(WALL, 0.1, start_s=np.nan)
    with raises(InputError, "flicker"):
        ps.scenes.DynamicScene(WALL, flicker=100)
    with raises(InputError, "scene"):
        ps.scenes.DynamicScene(LAMP)
