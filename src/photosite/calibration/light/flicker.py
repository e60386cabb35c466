"""Flicker of the light under a rolling shutter: its frequency and depth, from bands that move from frame to frame.

Row r of a frame has the light L_r (1 + A cos(w r + phase)), where the phase is that of the frame, and L_r the fixed
pattern and the shape of the light. With the mean over frames subtracted, L_r drops out. What is left of the frames of a
level are sines of one frequency, whose phasors are those of the bands less their mean. The frequency is that of the
least sum of squares over all frames of all levels. The phasors of the bands lie on a circle about 0: the radius of the
circle through what is left is their amplitude A, whatever the phases of the frames.

An exposure of T s keeps sinc(f T) of the depth of a sine, so that depth = A / |sinc(f T)| for each level. This needs
the frequency f = w / (2 pi line time), and so the line time of the sensor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri

from photosite.calibration.finding import Finding
from photosite.calibration.photon_transfer.noise_covariance import CORRELATION_P_VALUE, NoiseCovariance
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Measured, Uncertain

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Flicker(Finding, Shown):
    """Bands in the light.

    Parameters
    ----------
    fraction
        Standard deviation of the rows over the signal, the mean over the channels.
    period_rows
        Period of the bands in rows; None where the rows vary without a period.
    frequency_hz
        Frequency, where the sensor's line time is known; up to a multiple of the line frequency.
    depth
        Amplitude of the light's sine of this frequency over the mean light, where the line time is known.
    """

    fraction: float
    period_rows: float | None
    frequency_hz: Estimate | None = None
    depth: Estimate | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the values."""
        estimates = {"frequency_hz": self.frequency_hz, "depth": self.depth}
        found = {name: None if entry is None else entry.to_dict() for name, entry in estimates.items()}
        return {"share": self.fraction, "period_rows": self.period_rows, **found}

    def __str__(self) -> str:
        period = "" if self.period_rows is None else f", with a period of {self.period_rows:.3g} rows"
        known = ""
        if self.frequency_hz is not None:
            known = f" at {_with_interval(self.frequency_hz, 'Hz')}"
        if self.depth is not None:
            known += f" with a depth of {_with_interval(self.depth, '%', 100.0)}"
        return (
            f"the light flickers{known}: rows vary by {100 * self.fraction:.2g} % of the signal from frame to "
            f"frame{period}, as under a rolling shutter"
        )


def _with_interval(entry: Estimate, unit: str, scale: float = 1.0) -> str:
    """Return a value with as many digits as its 95 % interval supports."""
    assert entry.value is not None
    assert entry.interval_95 is not None
    low, high = (scale * end for end in entry.interval_95)
    digits = max(1 - math.floor(math.log10(high - low)), 0) if high > low else 6
    return f"{scale * entry.value:.{digits}f} {unit} (95 %: {low:.{digits}f} to {high:.{digits}f})"


def find_flicker(
    light: Sequence[NoiseCovariance], dark: Sequence[NoiseCovariance], square_dn2: Sequence[float]
) -> Flicker | None:
    """Return the flicker of the light; None where rows vary no more than in dark frames.

    Parameters
    ----------
    light, dark
        Noise covariances of the channels in flat fields and in dark frames.
    square_dn2
        Mean squared signal of the flat fields in each channel, DN^2.
    """
    extra = [a - b for a, b in zip(light, dark, strict=True)]
    scores = [entry.row / entry.row_uncertainty for entry in extra]
    # The variance of the row means follows a chi-square distribution.
    freedom = np.array([entry.row_freedom for entry in extra])
    limits = (chdtri(freedom, CORRELATION_P_VALUE / len(extra)) / freedom - 1.0) / np.sqrt(2.0 / freedom)
    if (scores < limits).all():
        return None
    fractions = [max(entry.row, 0.0) / square for entry, square in zip(extra, square_dn2, strict=True)]
    return Flicker(math.sqrt(float(np.mean(fractions))), light[int(np.argmax(scores))].row_period)


