"""Checkpoint on disk: the sums from which an interrupted calibration resumes."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.groups import group_label
from photosite.engine.frame_sums import FrameSums
from photosite.errors import FileError
from photosite.files.atomic import atomic_path
from photosite.frames.frame_set import FrameGroup, FrameSet

_VERSION = 3
SAVE_EVERY_S = 20.0
"""Seconds of work that an interruption may lose; a finished group is saved at once."""


@dataclass(frozen=True)
class GroupProgress:
    """How far the first pass over a group got.

    Parameters
    ----------
    read
        Number of frames read, in the order of the group.
    used
        Indices of those that are not repeats.
    digests
        Digest of the sampled rows of each used frame.
    rejected
        Reasons for the others.
    screened
        Whether all frames were read, and outlier frames left out.
    tops
        `top_value_shares` of the channels, once screened.
    samples
        (used, rows, cols) `SampleGrid.sample` of each used frame, until screened.
    """

    read: int
    used: tuple[int, ...]
    digests: tuple[str, ...]
    rejected: tuple[str, ...]
    screened: bool
    tops: tuple[tuple[float, float], ...]
    samples: NDArray[np.uint16] = field(compare=False, repr=False)


class Checkpoint:
    """A folder with one file of exact sums per group of a frame set.

    A run that resumes from it gives bit-identical results. The files are bound to the frames by their names, their size
    and the totals of the first and the last frame summed.

    Parameters
    ----------
    folder
        Created if it does not exist.
    frames
        The frame set.

    Raises
    ------
    FileError
        If the folder cannot be created, or holds other files.
    """

    def __init__(self, folder: str | PathLike[str], frames: FrameSet) -> None:
        self.folder = Path(folder)
        self._frames = frames
        self._files = {id(group): self.folder / f"sums-{n:04d}.h5" for n, group in enumerate(frames.groups)}
        self._saved_s = time.monotonic()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(folder, f"the folder cannot be created: {error.strerror or error}") from None
        others = sorted(p.name for p in self.folder.iterdir() if not p.name.startswith((".", "sums-")))
        if others:
            raise FileError(folder, f"the folder holds {others[0]}", hint="Use an empty folder for the checkpoint")

    def due(self) -> bool:
        """Return whether the sums should be saved again."""
        return time.monotonic() - self._saved_s > SAVE_EVERY_S

    def save(self, group: FrameGroup, sums: FrameSums, progress: GroupProgress) -> None:
        """Save a group's sums, completely or not at all."""
        import h5py

        note = {name: value for name, value in vars(progress).items() if name != "samples"}
        note |= {"version": _VERSION, "group": self._identity(group)}
        with atomic_path(self._files[id(group)]) as temporary, h5py.File(temporary, "w") as file:
            file.attrs["progress"] = json.dumps(note)
            for name, array in sums.state().items():
                file.create_dataset(name, data=array)
            file.create_dataset("samples", data=progress.samples)
        self._saved_s = time.monotonic()

    def load(self, group: FrameGroup, sums: FrameSums) -> GroupProgress | None:
        """Restore a group's sums; return None if none were saved."""
        path = self._files[id(group)]
        if (found := self._progress(group)) is None:
            return None
        try:
            import h5py

            with h5py.File(path, "r") as file:
                sums.restore({name: np.asarray(file[name]) for name in file})
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise _damaged(path, error) from None
        totals = sums.frame_totals()
        for place in sorted({0, len(found.used) - 1}) if found.used else ():
            source = group.frames[found.used[place]]
            if int(source.read().sum(dtype=np.uint64)) != totals[place]:
                raise FileError(
                    source.name,
                    "the frame has changed since its sums were saved",
                    hint=f"Remove the folder {self.folder} and start again",
                )
        return found

    def frames_read(self, group: FrameGroup) -> int:
        """Return the number of frames of a group that need not be read again."""
        found = self._progress(group)
        return found.read if found else 0

    def _progress(self, group: FrameGroup) -> GroupProgress | None:
        path = self._files[id(group)]
        if not path.exists():
            return None
        try:
            import h5py

            with h5py.File(path, "r") as file:
                note: dict[str, Any] = json.loads(file.attrs["progress"])
                same = note["version"] == _VERSION and note["group"] == self._identity(group)
                found = GroupProgress(
                    int(note["read"]), tuple(note["used"]), tuple(note["digests"]), tuple(note["rejected"]),
                    bool(note["screened"]), tuple((a, b) for a, b in note["tops"]), np.asarray(file["samples"]),
                )  # fmt: skip
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise _damaged(path, error) from None
        if not same:
            raise FileError(
                path,
                f"the file belongs to other frames than {group_label(group)} of {self._frames.source}",
                hint="Remove the folder, or use another one for the checkpoint",
            )
        return found

    def remove(self) -> None:
        """Remove the files, and the folder if it is then empty."""
        for path in self._files.values():
            path.unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()

    def _identity(self, group: FrameGroup) -> str:
        frames = self._frames
        what = [frames.rows, frames.cols, frames.bits, frames.cfa, group.kind, group.exposure_s]
        what += [source.name for source in group.frames]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()


def _damaged(path: Path, error: Exception) -> FileError:
    reason = " ".join(str(error).split()) or type(error).__name__
    return FileError(path, f"the file holds no checkpoint, or is damaged ({reason})", hint="Remove it")
