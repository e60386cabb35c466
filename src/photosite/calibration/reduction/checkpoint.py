"""Partial sums on disk: what a calibration that is broken off need not read again."""

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

_VERSION = 2
SAVE_EVERY_S = 20.0
"""Seconds of work that may be lost; a group that is finished is kept at once."""


@dataclass(frozen=True)
class GroupProgress:
    """How far the first look at a group got.

    Parameters
    ----------
    looked_at
        Frames of the group that were read, in its order.
    used
        The places of those that were not repeats.
    seen
        Of each of these, the digest of the rows that are looked at first.
    rejected
        What was said of the others.
    judged
        Whether the group was read to its end, and broken frames left out.
    tops
        Of a group that was judged, `top_value_shares` of its channels.
    samples
        (used, rows, cols) of a group that was not: `Grid.sample` of each frame used.
    """

    looked_at: int
    used: tuple[int, ...]
    seen: tuple[str, ...]
    rejected: tuple[str, ...]
    judged: bool
    tops: tuple[tuple[float, float], ...]
    samples: NDArray[np.uint16] = field(compare=False, repr=False)


class Checkpoint:
    """A folder that keeps the sums of a frame set's groups while it is calibrated: a file for each group.

    The file holds the exact sums, so that a run which goes on from them gives the same result to the last bit. It
    belongs to the frames by their names, their size and the totals of the first and the last one summed.

    Parameters
    ----------
    folder
        Made if it is missing.
    frames
        The set.

    Raises
    ------
    FileError
        If the folder cannot be made, or holds something else.
    """

    def __init__(self, folder: str | PathLike[str], frames: FrameSet) -> None:
        self.folder = Path(folder)
        self._frames = frames
        self._files = {id(group): self.folder / f"sums-{n:04d}.h5" for n, group in enumerate(frames.groups)}
        self._saved_s = time.monotonic()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(folder, f"cannot hold partial sums: {error.strerror or error}") from None
        strange = sorted(p.name for p in self.folder.iterdir() if not p.name.startswith((".", "sums-")))
        if strange:
            raise FileError(folder, f"holds {strange[0]}; partial sums need a folder of their own")

    def due(self) -> bool:
        """Whether so much time has passed since something was saved that the sums should be kept."""
        return time.monotonic() - self._saved_s > SAVE_EVERY_S

    def save(self, group: FrameGroup, sums: FrameSums, progressed: GroupProgress) -> None:
        """Keep a group's sums, whole or not at all.

        Raises
        ------
        FileError
            If they cannot be written.
        """
        import h5py

        note = {
            "version": _VERSION,
            "group": self._identity(group),
            "looked_at": progressed.looked_at,
            "used": progressed.used,
            "seen": progressed.seen,
            "rejected": progressed.rejected,
            "judged": progressed.judged,
            "tops": progressed.tops,
        }
        with atomic_path(self._files[id(group)]) as temporary, h5py.File(temporary, "w") as file:
            file.attrs["progressed"] = json.dumps(note)
            for name, array in sums.state().items():
                file.create_dataset(name, data=array)
            file.create_dataset("samples", data=progressed.samples)
        self._saved_s = time.monotonic()

    def load(self, group: FrameGroup, sums: FrameSums) -> GroupProgress | None:
        """Bring a group's sums back, if some were kept.

        Raises
        ------
        FileError
            If what was kept is damaged, or is of other frames.
        """
        path = self._files[id(group)]
        if (found := self._progressed(group)) is None:
            return None
        try:
            import h5py

            with h5py.File(path, "r") as file:
                sums.restore({name: np.asarray(file[name]) for name in file})
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise self._damaged(path, error) from None
        totals = sums.frame_totals()
        for place in sorted({0, len(found.used) - 1}) if found.used else ():
            source = group.frames[found.used[place]]
            if int(source.read().sum(dtype=np.uint64)) != totals[place]:
                raise FileError(
                    source.name, f"has changed since its sums were kept; remove the folder {self.folder} and begin anew"
                )
        return found

    def looked_at(self, group: FrameGroup) -> int:
        """Frames of a group that need not be read again in the first pass.

        Raises
        ------
        FileError
            As `load`.
        """
        found = self._progressed(group)
        return found.looked_at if found else 0

    def _progressed(self, group: FrameGroup) -> GroupProgress | None:
        path = self._files[id(group)]
        if not path.exists():
            return None
        try:
            import h5py

            with h5py.File(path, "r") as file:
                note: dict[str, Any] = json.loads(file.attrs["progressed"])
                version, identity = note["version"], note["group"]
                if version == _VERSION:
                    found = GroupProgress(
                        int(note["looked_at"]), tuple(note["used"]), tuple(note["seen"]), tuple(note["rejected"]),
                        bool(note["judged"]), tuple((a, b) for a, b in note["tops"]), np.asarray(file["samples"]),
                    )  # fmt: skip
        except (OSError, KeyError, ValueError, TypeError) as error:
            raise self._damaged(path, error) from None
        if version != _VERSION or identity != self._identity(group):
            raise FileError(
                path, f"holds partial sums of other frames than {group_label(group)} of {self._frames.source}; "
                f"remove the folder or name another"
            )  # fmt: skip
        return found

    def remove(self) -> None:
        """Take the files away, and the folder if nothing else is in it: the calibration is done."""
        for path in self._files.values():
            path.unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()

    def _identity(self, group: FrameGroup) -> str:
        frames = self._frames
        what = [frames.rows, frames.cols, frames.bits, frames.cfa, group.kind, group.exposure_s]
        what += [source.name for source in group.frames]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()

    def _damaged(self, path: Path, error: Exception) -> FileError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return FileError(path, f"is no file of partial sums, or is damaged ({reason}); remove it")
