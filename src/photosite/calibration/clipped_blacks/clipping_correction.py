"""Dark levels as they would be without clipping at zero.

What clipping leaves of a level's mean, temporal variance and spatial variance is, under the model of
`censored_likelihood.py`, a known function of its true mean, DSNU and noise; here that is turned
round. All dark levels
go the same way, so that what the chip's own pixels do to them is nearly the same in all, and drops out of slopes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root
from scipy.special import ndtr

from photosite.calibration.clipped_blacks.censored_likelihood import ROUNDING, CensoredDark
from photosite.calibration.reduction.groups import Level
from photosite.values.uncertain import Missing

_REACH = 8.0
"""Standard deviations on either side that the integrals go."""

_POINTS = 97
"""Pixel means of the integral over the fixed pattern."""


_MOST = 1 << 16
"""No digital number is as large."""


@dataclass(frozen=True)
class _Pixels:
    """What pixels of the model read, by their true mean: central moments of a clipped and rounded normal.

    Parameters
    ----------
    share
        (points,) share of the pixels at each true mean, 1 in all.
    offset
        (points,) true mean less the level's.
    mean, variance, third, fourth
        (points,) mean and central moments of the numbers.
    """

    share: NDArray[np.float64]
    offset: NDArray[np.float64]
    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    third: NDArray[np.float64]
    fourth: NDArray[np.float64]

    @classmethod
    def of(cls, mu: float, dsnu_variance: float, read_variance: float) -> _Pixels:
        """By sums over the probabilities of each number: exact, however small the noise."""
        d, r = math.sqrt(max(dsnu_variance, 0.0)), math.sqrt(read_variance)
        t = np.linspace(-_REACH, _REACH, _POINTS) if d > 0.0 else np.zeros(1)
        share = np.exp(-0.5 * t * t)
        offset = d * t
        top = max(2, min(math.ceil(mu + _REACH * (d + r)) + 2, _MOST))  # a solver may ask for any noise
        y = np.arange(1, top, dtype=np.float64)
        at_least = ndtr((mu + offset[:, None] - y + 0.5) / r)
        # E[y^k] is the sum over y of P(Y >= y) times what y^k grows by.
        raw = [at_least @ (y**k - (y - 1.0) ** k) for k in (1, 2, 3, 4)]
        m = raw[0]
        return cls(
            share / share.sum(),
            offset,
            m,
            raw[1] - m**2,
            raw[2] - 3.0 * m * raw[1] + 2.0 * m**3,
            raw[3] - 4.0 * m * raw[2] + 6.0 * m**2 * raw[1] - 3.0 * m**4,
        )


def _moments(mu: float, dsnu_variance: float, read_variance: float) -> NDArray[np.float64]:
    """(3,) mean, temporal variance, and variance over pixels of their means, of clipped numbers.

    A DSNU variance below zero, as one comes out where there is none, goes on as the first order of a small one.
    """
    pixels = _Pixels.of(mu, dsnu_variance, read_variance)
    mean = float(pixels.share @ pixels.mean)
    spatial = float(pixels.share @ (pixels.mean - mean) ** 2)
    if dsnu_variance < 0.0:
        spatial = dsnu_variance * float(ndtr((mu - 0.5) / math.sqrt(read_variance))) ** 2
    return np.array([mean, float(pixels.share @ pixels.variance), spatial])


def moment_slopes(theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) change of the moments with mean, DSNU variance and read variance."""
    steps = np.array([1e-3 * math.sqrt(theta[2]), 1e-3 * max(abs(theta[1]), 1e-2 * theta[2]), 1e-3 * theta[2]])
    return np.column_stack(
        [(_moments(*(theta + step)) - _moments(*(theta - step))) / (2.0 * step.max()) for step in np.diag(steps)]
    )


