"""Temporal noise of dark frames: noise by pixel, row, column and frame, its distribution, and periodic bands."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps.noise_shape import BLOCKS, NoiseShape, measure_noise_shape
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.calibration.spatial.line_noise import LineSums, TemporalComponents, pool_temporal, temporal_components
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.jit import read_only
from photosite.engine.map_statistics import FrameShift, ResidualSums, add_residuals, line_sums
from photosite.engine.threads import threads_for
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Uncertain

BAND_P_VALUE = 1e-3
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
    peak = (alarm < BAND_P_VALUE) & (power >= padded[:-2]) & (power >= padded[2:])
    peak[: LEAST_CYCLES - 1] = False
    found = []
    for k in np.flatnonzero(peak):
        # The peak includes the power of the noise.
        scale = math.sqrt(squares) / float(window.sum())
        amplitude = 2.0 * scale * math.sqrt(power[k] - background[k])
        uncertainty = scale * math.sqrt(2.0 * background[k] / count)
        found.append(Band(float((k + 1) / lines), amplitude, uncertainty, float(alarm[k])))
    return tuple(sorted(found, key=lambda band: -band.amplitude_dn))


BINS = 1024
"""Bins of the histogram of residuals, 8 per standard deviation: 64 standard deviations to each side."""

_BINS_PER_SIGMA = 8


@dataclass(frozen=True)
class StackResiduals:
    """Residuals of a stack about the means of its pixels.

    Parameters
    ----------
    lines
        Row and column sums of the frames, by site of the tile.
    variance, fourth
        (rows, cols) float32 temporal variance of each pixel, DN^2, and sum of the fourth powers of its residuals, DN^4,
        without shifts of whole frames.
    histogram, bin_dn
        (blocks, bins) residuals by block of rows, and the width of a bin. Shifts of frames, rows and columns are
        removed, and the residuals are scaled by sqrt(n / (n - 1)) to the standard deviation of the noise.
    series
        (pixels, frames) float32 values of selected pixels, without shifts of whole frames.
    """

    lines: LineSums
    variance: NDArray[np.float32]
    fourth: NDArray[np.float32]
    histogram: NDArray[np.int64]
    bin_dn: float
    series: NDArray[np.float32]


def read_residuals(
    frames: Iterable[NDArray[np.unsignedinteger]],
    mean: MeanFrame,
    sigma_dn: float,
    place: tuple[NDArray[np.int64], NDArray[np.int64]],
) -> StackResiduals:
    """Read the frames of a mean again.

    Parameters
    ----------
    frames, mean
        The frames, and their mean.
    sigma_dn
        Typical temporal standard deviation, which sets the bin width of the histogram.
    place
        Rows and columns of the pixels whose series are kept.
    """
    rows, cols = mean.sum.shape
    tile, n = (mean.labels.shape[0], mean.labels.shape[1]), mean.count
    row_level = mean.sum.sum(axis=1, dtype=np.float64) / (cols * n)
    column_level = mean.sum.sum(axis=0, dtype=np.float64) / (rows * n)
    level = float(row_level.mean())
    bin_dn = sigma_dn / _BINS_PER_SIGMA
    # Each residual lacks 1 / n of the noise variance, because the mean contains the frame.
    bins_per_dn = float(np.sqrt(n / max(n - 1, 1))) / bin_dn
    second, fourth = np.zeros((rows, cols), np.float32), np.zeros((rows, cols), np.float32)
    residuals = ResidualSums(second, fourth, np.zeros((BLOCKS, BINS), np.int64))
    by_row, by_column, series = [], [], []
    for dn in frames:
        frame = read_only(dn)
        row_sums, column_sums = (sums[0] for sums in line_sums([frame], tile))
        shift = float(row_sums.sum(dtype=np.float64)) / (rows * cols) - level
        row_shift = row_sums.sum(axis=1, dtype=np.float64) / cols - row_level - shift
        column_shift = column_sums.sum(axis=0, dtype=np.float64) / rows - column_level - shift
        with threads_for(frame.size):
            add_residuals(frame, mean.sum, n, FrameShift(shift, row_shift, column_shift), bins_per_dn, residuals)
        by_row.append(row_sums)
        by_column.append(column_sums)
        series.append(frame[place].astype(np.float32) - np.float32(shift))
    if len(series) != n:
        raise ValueError(f"expected the {n} frames of the mean, got {len(series)}")
    second /= np.float32(n - 1 if n > 1 else np.nan)
    lines = np.stack(by_row), np.stack(by_column)
    return StackResiduals(lines, second, fourth, residuals.histogram, bin_dn, np.stack(series, axis=1))


@dataclass(frozen=True)
class Trace:
    """The values of a blinking pixel, frame by frame.

    Parameters
    ----------
    row, col
        Position of the pixel.
    dn, lower_dn, upper_dn
        (frames,) values, without shifts of whole frames, and the two levels.
    """

    row: int
    col: int
    dn: NDArray[np.float32]
    lower_dn: float
    upper_dn: float


_NOT_MEASURED = Estimate(reason="not measured")
DISTRIBUTION = ("read_noise_log_spread", "steady_noise_dn", "blinking_fraction", "blinking_amplitude_dn")
"""Fields of `TemporalNoise` for the distribution of the noise over the pixels."""


@dataclass(frozen=True)
class TemporalNoise(Shown):
    """Frame-to-frame noise of a chip in the dark.

    Parameters
    ----------
    frames, exposure_s
        Number of frames of the stack, and their exposure time.
    pixel_noise_dn, row_noise_dn, column_noise_dn, frame_noise_dn
        Standard deviation of single pixels (without rounding; includes the shot noise of the dark current), and of the
        noise that a whole row, column or frame shares. Negative variance estimates give minus the root of their size.
    shape
        Deviation of the noise from a normal distribution.
    read_noise_log_spread
        Standard deviation over the pixels of the natural logarithm of their read noise.
    steady_noise_dn
        Root mean square of the read noise of the pixels that do not blink, without noise of rows, columns and frames.
    blinking_fraction, blinking_amplitude_dn
        Fraction of the pixels with random telegraph noise, and the mean distance of their levels, including those whose
        amplitude is too small to be found one by one (`noise_distribution`).
    bands
        "fixed rows", "fixed columns": periods in the mean frame. "temporal rows", "temporal columns": periods whose
        phase changes from frame to frame. Rows are horizontal bands.
    residual_dn, residual_count
        (bins,) middle and count of the histogram of all values about their pixels' means, without shifts of frames,
        rows and columns.
    traces
        Values of the blinking pixels whose levels are farthest apart relative to their noise.
    """

    frames: int
    exposure_s: float
    pixel_noise_dn: Estimate
    row_noise_dn: Estimate
    column_noise_dn: Estimate
    frame_noise_dn: Estimate
    shape: NoiseShape
    bands: Mapping[str, tuple[Band, ...]]
    residual_dn: NDArray[np.float64]
    residual_count: NDArray[np.int64]
    traces: tuple[Trace, ...] = ()
    read_noise_log_spread: Estimate = _NOT_MEASURED
    steady_noise_dn: Estimate = _NOT_MEASURED
    blinking_fraction: Estimate = _NOT_MEASURED
    blinking_amplitude_dn: Estimate = _NOT_MEASURED

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers, without histogram and traces."""
        names = ("pixel_noise_dn", "row_noise_dn", "column_noise_dn", "frame_noise_dn", *DISTRIBUTION)
        return {
            "frames": self.frames,
            "exposure_s": self.exposure_s,
            **{name: getattr(self, name).to_dict() for name in names},
            **{name: estimate.to_dict() for name, estimate in vars(self.shape).items()},
            "bands": {name: [dict(vars(band)) for band in bands] for name, bands in self.bands.items()},
        }


