"""Scenes in motion: skew, blur and flicker against closed forms and against sums of many still images."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.camera.image_over_time import NODES_PER_CELL
from photosite.errors import InputError

GRID = np.arange(400.0, 701.0, 10.0)
SIZE = 64
SENSOR = ps.load_sensor("nikon-d200").with_(
    rows=SIZE, cols=SIZE, cfa="mono", channels={"M": ps.load_sensor("nikon-d200").channels["G"]}
)
LENS = ps.DiffractionLimited(f_number=5.6, focal_length_mm=50)
EXPOSURE_S = 0.01


def scene_of(weights):
    """A scene of a few samples per pixel that fills the frame and half of its size beyond each border."""
    samples = np.asarray(weights, np.float32)[None]
    pixels = 2 * SIZE
    optics = LENS.magnification(1.0)
    width_m = pixels * SENSOR.pixel.width_um.value * 1e-6 / optics
    return ps.Scene(samples, np.full((1, GRID.size), 1e15), GRID, width_m=width_m, distance_m=1.0)


def edge():
    """Dark on the left, bright on the right, from the middle of the frame on; 4 samples per pixel."""
    weights = np.full((8 * SIZE, 8 * SIZE), 0.1)
    weights[:, 4 * SIZE :] = 1.0
    return scene_of(weights)


def camera(line_time_us=None, **changes):
    shutter = {} if line_time_us is None else {"line_time_us": line_time_us}
    return ps.Camera(LENS, SENSOR.with_(**shutter, **changes), cells_per_pixel=3)


def edge_place(row, bright):
    """Where a row crosses the mean of dark and bright, in pixels from the left border; linear between pixels."""
    level = 0.55 * bright
    k = int(np.argmax(row > level))
    return k - 0.5 + float((level - row[k - 1]) / (row[k] - row[k - 1]))


def edge_width(row, bright):
    """Contrast over the slope where the edge is steepest, over 3 pixels."""
    return 0.9 * bright / float(np.max(row[3:] - row[:-3])) * 3


def test_a_scene_at_rest_has_the_image_of_a_still_one() -> None:
    chart = ps.charts.macbeth("D65", 100)
    for cells in (1, 3):
        shooter = ps.Camera(
            ps.DiffractionLimited(8, 50), ps.load_sensor("nikon-d200").with_(rows=44, cols=64), "trapezoid", cells
        )
        still = shooter.mean_electrons(chart, EXPOSURE_S)
        for motion in (ps.scenes.Motion(), ps.scenes.Motion(rotation_deg_per_s=1e-6)):
            moving = shooter.mean_electrons(ps.scenes.DynamicScene(chart, motion=motion), EXPOSURE_S)
            assert np.abs(moving - still).max() < 2e-5 * still.max()


@pytest.mark.parametrize("direction", ["top_down", "bottom_up"])
def test_skew_of_a_vertical_edge(direction) -> None:
    """The edge moves velocity * line time from row to row; its mean place is that at the middle of the exposure."""
    velocity, line_us = 400.0, 250.0
    shooter = camera(line_us, direction=direction)
    mean = shooter.mean_electrons(
        ps.scenes.DynamicScene(edge(), motion=ps.scenes.Motion(cols_per_s=velocity)), EXPOSURE_S
    )
    place = np.array([edge_place(row, mean.max()) for row in mean])
    slope, start = np.polyfit(np.arange(SIZE), place, 1)
    sign = 1 if direction == "top_down" else -1
    assert slope == pytest.approx(sign * velocity * line_us * 1e-6, rel=0.01)
    first = start if sign == 1 else start + slope * (SIZE - 1)
    assert first == pytest.approx(SIZE / 2 + velocity * EXPOSURE_S / 2, abs=0.05)


def test_motion_widens_an_edge_to_its_length() -> None:
    scene = ps.scenes.DynamicScene(edge(), motion=ps.scenes.Motion(rows_per_s=123.0, cols_per_s=-15 / EXPOSURE_S))
    moving = camera().mean_electrons(scene, EXPOSURE_S)[20]
    assert edge_width(moving, moving.max()) == pytest.approx(15, rel=0.01)


@pytest.mark.parametrize("length", [0.4, 3.0, 11.3])
@pytest.mark.parametrize("growth", [0.0, 1e-9])  # the second is sampled, not a translation
def test_motion_lowers_the_contrast_of_a_wave_by_sinc(length, growth) -> None:
    period = 16.0  # pixels, along the columns
    wave = 1 + 0.8 * np.cos(2 * np.pi * np.arange(8 * SIZE) / (4 * period))
    scene = scene_of(np.tile(wave, (8, 1)).repeat(SIZE, axis=0))
    motion = ps.scenes.Motion(cols_per_s=length / EXPOSURE_S, scale_per_s=growth)
    rows = [camera().mean_electrons(s, EXPOSURE_S)[20] for s in (scene, ps.scenes.DynamicScene(scene, motion=motion))]
    still, moving = (np.fft.rfft(row)[round(SIZE / period)] for row in rows)
    assert abs(moving) / abs(still) == pytest.approx(np.sinc(length / period), rel=1e-3)
    shift = -np.angle(moving / still) / (2 * np.pi) * period
    assert shift == pytest.approx(length / 2, abs=1e-3 * period)


def test_moving_frames_are_the_limit_of_many_still_images() -> None:
    """An independent reference: the scene itself is shifted by whole samples and imaged anew, 4 times per pixel."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[: 8 * SIZE, : 8 * SIZE] / 4.0
    texture = 1.0 + sum(
        0.2 * np.cos(2 * np.pi * (fy * y + fx * x) + phase)
        for fy, fx, phase in zip(
            rng.uniform(-0.2, 0.2, 8), rng.uniform(-0.2, 0.2, 8), rng.uniform(0, 6, 8), strict=True
        )
    )
    lamp = ps.scenes.SineFlicker(120.0, depth=0.8, phase_deg=50.0)
    velocity, line_us = 500.0, 100.0  # 5 pixels in an exposure, 0.05 from row to row
    shooter = camera(line_us)
    scene = ps.scenes.DynamicScene(scene_of(np.maximum(texture, 0)), lamp, ps.scenes.Motion(cols_per_s=velocity))
    found = shooter.mean_electrons(scene, EXPOSURE_S)
    step_s = 0.25 / velocity  # a quarter of a pixel
    total = np.zeros((SIZE, SIZE))
    begin_s = shooter.sensor.row_start_s
    for k in range(round((begin_s.max() + EXPOSURE_S) / step_s) + 2):
        still = camera().mean_electrons(scene_of(np.roll(np.maximum(texture, 0), k, axis=1)), 1.0)
        middle = k * step_s
        low = np.clip(middle - step_s / 2, begin_s, begin_s + EXPOSURE_S)
        high = np.clip(middle + step_s / 2, begin_s, begin_s + EXPOSURE_S)
        total += still * lamp.integral_s(low, high)[:, None]
    inside = np.s_[:, 8:-8]
    assert np.abs(found - total)[inside].max() < 0.01 * total.max()
    assert np.ptp(total) > 0.5 * total.max()


