"""Fixed pattern of a mean frame: spectrograms, profiles, histograms, outlier pixels (EMVA 1288 R4.0, 8.6 to 8.8)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import NormalDist
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.spatial.line_noise import TemporalComponents
from photosite.calibration.spatial.nonuniformity import (
    SMALLEST_SIDE,
    Difference,
    high_passed,
    pixel_gain,
    plane_mean,
    spread_sample,
    strips,
)
from photosite.calibration.withheld import SMALL_FRAMES
from photosite.engine.frame_sums import MeanFrame
from photosite.engine.lazy_maps import Map, PatchedMap, SitePlane
from photosite.engine.site_planes import MARGIN, plane_shape
from photosite.engine.threads import thread_count
from photosite.values.shown import Shown, short_repr
from photosite.values.uncertain import Missing

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Profile(Shown):
    """Profile of a map along one direction (EMVA 1288 R4.0, 8.7).

    Parameters
    ----------
    mean, lowest, highest, middle
        (n,) mean, minimum and maximum over the lines, and the values of the middle line, in the unit of the map.
    """

    mean: Array
    lowest: Array
    highest: Array
    middle: Array


def profiles(planes: Sequence[Map]) -> tuple[Profile, Profile]:
    """Return the horizontal profile, over the rows, and the vertical one, over the columns, of maps of one size.

    Mean and extremes are those of all planes, (rows, cols) each; the middle line is that of the first plane.

    Examples
    --------
    >>> across, down = profiles([np.array([[1.0, 2.0], [3.0, 2.0], [8.0, 2.0]])])
    >>> across.mean.tolist(), across.highest.tolist(), across.middle.tolist()
    ([4.0, 2.0], [8.0, 2.0], [3.0, 2.0])
    >>> down.mean.tolist()
    [1.5, 2.5, 5.0]
    """
    rows, cols = planes[0].shape
    sums, lows, highs = np.zeros(cols), np.full(cols, np.inf), np.full(cols, -np.inf)
    row_sums, row_lows, row_highs = np.zeros(rows), np.full(rows, np.inf), np.full(rows, -np.inf)
    for plane in planes:
        for part, lines in strips(plane):
            sums += lines.sum(axis=0)
            np.minimum(lows, lines.min(axis=0), out=lows)
            np.maximum(highs, lines.max(axis=0), out=highs)
            row_sums[part] += lines.sum(axis=1)
            np.minimum(row_lows[part], lines.min(axis=1), out=row_lows[part])
            np.maximum(row_highs[part], lines.max(axis=1), out=row_highs[part])
    first, down, across = planes[0], rows // 2, cols // 2
    middle_row = np.array(first[down : down + 1, :]).ravel()
    middle_column = np.array(first[:, across : across + 1]).ravel()
    return (
        Profile(sums / (rows * len(planes)), lows, highs, middle_row),
        Profile(row_sums / (cols * len(planes)), row_lows, row_highs, middle_column),
    )


@dataclass(frozen=True, eq=False)
class Spectrogram(Shown):
    """Mean power spectrum of the lines of a map (EMVA 1288 R4.0, 8.6; the plots show the square root of the power).

    Parameters
    ----------
    frequency
        (n,) cycles per pixel of the map, from 0 to 0.5.
    power
        (n,) squared magnitude of the lines' Fourier transform divided by the line length, mean over the lines, in the
        squared unit of the map. For independent pixels it equals their variance at every frequency. The mean over all
        frequencies, including the mirrored ones, is the variance.
    length
        Number of values in a line. A sinusoid of amplitude a along the lines gives a peak of a^2 length / 4.
    white, temporal
        Median power, the part that does not depend on frequency; power of the temporal noise that remains in the map.
    """

    frequency: Array
    power: Array
    length: int
    white: float
    temporal: float

    def amplitude(self) -> Array:
        """Return the amplitude (n,) of the sinusoid that alone would produce each power, in the unit of the map."""
        fraction = np.full(len(self.frequency), 2.0)
        fraction[0] = 1.0
        if self.length % 2 == 0:
            fraction[-1] = 1.0
        return np.asarray(fraction * np.sqrt(self.power / self.length))


def spectrogram(planes: Sequence[Map], axis: int, *, scale: float = 1.0, temporal: float = 0.0) -> Spectrogram:
    """Return the spectrogram of one map, or of several maps of one size together.

    Parameters
    ----------
    planes
        (rows, cols) each; the mean of each is subtracted.
    axis
        1 for the horizontal spectrogram, along rows; 0 for the vertical spectrogram, along columns.
    scale, temporal
        Factor that the map is multiplied by, and temporal variance that remains in the scaled map.

    Examples
    --------
    >>> wave = 3.0 * np.sin(2 * np.pi * 0.125 * np.arange(64.0)) + 100.0
    >>> found = spectrogram([np.tile(wave, (8, 1))], axis=1)
    >>> float(found.frequency[found.power.argmax()]), round(float(found.amplitude().max()), 12)
    (0.125, 3.0)
    """
    from scipy import fft

    length = planes[0].shape[axis]
    total, lines = np.zeros(length // 2 + 1), 0
    for plane in planes:
        mean = plane_mean(plane)
        for _, some in strips(plane, axis):
            transform = fft.rfft(some - mean, axis=1, overwrite_x=True, workers=thread_count())
            total += np.einsum("ij,ij->j", transform.real, transform.real, dtype=np.float64)
            total += np.einsum("ij,ij->j", transform.imag, transform.imag, dtype=np.float64)
            lines += len(some)
    power = total * (scale**2 / (lines * length))
    # The power at frequency 0 comes from the line means. It belongs neither to the white floor nor to a sinusoid.
    return Spectrogram(np.arange(len(power)) / length, power, length, float(np.median(power[1:])), temporal)


MOST_BINS = 256
"""Largest number of bins of a histogram (EMVA 1288)."""

EXPECTED_BEYOND = 0.1
"""Pixels of the whole map that a normal distribution would have beyond the default threshold for outlier pixels."""

COARSE = 0.1
"""Step of the values, as a fraction of their interquartile range, above which it falsifies the range."""

_QUARTILE = NormalDist().inv_cdf(0.75)


@dataclass(frozen=True, eq=False)
class Histogram(Shown):
    """Numbers of pixels by their deviation from the mean: signed, and accumulated by size (EMVA 1288 R4.0, 8.8).

    Parameters
    ----------
    lower, width, count
        (bins,) lower ends of the bins; their common width, in the unit of the map; numbers of pixels. 0 is the mean of
        the map.
    sigma
        Standard deviation of the map, for the normal distribution drawn beside it.
    deviation, percent_beyond
        (bins,) deviations, and the percentage of pixels that deviate at least that far on either side.
    """

    lower: Array
    width: float
    count: NDArray[np.int64]
    sigma: float
    deviation: Array
    percent_beyond: Array

    def normal(self) -> Array:
        """Return the counts (bins,) of a normal distribution of the same standard deviation."""
        if self.sigma == 0.0:
            return self.count.astype(np.float64)
        edges = np.append(self.lower, self.lower[-1] + self.width)
        return np.asarray(self.count.sum() * np.diff(_normal_below(edges, self.sigma)))

    def normal_beyond(self) -> Array:
        """Return `percent_beyond` (bins,) of a normal distribution of the same standard deviation."""
        if self.sigma == 0.0:
            return self.percent_beyond
        return np.asarray(200.0 * _normal_below(-self.deviation, self.sigma))


def _normal_below(x: Array, sigma: float) -> Array:
    from scipy.special import ndtr

    return np.asarray(ndtr(x / sigma))


def histogram(planes: Sequence[Map], centres: Sequence[float], grain: float | None = None) -> Histogram:
    """Return the histogram of the deviations of one map from its mean, or of several maps together.

    `grain` is the step of the values: 1 / n for the mean of n frames. Bins are then whole numbers of steps wide, as the
    standard requires, so that each bin holds the same number of possible values. None for continuous values.

    Examples
    --------
    >>> found = histogram([np.array([[9.0, 9.5, 10.0, 10.0, 11.5]])], [10.0], grain=0.5)
    >>> found.lower.tolist(), found.count.tolist()
    ([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5], [1, 1, 2, 0, 0, 1])
    >>> found.deviation.tolist(), found.percent_beyond.tolist()
    ([0.0, 0.5, 1.0, 1.5], [100.0, 60.0, 40.0, 20.0])
    """
    lowest, highest, least, sigma = _extent(planes, centres)
    width, bins = _bins(highest - lowest, grain)
    least = 0.0 if grain is None else least
    step, steps = _bins(max(highest, -lowest) - least, grain)
    count, sizes = np.zeros(bins, np.int64), np.zeros(steps, np.int64)
    for deviations in _deviations(planes, centres):
        count += _counted(deviations - lowest, width, bins, grain)
        sizes += _counted(np.abs(deviations) - least, step, steps, grain)
    lower, deviation = lowest + width * np.arange(bins, dtype=np.float64), least + step * np.arange(steps, dtype=float)
    return Histogram(lower, width, count, sigma, deviation, 100.0 * np.cumsum(sizes[::-1])[::-1] / sizes.sum())


def _deviations(planes: Sequence[Map], centres: Sequence[float]) -> Iterator[NDArray[np.floating]]:
    return (lines - centre for plane, centre in zip(planes, centres, strict=True) for _, lines in strips(plane))


def _extent(planes: Sequence[Map], centres: Sequence[float]) -> tuple[float, float, float, float]:
    """Return lowest and highest deviation, smallest absolute deviation, and standard deviation."""
    lowest, highest, least = np.inf, -np.inf, np.inf
    total = squares = 0.0
    pixels = 0
    for some in _deviations(planes, centres):
        lowest, highest = min(lowest, float(some.min())), max(highest, float(some.max()))
        least = min(least, float(np.abs(some).min()))
        total += float(some.sum(dtype=np.float64))
        squares += float(np.einsum("ij,ij->", some, some, dtype=np.float64))
        pixels += some.size
    # The centers are the means, so a negative difference is a rounding error.
    return lowest, highest, least, float(np.sqrt(max(squares / pixels - (total / pixels) ** 2, 0.0)))


def _bins(extent: float, grain: float | None) -> tuple[float, int]:
    """Return width and number of the bins that cover an extent, its end included."""
    if grain is None:
        return (extent / MOST_BINS or 1.0) * (1.0 + 1e-12), MOST_BINS if extent > 0.0 else 1
    values = round(extent / grain)
    grains = values // MOST_BINS + 1
    return grains * grain, values // grains + 1


def _counted(above: NDArray[np.floating], width: float, bins: int, grain: float | None) -> NDArray[np.int64]:
    # Prevent rounding errors from moving a value at the lower end of a bin into the bin below.
    places = np.floor(above / width + (0.0 if grain is None else 1e-6 * grain / width))
    return np.bincount(np.minimum(places, bins - 1).astype(np.int32).ravel(), minlength=bins)


@dataclass(frozen=True, eq=False)
class OutlierPixels(Shown):
    """Pixels that deviate from the mean of their map by more than a threshold: candidates for a defect list.

    Parameters
    ----------
    row, col, deviation
        (m,) positions on the sensor, and deviations from the mean in the unit of the map, the largest first.
    threshold, rule
        Deviation beyond which pixels are listed, and how it was chosen.
    """

    row: NDArray[np.intp]
    col: NDArray[np.intp]
    deviation: Array
    threshold: float
    rule: str

    def to_dict(self, unit: str) -> dict[str, Any]:
        """Return `threshold`, `unit`, `rule`, and the lists `row`, `col` and `deviation`."""
        found = {"row": self.row.tolist(), "col": self.col.tolist(), "deviation": self.deviation.tolist()}
        return {"threshold": self.threshold, "unit": unit, "rule": self.rule, **found}


def normal_threshold(sample: NDArray[np.floating], pixels: int, step: float = 0.0) -> float:
    """Return the deviation beyond which a normal distribution of `pixels` values would have 0.1 pixels, on either side.

    Its standard deviation is that of the sample's interquartile range, which outlier pixels do not widen. Values at
    multiples of a `step` that is coarse for this range, as in a single frame, are spread evenly over the step.
    """
    low, high = np.quantile(sample, [0.25, 0.75])
    if step > COARSE * (high - low):
        spread = np.random.default_rng(0).uniform(-0.5 * step, 0.5 * step, sample.shape)
        low, high = np.quantile(sample + spread, [0.25, 0.75])
    sigma = float(high - low) / (2.0 * _QUARTILE)
    return sigma * -NormalDist().inv_cdf(0.5 * EXPECTED_BEYOND / pixels)


Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Sensor row of each row, and sensor column of each column of a plane."""


