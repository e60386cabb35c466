"""Checkpoint on disk: the sums from which an interrupted calibration resumes."""

from __future__ import annotations

import hashlib
import json
import time
from contextlib import suppress
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.codes import Counts
from photosite.calibration.reduction.groups import group_label
from photosite.engine.frame_sums import FrameSums
from photosite.errors import FileError
from photosite.files.hdf5 import check_own_data, create_hdf5
from photosite.files.writing import FolderLock, atomic_path, remove_abandoned
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.values.diagnostic import Diagnostic

_VERSION = 6
SAVE_EVERY_S = 20.0
"""Seconds of work that an interruption may lose; a finished group is saved at once."""


class FrameIdentity(NamedTuple):
    """What identifies a frame that was read: its `file_stamp` before, and the SHA-256 of its digital numbers."""

    stamp: tuple[int, ...] | None
    sha256: str


def identity(stamp: tuple[int, ...] | None, dn: NDArray[np.unsignedinteger]) -> FrameIdentity:
    """Return the identity of a frame that was read after its stamp was taken."""
    return FrameIdentity(stamp, hashlib.sha256(np.ascontiguousarray(dn).data).hexdigest())


@dataclass
class FirstPass:
    """How far the first pass over a group got."""

    read: int = 0  # number of frames read, in the order of the group
    identities: list[FrameIdentity] = field(default_factory=list)  # of the frames read
    used: list[int] = field(default_factory=list)  # indices of those that are not repeats
    digests: list[str] = field(default_factory=list)  # of the sampled rows of each used frame
    rejected: list[Diagnostic] = field(default_factory=list)  # why the others are not used
    screened: bool = False  # whether all frames were read, and outlier frames left out
    counts: Counts = field(default_factory=lambda: np.zeros((0, 3), np.int64))  # `count_codes`, once screened
    samples: list[NDArray[np.uint16]] = field(default_factory=list)  # `sample_grid` of each used frame, until screened


class SavedSums(Protocol):
    """Sums of groups of a frame set that need not be read, or not as a whole."""

    def load(self, group: FrameGroup, sums: FrameSums | None = None) -> FirstPass | None:
        """Return how far a group got, None if nothing is known; restore its sums, if given."""

    def save(self, group: FrameGroup, sums: FrameSums, progress: FirstPass) -> None:
        """Keep a group's sums."""

    def due(self) -> bool:
        """Return whether unfinished sums should be kept now."""


class Checkpoint:
    """A folder with one file of exact sums per group of a frame set.

    A run that resumes from it gives bit-identical results. The files are bound to the frames by their names, their size
    and the identity of every frame that was read. The folder is created if it does not exist. It is
    locked until the end of its `with` statement.

    Raises
    ------
    FileError
        If the folder cannot be created, holds other files, or is in use by another run.
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
        self._lock = FolderLock(self.folder)
        remove_abandoned(self.folder)

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()

    def due(self) -> bool:
        """Return whether the sums should be saved again."""
        return time.monotonic() - self._saved_s > SAVE_EVERY_S

    def save(self, group: FrameGroup, sums: FrameSums, progress: FirstPass) -> None:
        """Save a group's sums, completely or not at all."""
        note = {name: value for name, value in vars(progress).items() if name not in ("counts", "samples")}
        note |= {"version": _VERSION, "group": self._identity(group)}
        note["rejected"] = [found.to_dict() for found in progress.rejected]
        with atomic_path(self._files[id(group)]) as temporary, create_hdf5(temporary) as file:
            file.attrs["progress"] = json.dumps(note)
            for name, array in sums.state().items():
                file.create_dataset(name, data=array)
            file.create_dataset("samples", data=np.array(progress.samples, np.uint16))
            file.create_dataset("counts", data=progress.counts)
        self._saved_s = time.monotonic()

    def load(self, group: FrameGroup, sums: FrameSums | None = None) -> FirstPass | None:
        """Return how far a group got, None if nothing was saved; restore its sums, if given."""
        path = self._files[id(group)]
        if not path.exists():
            return None
        try:
            import h5py

            with h5py.File(path, "r") as file:
                check_own_data(path, file)
                note = json.loads(file.attrs["progress"])
                same = note.pop("version") == _VERSION and note.pop("group") == self._identity(group)
                if same and sums is not None:
                    sums.restore({name: np.asarray(file[name]) for name in file})
                if same:
                    samples, counts = list(np.asarray(file["samples"])), np.asarray(file["counts"])
                    identities = [
                        FrameIdentity(None if stamp is None else tuple(stamp), sha256)
                        for stamp, sha256 in note["identities"]
                    ]
                    rejected = [Diagnostic.from_dict(entry) for entry in note["rejected"]]
                    own = {"samples": samples, "counts": counts, "identities": identities, "rejected": rejected}
                    found = FirstPass(**note | own)
        except (OSError, KeyError, ValueError, TypeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise FileError(path, f"the file holds no checkpoint, or is damaged ({reason})", hint="Remove it") from None
        if not same:
            raise FileError(
                path,
                f"the file belongs to other frames than {group_label(group)} of {self._frames.source}",
                hint="Remove the folder, or use another one for the checkpoint",
            )
        return found

    def remove(self) -> None:
        """Remove the files, release the folder, and remove it if it is then empty."""
        for path in self._files.values():
            path.unlink(missing_ok=True)
        self._lock.release()
        with suppress(OSError):
            self.folder.rmdir()

    def _identity(self, group: FrameGroup) -> str:
        frames = self._frames
        what = [frames.rows, frames.cols, frames.bits, frames.cfa, group.kind, group.exposure_s]
        what += [source.name for source in group.frames]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()
