"""EMVA 1288 R4.0 General: the model for unknown light, or for a response that is not linear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.linearity import UNKNOWN_LIGHT
from photosite.calibration.photon_transfer.photon_transfer import NOT_REACHED
from photosite.calibration.withheld import FEW_LEVELS, NO_SIGNAL_TO_NOISE, UNKNOWN_DARK_NOISE
from photosite.engine.roots import brentq
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain, Value, derive

Array = NDArray[np.float64]

LEAST_LEVELS = 3
"""Light levels that a local slope needs."""


@dataclass(frozen=True, eq=False)
class GeneralModel(Shown):
    """One channel described by its characteristic curve, without assumptions on its shape or on the origin of noise.

    The noise of the output over the local slope of the characteristic curve is the noise of the input: the noise that
    the light would need to cause it. The signal-to-noise ratio of the input is the amount of light over that.

    Parameters
    ----------
    abscissa
        "photons_per_pixel" or "exposure_s": the unit of the amounts of light, `threshold` and `saturation`.
    x, signal_dn, signal_uncertainty
        (points,) the characteristic curve: amount of light; mean less dark; its standard uncertainty.
    slope, slope_uncertainty
        (points,) local slope, DN per unit of `x`: of the parabola through a level and its neighbors.
    noise_dn
        (points,) temporal standard deviation.
    snr, snr_uncertainty
        (points,) signal-to-noise ratio of the input, x slope / noise; NaN where the noise is unknown, the level is
        clipped, or the curve does not rise.
    threshold, saturation
        Amounts of light at which that ratio is 1, and largest; the uncertainty of the latter spans the neighboring
        levels.
    dynamic_range_db
        20 log10 (saturation / threshold).

    Notes
    -----
    EMVA 1288 R4.0 General. For a linear camera the ratio is that of the linear model. The threshold comes from a
    variance interpolated between the levels, the dark level included.
    """

    abscissa: str
    x: Array
    signal_dn: Array
    signal_uncertainty: Array
    slope: Array
    slope_uncertainty: Array
    noise_dn: Array
    snr: Array
    snr_uncertainty: Array
    threshold: Value
    saturation: Value
    dynamic_range_db: Value

    def to_dict(self) -> dict[str, Any]:
        """Return `abscissa`, and `threshold`, `saturation`, `dynamic_range_db` with value and standard_uncertainty."""
        values = ((name, getattr(self, name)) for name in ("threshold", "saturation", "dynamic_range_db"))
        return {"abscissa": self.abscissa} | {name: Estimate.of(value, "").to_dict() for name, value in values}


def general_model(channel: Channel) -> GeneralModel | Missing:
    """Return the general model of a channel, or the reason why it is missing.

    Levels with one frame have no noise, but shape the curve. Of several groups at one amount of light, the best known
    one is used.
    """
    levels = channel.levels
    if channel.dark.mean.reason:
        return UNKNOWN_DARK_NOISE.missing(channel.dark.mean.reason)
    if not levels.light_known:
        return UNKNOWN_LIGHT
    order = np.lexsort((np.diag(levels.signal_covariance), levels.x))
    order = order[levels.trusted[order]]
    place = order[np.append(True, np.diff(levels.x[order]) > 0.0)]
    x, signal = levels.x[place], levels.signal[place]
    if len(x) < LEAST_LEVELS:
        return FEW_LEVELS.missing(f"{len(x)} light levels; a characteristic curve needs {LEAST_LEVELS} or more")
    covariance = levels.signal_covariance[np.ix_(place, place)]
    difference = local_slopes(x)
    slope = difference @ signal
    slope_u = np.sqrt(np.sum((difference @ covariance) * difference, axis=1))
    variance, variance_u2 = (each[place] for each in channel.temporal_variance())
    good = (variance > 0.0) & (slope > 0.0) & ~levels.clipped[place]
    noise = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    snr = np.where(good, x * slope / noise, np.nan)
    relative = np.hypot(
        slope_u / np.where(good, slope, np.nan), 0.5 * np.sqrt(variance_u2) / np.where(good, variance, np.nan)
    )
    threshold = _threshold(channel.dark.variance.at_zero, x[good], slope[good], variance[good])
    saturation: Value = NOT_REACHED
    if channel.saturation.signal is not None and np.isfinite(snr).any():
        peak = int(np.nanargmax(snr))
        low, high = x[max(peak - 1, 0)], x[min(peak + 1, len(x) - 1)]
        saturation = Uncertain.of(float(x[peak]), float(high - low) / math.sqrt(12.0))
    return GeneralModel(
        abscissa=levels.abscissa,
        x=x,
        signal_dn=signal,
        signal_uncertainty=np.sqrt(np.diag(covariance)),
        slope=slope,
        slope_uncertainty=slope_u,
        noise_dn=noise,
        snr=snr,
        snr_uncertainty=snr * relative,
        threshold=threshold,
        saturation=saturation,
        dynamic_range_db=derive(lambda top, low: (top / low).decibel(20.0), saturation, threshold),
    )


def local_slopes(x: Array) -> Array:
    """Return the (m, m) matrix from ordinates to the slopes of the parabolas through each point and its neighbors.

    At each end, the parabola goes through the last three points.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 3.0, 4.0])
    >>> (local_slopes(x) @ x**2).round(12).tolist()
    [0.0, 2.0, 6.0, 8.0]
    """
    m = len(x)
    slopes = np.zeros((m, m))
    for i in range(m):
        three = min(max(i - 1, 0), m - 3) + np.arange(3)
        a, b, c = x[three]
        slopes[i, three] = (
            (2.0 * x[i] - b - c) / ((a - b) * (a - c)),
            (2.0 * x[i] - a - c) / ((b - a) * (b - c)),
            (2.0 * x[i] - a - b) / ((c - a) * (c - b)),
        )
    return slopes


def _threshold(dark: Value, x: Array, slope: Array, variance: Array) -> Value:
    """Return where x slope = noise, with variance and slope interpolated linearly between the levels and the dark."""
    if isinstance(dark, Missing):
        return dark
    if not x.size or dark.value <= 0.0:
        return NO_SIGNAL_TO_NOISE.missing(
            "no light level shows noise and signal, or the dark temporal variance is not above zero"
        )
    light, noise = np.append(0.0, x), np.append(dark.value, variance)
    rise = np.append(slope[0], slope)
    above = np.flatnonzero(light**2 * rise**2 >= noise)
    if not above.size:
        return NO_SIGNAL_TO_NOISE.missing("no light level has a signal-to-noise ratio of 1 or more")
    i = int(above[0])

    def excess(at: float) -> float:
        part = (at - light[i - 1]) / (light[i] - light[i - 1])
        between = rise[i - 1] + part * (rise[i] - rise[i - 1])
        return float((at * between) ** 2 - noise[i - 1] - part * (noise[i] - noise[i - 1]))

    root = float(brentq(excess, light[i - 1], light[i]))
    # Near zero light the noise is the dark noise: the root moves by half the relative error of its variance.
    relative = 0.5 * dark.relative if i == 1 else 0.0
    return Uncertain.of(root, root * relative)
