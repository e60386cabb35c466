"""Pictures for pages: reduced, enlarged, differences of two, and as JPEG."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

WIDEST = 900
"""Largest width of a picture on a page, in pixels."""


def shrink(picture: NDArray[np.float32], widest: int = WIDEST) -> NDArray[np.float32]:
    """Reduce a picture, (rows, cols, 3), by the smallest integer factor to at most `widest` columns.

    Squares of pixels are averaged; incomplete squares at the right and bottom are dropped.

    Examples
    --------
    >>> shrink(np.ones((7, 10, 3), np.float32), widest=5).shape
    (3, 5, 3)
    """
    factor = -(-picture.shape[1] // widest)
    rows, cols = picture.shape[0] // factor, picture.shape[1] // factor
    squares = picture[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor, 3)
    return np.asarray(squares.mean(axis=(1, 3)), dtype=np.float32)


def enlarge(picture: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Enlarge a picture, each pixel to a square of factor x factor."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def magnified(picture: NDArray[np.float32], reference: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """Return the difference from a reference (a picture or a color), multiplied by a factor, around middle gray.

    The result is clipped to the display's range.

    Examples
    --------
    >>> magnified(np.full((1, 1, 3), 0.6), np.array([0.6, 0.5, 0.0]), 2.0)[0, 0]
    array([0.5, 0.7, 1. ], dtype=float32)
    """
    return np.asarray(np.clip(0.5 + factor * (picture - reference), 0.0, 1.0), dtype=np.float32)


def jpeg_bytes(picture: NDArray[np.float32]) -> bytes:
    """Return a picture (rows, cols, 3) in display sRGB as JPEG."""
    stream = io.BytesIO()
    whole = np.rint(np.clip(picture, 0.0, 1.0) * 255.0).astype(np.uint8)
    Image.fromarray(whole).save(stream, format="JPEG", quality=88, subsampling=0)
    return stream.getvalue()
