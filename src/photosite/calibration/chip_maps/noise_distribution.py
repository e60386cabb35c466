"""Distribution of the temporal noise over the pixels: spread of the read noise, and random telegraph noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps.pixel_noise import LEAST_FRAMES
from photosite.sensor.chip import Blinking
from photosite.values.estimate import Estimate
from photosite.values.uncertain import COVERAGE_95

LEAST_VARIANCE_DN2 = 0.5
"""Smallest median temporal variance: below it, rounding makes the variances of few frames discrete."""

LEAST_BLINKING = 10
"""Smallest number of blinking pixels from which their distribution is estimated."""

_MISFIT_P_VALUE = 0.01
"""Probability of the blinking pixels' amplitudes or fractions of time, below which they are of another distribution."""

_WINDOW = (0.3, 0.7)
"""Fractions of frames in the upper level in which nearly all pixels of enough amplitude are found."""
_FOUND_FROM = {12: 16.0, 16: 12.0, 40: 7.0, 150: 5.0, 256: 4.5}
"""Amplitudes, in units of the noise, from which nearly all pixels in the window are found, by number of frames."""
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(61)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()
_WIDEST = 1.5
_SPREAD_METHOD = (
    "interquartile range of the pixels' log temporal variances against that of a log-normal read noise, without "
    "blinking pixels"
)
_STEADY_METHOD = (
    "root mean square of a log-normal read noise with the median of the pixels' temporal variances, without blinking "
    "pixels, rows, columns and whole frames"
)
_BLINKING_METHOD = (
    "blinking pixels with {:.3g} DN or more that are in the upper level in {:.0%} to {:.0%} of the frames; amplitudes "
    "taken as exponential, fractions of time as uniform"
)


def read_noise_distribution(
    variance: NDArray[np.floating], freedom: int, shared_dn2: float, blinking: tuple[float, float] = (0.0, 0.0)
) -> tuple[Estimate, Estimate]:
    """Estimate the distribution of the read noise over the pixels, which is taken as log-normal.

    The temporal variance of a pixel is its read noise squared plus a part that all pixels share, times chi-square over
    its degrees of freedom. Quartiles do not notice few pixels with another noise.

    Parameters
    ----------
    variance, freedom
        (n,) temporal variances of the pixels, DN^2, and their degrees of freedom.
    shared_dn2
        Variance of rounding, dark current, rows and columns.
    blinking
        Fraction of these pixels that blink without being found, and its largest plausible value. Faint ones have
        variances like those of ordinary pixels, others have larger ones: half of the fraction is taken as larger, and
        the interval covers none and all of the largest fraction.

    Returns
    -------
    Estimate, Estimate
        Standard deviation of its natural logarithm; its root mean square, DN.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> sigma = 5 * np.exp(0.2 * rng.standard_normal(20_000))
    >>> spread, noise_dn = read_noise_distribution(rng.normal(0, sigma, (16, 20_000)).var(axis=0, ddof=1), 15, 0.0)
    >>> round(spread.value, 2), spread.standard_uncertainty < 0.01, round(noise_dn.value, 1)
    (0.2, True, 5.2)
    """
    plain = _log_normal(variance, freedom, shared_dn2, 1.0)
    fraction, most = blinking
    if most == 0.0 or plain[0].interval_95 is None:
        return plain
    half, above = (_log_normal(variance, freedom, shared_dn2, 1.0 - one) for one in (0.5 * fraction, most))
    if half[0].value is None or above[0].interval_95 is None:
        return above if half[0].value is not None else half
    return _between(half[0], plain[0], above[0]), _between(half[1], plain[1], above[1])


def _between(value: Estimate, one: Estimate, other: Estimate) -> Estimate:
    """Return an estimate with the interval of two others, of which either may be right."""
    assert one.interval_95 is not None
    assert other.interval_95 is not None
    ends = min(one.interval_95[0], other.interval_95[0]), max(one.interval_95[1], other.interval_95[1])
    limit = ends[1] if one.upper_limit_95 is not None and other.upper_limit_95 is not None else None
    return Estimate(value.value, (ends[1] - ends[0]) / (2.0 * COVERAGE_95), None, limit, one.method, ends)


