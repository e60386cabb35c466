"""From darktable's a and b to slope and offset of a raw pixel's variance, with intervals for how a profile was made.

darktable's tool develops one raw frame of a gradient (white balance 1, linear, no color matrix), takes the diagonal
details of a 2 x 2 Haar transform, and fits a line to their variance in 300 bins of brightness. What it does not state:

- the demosaicing. Of the variance of a raw pixel's noise, the details of green keep between 0.046 and 0.079.
- the photo response nonuniformity p of the pixels. In one frame it counts as noise p^2 x^2, and adds about 0.86 p^2 to
  the line's slope; at low gain settings this is as much as the photon noise.

Both are given a distribution, and the interval holds the middle 95 % of the slopes that agree with a (JCGM 101:2008,
the propagation of distributions). The factors are simulated: `photosite.studies.noise_profiles`.

The offset has a sampling error beside them: it is the end of a line through brightness up to 0.8, where photon noise is
much larger than read noise. It is proportional to a over the root of the number of pixels, which the file does not
state either.
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.values.uncertain import COVERAGE_95, Measured

Mosaic = Literal["bayer", "mono"]

BINS = 300
"""Bins of brightness of darktable's tool, which writes the lower edge of each as its brightness."""


class Demosaicing(NamedTuple):
    """A way to demosaic: its fraction of the profiles, and the part of the variance that the details of green keep."""

    fraction: float
    factor: float
    relative_spread: float
    offset_ratio: float  # the part that they keep of read noise, which red and blue have as well, over `factor`
    offset_bias: float  # of b, in units of a


DEMOSAICING = {
    "PPG": Demosaicing(0.35, 0.0787, 0.030, 1.05, 0.0),
    "RCD": Demosaicing(0.35, 0.0463, 0.031, 1.09, 0.0),
    "VNG": Demosaicing(0.10, 0.0773, 0.046, 1.08, 0.0034),
    "AHD": Demosaicing(0.10, 0.0711, 0.045, 1.00, 0.0037),
    "bilinear": Demosaicing(0.10, 0.0472, 0.023, 1.00, 0.0),
}
"""darktable's defaults, PPG and later RCD, and others. Mean and spread are over 60 simulated cameras with different
gain, read noise and color of the light, ratio and bias of the offset over 26. The fractions are assumptions."""

MONO = {"none": Demosaicing(1.0, 0.25, 0.0, 1.0, 0.0)}

PRNU_PERCENT = (0.0, 0.8)
"""Range of the photo response nonuniformity, evenly distributed: an assumption."""

_PRNU_SLOPE, _PRNU_SLOPE_SPREAD = 0.86, 0.05
"""What p^2 adds to the slope, and its spread with the brightness of the gradient; simulated."""

_PRNU_OFFSET = -0.148
"""What p^2 adds to the offset: that of the line closest to x^2 over 0 to 0.8, -0.8^2 / 6."""

_OFFSET_SAMPLING = 6.0
"""Standard deviation of b in units of a, times the root of the number of pixels; simulated."""

_RATIO_SPREAD = 0.05
"""Relative spread of the offset's ratio: its standard error, and the color of the light."""

ASSUMED_PIXELS = 10e6
"""Pixels of the frame of a profile: less than most cameras have, so that the interval is rather too wide."""

LARGEST_WELL_E = 200_000.0
"""Electrons at white of the largest slope that is considered; between 1 and this, their logarithm is even."""


def slope_and_offset(
    a: float, b: float, mosaic: Mosaic = "bayer", *, pixels: float = ASSUMED_PIXELS
) -> tuple[Measured, Measured]:
    """Return slope and offset of a raw pixel's variance from darktable's a and b of green.

    Values are the middles of the 95 % intervals, which are 1.96 standard uncertainties to either side. That of the
    offset includes the sampling error of a frame of so many pixels; that of the slope is smaller.

    Raises
    ------
    InputError
        If a is too small for any sensor.

    References
    ----------
    darktable, tools/noise. JCGM 101:2008.

    Examples
    --------
    >>> slope, offset = slope_and_offset(1e-4, 1e-7)
    >>> low, high = (slope.value + side * 1.96 * slope.standard_uncertainty for side in (-1, 1))
    >>> round(low * 1e4, 1), round(high * 1e4, 1)
    (11.9, 22.5)
    """
    factor, prnu, effect, fraction, ratio, bias = _nodes(mosaic)
    slopes = a / factor - effect * prnu**2
    possible = (slopes > 1.0 / LARGEST_WELL_E) & (slopes < 1.0)
    if not possible.any():
        raise InputError("a", value=a, expected="a slope that some sensor has")
    # Density of a: that of the slope, 1 / slope, over the factor.
    weights = fraction[possible] / (slopes[possible] * factor[possible])
    of_offset = factor[possible] * ratio[possible]
    offsets = (b - a / (2 * BINS) - bias[possible] * a) / of_offset - _PRNU_OFFSET * prnu[possible] ** 2
    errors = np.hypot(_OFFSET_SAMPLING / math.sqrt(pixels) * a / of_offset, _RATIO_SPREAD * offsets)
    drawn = offsets + np.array(_normal(9))[:, None] * errors
    of_drawn = np.broadcast_to(weights, drawn.shape)
    return _middle_95(slopes[possible], weights), _middle_95(drawn.ravel(), of_drawn.ravel())


def _normal(count: int) -> list[float]:
    """Return numbers that stand for equal fractions of the standard normal distribution."""
    return [NormalDist().inv_cdf((k + 0.5) / count) for k in range(count)]


@lru_cache(maxsize=2)
def _nodes(mosaic: Mosaic) -> tuple[NDArray[np.float64], ...]:
    """Return factor, PRNU, its effect on the slope, fraction, and ratio and bias of the offset of each combination."""
    ways = MONO if mosaic == "mono" else DEMOSAICING
    normal = np.array(_normal(15))
    factors = np.concatenate([way.factor * (1.0 + way.relative_spread * normal) for way in ways.values()])
    fractions, ratios, biases = (
        np.repeat(values, 15)
        for values in zip(
            *((way.fraction / 15, way.offset_ratio, way.offset_bias) for way in ways.values()), strict=True
        )
    )
    low, high = (0.01 * limit for limit in PRNU_PERCENT)
    prnu = low + (high - low) * (np.arange(40) + 0.5) / 40
    effect = _PRNU_SLOPE + _PRNU_SLOPE_SPREAD * normal[::3]
    grid = np.meshgrid(np.arange(factors.size), prnu, effect, indexing="ij")
    index = grid[0].ravel()
    return factors[index], grid[1].ravel(), grid[2].ravel(), fractions[index], ratios[index], biases[index]


def _middle_95(values: NDArray[np.float64], weights: NDArray[np.float64]) -> Measured:
    """Return the 95 % interval with equal tails as its middle and half-width / 1.96."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    low, high = np.interp((0.025, 0.975), (total - 0.5 * weights[order]) / total[-1], values[order])
    value, half = 0.5 * (low + high), 0.5 * (high - low)
    if not math.isfinite(value):
        raise InputError("b", value=value, expected="finite")
    return Measured(float(value), float(half / COVERAGE_95))
