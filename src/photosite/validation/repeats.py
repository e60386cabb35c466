"""Detection of identical frames in a stack."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256

import numpy as np

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame


def check_repeats(frames: Sequence[RawFrame], names: Sequence[str] | None = None) -> None:
    """Reject stacks with identical frames, because a stack's noise is estimated from differences between frames.

    Frames with one value everywhere (all black or all white) are accepted.

    Parameters
    ----------
    frames
        The measured frames.
    names
        Names for the error message; None counts from 1.

    Raises
    ------
    InputError
        If two frames are identical.
    """
    seen: dict[tuple[tuple[int, ...], bytes], int] = {}
    for number, frame in enumerate(frames if len(frames) > 1 else ()):
        if frame.dn.min() == frame.dn.max():
            continue
        first = seen.setdefault((frame.dn.shape, sha256(np.ascontiguousarray(frame.dn).data).digest()), number)
        if first != number:
            which = (f"{first + 1} and {number + 1}") if names is None else f"{names[first]} and {names[number]}"
            raise InputError(f"measured frames {which} are identical in every pixel", hint="Pass each frame once")