def correct_clipping(level: Level, like: CensoredDark) -> Level | Missing:
    """A dark level without its clipping.

    Parameters
    ----------
    level
        As read.
    like
        The censored estimate of the same channel: where the search begins and, for a level of one frame, its noise
        and its DSNU.

    Returns
    -------
    Level or Missing
        Its own uncertainties are those of temporal noise, and of what the chip's own pixels, a sample of the model's,
        do to it otherwise than to the reference level; what they do to both alike is in `shared_mean` and
        `shared_variance`. Missing where nothing fits what was read.

    Examples
    --------
    >>> seen = _moments(0.0, 4.0, 9.0)
    >>> mean, temporal, spatial = (float(entry) for entry in seen)
    >>> level = Level(10**6, 10, mean, 1e-6, temporal, 1e-3, spatial + temporal / 10, 0.5, 0.0, 0.0)
    >>> like = CensoredDark(10**6, 10, 0.5, 0.1, 3.9, 9.2, np.eye(3), 1.0, True)
    >>> whole = correct_clipping(level, like)
    >>> abs(whole.mean) < 1e-6, round(whole.variance - 1 / 12, 6)
    (True, 9.0)
    """
    if level.low_fraction == 0.0:
        return level
    start = np.array([like.black_level, like.dsnu_variance, like.read_variance])
    seen = np.array([level.mean, level.variance, level.spatial_variance - level.variance / level.frames])
    free = np.array([0, 1, 2]) if level.repeated else np.array([0])
    scale = math.sqrt(abs(start[1]) + start[2])
    units = np.array([scale, scale**2, math.nan])

    def theta_of(x: NDArray[np.float64]) -> NDArray[np.float64]:
        theta = start.copy()
        theta[0] += scale * x[0]
        if level.repeated:
            theta[1] += units[1] * x[1]
            theta[2] *= math.exp(min(x[2], 50.0))
        return theta

    def off(x: NDArray[np.float64]) -> NDArray[np.float64]:
        away = (_moments(*theta_of(x)) - seen) / np.array([scale, scale**2, scale**2])
        return np.asarray(away[free])

    found = root(off, np.zeros(len(free)), tol=1e-10)
    if not found.success and float(np.abs(found.fun).max()) > 1e-6:
        return Missing(f"{100 * level.low_fraction:.3g} % of the numbers are 0, and no noise round any level reads so")
    return _restored(level, theta_of(found.x), start, free)


def _inverse(theta: NDArray[np.float64], free: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.inv(moment_slopes(theta)[np.ix_(free, free)]), np.float64)


def _influence(
    pixels: _Pixels, back: NDArray[np.float64], free: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(2, points): what a pixel at each true mean does to the level's mean and its read variance, times the pixels.

    What the chip's own pixels are brighter by is no error in its frames' level.
    """
    mean = float(pixels.share @ pixels.mean)
    variance = float(pixels.share @ pixels.variance)
    excess = (pixels.mean - mean) ** 2
    seen = np.array([pixels.mean - mean, pixels.variance - variance, excess - pixels.share @ excess])
    influence = back @ seen[free]
    return influence[0] - pixels.offset, influence[-1]


def _restored(level: Level, theta: NDArray[np.float64], first: NDArray[np.float64], free: NDArray[np.int64]) -> Level:
    """The level at `theta`; `first` is where the reference level is, with which it shares what its pixels do."""
    pixels, back = _Pixels.of(*theta.tolist()), _inverse(theta, free)
    temporal = back @ _temporal_covariance(pixels, level.frames)[np.ix_(free, free)] @ back.T / level.pixels
    like = _Pixels.of(*first.tolist())
    shared, own = [], []
    for here, there in zip(_influence(pixels, back, free), _influence(like, _inverse(first, free), free), strict=True):
        size = math.sqrt(float(like.share @ there**2))
        along = float((pixels.share * here) @ there) / size if here.size == there.size and size > 0.0 else 0.0
        shared.append(along / math.sqrt(level.pixels))
        own.append(max(float(pixels.share @ here**2) - along**2, 0.0) / level.pixels)
    numbers = float(theta[2]) + ROUNDING
    restored = replace(
        level,
        mean=float(theta[0]),
        mean_variance=float(temporal[0, 0]) + own[0],
        shared_mean=shared[0],
        low_fraction=0.0,
    )
    if not level.repeated:
        return restored
    return replace(
        restored,
        variance=numbers,
        variance_uncertainty=math.sqrt(float(temporal[2, 2]) + own[1]),
        shared_variance=shared[1],
        spatial_variance=float(theta[1]) + numbers / level.frames,
    )


def _temporal_covariance(pixels: _Pixels, n: int) -> NDArray[np.float64]:
    """(3, 3) of mean, temporal and spatial variance over n frames, the pixels fixed; times the number of pixels."""
    away = pixels.mean - pixels.share @ pixels.mean

    def over(values: NDArray[np.float64]) -> float:
        return float(pixels.share @ values)

    mean_mean = over(pixels.variance) / n
    if n == 1:
        return np.array([[mean_mean, 0.0, 0.0], [0.0, math.nan, 0.0], [0.0, 0.0, math.nan]])
    square = pixels.variance**2
    mean_temporal = over(pixels.third) / n
    mean_spatial = 2.0 * over(away * pixels.variance) / n
    temporal = over(pixels.fourth - square * (n - 3) / (n - 1)) / n
    both = 2.0 * over(square) / (n * (n - 1))
    temporal_spatial = 2.0 * over(away * pixels.third) / n - both
    spatial = 4.0 * over(away**2 * pixels.variance) / n + both
    return np.array(
        [
            [mean_mean, mean_temporal, mean_spatial],
            [mean_temporal, temporal, temporal_spatial],
            [mean_spatial, temporal_spatial, spatial],
        ]
    )
