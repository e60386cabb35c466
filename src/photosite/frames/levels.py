"""Levels that files state, held against what pixels read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.frames.raw_frame import RawFrame

BORDER = "masked_border_dn"
"""Of the metadata: what the pixels kept from light beside the frame read on average."""

FAR_DN, FAR_SHARE = 1.0, 1e-3
"""A level is far from another if both are passed: this many DN, and this share of the range up to white."""


def far_apart(stated_dn: float, found_dn: float, white_level_dn: float) -> bool:
    """Whether a level that was found contradicts the one stated.

    Examples
    --------
    >>> far_apart(256, 256.6, 4095), far_apart(256, 262, 4095), far_apart(512, 520, 16383)
    (False, True, False)
    """
    return abs(found_dn - stated_dn) > max(FAR_DN, FAR_SHARE * (white_level_dn - stated_dn))


def border_note(frame: RawFrame) -> tuple[str, ...]:
    """A line about a masked border that reads otherwise than the black level stated, if it does."""
    found = frame.metadata.get(BORDER)
    if not isinstance(found, float) or not far_apart(frame.black_level_dn, found, frame.white_level_dn):
        return ()
    return (
        f"the masked border reads {found:.2f} DN on average, where a black level of {frame.black_level_dn:g} DN is "
        f"stated",
    )


def border_level(strips: list[NDArray[np.uint16]]) -> float | None:
    """The level of borders that are not said to be masked in every line: the middle one of the lines' means.

    Parameters
    ----------
    strips
        Each (lines, pixels along the edge of the frame). Cameras have lines among them that are blank, or catch light
        beside the frame.

    Examples
    --------
    >>> border_level([np.array([[0, 0], [64, 66], [65, 65], [64, 65], [90, 95]], np.uint16)])
    65.0
    """
    means = [float(line.mean()) for strip in strips for line in strip]
    return float(np.median(means)) if means else None