@dataclass(frozen=True)
class _LogNormal:
    """Log temporal variances of a log-normal read noise whose median variance is `middle`, DN^2."""

    middle: float
    shared_dn2: float
    freedom: int

    def below(self, x: float, log_median: float, spread: float) -> float:
        """Return the fraction of log variances below x."""
        from scipy.special import gammainc

        true = np.exp(log_median + 2.0 * spread * _NODES) + self.shared_dn2
        return float(_WEIGHTS @ gammainc(0.5 * self.freedom, 0.5 * self.freedom * np.exp(x) / true))

    def quartiles(self, spread: float) -> tuple[float, float, float]:
        """Return the quartiles of log variances, and the median of the read noise's, that have the measured median."""
        from scipy.optimize import brentq

        at, center = math.log(self.middle), math.log(self.middle - self.shared_dn2)
        log_median = brentq(lambda value: self.below(at, value, spread) - 0.5, center - 3.0, center + 3.0)
        reach = 4.0 * (2.0 * spread + math.sqrt(2.0 / self.freedom)) + 1.0
        first, third = (
            brentq(lambda x, fraction=fraction: self.below(x, log_median, spread) - fraction, at - reach, at + reach)
            for fraction in (0.25, 0.75)
        )
        return first, third, log_median

    def width(self, spread: float) -> float:
        """Return the interquartile range."""
        first, third, _ = self.quartiles(spread)
        return float(third - first)

    @cached_property
    def narrowest(self) -> float:
        """Interquartile range without a spread of the read noise."""
        return self.width(0.0)

    @cached_property
    def widest(self) -> float:
        """Interquartile range of the largest spread."""
        return self.width(_WIDEST)

    def spread(self, width: float) -> float:
        """Return the spread of the read noise that gives an interquartile range."""
        from scipy.optimize import brentq

        if width <= self.narrowest:
            return 0.0
        if width >= self.widest:
            return _WIDEST
        return float(brentq(lambda one: self.width(one) - width, 0.0, _WIDEST, xtol=1e-6))


def _log_normal(
    variance: NDArray[np.floating], freedom: int, shared_dn2: float, ordinary: float
) -> tuple[Estimate, Estimate]:
    """Estimate spread and root mean square from the pixels of the lowest variances, of a fraction that is ordinary."""
    low, middle, high = np.quantile(variance, [0.25 * ordinary, 0.5 * ordinary, 0.75 * ordinary])
    if middle - shared_dn2 < LEAST_VARIANCE_DN2 or low <= 0.0:
        reason = f"the temporal variance of most pixels, {middle:.3g} DN², is that of rounding and dark current"
        return Estimate(reason=reason, method=_SPREAD_METHOD), Estimate(reason=reason, method=_STEADY_METHOD)
    model = _LogNormal(middle, shared_dn2, freedom)
    measured = math.log(high / low)
    value = model.spread(measured)
    first, third, log_median = model.quartiles(value)

    def density(x: float) -> float:
        step = 1e-3
        return (model.below(x + step, log_median, value) - model.below(x - step, log_median, value)) / (2.0 * step)

    # Variances and covariance of sample quantiles
    lower, upper = density(first), density(third)
    terms = 3.0 / 16.0 * sum(1.0 / one**2 for one in (lower, upper)) - 2.0 / 16.0 / (lower * upper)
    u = math.sqrt(terms / variance.size)
    ends = model.spread(measured - COVERAGE_95 * u), model.spread(measured + COVERAGE_95 * u)
    limit = ends[1] if measured - 1.645 * u <= model.narrowest else None
    spread_uncertainty = (ends[1] - ends[0]) / (2.0 * COVERAGE_95)
    median_uncertainty = 0.5 / (density(math.log(middle)) * math.sqrt(variance.size)) * middle / (middle - shared_dn2)
    noise_dn = math.exp(0.5 * log_median + value**2)
    u = noise_dn * math.hypot(0.5 * median_uncertainty, 2.0 * value * spread_uncertainty)
    return (
        Estimate(value, spread_uncertainty, None, limit, _SPREAD_METHOD, ends),
        Estimate(noise_dn, u, method=_STEADY_METHOD),
    )