def outlier_pixels(
    planes: Sequence[Map],
    centres: Sequence[float],
    places: Sequence[Places],
    threshold: float | None = None,
    step: float = 0.0,
) -> OutlierPixels:
    """Find the pixels of one or more maps that deviate from the mean by more than a threshold.

    Parameters
    ----------
    planes, centers, places
        (rows, cols) each; the mean of each; the sensor rows and columns of each.
    threshold
        In the unit of the map; `normal_threshold` if None. EMVA 1288 leaves the choice to the application.
    step
        Distance of the values of the maps, 0 where they have no common one.

    Examples
    --------
    >>> plane = np.full((2, 3), 7.0)
    >>> plane[1, 2] = 47.0
    >>> found = outlier_pixels([plane], [7.0], [(np.array([0, 2]), np.array([1, 3, 5]))], threshold=20.0)
    >>> found.row.tolist(), found.col.tolist(), found.deviation.tolist()
    ([2], [5], [40.0])
    """
    rule = "set by the user"
    if threshold is None:
        sample = np.concatenate([spread_sample(plane) - c for plane, c in zip(planes, centres, strict=True)])
        threshold = normal_threshold(sample, sum(plane.shape[0] * plane.shape[1] for plane in planes), step)
        rule = f"a normal distribution would have {EXPECTED_BEYOND:g} pixels beyond it"
    rows, cols, found = [], [], []
    for plane, centre, (row, col) in zip(planes, centres, places, strict=True):
        for part, lines in strips(plane):
            deviations = lines - centre
            i, j = np.nonzero(np.abs(deviations) > threshold)
            rows.append(row[part][i])
            cols.append(col[j])
            found.append(deviations[i, j].astype(np.float64))
    deviation = np.concatenate(found)
    order = np.argsort(-np.abs(deviation), kind="stable")
    return OutlierPixels(
        np.concatenate(rows)[order], np.concatenate(cols)[order], deviation[order], float(threshold), rule
    )


