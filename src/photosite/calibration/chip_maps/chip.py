"""Measure one chip: maps of offset, response, dark rate and read noise, its defects, and its temporal noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence, Sized
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.result_screening import too_short_for_dark_current
from photosite.calibration.chip_maps import defects, telegraph_noise
from photosite.calibration.chip_maps.pixel_noise import NoiseSpread, moderated, noise_spread
from photosite.calibration.chip_maps.residuals import StackResiduals, read_residuals
from photosite.calibration.chip_maps.response_map import ResponseMap, light_groups_in_range, read_response_map
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise, Trace, measure_temporal_noise
from photosite.calibration.reduction.frame_reader import FrameReader, Progress
from photosite.calibration.reduction.groups import GroupStatistics, pooled_level, reference_dark
from photosite.calibration.reduction.reduce import dark_slope_coefficients, read_group
from photosite.calibration.result import Calibration
from photosite.calibration.spatial.pixel_slopes import PixelSlopes
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.errors import CalibrationError, FileError
from photosite.frames.frame_set import FrameSet
from photosite.sensor.measured_chip import Blinking, DefectKind, Defects, MeasuredChip, no_blinking
from photosite.sensor.noise_profile import QUANTISATION_DN2

CLIPPED_DARK = 1e-3
"""Largest fraction of zeros in the dark frames. Beyond it, offset and noise of the clipped pixels are unknown."""

MOST_SUSPECTS = 4096
"""Largest number of pixels that are searched for two levels: those with the largest variance in their channel."""

_SUSPECT = 1e-3
"""Probability that an ordinary pixel's variance makes it a suspect."""

TRACES = 4
"""Blinking pixels whose values are kept for the report."""

FloatMap = NDArray[np.float32]
_Place = tuple[NDArray[np.int64], NDArray[np.int64]]


class ClippedChipError(CalibrationError):
    """The dark frames are clipped at 0, so the chip cannot be mapped; the sensor parameters remain valid."""


@dataclass(frozen=True)
class _DarkMaps:
    """Per-pixel results of the dark frames, in DN and seconds."""

    groups: Sequence[GroupStatistics]
    reference: int
    mean: MeanFrame
    variance: FloatMap
    rate: FloatMap | None
    coefficients: NDArray[np.float64]

    @property
    def stack(self) -> GroupStatistics:
        return self.groups[self.reference]


def measure_chip(
    frames: FrameSet, calibration: Calibration, progress: Progress | None = None
) -> tuple[MeasuredChip, TemporalNoise]:
    """Measure the chip that took a set of frames, pixel by pixel.

    Reads the dark frames and the flat fields of the linear range again, and the reference dark frames (those of the
    read noise) once more after that. Memory does not grow with the number of frames. `MeasuredChip` describes the maps
    and their uncertainties. Offset and dark rate are intercept and slope of a pixel's dark frames against exposure
    time. The response is the slope of its flat fields minus its dark rate. Weights depend on the level, not on the
    pixel, so that all maps are linear in the frames and unbiased. Uncertainties are those of temporal noise, estimated
    from each pixel's variance and those of its channel (`pixel_noise`).

    Parameters
    ----------
    frames
        The measurement.
    calibration
        The result of `calibrate` for these frames.
    progress
        As for `calibrate`.

    Returns
    -------
    MeasuredChip
        Maps and defects; no response without flat fields, no dark rate with a single dark exposure time.
    TemporalNoise
        Noise of pixels, rows and columns, its shape, and bands.

    Raises
    ------
    ClippedChipError
        If the dark frames are clipped at 0.
    FileError
        If a frame cannot be read.
    """
    lights = light_groups_in_range(frames, calibration)
    darks = frames.of_kind("dark")
    again = replace(frames, groups=(*darks, *lights))
    counted = _Counted(progress, later=len(darks[reference_dark(darks)]))
    with FrameReader(again, counted) as reader:
        dark = _read_darks(reader)
        response = read_response_map(reader, calibration, pooled_level(dark.stack.levels).variance) if lights else None
        spreads = _spreads(dark, reader.tile)
        sigma = float(np.sqrt(np.median([spread.variance for spread in spreads])))
        suspects = _suspects(dark, spreads, reader.tile)
        look = read_residuals(_used_again(reader, dark.stack, counted), dark.mean, sigma, suspects)
        tile = reader.tile
    del reader  # its sums need as much memory as three maps
    temporal = measure_temporal_noise(dark.stack, look, dark.variance, dark.mean, tile)
    return _chip(calibration, dark, response, spreads, suspects, look, temporal, tile)


