"""Checkpoint on disk: the sums from which an interrupted calibration resumes."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

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


@dataclass
class FirstPass:
    """How far the first pass over a group got."""

    read: int = 0  # number of frames read, in the order of the group
    used: list[int] = field(default_factory=list)  # indices of those that are not repeats
    digests: list[str] = field(default_factory=list)  # of the sampled rows of each used frame
    rejected: list[str] = field(default_factory=list)  # reasons for the others
    screened: bool = False  # whether all frames were read, and outlier frames left out
    tops: tuple[tuple[float, float], ...] = ()  # `top_value_shares` of the channels, once screened
    samples: list[NDArray[np.uint16]] = field(default_factory=list)  # `sample_grid` of each used frame, until screened


class Checkpoint:
    """A folder with one file of exact sums per group of a frame set.

    A run that resumes from it gives bit-identical results. The files are bound to the frames by their names, their size
    and the totals of the first and the last frame summed. The folder is created if it does not exist.

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

    def save(self, group: FrameGroup, sums: FrameSums, progress: FirstPass) -> None:
        """Save a group's sums, completely or not at all."""
        import h5py

        note = {name: value for name, value in vars(progress).items() if name != "samples"}
        note |= {"version": _VERSION, "group": self._identity(group)}
        with atomic_path(self._files[id(group)]) as temporary, h5py.File(temporary, "w") as file:
            file.attrs["progress"] = json.dumps(note)
            for name, array in sums.state().items():
                file.create_dataset(name, data=array)
            file.create_dataset("samples", data=np.array(progress.samples, np.uint16))
        self._saved_s = time.monotonic()

    def load(self, group: FrameGroup, sums: FrameSums | None = None) -> FirstPass | None:
        """Return how far a group got, None if nothing was saved; restore its sums, if given."""
        path = self._files[id(group)]
        if not path.exists():
            return None
        try:
            import h5py

            with h5py.File(path, "r") as file:
                note = json.loads(file.attrs["progress"])
                same = note.pop("version") == _VERSION and note.pop("group") == self._identity(group)
                if same and sums is not None:
                    sums.restore({name: np.asarray(file[name]) for name in file})
                if same:
                    tops, samples = tuple((a, b) for a, b in note["tops"]), list(np.asarray(file["samples"]))
                    found = FirstPass(**note | {"tops": tops, "samples": samples})
        except (OSError, KeyError, ValueError, TypeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise FileError(path, f"the file holds no checkpoint, or is damaged ({reason})", hint="Remove it") from None
        if not same:
            raise FileError(
                path,
                f"the file belongs to other frames than {group_label(group)} of {self._frames.source}",
                hint="Remove the folder, or use another one for the checkpoint",
            )
        if sums is not None:
            self._check_unchanged(group, sums.frame_totals(), found)
        return found

    def _check_unchanged(self, group: FrameGroup, totals: list[int], found: FirstPass) -> None:
        for place in sorted({0, len(found.used) - 1}) if found.used else ():
            source = group.frames[found.used[place]]
            if int(source.read().sum(dtype=np.uint64)) != totals[place]:
                raise FileError(
                    source.name,
                    "the frame has changed since its sums were saved",
                    hint=f"Remove the folder {self.folder} and start again",
                )

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
