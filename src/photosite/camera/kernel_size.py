"""How many cells of the sensor a lens spreads a point over: how large kernels become, and what is too large."""

from __future__ import annotations

import math
import warnings

import scipy.fft

from photosite.engine.transfer import Sampling
from photosite.errors import InputError, PhotositeWarning

_SMALLEST_KERNEL = 65
_LARGEST_KERNEL = 2049
"""Cells on an axis; a spread of 31 wavelengths then takes a gigabyte."""
_SLOW_KERNEL = 500
"""Cells from which on 41 wavelengths take more than half a minute."""
_LARGEST_RADIAL = 16384
"""Cells that a spread which needs no kernel may cover: the frame is padded by as many."""


def check_reach(reach_m: float, sampling: Sampling) -> None:
    """Refuse a rotationally symmetric spread that no frame can be padded for.

    Raises
    ------
    InputError
        If a point would be spread over more than 16384 cells.
    """
    _cells_across(reach_m, sampling, _LARGEST_RADIAL)


def kernel_size(reach_m: float, sampling: Sampling) -> int:
    """Cells on an axis of a kernel that holds four spots of this reach and the pixel; odd, and well transformed.

    Raises
    ------
    InputError
        If they are more than 2049.

    Warns
    -----
    PhotositeWarning
        If they are so many that transfer functions take long: it is said before they are computed.
    """
    cells = _cells_across(reach_m, sampling, _LARGEST_KERNEL)
    if cells > _SLOW_KERNEL:
        warnings.warn(
            f"the lens spreads a point over {cells:.0f} cells of the sensor, which may take minutes; check the units "
            "of its optics and its focus, or take fewer cells",
            PhotositeWarning,
            stacklevel=2,
        )
    size = max(math.ceil(cells), _SMALLEST_KERNEL)
    while size % 2 == 0 or scipy.fft.next_fast_len(size) != size:
        size += 1
    return size


def _cells_across(reach_m: float, sampling: Sampling, most: int) -> float:
    """Cells that a spread of this reach and the pixel cover on an axis."""
    across_m = 2 * reach_m + max(sampling.split_m)
    cells = (across_m / min(sampling.pitch_m) + 2) * sampling.cells_per_pixel
    if not cells <= most:
        raise InputError(
            f"the lens spreads a point over {across_m * 1e3:g} mm, {cells:.0f} cells of the sensor, and a mosaic "
            f"takes {most} at most; check the units of its optics and its focus, or take fewer cells"
        )
    return cells