def _read_darks(reader: FrameReader) -> _DarkMaps:
    planned = reader.frames.of_kind("dark")
    slopes, coefficients = None, dark_slope_coefficients(planned)
    if coefficients is not None:
        slopes = PixelSlopes((reader.frames.rows, reader.frames.cols), reader.tile)
    wanted = reference_dark(planned)
    groups: list[GroupStatistics] = []
    stack: tuple[MeanFrame, FloatMap] | None = None
    for index, group in enumerate(planned):
        statistics, sums = read_group(reader, group)
        groups.append(statistics)
        if max(level.low_fraction for level in groups[-1].levels) > CLIPPED_DARK:
            raise ClippedChipError(
                "the percentage of clipped dark values",
                where=groups[-1].label,
                value=round(100 * max(level.low_fraction for level in groups[-1].levels), 2),
                expected=f"at most {100 * CLIPPED_DARK:g}",
                hint="Raise the camera's black level, so that dark frames do not clip at 0 DN",
            )
        if index == wanted:
            stack = _mean_and_variance(sums)
        if slopes is not None and coefficients is not None:
            slopes.add(sums.mean_frame(), [float(coefficients[index])] * len(groups[-1].levels))
    if stack is None or (reference := reference_dark(groups)) != wanted:
        reader.expect(len(planned[reference_dark(groups)]))
        reference = reference_dark(groups)
        stack = _mean_and_variance(reader.sums(planned[reference]))
    rate = None if slopes is None else slopes.slopes.astype(np.float32)
    weights = np.zeros(len(planned)) if coefficients is None else coefficients
    return _DarkMaps(groups, reference, *stack, rate, weights)


def _mean_and_variance(sums: FrameSums) -> tuple[MeanFrame, FloatMap]:
    mean = sums.mean_frame()
    # The next group reuses the memory of these sums.
    return replace(mean, sum=mean.sum.copy()), sums.variance().astype(np.float32)


class _Counted:
    """Progress that includes the frames read after the reader is done."""

    def __init__(self, progress: Progress | None, later: int) -> None:
        self._progress, self._later = progress, later
        self._done = self._total = 0

    def __call__(self, done: int, total: int) -> None:
        self._done, self._total = done, total + self._later
        if self._progress is not None:
            self._progress(self._done, self._total)

    def one_more(self) -> None:
        self(self._done + 1, self._total - self._later)


def _used_again(
    reader: FrameReader, stack: GroupStatistics, counted: _Counted
) -> Iterator[NDArray[np.unsignedinteger]]:
    """Yield the stack's frames again, without repeats."""
    used = {id(entry.source) for entry in reader.used_frames}
    shape = reader.frames.rows, reader.frames.cols
    for source in stack.group.frames:
        counted.one_more()
        if id(source) in used:
            dn = source.read()
            if dn.shape != shape:
                raise FileError(
                    source.name, "the frame's shape", value=dn.shape, expected=f"{shape}, as at the first reading"
                )
            yield dn


def _spreads(dark: _DarkMaps, tile: NDArray[np.int64]) -> list[NoiseSpread]:
    """Return, per channel, the distribution of the pixels' temporal variances."""
    freedom = dark.stack.frames - 1
    return [
        noise_spread(defects.channel_values(dark.variance, tile, k), freedom) for k in range(len(dark.stack.levels))
    ]


def _by_channel(
    shape: tuple[int, ...], tile: NDArray[np.int64], values: Callable[[int, tuple[slice, slice]], NDArray[np.floating]]
) -> FloatMap:
    """Build a map from a function of the channel and of a plane's slices."""
    out = np.empty(shape, np.float32)
    for k in range(int(tile.max()) + 1):
        for part in defects.sites(tile, k):
            out[part] = values(k, part)
    return out


