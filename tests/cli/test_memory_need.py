"""The need of memory of commands: a warning before they start, and estimates at or above the measured peaks."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.cli import memory_need
from photosite.engine.memory import AvailableMemory
from photosite.errors import PhotositeWarning
from photosite.frames.frame_set import FrameSet
from photosite.studies.bench.memory import SENSORS, measure_memory, shape_of


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_need, "available_memory", lambda: AvailableMemory(1 << 20, of_container=True))
    monkeypatch.setattr(memory_need, "_SAID_FROM", 0)


def test_nothing_is_said_where_the_memory_suffices(monkeypatch: pytest.MonkeyPatch, recwarn: Any) -> None:
    for found in (None, AvailableMemory(4 << 30, of_container=False)):
        monkeypatch.setattr(memory_need, "available_memory", lambda found=found: found)
        memory_need.warn_if_short("a frame", 3 << 30, "Use less")
    assert not recwarn.list


@pytest.mark.usefixtures("short")
def test_a_warning_names_the_way_out() -> None:
    with pytest.warns(PhotositeWarning) as caught:
        memory_need.warn_if_short("a frame", 2 << 20, "Use less")
    assert caught[0].message.hint == "Use less"


@pytest.mark.usefixtures("short")
def test_simulate_and_develop_warn_in_a_line_and_go_on(photosite: Any, tmp_path: Path) -> None:
    for call in (
        ("simulate", "--rows", 48, "--cols", 64, "-o", tmp_path / "a.dng"),
        ("develop", tmp_path / "a.dng", "-o", tmp_path / "a.png"),
    ):
        done = photosite(*call)
        assert done.status == 0
        assert [line for line in done.err.splitlines() if "memory" in line]


@pytest.mark.usefixtures("short")
def test_measurements_and_their_calibrations_warn_in_a_line_and_go_on(photosite: Any, tmp_path: Path) -> None:
    for call in (
        ("shoot", "--rows", 48, "--cols", 64, "-o", tmp_path / "camera"),
        ("calibrate", tmp_path / "camera", "--into", tmp_path / "results"),
    ):
        done = photosite(*call)
        assert done.status == 0, done.err
        (line,) = [line for line in done.err.splitlines() if "memory" in line]
        assert "0.00307 megapixels" in line


@pytest.mark.usefixtures("short")
def test_processes_count_for_cameras_that_are_calibrated_at_the_same_time(photosite: Any, tmp_path: Path) -> None:
    assert photosite("shoot", "--rows", 48, "--cols", 64, "-o", tmp_path / "camera").status == 0
    shutil.copytree(tmp_path / "camera", tmp_path / "other")
    done = photosite("calibrate", tmp_path / "camera", tmp_path / "other", "--into", tmp_path / "out", "--processes", 4)
    assert done.status == 0, done.err
    assert "2 at a time of 2 calibrations" in done.err


def test_needs_grow_with_what_is_asked_for() -> None:
    d200, phone = ps.load_sensor("nikon-d200"), ps.load_sensor("dual-gain-phone")
    plain = memory_need.simulate_bytes(d200)
    assert plain < memory_need.simulate_bytes(d200, 3)
    assert plain < memory_need.simulate_bytes(d200, preview=True)
    assert plain < memory_need.simulate_bytes(phone)
    assert memory_need.shoot_bytes(d200) < memory_need.shoot_bytes(phone)
    frames = FrameSet.from_arrays([("dark", 0.1, np.zeros((100, 200), np.uint16))] * 2, bits=12)
    assert memory_need.calibrate_bytes([frames]) < memory_need.calibrate_bytes([frames], maps=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*response lies outside:photosite.errors.PhotositeWarning")
@pytest.mark.parametrize("sensor", SENSORS)
def test_estimates_against_measured_peaks(sensor: str) -> None:
    uses = {use.command: use for use in measure_memory((), (20.0,), lambda what: None, (sensor,))}
    rows, cols = shape_of(20.0)
    chip = ps.load_sensor(sensor).with_(rows=rows, cols=cols)
    frames = FrameSet.from_arrays([("dark", 0.1, np.zeros((rows, cols), np.uint16))] * 2, bits=16)
    in_memory = 10 * rows * cols  # those of the measurement are in files
    needs = {
        "simulate": memory_need.simulate_bytes(chip),
        "simulate --preview": memory_need.simulate_bytes(chip, preview=True),
        "develop": memory_need.develop_bytes(rows * cols),
        "calibrate": memory_need.calibrate_bytes([frames]) - in_memory,
        "calibrate --maps": memory_need.calibrate_bytes([frames], maps=True) - in_memory,
    }
    for name, need in needs.items():
        peak = 1e6 * uses[name].peak_mb[0]
        assert peak < need < 2.5 * peak, name
