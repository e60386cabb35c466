"""Photon transfer without the dark level, or without the dark variance: from differences between levels of light.

The temporal variance of the flat fields is a straight line against their mean, whose slope is the system gain K. Dark
frames only give one more point of it. Without them the line's constant is free. A bend of the response then shows less
clearly: with y the mean, x the light and y = R (x + b x^2), the variance has the slope K (1 + 6 b x) against the mean.

So does noise that pixels share the more, the more charge they hold (brighter-fatter effect: Guyonnet et al., A&A 575
(2015) A41): the variance of bright levels is then too small, while the means stay straight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark.dark_lines import DarkLine
from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.photon_transfer.photon_transfer import LightLevels
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.spatial.pixel_slopes import slope_coefficients
from photosite.calibration.withheld import UNKNOWN_DARK_CURRENT, UNKNOWN_DARK_NOISE
from photosite.values.uncertain import Missing, Uncertain, Value

Array = NDArray[np.float64]

NO_DARK_FRAMES = (
    "there are no dark frames; take some with the lens covered, two or more (better 50) at each of two exposure times"
)
SINGLE_DARK_FRAMES = (
    "each dark exposure has one frame, in which temporal noise and fixed pattern are one spread; take two or more dark "
    "frames (better 50) at one exposure time"
)


def unknown_level(lights: Sequence[GroupStatistics], channel: int, reason: str) -> DarkLine:
    """Return the unknown dark level of a channel: between 0 and the dimmest flat field.

    The nominal value, where a line through the means meets no light, decides only which levels lie in the linear range.
    """
    if not lights:
        return DarkLine.unknown(0.0, 1.0, reason)
    means = np.array([entry.levels[channel].mean for entry in lights])
    clipped = np.array([entry.levels[channel].clipped for entry in lights])
    light = np.array([entry.group.photons_per_pixel or entry.group.exposure_s for entry in lights])
    dimmest, nominal = float(means.min()), 0.0
    take = ~clipped
    if len(np.unique(light[take])) > 1:
        nominal = float(np.polynomial.Polynomial.fit(light[take], means[take], 1)(0.0))
    return DarkLine.unknown(min(max(nominal, 0.0), dimmest), max(dimmest, 1.0), reason)


def unknown_variance(
    lights: Sequence[GroupStatistics], channel: int, dark_dn: float, reason: str, largest: float | None = None
) -> DarkLine:
    """Return the unknown dark variance of a channel, from 0 to the largest possible one if that is known.

    Its nominal value is that of a line through the variances of the flat fields, at the dark level `dark_dn`.
    """
    levels = [entry.levels[channel] for entry in lights]
    levels = [level for level in levels if level.repeated and not level.clipped]
    means, variances = (np.array([getattr(level, name) for level in levels]) for name in ("mean", "variance"))
    nominal = 0.5 * (largest or 0.0)
    if len(np.unique(means)) > 1:
        sizes = np.maximum(variances, 1e-3)
        nominal = float(np.polynomial.Polynomial.fit(means, variances, 1, w=1.0 / sizes)(dark_dn))
    if largest is None:
        return DarkLine.unknown(nominal, float(variances.max(initial=1.0)), reason)
    return DarkLine.unknown(min(max(nominal, 0.0), largest), max(largest, 1.0), reason)


CONSTANT_S = 0.01
"""Range of exposure times up to which dark current is neglected: 100 electrons per second leave one."""


def unknown_dark_current(shortest_s: float, longest_s: float, reason: str) -> Missing | None:
    """Return why flat fields of a range of exposure times hold an unknown dark current; None where it is negligible."""
    if not longest_s - shortest_s > CONSTANT_S:
        return None
    return UNKNOWN_DARK_CURRENT.missing(
        f"flat fields of {shortest_s:g} to {longest_s:g} s hold a dark current that is not known: {reason}; or take "
        f"flat fields of different light at one exposure time"
    )


BEND_P_VALUE = 1e-3
"""Fraction of straight responses under proportional light whose means may count as bent."""
LARGEST_BEND = 0.5
"""Relative change of the slope from a bend of the means, above which the gain is withheld."""
LEAST_LEVELS = 3
"""Different amounts of light that a bend needs."""


def straightening(levels: LightLevels, used: NDArray[np.bool_]) -> Value:
    """Return the factor that makes the slope of variance against mean the gain at small signal, for an unknown dark.

    It is 1 where the means lie on a straight line against the light within noise. Otherwise either the sensor bends
    or the light is not in proportion to what is stated, and the factor covers both. Missing where the bend is too large
    for this.

    Parameters
    ----------
    levels
        The light levels of a channel.
    used
        (levels,) whether a level lies in the linear range.
    """
    from scipy.special import chdtrc

    take = used & levels.trusted
    x, y = levels.x[take], levels.signal[take]
    if len(np.unique(x)) < LEAST_LEVELS:
        return Uncertain(1.0)
    unit = x / x.max()
    covariance = levels.signal_covariance[np.ix_(take, take)]
    line, bent = (fit_linear(np.vander(unit, order, increasing=True), y, covariance) for order in (2, 3))
    chances = [chdtrc(line.degrees_of_freedom, line.chi_square), chdtrc(1, line.chi_square - bent.chi_square)]
    if 2.0 * min(chances) > BEND_P_VALUE:
        return Uncertain(1.0)
    _, slope, square = bent.uncertain
    if slope.value <= 0.0:
        return _not_proportional()
    b = square / slope
    noisy = take & levels.repeated
    unit, mean = levels.x[noisy] / x.max(), levels.signal[noisy]
    if len(unit) < 2:
        return Uncertain(1.0)
    # What a straight line through the variances of such a response has as its slope, over that at small signal.
    weights = slope_coefficients(mean, 1.0 / levels.noise_uncertainty[noisy] ** 2)
    shot = slope.value * (1.0 + 2.0 * b.value * unit) ** 2 * unit
    change = float(weights @ shot) - 1.0
    by_b = float(weights @ (slope.value * 4.0 * (1.0 + 2.0 * b.value * unit) * unit**2))
    if abs(change) > LARGEST_BEND:
        return _not_proportional()
    factor = 1.0 / (1.0 + change)
    half = 0.5 * (factor - 1.0)
    return Uncertain.of(1.0 + half, math.hypot(half, factor**2 * by_b * b.standard_uncertainty))


BRIGHTER_FATTER = 0.02
"""Standard deviation of the relative change of the brightest level's variance by brighter-fatter noise: a choice."""


