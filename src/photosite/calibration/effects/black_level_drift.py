"""1/f drift of the black level, from the means of successive dark frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.effect import Effect
from photosite.calibration.evidence import Evidence
from photosite.calibration.finding import Finding
from photosite.calibration.reduction.groups import pooled_level
from photosite.calibration.withheld import EFFECT_NOT_MEASURED, UNKNOWN_DARK_NOISE
from photosite.sensor.effects.black_level_drift import BlackLevelDrift
from photosite.sensor.model import Sensor
from photosite.values.estimate import Estimate, standard_deviation
from photosite.values.shown import Shown
from photosite.values.uncertain import COVERAGE_95, Missing, Uncertain, Value

Array = NDArray[np.float64]


_METHOD = (
    "likelihood of the means of successive dark frames under noise of pixels, rows and columns, and a drift with a "
    "spectrum of 1/f"
)


@dataclass(frozen=True)
class BlackLevelSeries(Finding, Shown):
    """Drift of the black level over series of dark frames.

    Parameters
    ----------
    drift_dn, drift_e
        Standard deviation of the black level over the frames of the longest series, without noise.
    frames
        Number of frames of the longest series.
    significant
        Whether there is a drift beyond chance.
    means_dn, noise_dn
        Means of the frames of each series less the mean of the series, and the standard deviation of each that noise
        explains.
    """

    drift_dn: Estimate
    drift_e: Estimate
    frames: int
    significant: bool
    means_dn: tuple[Array, ...]
    noise_dn: tuple[float, ...]

    @property
    def present(self) -> bool:
        """Whether there is a drift beyond chance."""
        return self.significant

    def section(self, base: Sensor, source: str) -> dict[str, Any]:
        """Return the drift for a sensor file: octaves up to the length of the series; none within chance.

        The file states the standard deviation over many frames, to which each octave contributes alike.
        """
        if not self.significant or self.drift_e.value is None:
            return {"black_level_drift": None}
        octaves = math.ceil(math.log2(self.frames)) + 1
        spread = self.drift_e.value * math.sqrt(octaves / octaves_within(self.frames))
        return {"black_level_drift": BlackLevelDrift(standard_deviation_e=spread, octaves=octaves)}

    def to_dict(self) -> dict[str, Any]:
        """Return the estimates, and what they are of."""
        return {**super().to_dict(), "frames": self.frames, "significant": self.significant}


_SLOWEST = 24
"""Octaves of the model: the slowest step is held for 2^23 frames, longer than any series."""


def step_covariance(frames: int) -> Array:
    """Return the (frames, frames) covariance of a drift whose octaves have a variance of 1 each.

    Two frames share the step of an octave, held for h frames from a random start, with probability 1 - distance / h.

    Examples
    --------
    >>> step_covariance(2)[0].round(1).tolist()
    [24.0, 22.0]
    """
    distance = np.abs(np.subtract.outer(np.arange(frames), np.arange(frames)))
    return np.asarray(sum(np.maximum(1.0 - distance / 2.0**octave, 0.0) for octave in range(_SLOWEST)))


def octaves_within(frames: int) -> float:
    """Return the expected variance over a number of frames, for octaves with a variance of 1 each."""
    covariance = step_covariance(frames)
    return float((np.trace(covariance) - covariance.sum() / frames) / (frames - 1))


LEAST_FRAMES = 4
"""Frames of the longest series below which nothing is estimated."""
SIGNIFICANT = 12.0
"""Twice the logarithm of the likelihood ratio beyond which there is a drift: below 1 of 1000 series without one."""
WITHIN_95 = 3.841458820694124 / 0.7
"""Twice the logarithm of the likelihood ratio within which a value belongs to the 95 % interval.

