"""Frames that several workers read give the same bits as one process."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction import shared_sums
from photosite.calibration.result import Calibration
from photosite.errors import InputError
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame

ROWS, COLS = 48, 40


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of 21 dark frames, of which one repeats another, and of four levels of flat fields, of which one frame
    is broken and the brightest is clipped."""
    folder, rng = tmp_path_factory.mktemp("stack"), np.random.default_rng(11)
    for kind, exposure_s, electrons, frames in (
        *[("dark", 0.01, 0.0, 21), ("light", 0.01, 200.0, 6), ("light", 0.02, 400.0, 6)],
        *[("light", 0.03, 600.0, 6), ("light", 0.04, 1e6, 6)],
    ):
        signal = 64 + 0.5 * rng.poisson(electrons, (frames, ROWS, COLS)) + rng.normal(0, 2, (frames, ROWS, COLS))
        stack = np.clip(signal + 0.5, 0, 4095).astype(np.uint16)
        if kind == "dark":
            stack[9] = stack[2]
        if exposure_s == 0.02:
            stack[4, 10:30] = 64
        for number, dn in enumerate(stack):
            RawFrame(dn, bits=12, cfa=(("M",),)).save(folder / f"{kind}_{1000 * exposure_s:g}ms_{number:02d}.tif")
    return folder


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Divide groups into parts of four frames, so that most groups have several."""
    monkeypatch.setattr(shared_sums, "_FRAMES", 4)


def assert_same(one: Calibration, other: Calibration) -> None:
    assert one.to_dict() == other.to_dict()
    assert one.estimates() == other.estimates()
    assert one.rejected == other.rejected
    assert one.frames_sha256 == other.frames_sha256


@pytest.mark.usefixtures("small_parts")
def test_parts_merged_without_rounding_give_the_same_bits(stack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The merging, with the parts read in this process and completed in the reverse order."""
    whole = calibrate(open_frames(stack, bits=12))
    seen: list[Any] = []

    def backwards(function: Any, tasks: Any, **_: Any) -> Any:
        seen.extend(tasks)
        yield from [(index, function(tasks[index])) for index in reversed(range(len(tasks)))]

    monkeypatch.setattr(shared_sums, "run_tasks", backwards)
    progress: list[tuple[int, int]] = []
    shared = calibrate(open_frames(stack, bits=12), processes=2, progress=lambda *done: progress.append(done))
    assert len(seen) == 6 + 4 * 2
    assert_same(shared, whole)
    assert len(whole.rejected) == 2
    assert progress[-1][0] == progress[-1][1]


@pytest.mark.usefixtures("small_parts")
def test_processes_give_the_same_bits(stack: Path) -> None:
    assert_same(calibrate(open_frames(stack, bits=12), processes=2), calibrate(open_frames(stack, bits=12)))


def test_a_checkpoint_with_several_workers_is_refused(stack: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        calibrate(open_frames(stack, bits=12), processes=2, checkpoint=tmp_path)
    assert caught.value.what == "checkpoint"
