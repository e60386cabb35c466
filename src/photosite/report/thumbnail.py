"""A small picture of a raw frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.develop.develop import develop
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import MONOCHROME
from photosite.values.thumbnail import stride_for


def frame_thumbnail(raw: RawFrame) -> NDArray[np.float32]:
    """Return a picture of at most 480 x 480 pixels in display sRGB, from every n-th tile of the color filter array.

    Tiles that `develop` does not know, and black frames, become gray.

    Examples
    --------
    >>> raw = RawFrame(np.full((3000, 4000), 700, np.uint16), bits=12, cfa=(("R", "G"), ("G", "B")))
    >>> frame_thumbnail(raw).shape
    (334, 446, 3)
    """
    if raw.shape[0] < len(raw.cfa) or raw.shape[1] < len(raw.cfa[0]):
        raw = replace(raw, cfa=MONOCHROME)
    height, width = len(raw.cfa), len(raw.cfa[0])
    rows, cols = raw.shape[0] // height, raw.shape[1] // width
    step = stride_for(rows * height, cols * width)
    tiles = raw.dn[: rows * height, : cols * width].reshape(rows, height, cols, width)[::step, :, ::step]
    small: NDArray[Any] = np.ascontiguousarray(tiles).reshape(tiles.shape[0] * height, tiles.shape[2] * width)
    frame = replace(raw, dn=small, captures={})
    try:
        return develop(frame)
    except InputError:
        gray = replace(frame, cfa=MONOCHROME, color_matrix=None, noise_profile=None, metadata={})
        return develop(gray, exposure=1.0)
