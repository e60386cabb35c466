"""Repeated frames must be repeats: two that are the same to the last bit are one frame, given twice."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256

import numpy as np

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame


def check_repeats(frames: Sequence[RawFrame], names: Sequence[str] | None = None) -> None:
    """Refuse frames of which two are identical, since a stack's noise comes from how its frames differ.

    A frame that reads the same number everywhere (all black, all white) has no noise to differ by and passes.

    Parameters
    ----------
    frames
        The measured frames.
    names
        What to call them; None counts from 1.

    Raises
    ------
    InputError
        If two are identical.
    """
    seen: dict[tuple[tuple[int, ...], bytes], int] = {}
    for number, frame in enumerate(frames if len(frames) > 1 else ()):
        if frame.dn.min() == frame.dn.max():
            continue
        first = seen.setdefault((frame.dn.shape, sha256(np.ascontiguousarray(frame.dn).data).digest()), number)
        if first != number:
            which = (f"{first + 1} and {number + 1}") if names is None else f"{names[first]} and {names[number]}"
            raise InputError(f"measured frames {which} are identical in every pixel, so no repeats; give each once")