@dataclass(frozen=True)
class OutlierThresholds(Shown):
    """Deviations from the mean beyond which pixels are listed as outliers; None selects `normal_threshold`.

    Parameters
    ----------
    dark_dn, light_percent
        For the mean dark frame, DN, and for the high-pass filtered mean flat field, percent of the mean signal.
    """

    dark_dn: float | None = None
    light_percent: float | None = None


@dataclass(frozen=True, eq=False)
class FramePattern(Shown):
    """The pattern of one channel in one mean frame.

    Parameters
    ----------
    kind
        "dark": the mean dark frame. "light": the mean frame near half saturation minus the mean dark frame.
    frames, exposure_s
        Number of averaged frames, and their exposure time. Where no dark frames have the exposure time of the flat
        fields, the mean dark frame is extrapolated to it.
    unit
        "DN", or "%" of the mean signal: the unit of spectrograms, histogram and outlier pixels.
    mean_dn
        Mean of the map.
    horizontal, vertical, horizontal_filtered, vertical_filtered
        Spectrograms of the map, and those after the standard's high-pass filter, which removes uneven light.
    along_columns, along_rows
        Horizontal and vertical profile in DN. In a mosaic, positions count pixels of the channel.
    histogram, outliers
        Deviations from the mean and their outlier pixels; for light, after the high-pass filter.
    """

    kind: Literal["dark", "light"]
    frames: int
    exposure_s: float
    unit: Literal["DN", "%"]
    mean_dn: float
    horizontal: Spectrogram
    vertical: Spectrogram
    horizontal_filtered: Spectrogram
    vertical_filtered: Spectrogram
    along_columns: Profile
    along_rows: Profile
    histogram: Histogram
    outliers: OutlierPixels