def _noisier(
    dark: _DarkMaps, spreads: Sequence[NoiseSpread], tile: NDArray[np.int64], probability: float
) -> tuple[_Place, NDArray[np.float64]]:
    """Return the pixels noisier than an ordinary one is with a given probability, and their relative variance."""
    chosen = np.zeros(dark.variance.shape, np.bool_)
    for k, spread in enumerate(spreads):
        for part in defects.sites(tile, k):
            chosen[part] = dark.variance[part] > spread.limit(probability, dark.stack.frames - 1)
    row, col = np.nonzero(chosen)
    channel = tile[row % tile.shape[0], col % tile.shape[1]]
    return (row, col), dark.variance[row, col] / np.array([spread.variance for spread in spreads])[channel]


def _suspects(dark: _DarkMaps, spreads: Sequence[NoiseSpread], tile: NDArray[np.int64]) -> _Place:
    """Return rows and columns of the pixels with the most extreme noise."""
    (row, col), ratio = _noisier(dark, spreads, tile, _SUSPECT)
    keep = np.sort(np.argsort(-ratio, kind="stable")[:MOST_SUSPECTS])
    return row[keep], col[keep]


def _chip(
    calibration: Calibration,
    dark: _DarkMaps,
    response: ResponseMap | None,
    spreads: Sequence[NoiseSpread],
    suspects: _Place,
    look: StackResiduals,
    temporal: TemporalNoise,
    tile: NDArray[np.int64],
) -> tuple[MeasuredChip, TemporalNoise]:
    gain, black = calibration.system_gain_dn_per_e.value, calibration.black_level_dn.value
    level = np.divide(dark.mean.sum, dark.mean.count, dtype=np.float64).astype(np.float32)
    black = float(level.mean(dtype=np.float64)) if black is None else black
    level -= np.float32(black)
    # Shot noise of the dark current, DN^2 per second; none for a negative rate.
    shot = None if dark.rate is None or gain is None else np.maximum(dark.rate, 0.0) * np.float32(gain)
    maps = _dark_maps(dark, level, shot, spreads, tile)
    if response is not None:
        unknown = np.zeros((1, 1), np.float32)
        rate, of_rate = (maps.get(name, unknown) for name in ("dark_rate_dn_per_s", "dark_rate_uncertainty_dn_per_s"))
        maps["prnu"], maps["prnu_uncertainty"] = response.relative(rate, of_rate, tile)
    if too_short_for_dark_current(np.array([entry.group.exposure_s for entry in dark.groups])) is not None:
        for name in ("dark_rate_dn_per_s", "dark_rate_uncertainty_dn_per_s"):
            maps.pop(name, None)  # the exposure times are wrong; the response above uses the same times and stays valid
    blinkers = _blinking(dark, look, suspects, shot)
    chip = MeasuredChip(
        **maps,
        read_noise_freedom=dark.stack.frames - 1,
        row_noise_dn=temporal.row_noise_dn.value or 0.0,
        column_noise_dn=temporal.column_noise_dn.value or 0.0,
        black_level_dn=black,
        system_gain_dn_per_e=gain,
        reference_exposure_s=dark.stack.group.exposure_s,
        defects=_defects(dark, spreads, blinkers, maps, tile),
        blinking=blinkers.pixels,
    )
    return chip, replace(temporal, traces=blinkers.traces)


def _dark_maps(
    dark: _DarkMaps,
    level: FloatMap,
    shot: FloatMap | None,
    spreads: Sequence[NoiseSpread],
    tile: NDArray[np.int64],
) -> dict[str, FloatMap]:
    """Return offset, read noise and dark rate. `level`, the mean reference dark above black, becomes the offset."""
    freedom, reference_s = dark.stack.frames - 1, dark.stack.group.exposure_s
    noise = _by_channel(level.shape, tile, lambda k, part: moderated(dark.variance[part], freedom, spreads[k]))
    of_mean = np.zeros(len(dark.groups))
    of_mean[dark.reference] = 1.0
    read = dark.variance - np.float32(QUANTISATION_DN2)
    if dark.rate is not None:
        level -= np.float32(reference_s) * dark.rate
        of_mean -= reference_s * dark.coefficients
    if shot is not None:
        read -= np.float32(reference_s) * shot
    size = np.abs(read)
    np.sqrt(size, out=size)
    maps = {
        "offset_dn": level,
        "offset_uncertainty_dn": _uncertainty(of_mean, dark, noise, shot),
        "read_noise_dn": np.copysign(size, read, out=read),
    }
    if dark.rate is not None:
        maps["dark_rate_dn_per_s"] = dark.rate
        maps["dark_rate_uncertainty_dn_per_s"] = _uncertainty(dark.coefficients, dark, noise, shot)
    return maps