@dataclass(frozen=True)
class RowLight:
    """Light of the rows in the frames of one level: (frames, rows) mean DN, without dark."""

    exposure_s: float
    dn: Array


def with_frequency(flicker: Flicker, levels: Sequence[RowLight], line_time_us: Measured | None) -> Flicker:
    """Return the flicker with its period, and with frequency and depth if the line time is known.

    Without a sine that stands out of the noise, it is unchanged.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> phase = 2 * np.pi * (100.0 * 20e-6 * np.arange(800) + rng.random((6, 1)))
    >>> exposure_s = 0.004
    >>> dn = 1000 * (1 + 0.1 * np.sinc(100 * exposure_s) * np.cos(phase)) + rng.normal(0, 2, (6, 800))
    >>> print(with_frequency(Flicker(0.05, None), [RowLight(exposure_s, dn)], Measured(20.0)))
    the light flickers at 100.000 Hz (95 %: 99.959 to 100.041) with a depth of 9.992 % (95 %: 9.980 to 10.004): rows
    vary by 5 % of the signal from frame to frame, with a period of 500 rows, as under a rolling shutter
    """
    levels = [level for level in levels if len(level.dn) > 1 and level.dn.mean(axis=0).min() > 0.0]
    found = None if not levels else _fit(levels)
    if found is None:
        return flicker
    cycles_per_row, amplitudes = found
    flicker = replace(flicker, period_rows=1.0 / cycles_per_row.value)
    if line_time_us is None:
        return flicker
    line_s = Uncertain.of(1e-6 * line_time_us.value, 1e-6 * line_time_us.standard_uncertainty)
    frequency = cycles_per_row / line_s
    frequency_estimate = Estimate.of(frequency, "one sine in the rows of all frames, least squares")
    depth = _depth(amplitudes, frequency)
    depth_estimate = (
        None if depth is None else Estimate.of(depth, "radius of the circle of the bands' phasors, over sinc(f T)")
    )
    return replace(flicker, frequency_hz=frequency_estimate, depth=depth_estimate)


@dataclass(frozen=True)
class _Bands:
    """The bands of a level: exposure time, and amplitude relative to the light."""

    exposure_s: float
    amplitude: Uncertain


LEAST_CYCLES_OF_PULSES = 2.5
"""Cycles over the frame below which a light with harmonics gives no frequency: those of others fit nearly as well."""
_CIRCLE_FRAMES = 3
"""Frames of a level that a circle needs."""
_CORRECTIONS = 4
"""Passes; each corrects the rows' light for the mean of the bands over the frames, which few frames leave."""


def _fit(levels: Sequence[RowLight]) -> tuple[Uncertain, list[_Bands]] | None:
    """Return cycles per row, and the bands of the levels with enough frames; None without a sine."""
    rows = levels[0].dn.shape[1]
    mean = [level.dn.mean(axis=0) for level in levels]
    steady = mean
    for _ in range(_CORRECTIONS):
        relative = [(level.dn - m) / s for level, m, s in zip(levels, mean, steady, strict=True)]
        # Differences between rows hold the noise, and little of the bands; each mean over n frames takes 1 / n of it.
        sigma = [
            math.sqrt(0.5 * float(np.mean(np.diff(each, axis=1) ** 2)) * (len(each) / (len(each) - 1.0)))
            for each in relative
        ]
        if min(sigma) <= 0.0:
            return None
        scaled = np.concatenate([each / s for each, s in zip(relative, sigma, strict=True)])
        freedom = sum((len(each) - 1) * (rows - 1) for each in relative)
        found = _frequency(scaled, freedom, sum(len(each) - 1 for each in relative))
        if found is None:
            return None
        cycles, harmonics = found
        design = _design(cycles.value, rows, harmonics)
        bands, steady = [], []
        for level, each, m in zip(levels, relative, mean, strict=True):
            fitted = each @ np.linalg.pinv(design).T
            waves = fitted[:, 1:]
            rest = float(np.sum((each - fitted @ design.T) ** 2)) / ((len(each) - 1) * (rows - design.shape[1]))
            noise = rest * np.linalg.inv(design.T @ design)[1:3, 1:3]
            if len(each) < _CIRCLE_FRAMES:
                steady.append(m)
                continue
            center, radius, uncertainty = _circle(waves[:, :2], noise)
            bands.append(_Bands(level.exposure_s, Uncertain.of(radius, uncertainty)))
            steady.append(m / (1.0 + design[:, 1:] @ _mean_waves(waves, center)))
    return None if harmonics > 1 and cycles.value * rows < LEAST_CYCLES_OF_PULSES else (cycles, bands)