def blinking_distribution(
    blinking: Blinking, pixels: int, frames: int, noise_dn: float, least_ratio: float
) -> tuple[Estimate, Estimate]:
    """Estimate the fraction of the pixels that blink, and the mean distance of their levels.

    Parameters
    ----------
    blinking, pixels
        The pixels that were found, and the number of those that were searched.
    frames, noise_dn
        Number of frames, and the temporal noise of a noisy but ordinary pixel.
    least_ratio
        Temporal variance over that of an ordinary pixel, from which pixels were searched.

    Returns
    -------
    Estimate, Estimate
        Fraction of the pixels; mean amplitude, DN.

    Notes
    -----
    Small amplitudes are not found, and neither are pixels that are nearly always in one state. Beyond the amplitude
    A from which all are found, an exponential distribution of mean a has the mean A + a, and the fraction exp(-A / a).
    With fractions of time that are uniform from 0 to 1, the number of the frames in the upper level is uniform, too,
    where the states of different frames are independent.
    """
    from scipy.stats import chi2, kstest

    least = float(np.interp(math.log(frames), np.log(list(_FOUND_FROM)), list(_FOUND_FROM.values()))) * noise_dn
    least = max(least, 1.3 * noise_dn * math.sqrt(max(least_ratio - 1.0, 0.0) / (_WINDOW[0] * _WINDOW[1])))
    method = _BLINKING_METHOD.format(least, *_WINDOW)
    first, last = math.ceil(_WINDOW[0] * frames - 1e-9), math.floor(_WINDOW[1] * frames + 1e-9)
    number = blinking.high_fraction * frames
    chosen = (blinking.amplitude_dn >= least) & (number > first - 0.5) & (number < last + 0.5)
    count = int(np.count_nonzero(chosen))
    if frames < LEAST_FRAMES or count < LEAST_BLINKING:
        reason = f"{count} blinking pixels with {least:.3g} DN or more, fewer than {LEAST_BLINKING}"
        return Estimate(reason=reason, method=method), Estimate(reason=reason, method=method)
    excess = blinking.amplitude_dn[chosen] - least
    mean = float(excess.mean())
    within = np.random.default_rng(0).uniform(-0.5, 0.5, count)  # spreads whole numbers of frames evenly
    fraction_of_time = (number[chosen] + within - first + 0.5) / (last - first + 1)
    # Lilliefors' limits for an exponential distribution with an estimated mean at 1 %: 1.25 / sqrt(n)
    uneven = float(kstest(excess / mean, "expon").statistic) * math.sqrt(count) > 1.25
    if uneven or kstest(fraction_of_time, "uniform").pvalue < _MISFIT_P_VALUE:
        what = "amplitudes are not exponential" if uneven else "fractions of time are not uniform"
        reason = f"the {what}; {count} pixels of {least:.3g} DN or more blink"
        return Estimate(reason=reason, method=method), Estimate(reason=reason, method=method)
    amplitude_ends = tuple(float(2 * count * mean / chi2.isf(tail, 2 * count)) for tail in (0.025, 0.975))
    amplitude = Estimate(
        mean, mean / math.sqrt(count), method=method, interval_95=(amplitude_ends[0], amplitude_ends[1])
    )
    # E[1 / mean of n exponential amplitudes] is n / (n - 1) of the true one
    exponent = least / mean * (1.0 - 1.0 / count)
    fraction = count / pixels * (frames + 1) / (last - first + 1) * math.exp(exponent)
    relative = math.sqrt((1.0 + exponent**2) / count)
    ends = fraction * math.exp(-COVERAGE_95 * relative), min(fraction * math.exp(COVERAGE_95 * relative), 1.0)
    if fraction > 1.0:
        reason = f"most blinking pixels are below {least:.3g} DN, from which they are found"
        return Estimate(reason=reason, method=method), amplitude
    return Estimate(fraction, fraction * relative, method=method, interval_95=ends), amplitude
