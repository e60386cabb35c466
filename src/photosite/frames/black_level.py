"""Black level of the masked border, compared with the level that the file states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.frames.raw_frame import RawFrame

MASKED_BORDER = "masked_border_dn"
"""Metadata name of the mean level of the masked pixels beside the frame."""

_TOLERANCE_DN, _TOLERANCE_SHARE = 1.0, 1e-3
"""Levels disagree if they differ by more than this many DN and by more than this share of the range up to white."""


def levels_disagree(stated_dn: float, found_dn: float, white_level_dn: float) -> bool:
    """Return whether a measured black level contradicts the stated one.

    Examples
    --------
    >>> levels_disagree(256, 256.6, 4095), levels_disagree(256, 262, 4095), levels_disagree(512, 520, 16383)
    (False, True, False)
    """
    return abs(found_dn - stated_dn) > max(_TOLERANCE_DN, _TOLERANCE_SHARE * (white_level_dn - stated_dn))


def masked_border_note(frame: RawFrame) -> tuple[str, ...]:
    """Return a note if the masked border contradicts the stated black level, else nothing."""
    found = frame.metadata.get(MASKED_BORDER)
    if not isinstance(found, float) or not levels_disagree(frame.black_level_dn, found, frame.white_level_dn):
        return ()
    return (
        f"the masked border has a mean of {found:.2f} DN, but the stated black level is {frame.black_level_dn:g} DN",
    )


def masked_border_level(strips: list[NDArray[np.uint16]]) -> float | None:
    """Return the level of a border whose lines need not all be masked: the median of the lines' means.

    Parameters
    ----------
    strips
        (lines, pixels along the edge of the frame) each. Some lines may be blank or receive light.

    Examples
    --------
    >>> masked_border_level([np.array([[0, 0], [64, 66], [65, 65], [64, 65], [90, 95]], np.uint16)])
    65.0
    """
    means = [float(line.mean()) for strip in strips for line in strip]
    return float(np.median(means)) if means else None
