"""Periodic row and column bands, found as peaks in the power spectrum of the line means."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FALSE_ALARMS = 1e-3
"""Probability that line means of independent lines show a band."""

_WINDOW = 65
"""Number of frequencies whose median is the background of the middle one."""

_INDEPENDENT = _WINDOW / 1.94
"""Effective number of independent frequencies in the window: Hann's window correlates neighbors (4/9 and 1/36)."""

LEAST_CYCLES = 5
"""Cycles over all lines below which a period counts as shading, not as a band."""

SHORTEST = 2 * _WINDOW
"""Smallest number of lines."""


@dataclass(frozen=True)
class Band:
    """A periodic band in the rows or columns.

    Parameters
    ----------
    cycles_per_pixel
        Frequency, known to half of 1 / lines; 0.5 is every other line.
    amplitude_dn, standard_uncertainty_dn
        Amplitude of the sine. If the frequency lies between two frequencies of the spectrum, the true amplitude is up
        to 18 % larger.
    false_alarm_probability
        Probability that independent lines show a peak this high at any frequency.
    """

    cycles_per_pixel: float
    amplitude_dn: float
    standard_uncertainty_dn: float
    false_alarm_probability: float


def find_bands(profiles: NDArray[np.floating]) -> tuple[Band, ...]:
    """Find periodic bands in line means, strongest first.

    The statistic is the power at each frequency, mean over the profiles, divided by the median of its neighbors. For n
    profiles of independent lines, n times the power over its mean follows the gamma distribution of shape n. Because
    the mean is itself an estimate, the ratio follows Fisher's F, which gives the probability of the highest of m
    values. Hann's window keeps a strong band from leaking into its neighbors. Only the maximum of a peak counts.

    `profiles` holds (profiles, lines) line means in DN: one profile of the mean frame, or one per frame. Fewer lines
    than `SHORTEST` give no bands.

    Examples
    --------
    >>> lines = np.arange(600)
    >>> wave = 0.5 * np.sin(2 * np.pi * 0.1 * lines) + np.random.default_rng(1).normal(0, 0.3, 600)
    >>> [(band.cycles_per_pixel, round(band.amplitude_dn, 1)) for band in find_bands(wave[None])]
    [(0.1, 0.5)]
    """
    from scipy.ndimage import median_filter
    from scipy.special import fdtrc
    from scipy.stats import gamma

    count, lines = profiles.shape
    if lines < SHORTEST:
        return ()
    trend = np.vander(np.linspace(-1.0, 1.0, lines), 3)
    level = profiles.T - trend @ np.linalg.lstsq(trend, profiles.T, rcond=None)[0]
    window = np.hanning(lines + 1)[:-1, None]
    squares = float(np.sum(window**2))
    power = np.mean(np.abs(np.fft.rfft(level * window, axis=0)) ** 2, axis=1)[1:] / squares
    if lines % 2 == 0:
        power = power[:-1]  # the Nyquist frequency has one quadrature and another distribution
    median = gamma.median(count)
    background = median_filter(power, _WINDOW, mode="reflect") / (median / count)
    if not (background > 0).all():
        return ()
    # Degrees of freedom of a mean of squares with the median's relative variance, 1 / (4 n f^2 m^2).
    freedom = 2.0 * 4.0 * _INDEPENDENT * (gamma.pdf(median, count) * median) ** 2
    single = fdtrc(2.0 * count, freedom, power / background)
    alarm = -np.expm1(power.size * np.log1p(-np.minimum(single, 1.0 - 1e-12)))
    padded = np.pad(power, 1)
    peak = (alarm < FALSE_ALARMS) & (power >= padded[:-2]) & (power >= padded[2:])
    peak[: LEAST_CYCLES - 1] = False
    found = []
    for k in np.flatnonzero(peak):
        # The peak includes the power of the noise.
        scale = math.sqrt(squares) / float(window.sum())
        amplitude = 2.0 * scale * math.sqrt(power[k] - background[k])
        uncertainty = scale * math.sqrt(2.0 * background[k] / count)
        found.append(Band(float((k + 1) / lines), amplitude, uncertainty, float(alarm[k])))
    return tuple(sorted(found, key=lambda band: -band.amplitude_dn))
