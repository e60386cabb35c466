"""The number of cells over which a lens spreads a point, and its limits."""

from __future__ import annotations

import math
import warnings

import scipy.fft

from photosite.engine.transfer import Sampling
from photosite.errors import InputError, PhotositeWarning

_SMALLEST_KERNEL = 65
_LARGEST_KERNEL = 2049
"""Cells per axis; the kernels of 31 wavelengths then take a gigabyte."""
_SLOW_KERNEL = 500
"""Cells per axis above which 41 wavelengths take more than half a minute."""
_LARGEST_RADIAL = 16384
"""Cells per axis of a spread that needs no kernel; the frame is padded by this many."""


def check_reach(reach_m: float, sampling: Sampling) -> None:
    """Reject a rotationally symmetric spread for which the frame would need too much padding.

    Raises
    ------
    InputError
        If a point is spread over more than 16384 cells.
    """
    _cells_across(reach_m, sampling, _LARGEST_RADIAL)


def kernel_size(reach_m: float, sampling: Sampling) -> int:
    """Return the cells per axis of a kernel for the low-pass filter's four spots; odd, with a fast transform.

    Raises
    ------
    InputError
        If there are more than 2049.

    Warns
    -----
    PhotositeWarning
        If there are so many that computing the transfer functions takes long.
    """
    cells = _cells_across(reach_m, sampling, _LARGEST_KERNEL)
    if cells > _SLOW_KERNEL:
        warnings.warn(
            PhotositeWarning(
                f"the lens spreads a point over {cells:.0f} cells of the sensor, which may take minutes to compute",
                hint="Check the units of the optics and the focus, or use fewer cells per pixel",
            ),
            stacklevel=2,
        )
    size = max(math.ceil(cells), _SMALLEST_KERNEL)
    while size % 2 == 0 or scipy.fft.next_fast_len(size) != size:
        size += 1
    return size


def _cells_across(reach_m: float, sampling: Sampling, most: int) -> float:
    """Return the cells per axis that a spread with its low-pass filter and pixel covers; check the limit."""
    across_m = 2 * reach_m + max(sampling.split_m)
    cells = (across_m / min(sampling.pitch_m) + 2) * sampling.cells_per_pixel
    if not cells <= most:
        raise InputError(
            "the number of cells over which the lens spreads a point",
            value=round(cells) if math.isfinite(cells) else cells,
            expected=f"at most {most}",
            where=f"point spread of {across_m * 1e3:g} mm",
            hint="Check the units of the optics and the focus, or use fewer cells per pixel",
        )
    return cells