def test_nodes_integrate_waves_up_to_the_stated_frequency() -> None:
    """Sums over the nodes against sinc(f l), for waves of up to 0.3 cycles per cell along straight paths."""
    frequency = np.linspace(0, 0.3, 100)[:, None]
    for length in (0.1, 1.0, 3.0, 5.0, 8.0, 20.0, 100.0):
        nodes, weights = np.polynomial.legendre.leggauss(2 + int(np.ceil(NODES_PER_CELL * length)))
        found = (0.5 * weights * np.cos(np.pi * frequency * length * nodes)).sum(axis=1)
        assert np.abs(found - np.sinc(frequency[:, 0] * length)).max() < 1.5e-3


def test_a_quarter_turn_and_growth() -> None:
    rng = np.random.default_rng(2)
    blocks = np.kron(rng.random((16, 16)), np.ones((32, 32)))
    scene = scene_of(blocks)
    shooter = camera()
    still = shooter.mean_electrons(scene, 1e-5)
    turned = shooter.mean_electrons(
        ps.scenes.DynamicScene(scene, motion=ps.scenes.Motion(rotation_deg_per_s=90)), 1e-5, start_s=1.0
    )
    assert np.abs(turned - np.rot90(still, -1)).max() < 2e-3 * still.max()
    grown = shooter.mean_electrons(
        ps.scenes.DynamicScene(scene, motion=ps.scenes.Motion(scale_per_s=float(np.log(2)))), 1e-5, start_s=1.0
    )
    # A pixel in the middle of a block of 8 pixels, now 16, has the light of the block.
    inner = still[24:40, 24:40]
    assert grown[20:24, 20:24].mean() == pytest.approx(inner[2:6, 2:6].mean(), rel=0.3)
    large = shooter.mean_electrons(scene_of(np.kron(blocks, np.ones((2, 2)))[256:768, 256:768]), 1e-5)
    assert np.corrcoef(grown.ravel(), large.ravel())[0, 1] > 0.99