def _mean_waves(waves: Array, center: Array) -> Array:
    """Return (2 harmonics,) mean of the bands over the frames, from waves without it and the center of their circle.

    The phases of the harmonics are multiples of that of the first one, about the center.
    """
    phasors = waves[:, ::2] - 1j * waves[:, 1::2]
    first = phasors[:, 0] - (center[0] - 1j * center[1])
    turns = (first / np.abs(first))[:, None] ** np.arange(1, phasors.shape[1] + 1)
    mean_turn = turns.mean(axis=0)
    moved = turns - mean_turn
    strength = np.sum(moved.conj() * phasors, axis=0) / np.maximum(np.sum(np.abs(moved) ** 2, axis=0), 1e-12)
    mean = strength * mean_turn
    mean[0] = -(center[0] - 1j * center[1])
    return np.stack([mean.real, -mean.imag], axis=1).ravel()


def _design(cycles_per_row: float, rows: int, harmonics: int) -> Array:
    """Return (rows, 1 + 2 harmonics): a constant, and cosine and sine of each harmonic."""
    angle = 2.0 * np.pi * cycles_per_row * np.arange(rows)
    waves = [wave(k * angle) for k in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
    return np.stack([np.ones(rows), *waves], axis=1)


LEAST_CYCLES = 0.6
"""Cycles over the frame below which bands cannot be distinguished from drift of the light."""
_MOST_HARMONICS = 16  # that are tried
_MISSING_HARMONICS = 3
"""Harmonics that are tried beyond the last one found."""


def _frequency(scaled: Array, freedom: int, frames: int) -> tuple[Uncertain, int] | None:
    """Return the cycles per row of all rows of a matrix, of noise 1, and the harmonics; None within chance."""
    rows = scaled.shape[1]
    total = float(np.sum((scaled - scaled.mean(axis=1, keepdims=True)) ** 2))

    def left(cycles_per_row: float, harmonics: int) -> float:
        """Return the sum of squares that is left."""
        basis = np.linalg.qr(_design(cycles_per_row, rows, harmonics))[0]
        return float(np.sum(scaled**2) - np.sum((scaled @ basis) ** 2))

    step = 0.1 / rows
    padded = np.abs(np.fft.rfft(scaled - scaled.mean(axis=1, keepdims=True), 8 * rows, axis=1)) ** 2
    coarse = float(np.argmax(padded.sum(axis=0))) / (8 * rows)
    low = LEAST_CYCLES / rows
    # The spectrum of less than about two cycles has its maximum elsewhere.
    near = np.concatenate([np.arange(low, 3.0 / rows, step), coarse + step * np.arange(-10, 11)])
    near = near[(near >= low) & (near < 0.5 - 1.0 / rows)]
    if not near.size:
        return None
    best = float(near[int(np.argmin([left(cycles, 1) for cycles in near]))])
    best = _minimum(left, best, step, 1)
    if best <= low + 1e-3 * step:
        return None
    found = left(best, 1)
    # Of as many frequencies as there are rows, the best was chosen.
    if (total - found) / (2 * frames) < fdtri(2 * frames, freedom, 1.0 - CORRELATION_P_VALUE / rows) * found / freedom:
        return None
    harmonics = tried = 1
    # A pulse may lack single harmonics.
    while tried < min(harmonics + _MISSING_HARMONICS, _MOST_HARMONICS) and (tried + 1) * best < 0.5 - 1.0 / rows:
        tried += 1
        other = _minimum(left, best, step, tried)
        more, waves = left(other, tried), 2 * frames * (tried - harmonics)
        if (found - more) / waves > fdtri(waves, freedom, 1.0 - CORRELATION_P_VALUE) * more / freedom:
            best, found, harmonics = other, more, tried
    # The second derivative of the sum of squares over the variance is 2 / u^2.
    h = 0.02 / rows
    curvature = (left(best + h, harmonics) - 2.0 * found + left(best - h, harmonics)) / h**2
    if curvature <= 0.0:
        return None
    scatter = found / (freedom - 2 * frames * harmonics)
    return Uncertain.of(best, math.sqrt(2.0 * scatter / curvature)), harmonics


def _minimum(left: Any, start: float, step: float, harmonics: int) -> float:
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(
        lambda cycles: left(cycles, harmonics),
        bounds=(start - 1.5 * step, start + 1.5 * step),
        method="bounded",
        options={"xatol": 1e-6 * step},
    )
    return float(found.x)


def _circle(points: Array, covariance: Array) -> tuple[Array, float, float]:
    """Return center and radius of the circle through points of a common covariance, and the radius's uncertainty.

    Least squares of the distances, from the algebraic solution (Kasa, IEEE Trans. Instrum. Meas. 25 (1976) 8) on.
    """
    x, y = points.T
    a, b, c = np.linalg.lstsq(np.stack([2 * x, 2 * y, np.ones(x.size)], axis=1), x**2 + y**2, rcond=None)[0]
    center, radius = np.array([a, b]), math.sqrt(max(c + a * a + b * b, 0.0))
    inverse = np.full((3, 3), np.inf)
    for _ in range(20):
        away = points - center
        distance = np.hypot(*away.T)
        if distance.min() <= 0.0:
            break
        along = away / distance[:, None]
        weight = 1.0 / np.einsum("ni,ij,nj->n", along, covariance, along)
        design = np.column_stack([along, np.ones(len(along))])
        normal = design.T @ (weight[:, None] * design)
        if np.linalg.cond(normal) > 1e12:
            break
        inverse = np.linalg.inv(normal)
        change = inverse @ (design.T @ (weight * (distance - radius)))
        center, radius = center + change[:2], radius + float(change[2])
        if np.abs(change).max() < 1e-9 * max(abs(radius), 1e-300):
            break
    return center, abs(radius), float(np.sqrt(inverse[2, 2]))


SCATTER_P_VALUE = 0.01
"""Probability of the disagreement of levels from which the uncertainty of the depth is scaled with it."""


def _depth(bands: Sequence[_Bands], frequency_hz: Uncertain) -> Uncertain | None:

    def mean(f: float) -> tuple[float, float, float]:
        """Return the weighted mean over the levels, its uncertainty, and a factor for levels that disagree."""
        kept = np.abs(np.sinc(f * np.array([band.exposure_s for band in used])))
        amplitude = np.array([band.amplitude.value for band in used])
        weight = (kept / np.array([band.amplitude.standard_uncertainty for band in used])) ** 2
        depth = float(np.sum(weight * amplitude / kept) / weight.sum())
        spread = float(np.sum(weight * (amplitude / kept - depth) ** 2))
        freedom = len(used) - 1
        by_chance = freedom == 0 or spread < chdtri(freedom, SCATTER_P_VALUE)
        return depth, 1.0 / math.sqrt(weight.sum()), 1.0 if by_chance else spread / freedom

    # What a level keeps of the depth must be more than its noise.
    used = [b for b in bands if 0.0 < 3.0 * b.amplitude.standard_uncertainty < b.amplitude.value]
    if not used:
        return None
    f, u = frequency_hz.value, frequency_hz.standard_uncertainty
    depth, noise_part, spread = mean(f)
    frequency_part = 0.5 * (mean(f + u)[0] - mean(f - u)[0])
    return Uncertain.of(depth, math.hypot(noise_part * math.sqrt(spread), frequency_part))