@dataclass(frozen=True, eq=False)
class MeanPlanes(Shown):
    """A channel's mean frame, cut into one plane per site of the channel in the tile.

    Parameters
    ----------
    planes, origins, tile
        (rows, cols) each, in DN; sensor row and column of each plane's first value; rows and columns between
        neighboring values.
    frames, exposure_s, noise
        Number of averaged frames, their exposure time, and the temporal variance that remains in the mean, DN^2.
    extrapolated
        Whether the mean was extrapolated to `exposure_s`; its values then have no common step.
    """

    planes: Sequence[Map]
    origins: Sequence[tuple[int, int]]
    tile: tuple[int, int]
    frames: int
    exposure_s: float
    noise: TemporalComponents
    extrapolated: bool = False

    @classmethod
    def of(
        cls,
        mean: Map,
        tile: NDArray[np.int64],
        channel: int,
        frames: int,
        exposure_s: float,
        noise: TemporalComponents,
        *,
        extrapolated: bool = False,
    ) -> MeanPlanes:
        """Cut a mean frame into planes."""
        origins = [(int(r), int(c)) for r, c in np.argwhere(tile == channel)]
        steps = tile.shape[0], tile.shape[1]
        # Planes differ in size if the sensor's size is not a multiple of the tile. Keep the common part.
        shapes = [plane_shape(mean.shape, site, steps) for site in origins]
        shape = min(rows for rows, _ in shapes), min(cols for _, cols in shapes)
        planes = [SitePlane(mean, site, steps, shape) for site in origins]
        return cls(planes, origins, steps, frames, exposure_s, noise, extrapolated)

    def copied(self) -> MeanPlanes:
        """Return the planes of a stored mean frame with their own memory."""
        planes = [
            plane.values.plane(plane.site, plane.shape)
            if isinstance(plane, SitePlane) and isinstance(plane.values, MeanFrame)
            else plane
            for plane in self.planes
        ]
        return replace(self, planes=planes)

    def with_pixels(self, row: NDArray[np.int64], col: NDArray[np.int64], values: Array) -> MeanPlanes:
        """Return the planes with other values of some pixels of the sensor."""
        planes: list[Map] = []
        for plane, (first_row, first_col) in zip(self.planes, self.origins, strict=True):
            r, c = row - first_row, col - first_col
            own = (r >= 0) & (r % self.tile[0] == 0) & (c >= 0) & (c % self.tile[1] == 0)
            planes.append(PatchedMap(plane, r[own] // self.tile[0], c[own] // self.tile[1], values[own]))
        return replace(self, planes=planes)

    def places(self, site: int, border: int) -> Places:
        """Return the sensor rows and columns of a plane, without a border."""
        rows, cols = (np.arange(border, size - border) for size in self.planes[site].shape)
        row, col = self.origins[site]
        return row + self.tile[0] * rows, col + self.tile[1] * cols


class SpatialAnalysis(Shown):
    """Patterns of one channel in the dark and near half saturation (EMVA 1288 R4.0, 8.6 to 8.8).

    Each pattern is computed when it is first read. Until both have been read, the sums of the mean frames stay in
    memory, 2 or 4 bytes per pixel of the sensor each, and the dark slopes, 8 bytes. Pickling computes both.

    Parameters
    ----------
    dark, light
        Mean dark frame, and mean frame near half saturation, from which the dark signal is not yet subtracted.
    thresholds
        Deviations beyond which pixels are listed as outliers.
    """

    def __init__(self, dark: MeanPlanes, light: MeanPlanes | Missing, thresholds: OutlierThresholds) -> None:
        self._frames: tuple[MeanPlanes, MeanPlanes | Missing, OutlierThresholds] | None = dark, light, thresholds

    @cached_property
    def dark(self) -> FramePattern:
        """The pattern of the mean dark frame."""
        assert self._frames is not None
        dark, _, wanted = self._frames
        pattern = _pattern(dark, None, wanted.dark_dn)
        if "light" in vars(self):
            self._frames = None
        return pattern

    @cached_property
    def light(self) -> FramePattern | Missing:
        """The pattern of the mean frame near half saturation less the mean dark frame, or why it is missing."""
        assert self._frames is not None
        dark, light, wanted = self._frames
        pattern = light if isinstance(light, Missing) else _pattern(light, dark, wanted.light_percent)
        if "dark" in vars(self):
            self._frames = None
        return pattern

    def compute(self) -> None:
        """Compute both patterns now, and release the mean frames."""
        _ = self.dark, self.light

    def __getstate__(self) -> dict[str, Any]:
        self.compute()
        return vars(self)

    def __repr__(self) -> str:
        return short_repr(self, {"dark": self.dark, "light": self.light})

    def to_dict(self) -> dict[str, Any]:
        """Return `dark` and `light`: the outlier pixels of each, or the reason why they are missing."""
        light = self.light
        light_entry = light.to_dict() if isinstance(light, Missing) else light.outliers.to_dict(light.unit)
        return {"dark": self.dark.outliers.to_dict(self.dark.unit), "light": light_entry}


def spatial_analysis(
    dark: MeanPlanes, light: MeanPlanes | Missing, thresholds: OutlierThresholds | None = None
) -> SpatialAnalysis | Missing:
    """Analyze a channel's pattern in its mean dark frame and its mean frame near half saturation.

    The dark signal is not yet subtracted from `light`. Missing if the planes are too small for the high-pass filter.
    """
    smallest = min(dark.planes[0].shape)
    if smallest < SMALLEST_SIDE:
        return SMALL_FRAMES.missing(
            f"a color plane has {smallest} pixels on its short side; the high-pass needs {SMALLEST_SIDE}"
        )
    return SpatialAnalysis(dark, light, thresholds or OutlierThresholds())


def _pattern(frames: MeanPlanes, dark: MeanPlanes | None, threshold: float | None) -> FramePattern:
    """Return the pattern of a mean dark frame, or of a mean flat field less a mean dark frame."""
    planes: Sequence[Map] = frames.planes
    noise, grain = frames.noise.total.value, None
    if dark is not None:
        planes = [Difference(bright, black) for bright, black in zip(frames.planes, dark.planes, strict=True)]
        noise += dark.noise.total.value
    elif len(planes) == 1 and not frames.extrapolated:  # several planes have means with different fractions
        grain = 1.0 / frames.frames
    means = [plane_mean(plane) for plane in planes]
    mean = float(np.mean(means))
    scale = 1.0 if dark is None else 100.0 / mean
    filtered = [high_passed(plane, scale) for plane in planes]
    counted: Sequence[Map] = planes if dark is None else filtered
    centres, border = (means, 0) if dark is None else ([plane_mean(plane) for plane in filtered], MARGIN)
    temporal = noise * scale**2
    horizontal, vertical = (spectrogram(planes, axis, scale=scale, temporal=temporal) for axis in (1, 0))
    passed = [spectrogram(filtered, axis, temporal=temporal * pixel_gain()) for axis in (1, 0)]
    along_columns, along_rows = profiles(planes)
    return FramePattern(
        kind="dark" if dark is None else "light",
        frames=frames.frames,
        exposure_s=frames.exposure_s,
        unit="DN" if dark is None else "%",
        mean_dn=mean,
        horizontal=horizontal,
        vertical=vertical,
        horizontal_filtered=passed[0],
        vertical_filtered=passed[1],
        along_columns=along_columns,
        along_rows=along_rows,
        histogram=histogram(counted, centres, grain),
        outliers=outlier_pixels(
            counted,
            centres,
            [frames.places(site, border) for site in range(len(planes))],
            threshold,
            0.0 if frames.extrapolated or dark is not None else 1.0 / frames.frames,
        ),
    )
