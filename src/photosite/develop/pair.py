"""Develop two frames of one scene in the same way, for comparison."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.develop.color_matrix import ColorMatrix
from photosite.develop.develop import develop
from photosite.frames.raw_frame import RawFrame


def develop_pair(
    first: RawFrame, second: RawFrame, color_matrix: ColorMatrix | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Develop two frames with the same colour matrix and exposure, so that only the frames cause differences.

    Parameters
    ----------
    first, second
        Two frames of one scene, each with its own black and white level.
    color_matrix
        Camera RGB to XYZ under D65, fitted to the light of the scene, because there is no other white balance.
        Default: the matrix of the frames.

    Returns
    -------
    tuple of numpy.ndarray
        (rows, cols, 3) float32 each, display sRGB. White is the neutral that saturates the first channel.

    Raises
    ------
    InputError
        As for `develop`.

    Examples
    --------
    >>> frame = RawFrame(np.full((4, 4), 255, np.uint16), bits=8)
    >>> one, other = develop_pair(frame, frame)
    >>> one.shape, float(one.min()), bool((one == other).all())
    ((4, 4, 3), 1.0, True)
    """
    return develop(first, "none", color_matrix, 1.0), develop(second, "none", color_matrix, 1.0)
