"""Stage "noise structure": temporal noise that pixels, frames or rows share, before photon transfer."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from photosite.calibration import withheld
from photosite.calibration.dark.dark_result import GroupMean
from photosite.calibration.light.flicker import Flicker, RowLight, find_flicker, with_frequency
from photosite.calibration.photon_transfer.noise_covariance import (
    LEAST_RUN,
    SHARED_NOISE,
    NoiseCovariance,
    Run,
    SharedNoise,
    find_shared_noise,
    mean_covariance,
    noise_covariances,
    seen_correlations,
)
from photosite.calibration.photon_transfer.photon_transfer import LINEAR_FRACTION
from photosite.calibration.photon_transfer.pixel_coupling import PixelCoupling, fit_coupling
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.line_noise import group_lines, temporal_components
from photosite.engine.lazy_maps import row_means
from photosite.engine.threads import thread_count
from photosite.values.uncertain import Measured, Missing, Uncertain

PIXELS = 1 << 21
"""Pixels, over all pairs of frames of a level, that decide whether noise is correlated."""

PIXELS_CORRELATED = 1 << 25
"""Pixels that measure a correlation once it has been found."""

SMALL_FRAME = 1 << 20
"""Pixels of the largest frames of which several groups are compared at a time."""

RUN = 8
"""Successive frames that are compared with each other."""

LEAST_SIDE = 8
"""Rows and columns of a channel below which frames are too small to tell neighbors from far pixels."""

NO_COUPLING = withheld.NO_COUPLING.missing(
    f"the coupling of pixels needs two dark frames, and two flat fields in the linear range, each channel with "
    f"{LEAST_SIDE} rows and columns"
)


@dataclass(frozen=True)
class NoiseStructure:
    """Temporal noise that is not independent; None for each kind that is not seen beyond chance.

    Parameters
    ----------
    shared
        Correlation of the shot noise between neighboring pixels and between frames, seen or suspected.
    flicker
        Flicker of the light, in rows.
    coupling
        Interpixel capacitance, or why it is not known.
    """

    shared: SharedNoise | None = None
    flicker: Flicker | None = None
    coupling: PixelCoupling | Missing = NO_COUPLING


def measure_noise_structure(reduction: Reduction, reader: FrameReader) -> NoiseStructure:
    """Return the structure of the temporal noise.

    A few runs of successive frames are read again: of the reference dark frames, and of flat fields in the linear
    range, the brightest first, until there are enough pixels.
    """
    frames = reduction.frames
    flats = _linear(reduction)
    if not flats or min(frames.rows // reader.tile.shape[0], frames.cols // reader.tile.shape[1]) < LEAST_SIDE:
        return NoiseStructure()
    dark = reduction.reference_group
    known = dark is not None and dark.frames > 1
    if dark is None or dark.frames == 1:
        # What grows with the light shows in the difference from the dimmest flat fields as well.
        *flats, dark = sorted(flats, key=lambda entry: -entry.levels[0].mean)
        if not flats:
            return NoiseStructure()
    dark_noise = _covariances(reader, dark, PIXELS)
    light_noise, square = _mean_covariances(reader, flats, dark, dark_noise, PIXELS)
    flicker = find_flicker(light_noise, dark_noise, square)
    shared = find_shared_noise(light_noise, dark_noise)
    if not known:
        return _withheld(shared, flicker)
    if shared is not None and sum(_pairs(reader, group) for group in flats) > PIXELS:
        dark_noise = _covariances(reader, dark, PIXELS_CORRELATED)
        light_noise, _ = _mean_covariances(reader, flats, dark, dark_noise, PIXELS_CORRELATED)
        again = find_shared_noise(light_noise, dark_noise)
        if not shared.seen or (again is not None and again.seen):
            shared = again
    shot = [a - b for a, b in zip(light_noise, dark_noise, strict=True)]
    signal = [a.mean - b.mean for a, b in zip(flats[0].levels, dark.levels, strict=True)]
    return NoiseStructure(shared, flicker, _coupling(shot, shared, reader.tile, signal))


def _coupling(
    shot: Sequence[NoiseCovariance], shared: SharedNoise | None, tile: NDArray[np.int64], signal: Sequence[float]
) -> PixelCoupling | Missing:
    if shared is not None and isinstance(shared.charge, Missing):
        return shared.charge
    if shared is not None and shared.unclear_cause:
        return SHARED_NOISE.missing(f"{seen_correlations(shared.neighbors, shared.frames)}, {shared.unclear_cause}")
    if min(entry.variance for entry in shot) <= 0.0 or min(signal) <= 0.0:
        return NO_COUPLING
    return fit_coupling(shot, tile, signal, seen=shared is not None and shared.neighbors is not None)


def _withheld(shared: SharedNoise | None, flicker: Flicker | None) -> NoiseStructure:
    """Return a structure of which single dark frames, or none, do not tell how to correct it."""
    if shared is None or not shared.seen:
        if flicker is None:
            return NoiseStructure(shared)
        seen = str(flicker)
    else:
        seen = seen_correlations(shared.neighbors, shared.frames)
    why = SHARED_NOISE.missing(f"{seen}; without two dark frames at one exposure time this cannot be corrected")
    return NoiseStructure(SharedNoise(None, None, why))


def _mean_covariances(
    reader: FrameReader,
    flats: Sequence[GroupStatistics],
    dark: GroupStatistics,
    dark_noise: Sequence[NoiseCovariance],
    pixels: int,
) -> tuple[list[NoiseCovariance], list[float]]:
    """Return each channel's noise covariances and squared signal, the mean over levels until there are enough pixels.

    The weights make the correlation of the shot noise as precise as possible.
    """
    used: list[GroupStatistics] = []
    wanted: list[int] = []
    pairs: list[int] = []
    for group in flats:
        if (left := pixels - sum(pairs)) <= 0:
            break
        wanted.append(left)
        pairs.append(min(_pairs(reader, group), left))
        used.append(group)
    # One thread does much of the work on a group of few frames. Runs of large frames take too much memory for two.
    covariances = partial(_covariances, reader)
    if reader.frames.rows * reader.frames.cols <= SMALL_FRAME and reader.thread_safe:
        with ThreadPoolExecutor(thread_count()) as threads:
            found = list(threads.map(covariances, used, wanted))
    else:
        found = list(map(covariances, used, wanted))
    means, squares = [], []
    for k, dark_covariance in enumerate(dark_noise):
        noise = [entry[k] for entry in found]
        variance = np.array([entry.variance for entry in noise])
        weights = np.array(pairs) * np.maximum(variance - dark_covariance.variance, 0.0) / variance**2
        weights = weights / weights.sum() if weights.any() else np.eye(len(noise))[0]
        signal = np.array([group.levels[k].mean - dark.levels[k].mean for group in used])
        means.append(mean_covariance(noise, weights))
        squares.append(float(weights @ signal**2))
    return means, squares


def _pairs(reader: FrameReader, group: GroupStatistics) -> int:
    """Return the pixels of a group, over all pairs of its frames."""
    return reader.frames.rows * reader.frames.cols * (group.frames // 2)


def without_flicker(
    reduction: Reduction, reader: FrameReader, dark: GroupMean, flicker: Flicker, line_time_us: Measured | None
) -> tuple[Reduction, Flicker]:
    """Return the reduction without flicker in the temporal variances of the flat fields, and what all of them show.

    The variance that rows share in the reference dark frames stays, because it is subtracted with the dark variance.

    Parameters
    ----------
    reduction
        The reduced frames.
    reader
        The reader, for the frames of each group.
    dark
        The reference dark frames.
    flicker
        The flicker as found.
    line_time_us
        Line time of the sensor, if it is known.
    """
    lights, fractions, bands = [], [], []
    dark_rows = row_means(dark.mean)
    for group in reduction.lights:
        if group.frames > 1 and not any(level.clipped for level in group.levels):
            levels = []
            lines = group_lines(reader, group, most=group.frames)
            found = temporal_components(group.levels, lines, reader.tile)
            of_rows = lines[0].sum(axis=2, dtype=np.float64) / reader.frames.cols
            bands.append(RowLight(group.group.exposure_s, of_rows - dark_rows))
            for k, (level, parts) in enumerate(zip(group.levels, found, strict=True)):
                dark_part = dark.noise[k].row.value * dark.statistics.frames
                # The bands are those of the same frames: they leave no error behind in what is left.
                pixel = parts.pixel.value * math.sqrt(2.0 / ((group.frames - 1) * level.pixels))
                own = Uncertain.of(parts.pixel.value, pixel) + parts.column
                levels.append(
                    replace(level, variance=own.value + dark_part, variance_uncertainty=own.standard_uncertainty)
                )
                fractions.append((parts.row.value - dark_part) / (level.mean - dark.statistics.levels[k].mean) ** 2)
            group = replace(group, levels=tuple(levels))
        lights.append(group)
    fraction = math.sqrt(max(float(np.median(fractions)), 0.0))
    flicker = with_frequency(replace(flicker, fraction=fraction or flicker.fraction), bands, line_time_us)
    return replace(reduction, lights=tuple(lights)), flicker


def _linear(reduction: Reduction) -> list[GroupStatistics]:
    """Return flat fields of several frames, up to 70 % of the signal at the largest variance, the brightest first."""
    flats = [
        entry for entry in reduction.lights if entry.frames > 1 and not any(level.clipped for level in entry.levels)
    ]
    if not flats:
        return []
    levels = [pooled_level(entry.levels) for entry in flats]
    reference = reduction.reference_group
    dark = 0.0 if reference is None else pooled_level(reference.levels).mean
    limit = LINEAR_FRACTION * (max(levels, key=lambda level: level.variance).mean - dark)
    signals = [level.mean - dark for level in levels]
    # Without a level in the linear range, the darkest.
    chosen = [k for k, signal in enumerate(signals) if signal <= limit] or [int(np.argmin(signals))]
    return [flats[k] for k in sorted(chosen, key=lambda k: -signals[k])]


def _covariances(reader: FrameReader, group: GroupStatistics, pixels: int) -> list[NoiseCovariance]:
    return noise_covariances(_runs(reader, group, pixels), reader.tile)


def _runs(reader: FrameReader, group: GroupStatistics, pixels: int) -> Iterator[Run]:
    """Yield the middle rows of runs of successive frames, spread evenly over the group."""
    sources = reader.used_sources(group.group)
    rows, cols = reader.frames.rows, reader.frames.cols
    frames = min(max(2 * pixels // (rows * cols), LEAST_RUN), len(sources))
    length = min(RUN, frames)
    runs = frames // length
    step = reader.tile.shape[0]
    height = min(max(2 * pixels // frames // cols, LEAST_SIDE * step), rows) // step * step
    start = (rows - height) // 2 // step * step
    for first in np.linspace(0, len(sources) - length, runs).astype(int):
        yield reader.each(sources[first : first + length], slice(start, start + height))
