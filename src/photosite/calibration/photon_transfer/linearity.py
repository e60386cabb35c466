"""Linearity of EMVA 1288: deviation of the response from a straight line, in the definitions of R4.0 and R3.0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.photon_transfer import temporal_series
from photosite.calibration.withheld import (
    FEW_LEVELS,
    NO_FLAT_FIELDS,
    NO_SATURATION,
    UNDEFINED_LINEARITY,
    UNKNOWN_DARK_NOISE,
    UNMEASURED_LIGHT,
)
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain, weighted_mean

Array = NDArray[np.float64]

RANGE = (0.05, 0.95)
"""EMVA 1288: the regression uses signals from 5 to 95 % of that at saturation."""

UNKNOWN_LIGHT = UNMEASURED_LIGHT.missing(
    "the light of the levels is not known: flat fields of one exposure time differ, and no photons are stated"
)

LEAST_LEVELS = 3
"""Light levels that a deviation from a line needs; the standard asks for 50 equal steps, at least 9 in the range."""


@dataclass(frozen=True, eq=False)
class LinearityFit(Shown):
    """A straight line through the response, and the deviations from it, in one of the definitions of `linearity`.

    Parameters
    ----------
    intercept, slope
        The line: DN, and DN per unit of the abscissa.
    deviation_percent, deviation_uncertainty
        (points,) deviation of each light level that has one, and its standard uncertainty from sampling.
    error, lowest, highest
        Linearity error and lowest and highest deviation of the fitted levels, percent. The error is the mean absolute
        deviation for "relative", and half the difference of highest and lowest for "full scale".
    """

    intercept: float
    slope: float
    deviation_percent: Array
    deviation_uncertainty: Array
    error: Uncertain
    lowest: Uncertain
    highest: Uncertain


@dataclass(frozen=True, eq=False)
class Linearity(Shown):
    """The linearity of one channel.

    Parameters
    ----------
    abscissa
        "photons_per_pixel" or "exposure_s".
    x, signal_dn, signal_uncertainty
        (points,) the light levels below saturation: amount of light; mean less dark; its standard uncertainty.
    used
        (points,) whether the signal is between 5 and 95 % of that at saturation, so that it was fitted.
    relative, full_scale
        Definitions of EMVA 1288 releases 3.1 and 4.0, and of release 3.0.
    """

    abscissa: str
    x: Array
    signal_dn: Array
    signal_uncertainty: Array
    used: NDArray[np.bool_]
    relative: LinearityFit
    full_scale: LinearityFit


def linearity_estimates(channels: Sequence[Linearity | Missing]) -> dict[str, Estimate]:
    """Return the linearity errors as parameters: means over the channels, and the extremes of all channels."""
    known = [entry for entry in channels if isinstance(entry, Linearity)]
    suffix = f"; over {len(known)} of {len(channels)} channels" if len(channels) > 1 else ""
    relative = f"of least relative squares, relative to it (EMVA 1288 R4.0, equations 61 and 62){suffix}"
    range_text = "signals from 5 to 95 % of saturation about the line"
    methods = {
        "linearity_error_percent": f"mean absolute deviation of {range_text} {relative}",
        "linearity_error_min_percent": f"lowest deviation of {range_text} {relative}",
        "linearity_error_max_percent": f"highest deviation of {range_text} {relative}",
        "linearity_error_full_scale_percent": f"half the range of the deviations of {range_text} of least squares, "
        f"over 0.9 of the signal at saturation (EMVA 1288 R3.0){suffix}",
    }
    if not known:
        missing = next(
            (entry for entry in channels if isinstance(entry, Missing)), NO_FLAT_FIELDS.missing("no light frames")
        )
        return {name: Estimate.of(missing, text) for name, text in methods.items()}
    even = [1.0] * len(known)
    values = (
        weighted_mean([entry.relative.error for entry in known], even),
        min((entry.relative.lowest for entry in known), key=lambda part: part.value),
        max((entry.relative.highest for entry in known), key=lambda part: part.value),
        weighted_mean([entry.full_scale.error for entry in known], even),
    )
    return {name: Estimate.of(value, text) for (name, text), value in zip(methods.items(), values, strict=True)}


def channel_linearity(channel: Channel) -> Linearity | Missing:
    """Return the linearity of a channel, or the reason why it is missing.

    Without known photons the abscissa is the exposure time, and the light is taken as constant: the standard's method
    I.
    """
    levels, saturation = channel.levels, channel.saturation
    if channel.dark.mean.reason:
        return UNKNOWN_DARK_NOISE.missing(channel.dark.mean.reason)
    if not levels.light_known:
        return UNKNOWN_LIGHT
    if saturation.signal is None or saturation.index is None:
        return NO_SATURATION.missing(
            "linearity is defined from 5 to 95 % of saturation, and no flat field reached saturation"
        )
    inside = levels.trusted & (np.arange(len(levels.x)) <= saturation.index)
    levels = levels.take(np.flatnonzero(inside & temporal_series(levels.frames)))
    return linearity(levels.x, levels.signal, levels.signal_covariance, saturation.signal, levels.abscissa)


def linearity(
    x: Array, signal: Array, covariance: Array, saturation: float, abscissa: str = "photons_per_pixel"
) -> Linearity | Missing:
    """Return the linearity of EMVA 1288, from signals y at amounts of light H, in two definitions.

    Relative (R4.0 Linear, equations 61 and 62; the same since R3.1). The line a0 + a1 H is the one of least relative
    squares, sum ((y - a0 - a1 H) / y)^2, over signals from 5 to 95 % of that at saturation. The deviation is
    100 (y - a0 - a1 H) / (a0 + a1 H), LE_min and LE_max its extremes there, and LE the mean of its absolute values.

    Full scale (R3.0). The line is that of plain least squares over the same range; the deviation is
    100 (y - a0 - a1 H) / (0.9 y_sat), 0.9 being the range's part of the full scale, and LE is half of the difference
    between highest and lowest. Small signals have little weight, so it hides the errors of a camera with high dynamic
    range.

    Parameters
    ----------
    x, signal, covariance
        (m,) amounts of light; (m,) signals in DN, dark subtracted, up to saturation, and their (m, m) covariance.
    saturation
        The signal at saturation, DN.
    abscissa
        Unit of `x`.

    Returns
    -------
    Linearity or Missing
        Missing with fewer than three amounts of light in the range. The uncertainties are those of sampling. Noise
        widens the extremes and increases mean absolute values: compare errors with their uncertainty.

    Examples
    --------
    >>> light = np.linspace(0.0, 1.0, 11)
    >>> bent = linearity(light, 1000.0 * light * (1.0 - 0.1 * light), 0.01 * np.eye(11), 900.0)
    >>> fit = bent.relative
    >>> [round(part.value, 2) for part in (fit.lowest, fit.highest, fit.error)]
    [-2.47, 1.99, 1.4]
    """
    used = (signal >= RANGE[0] * saturation) & (signal <= RANGE[1] * saturation)
    different = len(np.unique(x[used]))
    if different < LEAST_LEVELS:
        return FEW_LEVELS.missing(
            f"{different} light levels lie between 5 and 95 % of saturation; linearity needs {LEAST_LEVELS}, better 9"
        )
    relative, full_scale = (_fit(is_relative, x, signal, covariance, used, saturation) for is_relative in (True, False))
    if not math.isfinite(relative.error.value):
        return UNDEFINED_LINEARITY.missing(
            "the line of least relative squares through the response falls to zero within its range"
        )
    return Linearity(abscissa, x, signal, np.sqrt(np.diag(covariance)), used, relative, full_scale)


def _fit(
    relative: bool, x: Array, signal: Array, covariance: Array, used: NDArray[np.bool_], saturation: float
) -> LinearityFit:
    weight = np.zeros_like(signal)
    weight[used] = 1.0 / signal[used] ** 2 if relative else 1.0
    design = np.column_stack([np.ones_like(x), x])
    # (2, m): its product with the signals is intercept and slope, for fixed weights.
    estimator = np.linalg.solve(design.T @ (weight[:, None] * design), design.T * weight)
    line = design @ (estimator @ signal)
    # Where the line is not above zero there is no relative deviation.
    scale = np.where(line > 0.0, line, np.nan) if relative else np.full_like(line, (RANGE[1] - RANGE[0]) * saturation)
    deviation = 100.0 * (signal - line) / scale
    # For least relative squares the weights depend on the signals: the line moves (2 line / y - 1) times as far.
    moved = np.divide(2.0 * line, signal, out=np.ones_like(line), where=used) - used if relative else used
    hat = (design @ estimator) * moved
    fraction = signal / scale if relative else np.ones_like(x)
    slopes = 100.0 / scale[:, None] * (np.eye(len(x)) - fraction[:, None] * hat)
    uncertainty = np.sqrt(np.sum((slopes @ covariance) * slopes, axis=1))

    inside = np.flatnonzero(used)
    low, high = (int(inside[choose(deviation[inside])]) for choose in (np.argmin, np.argmax))
    if relative:
        error = float(np.abs(deviation[inside]).mean())
        gradient = (np.sign(deviation[inside])[:, None] * slopes[inside]).mean(axis=0)
    else:
        error = 0.5 * float(deviation[high] - deviation[low])
        gradient = 0.5 * (slopes[high] - slopes[low])
    intercept, slope = (float(p) for p in estimator @ signal)
    return LinearityFit(
        intercept,
        slope,
        deviation,
        uncertainty,
        Uncertain.of(error, math.sqrt(float(gradient @ covariance @ gradient))),
        Uncertain.of(float(deviation[low]), float(uncertainty[low])),
        Uncertain.of(float(deviation[high]), float(uncertainty[high])),
    )