def _uncertainty(weights: NDArray[np.float64], dark: _DarkMaps, noise: FloatMap, shot: FloatMap | None) -> FloatMap:
    """Return the standard uncertainty of a linear combination of the dark groups' means, per pixel.

    The noise of a group is that of the reference stack plus the shot noise of the dark current during the difference in
    exposure time. Rounding sets a lower limit.
    """
    share = weights**2 / np.array([entry.frames for entry in dark.groups])
    longer = np.array([entry.group.exposure_s for entry in dark.groups]) - dark.stack.group.exposure_s
    variance = noise * np.float32(share.sum())
    if shot is not None:
        variance += shot * np.float32(share @ longer)
    np.maximum(variance, np.float32(QUANTISATION_DN2 * share.sum()), out=variance)
    np.sqrt(variance, out=variance)
    return variance


def _defects(
    dark: _DarkMaps,
    spreads: Sequence[NoiseSpread],
    blinkers: _Blinkers,
    maps: dict[str, FloatMap],
    tile: NDArray[np.int64],
) -> Defects:
    far, shape, found = defects.FAR_SIGMA, dark.variance.shape, []
    off = defects.deviations(maps["offset_dn"], maps["offset_uncertainty_dn"], tile)
    found.append(defects.listed(DefectKind.OFFSET, np.abs(off) > far, maps["offset_dn"], off))
    if "dark_rate_dn_per_s" in maps:
        rate = maps["dark_rate_dn_per_s"]
        off = defects.deviations(rate, maps["dark_rate_uncertainty_dn_per_s"], tile)
        found.append(defects.listed(DefectKind.HOT, off > far, rate, off))
    if "prnu" in maps:
        relative = 1.0 + maps["prnu"]
        off = defects.deviations(maps["prnu"], maps["prnu_uncertainty"], tile)
        dead = relative < defects.DEAD_RESPONSE
        found.append(defects.listed(DefectKind.DEAD, dead, relative, off))
        found.append(defects.listed(DefectKind.RESPONSE, (np.abs(off) > far) & ~dead, relative, off))

    jumping = blinkers.pixels
    found.append(
        Defects(jumping.row, jumping.col, _kinds(DefectKind.BLINKING, jumping), jumping.amplitude_dn, blinkers.distance)
    )
    place, ratio = _noisier(dark, spreads, tile, defects.NOISY_PROBABILITY)
    noisy = Defects(*place, _kinds(DefectKind.NOISY, ratio), np.sqrt(dark.variance[place]).astype(float), ratio**0.5)
    steady = ~np.isin(np.ravel_multi_index(place, shape), np.ravel_multi_index((jumping.row, jumping.col), shape))
    found.append(noisy.where(steady))
    return defects.together(found)


def _kinds(kind: DefectKind, like: Sized) -> NDArray[np.uint8]:
    return np.full(len(like), kind, np.uint8)


@dataclass(frozen=True)
class _Blinkers:
    """Blinking suspects, the distance of their levels in units of their noise, and some of their traces."""

    pixels: Blinking
    distance: NDArray[np.float64]
    traces: tuple[Trace, ...]


def _blinking(dark: _DarkMaps, look: StackResiduals, place: _Place, shot: FloatMap | None) -> _Blinkers:
    if look.series.shape[1] < telegraph_noise.LEAST_FRAMES or not len(look.series):
        return _Blinkers(no_blinking(), np.zeros(0), ())
    jumps, levels = telegraph_noise.find_blinking(look.series)
    row, col = place[0][jumps], place[1][jumps]
    within = levels.within[jumps] - QUANTISATION_DN2
    if shot is not None:
        within = within - dark.stack.group.exposure_s * shot[row, col]
    amplitude = (levels.upper - levels.lower)[jumps]
    noise = np.copysign(np.sqrt(np.abs(within)), within)
    distance = levels.distance[jumps]
    clearest = np.flatnonzero(jumps)[np.argsort(-distance, kind="stable")[:TRACES]]
    traces = tuple(
        Trace(int(place[0][i]), int(place[1][i]), look.series[i], float(levels.lower[i]), float(levels.upper[i]))
        for i in clearest
    )
    return _Blinkers(Blinking(row, col, amplitude, levels.high_fraction[jumps], noise), distance, traces)
