"""Viewing conditions, and the contrast sensitivity of the eye in them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma, gammainc

Array = NDArray[np.float64]

PITCH_MM, DISTANCE_MM = 0.254, 860.0
"""Default viewing condition: a display of 100 pixels per inch, one image pixel on each, from 86 cm."""

_A, _B, _C = 75.0, 0.2, 0.8
_ISO_SCALE = 34.05


def pixels_per_degree(pitch_mm: float, distance_mm: float) -> float:
    """Return the image pixels in a degree of the visual field.

    Examples
    --------
    >>> round(pixels_per_degree(0.254, 860.0), 2)
    59.09
    """
    return 1.0 / math.degrees(2.0 * math.atan(0.5 * pitch_mm / distance_mm))


def luminance_sensitivity(cycles_per_degree: Array) -> Array:
    """Return the sensitivity to contrast in luminance, 75 f^0.8 exp(-0.2 f) / 34.05: 3 at its peak of 4 cycles/degree.

    References
    ----------
    G. M. Johnson and M. D. Fairchild, "A top down description of S-CIELAB and CIEDE2000", Color Res. Appl. 28 (2003)
    425; D. Baxter et al., "Development of the I3A CPIQ spatial metrics", Proc. SPIE 8293 (2012).

    Examples
    --------
    >>> luminance_sensitivity(np.array([0.0, 4.0])).round(3)
    array([0., 3.])
    """
    f = np.asarray(cycles_per_degree, dtype=np.float64)
    return np.asarray(_A * f**_C * np.exp(-_B * f) / _ISO_SCALE)


def luminance_sensitivity_area(up_to: float = math.inf) -> float:
    """Return the integral of `luminance_sensitivity` from 0 to a frequency in cycles/degree.

    Examples
    --------
    >>> round(luminance_sensitivity_area() / luminance_sensitivity_area(30.0), 3)
    1.013
    """
    part = 1.0 if math.isinf(up_to) else float(gammainc(_C + 1.0, _B * up_to))
    return float(_A / _ISO_SCALE * gamma(_C + 1.0) / _B ** (_C + 1.0) * part)


_RED_GREEN = (109.1413, 0.00038, 3.42436, 93.59711, 0.00367, 2.16771, 202.7384)
_BLUE_YELLOW = (7.032845, 0.000004, 4.258205, 40.690950, 0.103909, 1.648658, 40.690950)


def chrominance_sensitivities(cycles_per_degree: Array) -> tuple[Array, Array]:
    """Return the sensitivities to red-green and blue-yellow contrast; low-pass, about 1 at 0.

    Each is a sum of two terms a exp(-b f^c); see `luminance_sensitivity` for the references.
    """
    f = np.asarray(cycles_per_degree, dtype=np.float64)
    found = []
    for a1, b1, c1, a2, b2, c2, scale in (_RED_GREEN, _BLUE_YELLOW):
        found.append(np.asarray((a1 * np.exp(-b1 * f**c1) + a2 * np.exp(-b2 * f**c2)) / scale))
    return found[0], found[1]


def barten_sensitivity(cycles_per_degree: Array, luminance_cd_m2: float, width_deg: float) -> Array:
    """Return Barten's contrast sensitivity for a display of a luminance and an angular width.

    References
    ----------
    P. G. J. Barten, "Evaluation of subjective image quality with the square-root integral method", J. Opt. Soc. Am. A 7
    (1990) 2024.
    """
    u = np.asarray(cycles_per_degree, dtype=np.float64)
    a = 540.0 * (1.0 + 0.7 / luminance_cd_m2) ** -0.2 / (1.0 + 12.0 / (width_deg * (1.0 + u / 3.0) ** 2))
    b = 0.3 * (1.0 + 100.0 / luminance_cd_m2) ** 0.15
    return np.asarray(a * u * np.exp(-b * u) * np.sqrt(1.0 + 0.06 * np.exp(b * u)))