def test_a_short_pulse_freezes_an_edge() -> None:
    """Light at 6 ms only: the edge is where it is then, as sharp as at rest."""
    lamp = ps.scenes.PulseFlicker(50.0, duty=0.002, phase_deg=-360 * 50 * 0.006)
    scene = ps.scenes.DynamicScene(edge(), lamp, ps.scenes.Motion(cols_per_s=1000))
    rows = [camera().mean_electrons(one, EXPOSURE_S)[7] for one in (scene, edge())]
    (place, width), (at_rest, still) = ((edge_place(r, r.max()), edge_width(r, r.max())) for r in rows)
    assert place - at_rest == pytest.approx(6.02, abs=0.05)
    assert width == pytest.approx(still, rel=0.02)


def test_light_is_conserved_and_regions_equal_the_whole_frame() -> None:
    dot = np.zeros((8 * SIZE, 8 * SIZE))
    dot[4 * SIZE - 40 : 4 * SIZE, 4 * SIZE - 40 : 4 * SIZE] = 1
    scene = scene_of(dot)
    still = camera().mean_electrons(scene, EXPOSURE_S).sum(dtype=np.float64)
    for motion in (ps.scenes.Motion(300, 900), ps.scenes.Motion(100, 50, rotation_deg_per_s=200)):
        moving = camera(20).mean_electrons(ps.scenes.DynamicScene(scene, motion=motion), EXPOSURE_S)
        assert moving.sum(dtype=np.float64) == pytest.approx(still, rel=0.01)
    moving = ps.scenes.DynamicScene(scene, motion=ps.scenes.Motion(300, 900))
    whole = camera(20).capture(moving, EXPOSURE_S, seed=4, start_s=0.01)
    part = camera(20).capture(moving, EXPOSURE_S, seed=4, start_s=0.01, region=(3, 40, 11, 51))
    assert (part.dn == whole.dn[3:40, 11:51]).all()


def test_what_cannot_move() -> None:
    motion = ps.scenes.Motion(cols_per_s=100)
    distorting = ps.Camera(ps.Lens(LENS, distortion=ps.optics.Distortion.polynomial(-0.1)), SENSOR)
    with raises(InputError, "motion does not apply to a lens"):
        distorting.capture(ps.scenes.DynamicScene(edge(), motion=motion), EXPOSURE_S)
    with raises(InputError, "motion"):
        camera().capture(ps.scenes.DynamicScene(edge(), motion=motion), EXPOSURE_S, start_s=1e4)
    with raises(InputError, "motion applies to a flat scene"):
        ps.scenes.DynamicScene(
            ps.scenes.Planes((edge(), ps.Scene.uniform(np.full(GRID.size, 1e14), GRID, distance_m=3))), motion=motion
        )
    with raises(InputError, "cols_per_s"):
        ps.scenes.Motion(cols_per_s=np.inf)


@pytest.mark.parametrize("wrong", [(0, 600), [1.0], None, "fast", True, 1j, np.zeros(2), math.nan])
def test_rates_are_single_numbers(wrong: Any) -> None:
    with raises(InputError, "rows_per_s"):
        ps.scenes.Motion(wrong)


def test_rates_of_any_real_type() -> None:
    assert ps.scenes.Motion(np.float32(2), np.int64(600)).is_translation
