"""Per-pixel slopes against exposure, and their spread: PRNU and dark current nonuniformity of the 2008 paper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.groups import Level
from photosite.calibration.spatial.channel_tables import alike_noise, alike_slopes
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.lazy_maps import is_large
from photosite.engine.map_statistics import Moments, add_scaled, label_moments
from photosite.sensor.effects.readout_channels import ReadoutChannels
from photosite.values.uncertain import Uncertain


def excess_variance(moments: Moments, noise: Uncertain) -> Uncertain:
    """Subtract temporal noise from the variance over pixels.

    The uncertainty is that of the pixels as a sample: Var(s^2) = (m4 - s^4) / P for any distribution, with m4 the
    fourth central moment. The result therefore applies to the sensor from which this chip's pixels were drawn.
    """
    sampling = max(moments.fourth - moments.variance**2, 0.0) / moments.pixels  # rounding, on constant maps
    return Uncertain.of_variance(moments.variance, math.sqrt(sampling)) - noise


def mean_frame_noise(level: Level, scatter: float = 0.0) -> Uncertain:
    """Return the temporal variance in the mean of a level's frames, DN^2. `scatter` as in `slope_noise`."""
    noise = level.variance / level.frames
    return Uncertain.of_variance(noise, math.hypot(level.variance_uncertainty / level.frames, scatter * noise))


def with_chip_sampling(
    mean: Uncertain, variance: Uncertain, third: float, pixels: float
) -> tuple[Uncertain, Uncertain]:
    """Return a mean and a variance over pixels as those of the sensor from which the pixels were drawn.

    The mean gains the uncertainty variance / pixels. Where the pixels are skewed, such as by a few hot pixels, the
    errors of both are correlated: their covariance over samples is the third central moment / pixels.

    Examples
    --------
    >>> mean, variance = with_chip_sampling(Uncertain.of(2.0), Uncertain.of(4.0, 0.5), 8.0, 100)
    >>> [round(u, 6) for u in (mean.standard_uncertainty, variance.standard_uncertainty, mean.covariance(variance))]
    [0.2, 0.5, 0.08]
    """
    sampling = Uncertain.of(0.0, math.sqrt(max(variance.value, 0.0) / pixels))
    own, spread = sampling.standard_uncertainty, variance.standard_uncertainty
    if own == 0.0 or spread == 0.0:
        return mean + sampling, variance
    along = max(-0.99, min(third / pixels / (own * spread), 0.99))  # a correlation estimated from a sample
    left = math.sqrt(1.0 - along**2)
    parts = {source: left * part for source, part in variance.parts.items()}
    return mean + sampling, Uncertain(variance.value, parts) + sampling * (along * spread / own)


def slope_coefficients(x: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coefficients (m,) of the linear combination of points that is the slope of the weighted line.

    Examples
    --------
    >>> slope_coefficients(np.array([0.0, 1.0, 2.0]), np.ones(3)).tolist()
    [-0.5, 0.0, 0.5]
    """
    centred = x - weights @ x / weights.sum()
    return np.asarray(weights * centred / (weights @ centred**2))


@dataclass(frozen=True)
class SlopeSpread:
    """Statistics of one channel's slopes.

    Parameters
    ----------
    pixels, mean
        Number of pixels, and their mean slope.
    variance
        Variance over pixels, with the propagated noise subtracted.
    third
        Third central moment, which correlates the errors of mean and variance.
    """

    pixels: int
    mean: float
    variance: Uncertain
    third: float = 0.0


_TOGETHER_BYTES = 192 << 20
"""Memory of the mean frames that are added to the map in one pass; of large frames, one is."""


class PixelSlopes:
    """A map (rows, cols) of per-pixel slopes, accumulated level by level as a linear combination of mean frames."""

    def __init__(self, shape: tuple[int, int], tile: NDArray[np.int64]) -> None:
        self.tile = tile
        self._slopes = np.zeros(shape)
        self._added: list[tuple[NDArray[np.unsignedinteger], NDArray[np.float64]]] = []

    def add(self, level: MeanFrame, coefficients: Sequence[float]) -> None:
        """Add a level's mean frame, multiplied by one coefficient per channel.

        The sum of the level must not change until `slopes` is read.
        """
        self._added.append((level.sum, np.array(coefficients)[self.tile] / level.count))
        held = sum(values.nbytes for values, _ in self._added)
        if held >= _TOGETHER_BYTES or is_large(level.shape):
            self._add_all()

    def _add_all(self) -> None:
        add_scaled(self._slopes, self._added)
        self._added = []

    @property
    def slopes(self) -> NDArray[np.float64]:
        """The map."""
        if self._added:
            self._add_all()
        return self._slopes

    def spreads(self, noise: Sequence[Uncertain], readout: ReadoutChannels | None = None) -> tuple[SlopeSpread, ...]:
        """Return the statistics of the slopes per channel, given the temporal noise in them (`slope_noise`).

        With `readout`, they are those of readout channels that are alike.
        """
        moments, factor = label_moments(alike_slopes(self.slopes, readout), self.tile), alike_noise(readout)
        return tuple(
            SlopeSpread(entry.pixels, entry.mean, excess_variance(entry, left * factor), entry.third)
            for entry, left in zip(moments, noise, strict=True)
        )


def slope_noise(
    coefficients: NDArray[np.float64],
    frames: NDArray[np.int64],
    variance: NDArray[np.float64],
    variance_uncertainty: NDArray[np.float64],
    scatter: float = 0.0,
) -> Uncertain:
    """Propagate temporal noise to the variance of a pixel's slope: the sum of c^2 v / n over the levels.

    `scatter` is that of the noise between combinations of frames, such as the slope, beyond sampling.
    """
    fraction = coefficients**2 / frames
    noise = float(fraction @ variance)
    return Uncertain.of(noise, math.hypot(float(np.linalg.norm(fraction * variance_uncertainty)), scatter * noise))


def relative_response_variance(light: SlopeSpread, dark: SlopeSpread | None, seconds_per_unit: float) -> Uncertain:
    """Return the relative variance over pixels of the response to light: PRNU squared.

    A light slope includes the pixel's dark current during `seconds_per_unit` seconds per unit of the light axis (1 if
    the axis is exposure time). The mean and spread of the dark slopes are subtracted. The uncertainty of the mean
    response is common to all pixels and does not change the ratio.
    """
    if dark is None:
        return light.variance * (1.0 / light.mean**2)
    variance = light.variance - dark.variance * seconds_per_unit**2
    return variance * (1.0 / (light.mean - seconds_per_unit * dark.mean) ** 2)
