"""S-CIELAB: color differences after the blur of the eye, which does not see fine patterns, least of all in color."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import delta_e_2000

Array = NDArray[np.float64]

OPPONENT_FROM_XYZ: Array = np.array([[0.279, 0.72, -0.107], [-0.449, 0.29, -0.077], [0.086, -0.59, 0.501]])
"""(3, 3), XYZ to luminance, red-green and blue-yellow (Poirson and Wandell 1996)."""
OPPONENT_FROM_XYZ.flags.writeable = False

_FILTERS = (
    ((0.05, 1.00327), (0.225, 0.114416), (7.0, -0.117686)),
    ((0.0685, 0.616725), (0.826, 0.383275)),
    ((0.0920, 0.567885), (0.6451, 0.432115)),
)
"""Half-widths in degrees and weights of the Gaussians of each channel; the values of the S-CIELAB distribution."""


def kernel_size(pixels_per_degree: float) -> int:
    """Return the odd number of pixels of about a degree.

    Examples
    --------
    >>> kernel_size(59.09)
    59
    """
    return 2 * math.ceil(pixels_per_degree / 2.0) - 1


def scielab_kernels(pixels_per_degree: float, size: int | None = None) -> list[Array]:
    """Return the (size, size) kernels of luminance, red-green and blue-yellow, each with the sum 1.

    Parameters
    ----------
    pixels_per_degree
        Image pixels in a degree of the visual field.
    size
        Odd number of pixels; default: about one degree.

    References
    ----------
    X. Zhang and B. A. Wandell, "A spatial extension of CIELAB for digital color image reproduction", SID Digest 27
    (1996) 731.

    Examples
    --------
    >>> [round(float(kernel.sum()), 9) for kernel in scielab_kernels(60.0)]
    [1.0, 1.0, 1.0]
    """
    if size is None:
        size = kernel_size(pixels_per_degree)
    x = np.arange(size) - size // 2
    kernels = []
    for gaussians in _FILTERS:
        kernel = np.zeros((size, size))
        for half_width_deg, weight in gaussians:
            sigma = half_width_deg * pixels_per_degree / math.sqrt(2.0 * math.log(2.0))
            line = np.exp(-0.5 * (x / sigma) ** 2)
            kernel += weight * np.outer(line, line) / line.sum() ** 2
        kernels.append(kernel / kernel.sum())
    return kernels


def seen_xyz(xyz: Array, pixels_per_degree: float) -> Array:
    """Return (rows, cols, 3) XYZ as blurred by the eye; the image is continued by reflection."""
    from scipy.signal import fftconvolve

    kernels = scielab_kernels(pixels_per_degree)
    reach = kernels[0].shape[0] // 2
    opponent = xyz @ OPPONENT_FROM_XYZ.T
    padded = np.pad(opponent, ((reach, reach), (reach, reach), (0, 0)), mode="symmetric")
    planes = [fftconvolve(padded[..., i], kernel, mode="valid") for i, kernel in enumerate(kernels)]
    return np.asarray(np.stack(planes, axis=-1) @ np.linalg.inv(OPPONENT_FROM_XYZ).T)


def scielab_differences(xyz: Array, other_xyz: Array, pixels_per_degree: float) -> Array:
    """Return the (rows, cols) CIEDE2000 differences of two images after the blur of the eye.

    Parameters
    ----------
    xyz, other_xyz
        (rows, cols, 3) under D65, Y = 1 for white.
    pixels_per_degree
        Image pixels in a degree of the visual field.
    """
    one, other = (seen_xyz(each, pixels_per_degree) for each in (xyz, other_xyz))
    return delta_e_2000(one, other)
