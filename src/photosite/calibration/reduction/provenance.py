"""The frames that a calibration is based on, and their digests."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.engine.threads import thread_count
from photosite.errors import FileError
from photosite.frames.frame_set import FrameSource
from photosite.values.shown import Shown


@dataclass(frozen=True)
class UsedFrame(Shown):
    """A frame that was used: where it is read from, and the sum of its digital numbers when it was used."""

    source: FrameSource
    total: int

    @property
    def name(self) -> str:
        """Its path, or a label for a frame in memory."""
        return self.source.name

    def check_total(self, total: int) -> None:
        """Raise `FileError` if the sum of the digital numbers is another now."""
        if total != self.total:
            raise FileError(self.name, "the frame has changed since it was calibrated", hint="Calibrate again")


def frames_sha256(used: Sequence[UsedFrame]) -> tuple[str, ...]:
    """Return one SHA-256 per frame, of its digital numbers as little-endian uint16, row by row.

    Hashing takes several times as long as calibrating; therefore it is done on request only.

    Raises
    ------
    FileError
        If a frame is missing, or has another total than when it was used.
    """
    if not all(frame.source.thread_safe for frame in used):
        return tuple(_digest(frame) for frame in used)
    with ThreadPoolExecutor(min(4, thread_count()), "photosite-hash") as threads:
        return tuple(threads.map(_digest, used))


def _digest(frame: UsedFrame) -> str:
    dn: NDArray[np.unsignedinteger] = frame.source.read()
    frame.check_total(int(dn.sum(dtype=np.uint64)))
    return hashlib.sha256(np.ascontiguousarray(dn, dtype="<u2").data).hexdigest()
