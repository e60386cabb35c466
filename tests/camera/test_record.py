"""Recordings: times, noise and exposures of their frames, and scenes that are a function of time."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError

SENSOR = ps.load_sensor("nikon-d200").with_(rows=40, cols=60, black_level_dn=64)
LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
CAMERA = ps.Camera(LENS, SENSOR)
ROLLING = ps.Camera(LENS, SENSOR.with_(line_time_us=200))
WALL = ps.charts.uniform("D65", 200)
LIT = ps.scenes.DynamicScene(WALL, ps.scenes.SineFlicker(100.0, depth=0.5))


def test_frames_are_the_captures_at_their_times() -> None:
    moving = ps.scenes.DynamicScene(ps.charts.macbeth("D65", 200), LIT.flicker, ps.scenes.Motion(30, 200))
    for scene in (LIT, moving):
        clip = list(ROLLING.record(scene, 3, 60.0, 1 / 300, start_s=0.5, seed=9, first_frame=4))
        for n, raw in enumerate(clip):
            alone = ROLLING.capture(scene, 1 / 300, start_s=0.5 + n / 60, seed=9, frame=4 + n)
            assert (raw.dn == alone.dn).mean() > 0.999  # the field of a longer recording has other roundings
            assert raw.metadata["start_s"] == pytest.approx(0.5 + n / 60)
    static = list(CAMERA.record(WALL, 2, 60.0, 1 / 300, seed=9, region=(3, 20, 5, 41)))
    assert (static[1].dn == CAMERA.capture(WALL, 1 / 300, seed=9, frame=1).dn[3:20, 5:41]).all()


def test_a_function_of_time_is_sampled_in_the_middle_of_a_frame() -> None:
    times = []

    def brighter(time_s):
        times.append(time_s)
        return ps.charts.uniform("D65", 100 * (1 + time_s))

    clip = list(ROLLING.record(brighter, 2, 50.0, 1 / 100, start_s=1.0))
    readout_s = 39 * 200e-6
    assert times == pytest.approx([1.0 + 0.5 * (readout_s + 0.01), 1.02 + 0.5 * (readout_s + 0.01)])
    assert len(clip) == 2


def test_many_scenes_per_frame_converge_to_the_integral() -> None:
    """A scene that grows brighter linearly: row r has the brightness at the middle of its exposure."""
    exposure_s, steps = 1 / 100, 40

    def brighter(time_s):
        return ps.charts.uniform("D65", 100 * time_s)

    mean = ROLLING._mean_of_scenes(brighter, 0.0, exposure_s, steps)[1][:, 0].astype(np.float64)
    unit = ROLLING.mean_electrons(ps.charts.uniform("D65", 100), exposure_s)[:, 0]
    middle_s = ROLLING.sensor.row_start_s + exposure_s / 2
    assert mean / unit == pytest.approx(middle_s, rel=0.01)
    lit = ROLLING._mean_of_scenes(lambda time_s: LIT, 0.3, exposure_s / 3, steps)[1]
    assert lit == pytest.approx(ROLLING.mean_electrons(LIT, exposure_s / 3, start_s=0.3), rel=1e-5)
    moving = ps.scenes.DynamicScene(ps.charts.macbeth("D65", 200), motion=ps.scenes.Motion(0, 300))
    parts = ROLLING._mean_of_scenes(lambda time_s: moving, 0.01, exposure_s, 5)[1]
    whole = ROLLING.mean_electrons(moving, exposure_s, start_s=0.01)
    assert np.abs(parts - whole).max() < 1e-3 * whole.max()


def test_automatic_exposure_reaches_its_level_and_follows_the_light() -> None:
    def wall(time_s):
        return ps.charts.uniform("D65", 200 if time_s < 0.5 else 1600)

    control = ps.AutoExposure(first_s=1e-4, level=0.5)
    clip = list(CAMERA.record(wall, 40, 40.0, control))
    fraction = [(np.percentile(raw.dn, 99.5) - 64) / (4095 - 64) for raw in clip]
    assert fraction[19] == pytest.approx(0.5, rel=0.02)
    assert fraction[20] > 0.99
    assert fraction[39] == pytest.approx(0.5, rel=0.02)
    assert clip[19].exposure_s / clip[39].exposure_s == pytest.approx(8, rel=0.05)


def test_a_control_of_the_users_own() -> None:
    seen = []

    def control(last):
        seen.append(last)
        return 0.001 if last is None else 2 * last.exposure_s

    clip = list(CAMERA.record(WALL, 4, 250.0, control))
    assert [raw.exposure_s for raw in clip] == pytest.approx([0.001, 0.002, 0.004, 0.004])  # at most 1 / fps
    assert seen[0] is None
    assert seen[1:] == clip[:3]


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ((WALL, 0, 30.0, 0.01), "frames"),
        ((WALL, 1, 0.0, 0.01), "fps"),
        ((WALL, 1, 200.0, 0.01), "fps"),
        ((WALL, 1, 30.0, 0.1), "exposure_s"),
        ((WALL, 1, 30.0, []), "exposure_s"),
    ],
)
def test_invalid_recordings(arguments, field) -> None:
    with raises(InputError, field):
        list(ROLLING.record(*arguments))


@pytest.mark.parametrize("changes", [{"first_s": 0.0}, {"level": 1.0}, {"speed": 1.5}, {"percentile": 101.0}])
def test_invalid_controls(changes) -> None:
    with raises(InputError, next(iter(changes))):
        ps.AutoExposure(**{"first_s": 0.01, **changes})
