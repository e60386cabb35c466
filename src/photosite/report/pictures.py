"""Pictures as the pages show them: developed alike, made smaller, and what differs between two."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from photosite.develop.color_matrix import ColorMatrix
from photosite.develop.develop import develop
from photosite.frames.raw_frame import RawFrame

WIDEST = 900
"""Columns of a picture on a page."""

JPEG_QUALITY = 88


def develop_alike(
    first: RawFrame, second: RawFrame, color_matrix: ColorMatrix | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Develop two frames with one colour matrix and one exposure, so that what differs is theirs.

    Parameters
    ----------
    first, second
        Two frames of one scene, each with its own black and white level.
    color_matrix
        Camera RGB to XYZ under D65, best fitted to the scene's own light: there is no other white balance. None takes
        what the frames say.

    Returns
    -------
    tuple of numpy.ndarray
        (rows, cols, 3) float32 each, display sRGB; the neutral that just saturates the first channel is white.

    Raises
    ------
    InputError
        As `photosite.develop.develop.develop`.

    Examples
    --------
    >>> frame = RawFrame(np.full((4, 4), 255, np.uint16), bits=8)
    >>> one, other = develop_alike(frame, frame)
    >>> one.shape, float(one.min()), bool((one == other).all())
    ((4, 4, 3), 1.0, True)
    """
    return develop(first, "none", color_matrix, 1.0), develop(second, "none", color_matrix, 1.0)


def shrink(picture: NDArray[np.float32], widest: int = WIDEST) -> NDArray[np.float32]:
    """The picture made smaller by a whole factor, each pixel the mean of a square, until it is narrow enough.

    Parameters
    ----------
    picture
        (rows, cols, 3).
    widest
        Columns allowed.

    Returns
    -------
    numpy.ndarray
        (rows // n, cols // n, 3); what does not fill a square at the right and the bottom is left off.

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
    """The picture with every pixel a square of factor x factor."""
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def magnified(picture: NDArray[np.float32], reference: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """What a picture differs from a reference, times a factor, around middle gray.

    Parameters
    ----------
    picture
        (rows, cols, 3).
    reference
        Another picture, or one color: anything that broadcasts.
    factor
        Magnification; what leaves the display's range is clipped to it.

    Examples
    --------
    >>> magnified(np.full((1, 1, 3), 0.6), np.array([0.6, 0.5, 0.0]), 2.0)[0, 0]
    array([0.5, 0.7, 1. ], dtype=float32)
    """
    return np.asarray(np.clip(0.5 + factor * (picture - reference), 0.0, 1.0), dtype=np.float32)


def jpeg_bytes(picture: NDArray[np.float32]) -> bytes:
    """A picture, (rows, cols, 3) in display sRGB, as JPEG."""
    stream = io.BytesIO()
    whole = np.rint(np.clip(picture, 0.0, 1.0) * 255.0).astype(np.uint8)
    Image.fromarray(whole).save(stream, format="JPEG", quality=JPEG_QUALITY, subsampling=0)
    return stream.getvalue()