The likelihood is that of normal numbers. Steps at random frames have fewer degrees of freedom: the variance that it
finds for a drift beyond the noise scatters as that of 0.7 times as many (600 simulated series of 24 frames)."""


def measure_drift(
    series_dn: Sequence[Sequence[float]], noise_variance_dn2: Sequence[float], gain: Value
) -> BlackLevelSeries | None:
    """Estimate the drift of the black level; None with fewer than four frames in the longest series.

    The levels of the series are free, because the frames between them are unknown. Restricted maximum likelihood, with
    the interval from the likelihood's ratio.

    Parameters
    ----------
    series_dn
        Means of the successive frames of each exposure time, DN.
    noise_variance_dn2
        Variance of a frame's mean of each series that noise of pixels, rows and columns explains, DN^2.
    gain
        System gain in DN per electron.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> steady = measure_drift([rng.normal(64, 0.01, 40)], [0.01**2], Uncertain(0.5))
    >>> steady.significant, measure_drift([[64, 65]], [0.01], Uncertain(0.5)) is None
    (False, True)
    >>> moving = measure_drift([64 + np.cumsum(rng.normal(0, 0.1, 40))], [0.01**2], Uncertain(0.5))
    >>> moving.significant
    True
    """
    from scipy.optimize import brentq, minimize_scalar

    chosen = [(np.asarray(y, np.float64), v) for y, v in zip(series_dn, noise_variance_dn2, strict=True) if len(y) > 1]
    longest = max((len(y) for y, _ in chosen), default=0)
    if longest < LEAST_FRAMES or all(np.ptp(y) == 0.0 for y, _ in chosen):
        return None
    square, fraction, white = _contrasts(chosen)

    def misfit(octave: float) -> float:
        variance = white + octave * fraction
        return float(np.sum(np.log(variance) + square / variance))

    # Over the logarithm, from far below the noise to far above all squares
    low, high = (
        math.log(1e-6 * float((white / fraction).min())),
        math.log(1e3 * float((square / fraction).max()) + 1e-300),
    )
    grid = np.linspace(low, max(high, low + 1.0), 200)
    values = [misfit(math.exp(x)) for x in grid]
    best = int(np.argmin(values))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = minimize_scalar(lambda x: misfit(math.exp(x)), bounds=ends, method="bounded")
    at_zero = misfit(0.0)
    octave, least = (math.exp(found.x), float(found.fun)) if found.fun < at_zero else (0.0, at_zero)

    def beyond(x: float) -> float:
        return misfit(math.exp(x)) - least - WITHIN_95

    start = grid[0] if octave == 0.0 else math.log(octave)
    upper = math.exp(brentq(beyond, start, grid[-1] + 10.0))
    lower = 0.0 if at_zero - least < WITHIN_95 else math.exp(brentq(beyond, grid[0] - 10.0, start))
    scale = octaves_within(longest)
    ends_dn = math.sqrt(lower * scale), math.sqrt(upper * scale)
    # The root of a variance is too small on average (`standard_deviation`).
    deviation = standard_deviation(Uncertain.of(octave * scale, (upper - lower) * scale / (2.0 * COVERAGE_95)))
    return BlackLevelSeries(
        Estimate.of(deviation, _METHOD, interval_95=ends_dn),
        _in_electrons(deviation, ends_dn, gain),
        longest,
        at_zero - least > SIGNIFICANT,
        tuple(y - y.mean() for y, _ in chosen),
        tuple(math.sqrt(variance) for _, variance in chosen),
    )


def _contrasts(series: Sequence[tuple[Array, float]]) -> tuple[Array, Array, Array]:
    """Return independent contrasts of the series: their squares, variances per octave's variance, and noise variances.

    Each series comes with the noise variance of a frame's mean.
    """
    squares, fractions, noise = [], [], []
    for y, variance in series:
        centering = np.eye(len(y)) - 1.0 / len(y)
        fraction, vectors = np.linalg.eigh(centering @ step_covariance(len(y)) @ centering)
        keep = fraction > 1e-9 * fraction.max()
        squares.append((vectors[:, keep].T @ y) ** 2)
        fractions.append(fraction[keep])
        noise.append(np.full(int(keep.sum()), variance))
    square, fraction, white = (np.concatenate(entries) for entries in (squares, fractions, noise))
    return square, fraction, np.maximum(white, 1e-12 * float(square.mean()))


def _in_electrons(deviation: Uncertain, ends_dn: tuple[float, float], gain: Value) -> Estimate:
    """Return a standard deviation in DN in electrons, its interval widened by the uncertainty of the gain."""
    if isinstance(gain, Missing):
        return Estimate(reason=gain.reason, method=_METHOD)
    gain_part = COVERAGE_95 * gain.relative * deviation.value
    low, high = (
        deviation.value + sign * math.hypot(end - deviation.value, gain_part)
        for sign, end in zip((-1.0, 1.0), ends_dn, strict=True)
    )
    return Estimate.of(deviation / gain, _METHOD, interval_95=(max(low, 0.0) / gain.value, high / gain.value))


def _measure(evidence: Evidence) -> BlackLevelSeries | Missing:
    dark, gain = evidence.dark, evidence.light.gain
    if dark.mean is None or dark.clipped is not None or dark.noise_unknown:
        return UNKNOWN_DARK_NOISE.missing(dark.noise_unknown or "the dark frames are clipped at 0")
    rows, cols = dark.mean.mean.shape
    frames = dark.mean.statistics.frames
    # Of a frame: the noise of rows and columns, which are few
    row_variance, column_variance = (
        frames * float(np.mean([max(getattr(parts, name).value, 0.0) for parts in dark.mean.noise]))
        for name in ("row", "column")
    )
    noise = [
        pooled_level(entry.levels).variance / (rows * cols) + row_variance / rows + column_variance / cols
        for entry in dark.groups
    ]
    found = measure_drift([entry.frame_means for entry in dark.groups], noise, gain)
    return found or EFFECT_NOT_MEASURED.missing(f"no exposure time has {LEAST_FRAMES} dark frames that differ")


EFFECT = Effect(40, _measure)