def measure_temporal_noise(
    stack: GroupStatistics,
    residuals: StackResiduals,
    mean: MeanFrame,
    tile: NDArray[np.int64],
) -> TemporalNoise:
    """Measure the temporal noise of a stack of dark frames.

    `look` holds the residuals from the second reading of the stack.
    """
    parts = pool_temporal(
        temporal_components(stack.levels, residuals.lines, tile), [float(level.pixels) for level in stack.levels]
    )
    method = f"{stack.frames} {stack.label}, two-way analysis of variance"
    rounding = pooled_level(stack.levels).rounding_variance
    histogram = residuals.histogram.sum(axis=0)
    bins = len(histogram)
    return TemporalNoise(
        frames=stack.frames,
        exposure_s=stack.group.exposure_s,
        pixel_noise_dn=Estimate.of_variance(parts.pixel - QUANTIZATION_DN2 + Uncertain.of(0.0, rounding), method),
        row_noise_dn=Estimate.of_variance(parts.row, method),
        column_noise_dn=Estimate.of_variance(parts.column, method),
        frame_noise_dn=_frame_noise(residuals, mean.sum.size, parts, method),
        shape=measure_noise_shape(
            residuals.variance, residuals.fourth, stack.frames, residuals.histogram, residuals.bin_dn
        ),
        bands=_bands(residuals, mean, tile),
        residual_dn=np.asarray((np.arange(bins) + 0.5 - bins / 2) * residuals.bin_dn, np.float64),
        residual_count=histogram,
    )


def _frame_noise(residuals: StackResiduals, pixels: int, parts: TemporalComponents, method: str) -> Estimate:
    """Estimate the variance of the frame means that pixels, rows and columns do not explain."""
    row_sums, column_sums = residuals.lines
    means = row_sums.sum(axis=(1, 2), dtype=np.float64) / pixels
    variance = float(means.var(ddof=1))
    rows, cols = row_sums.shape[1], column_sums.shape[2]
    explained = parts.pixel * (1.0 / pixels) + parts.row * (1.0 / rows) + parts.column * (1.0 / cols)
    found = Uncertain.of_variance(variance, variance * math.sqrt(2.0 / (len(means) - 1)))
    return Estimate.of_variance(found - explained, method)


def _bands(residuals: StackResiduals, mean: MeanFrame, tile: NDArray[np.int64]) -> dict[str, tuple[Band, ...]]:
    """Find periods in the line means of the mean frame, and of the deviations of each frame from them."""
    rows, cols = mean.sum.shape
    height, width = tile.shape
    row_means = residuals.lines[0].sum(axis=2, dtype=np.float64) / cols
    column_means = residuals.lines[1].sum(axis=1, dtype=np.float64) / rows
    found = {}
    for name, means, period in (("rows", row_means, height), ("columns", column_means, width)):
        fixed = means.mean(axis=0)
        # The levels of the channels repeat with the tile.
        channels = np.array([fixed[phase::period].mean() for phase in range(period)])
        found[f"fixed {name}"] = find_bands((fixed - channels[np.arange(len(fixed)) % period])[None])
        found[f"temporal {name}"] = find_bands(means - fixed) if len(means) > 1 else ()
    return found
