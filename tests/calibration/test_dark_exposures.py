"""Dark frames under a wrong exposure time are left out and named; moving black levels are not taken for them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction.dark_exposures import find_wrong_exposure
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.reduce import reduce_frames
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
from photosite.sensor.readout import digital_numbers
from photosite.studies.plain_camera import Disturbance, PlainCamera
from photosite.studies.protocol import ShootingProtocol, Step

DARK_E_PER_S, GAIN, BLACK_DN, READ_E = 2000.0, 0.3, 64.0, 6.0
TIMES_S = (0.01, 0.02, 0.03, 0.04, 0.06)

CAMERA = PlainCamera(
    shape=(48, 64),
    gain=GAIN,
    black_dn=BLACK_DN,
    read_noise_e=READ_E,
    dsnu_dn=0.6,
    prnu=0.008,
    electrons_per_s=1.5e5,
    dark_e_per_s=DARK_E_PER_S,
    dcnu=0.1,
)


def frames_of(stated_s: tuple[float, ...], taken_s: tuple[float, ...]) -> FrameSet:
    """Dark frames of stated and other exposure times, and flat fields of the stated ones."""
    steps = [Step("dark", t, 8) for t in taken_s] + [Step("light", t, 4) for t in stated_s]
    frames = CAMERA.frame_set(ShootingProtocol("darks", tuple(steps)), Disturbance(), 3)
    stated = dict(zip(taken_s, stated_s, strict=True))
    groups = [
        replace(group, exposure_s=stated[group.exposure_s]) if group.kind == "dark" else group
        for group in frames.groups
    ]
    return replace(frames, groups=tuple(sorted(groups, key=lambda group: (group.kind, group.exposure_s))))


@pytest.mark.parametrize("wrong", [0, 2, 4])
def test_a_wrong_exposure_time_is_named(wrong: int) -> None:
    taken = tuple(10.0 * t if i == wrong else t for i, t in enumerate(TIMES_S))
    calibration = calibrate(frames_of(TIMES_S, taken))
    assert len(calibration.rejected) == 8
    assert {e.id for e in calibration.diagnostics if e.severity == "left out"} == {"wrong-dark-exposure"}
    assert limits(calibration)["frames-left-out"] == 8
    for name, truth in {
        "dark_current_dn_per_s": GAIN * DARK_E_PER_S,
        "black_level_dn": BLACK_DN,
        "read_noise_dn": GAIN * READ_E,
        "system_gain_dn_per_e": GAIN,
    }.items():
        estimate = getattr(calibration, name)
        assert estimate.value == pytest.approx(truth, abs=3.5 * estimate.standard_uncertainty), name
        assert estimate.standard_uncertainty < 0.02 * truth, name


@pytest.mark.parametrize("taken_s", [(0.03, 0.02, 0.04), (0.01, 0.03, 0.04), (0.01, 0.02, 0.03)])
def test_three_exposures_do_not_tell_which_is_wrong(taken_s: tuple[float, ...]) -> None:
    """The intervals hold the truth, and a warning names the scatter."""
    frames = frames_of((0.01, 0.02, 0.04), taken_s)
    dark = replace(frames, groups=tuple(group for group in frames.groups if group.kind == "dark"))
    for calibration in (calibrate(frames), calibrate(dark)):
        assert calibration.rejected == ()
        for name, truth in {
            "dark_current_dn_per_s": GAIN * DARK_E_PER_S,
            "black_level_dn": BLACK_DN,
            "read_noise_dn": GAIN * READ_E,
            "dsnu_dn": CAMERA.dsnu_dn,
        }.items():
            low, high = getattr(calibration, name).interval_95
            assert low < truth < high, name
        assert "dark-levels-scatter" in limits(calibration)


def test_read_noise_of_dark_frames_alone_is_without_dark_shot_noise() -> None:
    """Without a gain, the slope of the dark variance gives it: 20 to 80 electrons beside 36 electrons^2."""
    steps = tuple(Step("dark", t, 16) for t in (0.01, 0.02, 0.04))
    found = calibrate(CAMERA.frame_set(ShootingProtocol("dark", steps), Disturbance(), 5)).read_noise_dn
    assert found.value == pytest.approx(GAIN * READ_E, abs=3.5 * found.standard_uncertainty)
    assert found.standard_uncertainty < 0.03 * found.value


def shifted(group: FrameGroup, dn: int) -> FrameGroup:
    sources = (FrameSource(source.name, partial(np.add, source.read(), np.uint16(dn))) for source in group.frames)
    return replace(group, frames=tuple(sources))


@pytest.mark.parametrize("sets", [3, pytest.param(40, marks=pytest.mark.slow)])
def test_moving_black_levels_and_clean_frames_are_left_alone(sets: int) -> None:
    """Of 40 sets each, none is named. A black level that moves from group to group does not change the noise."""
    rng = np.random.default_rng(1)
    for seed in range(sets):
        steps = tuple(Step("dark", t, 8) for t in TIMES_S)
        frames = CAMERA.frame_set(ShootingProtocol("darks", steps), Disturbance(), seed)
        clean = frames.groups
        for groups in (clean, tuple(shifted(group, int(rng.integers(0, 10))) for group in clean)):
            with FrameReader(replace(frames, groups=groups)) as reader:
                assert find_wrong_exposure(reduce_frames(reader).darks) is None


def test_hot_pixels_that_saturate_are_not_taken_for_a_shorter_exposure() -> None:
    sensor = ps.load_sensor("sony-imx174").with_(
        rows=96,
        cols=120,
        black_level_dn=100,
        well_capacity_e=10500,
        dark_current_e_per_s=15,
        hot_pixels={"fraction": 0.005, "median_e_per_s": 300, "log_spread": 0.8},
    )
    dark = np.zeros((96, 120), np.float32)
    times_s = (0.01, 1.0, 3.0, 10.0, 30.0)
    frames = [
        ("dark", t, digital_numbers(sensor, dark, t, seed=1, frame=100 * k + n))
        for k, t in enumerate(times_s)
        for n in range(20)
    ]
    calibration = calibrate(FrameSet.from_arrays(frames, bits=12, sensor=sensor.with_(hot_pixels=None)))
    assert not calibration.rejected
