"""An interrupted calibration resumes from its checkpoint, and rejects the checkpoint of other frames."""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.calibration.calibrate import calibrate
from photosite.calibration.reduction import checkpoint, frame_reader
from photosite.errors import FileError
from photosite.files import small_files
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource

ROWS, COLS = 48, 40


class Lab:
    """A frame set in memory that counts its readings and can fail at one of them."""

    def __init__(self) -> None:
        rng = np.random.default_rng(11)
        self.stacks = {
            ("dark", 0.01): self.stack(rng, 0.0, 21),
            **{("light", t): self.stack(rng, 2e4 * t, 6) for t in (0.01, 0.02, 0.03)},
        }
        self.stacks["dark", 0.01][9] = self.stacks["dark", 0.01][2]  # a repeat, before the interruption
        self.readings = 0
        self.fails_at = 10**9

    @staticmethod
    def stack(rng: np.random.Generator, electrons: float, frames: int) -> NDArray[np.uint16]:
        signal = 64 + 0.5 * rng.poisson(electrons, (frames, ROWS, COLS)) + rng.normal(0, 2, (frames, ROWS, COLS))
        return (signal + 0.5).astype(np.uint16)

    def frames(self) -> FrameSet:
        groups = []
        for (kind, exposure_s), stack in self.stacks.items():
            sources = [FrameSource(f"{kind}-{exposure_s}-{i}", self.reader(dn)) for i, dn in enumerate(stack)]
            groups.append(FrameGroup(kind, exposure_s, tuple(sources)))
        return FrameSet(tuple(groups), rows=ROWS, cols=COLS, bits=12)

    def reader(self, dn: NDArray[np.uint16]) -> Callable[[], NDArray[np.uint16]]:
        def read() -> NDArray[np.uint16]:
            self.readings += 1
            if self.readings > self.fails_at:
                raise KeyboardInterrupt
            return dn

        return read


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Save after every batch, and use small batches."""
    monkeypatch.setattr(checkpoint, "SAVE_EVERY_S", -1.0)
    monkeypatch.setattr(frame_reader, "_BATCH_FRAMES", 4)


@pytest.mark.usefixtures("often")
@pytest.mark.parametrize("fails_at", [3, 14, 20, 26, 38])
def test_an_interrupted_run_resumes_with_bit_identical_results(tmp_path: Path, fails_at: int) -> None:
    whole = calibrate(Lab().frames())
    lab = Lab()
    lab.fails_at = fails_at
    with pytest.raises(KeyboardInterrupt):
        calibrate(lab.frames(), checkpoint=tmp_path / "sums")
    saved = sorted((tmp_path / "sums").iterdir())
    assert all(path.name.startswith("sums-") for path in saved)
    assert bool(saved) == (fails_at > 12)

    lab.fails_at, lab.readings = 10**9, 0
    again = calibrate(lab.frames(), checkpoint=tmp_path / "sums")
    assert again.estimates() == whole.estimates()
    assert again.rejected == whole.rejected
    assert again.rejected[0].startswith("dark-0.01-9 repeats dark-0.01-2")
    assert again.frames_sha256 == whole.frames_sha256
    assert not (tmp_path / "sums").exists()


@pytest.mark.usefixtures("often")
def test_a_checkpoint_of_other_frames_and_a_damaged_one_are_rejected(tmp_path: Path) -> None:
    lab = Lab()
    lab.fails_at = 30
    with pytest.raises(KeyboardInterrupt):
        calibrate(lab.frames(), checkpoint=tmp_path)
    lab.fails_at = 10**9

    other = lab.frames()
    fewer = FrameGroup("dark", 0.01, other.groups[0].frames[:-1])
    with pytest.raises(FileError) as caught:
        calibrate(FrameSet((fewer, *other.groups[1:]), rows=ROWS, cols=COLS, bits=12), checkpoint=tmp_path)
    assert Path(caught.value.path) == tmp_path / "sums-0000.h5"
    assert caught.value.what.startswith("the file belongs to other frames than dark frames at 0.01 s")

    for index in (0, 5, 9, 20):  # 9 was left out as a repeat
        lab.stacks["dark", 0.01][index, 20, 20] += 1
        lab.stacks["dark", 0.01][index, 21, 20] -= 1
        with pytest.raises(FileError) as caught:
            calibrate(lab.frames(), checkpoint=tmp_path)
        assert caught.value.path == f"dark-0.01-{index}"
        lab.stacks["dark", 0.01][index, 20, 20] -= 1
        lab.stacks["dark", 0.01][index, 21, 20] += 1

    path = tmp_path / "sums-0000.h5"
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(FileError) as caught:
        calibrate(lab.frames(), checkpoint=tmp_path)
    assert Path(caught.value.path) == path
    assert "damaged" in caught.value.what


class Files(Lab):
    """The frames of a `Lab` as files."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        for (kind, exposure_s), stack in self.stacks.items():
            for i, dn in enumerate(stack):
                np.save(folder / f"{kind}-{exposure_s}-{i}.npy", dn)
        self.folder = folder

    def frames(self) -> FrameSet:
        whole = super().frames()

        def from_file(source: FrameSource) -> FrameSource:
            path = self.folder / f"{source.name}.npy"

            def read() -> NDArray[np.uint16]:
                source.read()
                return np.asarray(np.load(path))

            return FrameSource(source.name, read, path=path)

        groups = tuple(replace(group, frames=tuple(map(from_file, group.frames))) for group in whole.groups)
        return replace(whole, groups=groups)


