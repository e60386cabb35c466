"""Which frames a calibration stands on: their digests, taken when somebody asks for them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.frame_set import FrameSource


@dataclass(frozen=True)
class UsedFrame:
    """A frame that was used.

    Parameters
    ----------
    source
        Where it is.
    total
        The sum of its digital numbers when it was used.
    """

    source: FrameSource
    total: int

    @property
    def name(self) -> str:
        """What it is called: its path, or a label for a frame in memory."""
        return self.source.name


def frames_sha256(used: Sequence[UsedFrame]) -> tuple[str, ...]:
    """One SHA-256 per frame, in the order of the frames: of its digital numbers, little-endian uint16, row by row.

    Hashing takes several times as long as calibrating, so it is done when the digests are asked for. A frame whose
    numbers do not add up any more to what they did is no longer the frame that was used.

    Raises
    ------
    FileError
        If a frame is not there any more, or has changed since it was used.

    Examples
    --------
    >>> frame = FrameSource("black", lambda: np.zeros((2, 2), np.uint16))
    >>> frames_sha256([UsedFrame(frame, 0)])[0][:12]
    'af5570f5a181'
    """
    with ThreadPoolExecutor(min(4, os.cpu_count() or 1), "photosite-hash") as threads:
        together = list(used)
        if all(frame.source.thread_safe for frame in together):
            return tuple(threads.map(_digest_of, together))
        return tuple(_digest_of(frame) for frame in together)


def _digest_of(frame: UsedFrame) -> str:
    dn: NDArray[np.unsignedinteger] = frame.source.read()
    if int(dn.sum(dtype=np.uint64)) != frame.total:
        raise FileError(
            frame.name,
            "has changed since it was calibrated, so that its digest would be another frame's; calibrate again",
        )
    return hashlib.sha256(np.ascontiguousarray(dn, dtype="<u2").data).hexdigest()
