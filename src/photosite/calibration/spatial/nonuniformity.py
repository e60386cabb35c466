"""Fixed pattern: DSNU, and the per-pixel slopes behind PRNU and dark current non-uniformity (the 2008 paper's way)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.groups import Level
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.map_statistics import Moments, add_scaled, label_moments
from photosite.values.uncertain import Uncertain


def excess_variance(moments: Moments, noise: Uncertain) -> Uncertain:
    """Variance over pixels less what temporal noise put there; its uncertainty is that of the pixels' sample.

    Var(s^2) = (m4 - s^4) / P, whatever the distribution (m4: fourth central moment), so that the result holds for
    the sensor that this chip's pixels were drawn from.
    """
    sampling = max(moments.fourth - moments.variance**2, 0.0) / moments.pixels  # rounding, on constant maps
    return Uncertain.of_variance(moments.variance, math.sqrt(sampling)) - noise


def mean_frame_noise(level: Level, scatter: float = 0.0) -> Uncertain:
    """Temporal variance left in the mean of a level's frames, DN^2; `scatter` as for `slope_noise`."""
    noise = level.variance / level.frames
    return Uncertain.of_variance(noise, math.hypot(level.variance_uncertainty / level.frames, scatter * noise))


def of_one_sample(mean: Uncertain, variance: Uncertain, third: float, pixels: int) -> tuple[Uncertain, Uncertain]:
    """A mean and a variance over pixels as those of the sensor that the pixels were drawn from.

    The variance over the number of pixels comes in, and the two err together where the pixels are skewed (a few hot
    ones raise both): their covariance over samples is the third central moment over the number of pixels.

    Examples
    --------
    >>> mean, variance = of_one_sample(Uncertain.of(2.0), Uncertain.of(4.0, 0.5), 8.0, 100)
    >>> [round(u, 6) for u in (mean.standard_uncertainty, variance.standard_uncertainty, mean.covariance(variance))]
    [0.2, 0.5, 0.08]
    """
    sampling = Uncertain.of(0.0, math.sqrt(max(variance.value, 0.0) / pixels))
    own, whole = sampling.standard_uncertainty, variance.standard_uncertainty
    if own == 0.0 or whole == 0.0:
        return mean + sampling, variance
    along = max(-0.99, min(third / pixels / (own * whole), 0.99))  # a correlation, but found from a sample
    left = math.sqrt(1.0 - along**2)
    parts = {source: left * part for source, part in variance.parts.items()}
    return mean + sampling, Uncertain(variance.value, parts) + sampling * (along * whole / own)


def slope_coefficients(x: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m,) the linear combination of the measured points that is the slope of the weighted line.

    Examples
    --------
    >>> slope_coefficients(np.array([0.0, 1.0, 2.0]), np.ones(3)).tolist()
    [-0.5, 0.0, 0.5]
    """
    centred = x - weights @ x / weights.sum()
    return np.asarray(weights * centred / (weights @ centred**2))


@dataclass(frozen=True)
class SlopeSpread:
    """One channel's slopes: their mean, their variance over pixels with the propagated noise taken off, and their third
    central moment, by which a sample's mean and variance err together."""

    pixels: int
    mean: float
    variance: Uncertain
    third: float = 0.0


class PixelSlopes:
    """A map of per-pixel slopes, built level by level: a linear combination of the levels' mean frames.

    Parameters
    ----------
    shape
        (rows, cols).
    tile
        The repeating tile of channel indices.
    """

    def __init__(self, shape: tuple[int, int], tile: NDArray[np.int64]) -> None:
        self.tile = tile
        self.slopes = np.zeros(shape)

    def add(self, level: MeanFrame, coefficients: Sequence[float]) -> None:
        """Add a level's mean frame, times a coefficient for each channel."""
        add_scaled(self.slopes, level.sum, np.array(coefficients)[self.tile] / level.count)

    def spreads(self, noise: Sequence[Uncertain]) -> tuple[SlopeSpread, ...]:
        """Per channel, mean and spread of the slopes, given the temporal noise in them (`slope_noise`)."""
        moments = label_moments(self.slopes, self.tile)
        return tuple(
            SlopeSpread(entry.pixels, entry.mean, excess_variance(entry, left), self._third(k, entry.mean))
            for k, (entry, left) in enumerate(zip(moments, noise, strict=True))
        )

    def _third(self, label: int, mean: float) -> float:
        """Third central moment of a label's slopes."""
        rows, cols = self.tile.shape
        sites = [self.slopes[r::rows, c::cols] - mean for r, c in np.argwhere(self.tile == label)]
        # A product, because a power of 3 is worked out through logarithms.
        return float(sum((site * site * site).sum() for site in sites) / sum(site.size for site in sites))


def slope_noise(
    coefficients: NDArray[np.float64],
    frames: NDArray[np.int64],
    variance: NDArray[np.float64],
    variance_uncertainty: NDArray[np.float64],
    scatter: float = 0.0,
) -> Uncertain:
    """Variance that temporal noise gives a pixel's slope: sum of c^2 v / n over the levels.

    `scatter` is by how much, relatively, the noise differs from one combination of frames to the next beyond
    sampling; the slope is one such combination.
    """
    share = coefficients**2 / frames
    noise = float(share @ variance)
    return Uncertain.of(noise, math.hypot(float(np.linalg.norm(share * variance_uncertainty)), scatter * noise))


def relative_response_variance(light: SlopeSpread, dark: SlopeSpread | None, seconds_per_unit: float) -> Uncertain:
    """Relative variance over pixels of the response to light: PRNU squared.

    A light slope holds the pixel's dark current too, as many seconds of it as go with one unit of the light axis
    (1 where the axis is exposure time); its mean and spread, measured in the dark, are taken off.
    The response's mean is common to all pixels; that it is known less well does not change the ratio.
    """
    if dark is None:
        return light.variance * (1.0 / light.mean**2)
    variance = light.variance - dark.variance * seconds_per_unit**2
    return variance * (1.0 / (light.mean - seconds_per_unit * dark.mean) ** 2)