@pytest.mark.skipif(sys.platform == "win32", reason="the times of files do not identify them")
@pytest.mark.usefixtures("often")
def test_unchanged_files_are_not_read_again_and_replaced_ones_are_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "frames").mkdir()
    lab = Files(tmp_path / "frames")
    sums = tmp_path / "sums"

    def interrupted() -> int:
        lab.readings, lab.fails_at = 0, 30
        with pytest.raises(KeyboardInterrupt):
            calibrate(lab.frames(), checkpoint=sums)
        return lab.readings

    def resumed() -> int:
        lab.readings, lab.fails_at = 0, 10**9
        calibrate(lab.frames(), checkpoint=sums)
        return lab.readings

    interrupted()
    all_compared = resumed()  # the files are younger than SETTLED_NS
    monkeypatch.setattr(small_files, "SETTLED_NS", -1)
    interrupted()
    none_compared = resumed()
    assert none_compared <= all_compared - 24

    interrupted()
    touched = lab.folder / "dark-0.01-3.npy"
    os.utime(touched, (1, 1))
    assert resumed() == none_compared + 1

    interrupted()
    replaced, before = lab.folder / "dark-0.01-11.npy", (lab.folder / "dark-0.01-11.npy").stat()
    np.save(replaced, lab.stacks["dark", 0.01][11] ^ 1)
    os.utime(replaced, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert replaced.stat().st_size == before.st_size
    with pytest.raises(FileError) as caught:
        resumed()
    assert caught.value.path == "dark-0.01-11"


def test_one_run_at_a_time_uses_a_folder(tmp_path: Path) -> None:
    sums = tmp_path / "sums"
    refused: list[FileError] = []

    def meanwhile(done: int, total: int) -> None:
        if done == 25:
            with pytest.raises(FileError) as caught:
                calibrate(Lab().frames(), checkpoint=sums)
            refused.append(caught.value)

    whole = calibrate(Lab().frames(), checkpoint=sums, progress=meanwhile)
    assert Path(refused[0].path) == sums
    assert "\n" not in str(refused[0])
    assert calibrate(Lab().frames(), checkpoint=sums).estimates() == whole.estimates()
    assert not sums.exists()


def test_a_folder_with_other_files_is_left_unchanged(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(FileError) as caught:
        calibrate(Lab().frames(), checkpoint=tmp_path)
    assert Path(caught.value.path) == tmp_path
    assert "thesis.txt" in caught.value.what
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