def brighter_fatter(levels: Sequence[LightLevels], used: Sequence[NDArray[np.bool_]]) -> Uncertain:
    """Return the gain at small signal over the slope of a straight line of variance against mean, for an unknown dark.

    It is the curvature of the variances of some channels, as far as they determine it. Before, a change of the
    brightest variance is taken as normally distributed about 0 with the standard deviation `BRIGHTER_FATTER`.
    """
    precision, weighted = 0.0, 0.0
    usual = []
    for channel_levels, take in zip(levels, used, strict=True):
        take = take & channel_levels.repeated
        mean, variance = channel_levels.signal[take], channel_levels.shot[take]
        if len(np.unique(mean)) < 2:
            continue
        sampling = channel_levels.noise_uncertainty[take] ** 2
        # What c mean^2 adds to the slope of the line.
        reach = float(slope_coefficients(mean, 1.0 / sampling) @ mean**2)
        usual.append(BRIGHTER_FATTER * reach / float(mean.max()))
        if len(mean) < LEAST_LEVELS:
            continue
        scale = float(mean.max())
        line, bent = (
            fit_linear(np.vander(mean / scale, order, increasing=True), variance, np.diag(sampling)) for order in (2, 3)
        )
        size = -reach * scale / (scale**2 * line.parameters[1])
        precision += 1.0 / (size**2 * bent.covariance[2, 2])
        weighted += bent.parameters[2] / (size * bent.covariance[2, 2])
    if not usual:
        return Uncertain(1.0)
    prior = 1.0 / float(np.mean(usual)) ** 2
    return Uncertain.of(1.0 + weighted / (precision + prior), 1.0 / math.sqrt(precision + prior))


def _not_proportional() -> Missing:
    return UNKNOWN_DARK_NOISE.missing(
        "the means of the flat fields do not lie on a straight line against the stated light, and without dark frames "
        "a bend of the response cannot be corrected; take dark frames"
    )
