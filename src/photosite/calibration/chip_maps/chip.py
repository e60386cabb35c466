"""Measure one chip: maps of offset, response, dark rate and read noise, its defects, and its temporal noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.checks.result_screening import too_short_for_dark_current
from photosite.calibration.chip_maps import defects, pixel_noise
from photosite.calibration.chip_maps.noise_distribution import blinking_distribution, read_noise_distribution
from photosite.calibration.chip_maps.pixel_gain import PIXEL_GAINS_MISSING, GainSums
from photosite.calibration.chip_maps.pixel_noise import NoiseSpread, moderated, noise_spread
from photosite.calibration.chip_maps.response_map import (
    ResponseMap,
    light_groups_in_range,
    light_in_range,
    read_response_map,
)
from photosite.calibration.chip_maps.temporal_noise import (
    TemporalNoise,
    Trace,
    measure_temporal_noise,
    read_residuals,
)
from photosite.calibration.effects.glow import GlowMap
from photosite.calibration.evidence import Evidence
from photosite.calibration.parameters import Parameters
from photosite.calibration.reduction.frame_reader import FrameReader, Progress
from photosite.calibration.reduction.groups import GroupStatistics, Level, pooled_level, reference_dark
from photosite.calibration.reduction.reduce import dark_slope_coefficients, read_group
from photosite.calibration.spatial.pixel_slopes import PixelSlopes
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.engine.lazy_maps import row_strips
from photosite.errors import CalibrationError, FileError
from photosite.sensor.chip import Blinking, DefectKind, Defects, MeasuredChip, no_blinking
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.estimate import Estimate, signed_square
from photosite.values.uncertain import Missing

CLIPPED_DARK = 1e-3
"""Largest fraction of zeros in the dark frames. Beyond it, offset and noise of the clipped pixels are unknown."""

MOST_SUSPECTS = 4096
"""Largest number of pixels that are searched for two levels: those with the largest variance in their channel."""

_SUSPECT_P_VALUE = 1e-3
"""Probability that an ordinary pixel's variance makes it a suspect."""

_FEW_BLINKING = 3
"""Blinking pixels that are not chance, so that there are fainter ones."""

_NOISY_PIXEL = 1.3
"""Deviate of the read noise of a noisy but ordinary pixel: one in ten has more."""

TRACES = 4
"""Blinking pixels whose values are kept for the report."""

FloatMap = NDArray[np.float32]
_Place = tuple[NDArray[np.int64], NDArray[np.int64]]


class ClippedChipError(CalibrationError):
    """The dark frames are clipped at 0, so the chip cannot be mapped; the sensor parameters remain valid."""


@dataclass(frozen=True)
class _DarkMaps:
    """Per-pixel results of the dark frames, in DN and seconds.

    `variance` is that of the reference group, `spreads` its distribution in each channel of the `tile`, and
    `coefficients` the weights of the groups' means in `rate`.
    """

    groups: Sequence[GroupStatistics]
    reference: int
    tile: NDArray[np.int64]
    variance: FloatMap
    spreads: Sequence[NoiseSpread]
    rate: FloatMap | None
    coefficients: NDArray[np.float64]

    @property
    def stack(self) -> GroupStatistics:
        return self.groups[self.reference]

    @property
    def freedom(self) -> int:
        return self.stack.frames - 1

    @property
    def exposure_s(self) -> float:
        return self.stack.group.exposure_s

    @property
    def strips(self) -> Iterator[slice]:
        """Rows of the chip that are computed at once."""
        return (slice(*strip) for strip in row_strips(self.variance, self.tile.shape[0]))

    def noisier(self, probability: float) -> tuple[_Place, NDArray[np.float64]]:
        """Return the pixels noisier than an ordinary one is with a given probability, and their relative variance."""
        chosen = np.zeros(self.variance.shape, np.bool_)
        for k, spread in enumerate(self.spreads):
            for part in defects.sites(self.tile, k):
                chosen[part] = self.variance[part] > spread.limit(probability, self.freedom)
        row, col = np.nonzero(chosen)
        channel = self.tile[row % self.tile.shape[0], col % self.tile.shape[1]]
        return (row, col), self.variance[row, col] / np.array([spread.variance for spread in self.spreads])[channel]

    def suspects(self) -> _Place:
        """Return rows and columns of the pixels with the most extreme noise."""
        (row, col), ratio = self.noisier(_SUSPECT_P_VALUE)
        keep = np.sort(np.argsort(-ratio, kind="stable")[:MOST_SUSPECTS])
        return row[keep], col[keep]

    def moderated_variance(self, rows: slice) -> FloatMap:
        """Return each pixel's temporal variance, moderated by those of its channel."""
        variance = self.variance[rows]
        out = np.empty_like(variance)
        for k, spread in enumerate(self.spreads):
            for part in defects.sites(self.tile, k):
                out[part] = moderated(variance[part], self.freedom, spread)
        return out

    def uncertainty(self, weights: NDArray[np.float64], noise: FloatMap, shot: FloatMap | None) -> FloatMap:
        """Return the standard uncertainty of a linear combination of the groups' means, per pixel.

        The noise of a group is that of the reference stack plus the shot noise of the dark current during the
        difference in exposure time. Rounding sets a lower limit.
        """
        fraction = weights**2 / np.array([entry.frames for entry in self.groups])
        variance = noise * np.float32(fraction.sum())
        if shot is not None:
            longer = np.array([entry.group.exposure_s for entry in self.groups]) - self.exposure_s
            variance += shot * np.float32(fraction @ longer)
        np.maximum(variance, np.float32(QUANTIZATION_DN2 * fraction.sum()), out=variance)
        np.sqrt(variance, out=variance)
        return variance

    def with_variance(self, variance: FloatMap) -> _DarkMaps:
        """Return these maps with another temporal variance of each pixel."""
        return replace(self, variance=variance, spreads=_spreads(variance, self.tile, self.stack))

    def maps(self, level: FloatMap, shot: FloatMap | None) -> dict[str, FloatMap]:
        """Return offset, read noise and dark rate.

        `level`, the mean reference dark above black, becomes the offset, and the variance becomes the read noise, which
        saves memory.
        """
        offset_weights = np.zeros(len(self.groups))
        offset_weights[self.reference] = 1.0
        maps = {"offset_dn": level, "offset_uncertainty_dn": np.empty_like(level), "read_noise_dn": self.variance}
        if self.rate is not None:
            offset_weights -= self.exposure_s * self.coefficients
            maps |= {"dark_rate_dn_per_s": self.rate, "dark_rate_uncertainty_dn_per_s": np.empty_like(level)}
        for rows in self.strips:
            noise, shot_rows = self.moderated_variance(rows), None if shot is None else shot[rows]
            maps["offset_uncertainty_dn"][rows] = self.uncertainty(offset_weights, noise, shot_rows)
            if self.rate is not None:
                level[rows] -= np.float32(self.exposure_s) * self.rate[rows]
                uncertainty = self.uncertainty(self.coefficients, noise, shot_rows)
                maps["dark_rate_uncertainty_dn_per_s"][rows] = uncertainty
            read = self.variance[rows]
            read -= np.float32(QUANTIZATION_DN2)
            if shot_rows is not None:
                read -= np.float32(self.exposure_s) * shot_rows
            np.copysign(np.sqrt(np.abs(read)), read, out=read)
        return maps


def measure_chip(
    evidence: Evidence, glow: GlowMap | None, progress: Progress | None = None, *, pixel_gain: bool = False
) -> Evidence:
    """Return the evidence with the maps of the chip, pixel by pixel.

    Reads the dark frames and the flat fields of the linear range again, and the reference dark frames (those of the
    read noise) once more after that. Memory does not grow with the number of frames. `MeasuredChip` describes the maps
    and their uncertainties. Offset and dark rate are intercept and slope of a pixel's dark frames against exposure
    time. The response is the slope of its flat fields minus its dark rate. Weights depend on the level, not on the
    pixel, so that all maps are linear in the frames and unbiased. Uncertainties are those of temporal noise, estimated
    from each pixel's variance and those of its channel (`pixel_noise`).

    Parameters
    ----------
    evidence
        Measured quantities of the frames. The map of the response needs flat fields, that of the dark rate several dark
        exposure times.
    glow
        The glow, which does not make pixels hot.
    progress
        As for `calibrate`.
    pixel_gain
        Whether the gains of the pixels are measured, from the variances of the same flat fields.

    Raises
    ------
    ClippedChipError
        If the dark frames are clipped at 0.
    FileError
        If a frame cannot be read.
    """
    frames = evidence.reduction.as_taken.frames
    lights, darks = light_groups_in_range(frames, evidence.light.channels), frames.of_kind("dark")
    counted = _Counted(progress, later=len(darks[reference_dark(darks)]))
    with FrameReader(replace(frames, groups=(*darks, *lights)), counted) as reader:
        dark, mean = _read_darks(reader)
        gains = _gain_sums(reader, evidence, dark.stack) if pixel_gain else None
        sums = gains if isinstance(gains, GainSums) else None
        dark_variance = pooled_level(dark.stack.levels).variance
        response = read_response_map(reader, evidence, dark_variance, sums) if lights else None
        sigma = float(np.sqrt(np.median([spread.variance for spread in dark.spreads])))
        suspects = dark.suspects()
        reader.release()  # its sums need as much memory as a map
        residuals = read_residuals(_used_again(reader, dark.stack, counted), mean, sigma, suspects)
    dark = dark.with_variance(residuals.variance)
    temporal, series = measure_temporal_noise(dark.stack, residuals, mean, dark.tile), residuals.series
    if sums is not None:
        noise = np.concatenate([dark.moderated_variance(rows) for rows in dark.strips])
        sums.add_dark(mean, dark.variance, noise)
    level = _level(mean)
    del residuals, mean
    chip, temporal = _chip(evidence.parameters, dark, level, response, suspects, series, temporal, glow)
    reader.release()
    rate = chip.dark_rate_dn_per_s
    flat = rate if rate is None or glow is None else glow.without(rate)
    evidence = replace(evidence, chip=chip, temporal=temporal, dark_rate_dn_per_s=flat)
    return replace(evidence, pixel_gains=gains) if not isinstance(gains, GainSums) else _with_gains(evidence, gains)


def _gain_sums(reader: FrameReader, evidence: Evidence, dark: GroupStatistics) -> GainSums | Missing:
    """Return empty sums for the gains of the pixels, or why they cannot be measured."""
    gain, groups = evidence.parameters.system_gain_dn_per_e, evidence.reduction.lights
    lights: list[dict[int, Level]] = []
    for k, channel in enumerate(evidence.light.channels):
        levels = {i: groups[i].levels[k] for i in light_in_range(channel)}
        lights.append({i: level for i, level in levels.items() if level.repeated})
    if gain.value is None:
        return PIXEL_GAINS_MISSING.missing(f"the system gain is missing: {gain.reason}")
    if not (lights and GainSums.usable(dark, lights) and reader.frames.of_kind("light")):
        return PIXEL_GAINS_MISSING.missing("no two light levels of the linear range have several frames each")
    return GainSums((reader.frames.rows, reader.frames.cols), reader.tile, dark, lights)


def _with_gains(evidence: Evidence, sums: GainSums) -> Evidence:
    """Return the evidence, which has a system gain, with the gains of the pixels, or why they are missing."""
    gain = evidence.parameters.system_gain_dn_per_e.value
    assert gain is not None
    assert evidence.chip is not None
    maps = sums.maps(gain)
    if isinstance(maps, Missing):
        return replace(evidence, pixel_gains=maps)
    values, uncertainty, found = maps
    chip = replace(evidence.chip, pixel_gain_dn_per_e=values, pixel_gain_uncertainty_dn_per_e=uncertainty)
    return replace(evidence, chip=chip, pixel_gains=found)


def _level(mean: MeanFrame) -> FloatMap:
    level = np.empty(mean.shape, np.float32)
    for first, last in row_strips(level):
        level[first:last] = mean[first:last]
    return level


def _read_darks(reader: FrameReader) -> tuple[_DarkMaps, MeanFrame]:
    """Return the results of the dark frames, and the mean of the reference group."""
    planned = reader.frames.of_kind("dark")
    coefficients, shape = dark_slope_coefficients(planned), (reader.frames.rows, reader.frames.cols)
    slopes = None if coefficients is None else PixelSlopes(shape, reader.tile)
    wanted = reference_dark(planned)
    groups: list[GroupStatistics] = []
    stack: tuple[MeanFrame, FloatMap] | None = None
    for index, group in enumerate(planned):
        statistics, sums = read_group(reader, group, variance=index == wanted)
        groups.append(statistics)
        clipped = max(level.low_fraction for level in statistics.levels)
        if clipped > CLIPPED_DARK:
            raise ClippedChipError(
                "the percentage of clipped dark values",
                where=statistics.label,
                value=round(100 * clipped, 2),
                expected=f"at most {100 * CLIPPED_DARK:g}",
                hint="Raise the camera's black level, so that dark frames do not clip at 0 DN",
            )
        if index == wanted:
            stack = _mean_and_variance(sums)
        if slopes is not None and coefficients is not None:
            slopes.add(sums.mean_frame(), [float(coefficients[index])] * len(statistics.levels))
        del sums
        if index == wanted:
            reader.release()  # the squares need as much memory as two maps
    reference = reference_dark(groups)
    if stack is None or reference != wanted:
        reader.expect(len(planned[reference]))
        stack = _mean_and_variance(reader.sums(planned[reference], variance=True))
    mean, variance = stack
    chosen = groups[reference]
    spreads = _spreads(variance, reader.tile, chosen)
    rate = None if slopes is None else slopes.slopes.astype(np.float32)
    weights = np.zeros(len(planned)) if coefficients is None else coefficients
    return _DarkMaps(groups, reference, reader.tile, variance, spreads, rate, weights), mean


def _spreads(variance: FloatMap, tile: NDArray[np.int64], stack: GroupStatistics) -> list[NoiseSpread]:
    """Return the distribution of the pixels' temporal variances in each channel."""
    channels = range(len(stack.levels))
    return [noise_spread(defects.channel_values(variance, tile, k), stack.frames - 1) for k in channels]


def _mean_and_variance(sums: FrameSums) -> tuple[MeanFrame, FloatMap]:
    variance = np.empty(sums.shape, np.float32)
    for first, last in row_strips(variance):
        variance[first:last] = sums.variance(rows=slice(first, last))
    return sums.mean_frame(), variance


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
                expected = f"{shape}, as at the first reading"
                raise FileError(source.name, "the frame's shape", value=dn.shape, expected=expected)
            yield dn


def _chip(
    parameters: Parameters,
    dark: _DarkMaps,
    level: FloatMap,
    response: ResponseMap | None,
    suspects: _Place,
    series: NDArray[np.float32],
    temporal: TemporalNoise,
    glow: GlowMap | None,
) -> tuple[MeasuredChip, TemporalNoise]:
    gain, black = parameters.system_gain_dn_per_e.value, parameters.black_level_dn.value
    black = float(level.mean(dtype=np.float64)) if black is None else black
    level -= np.float32(black)
    withheld = parameters.dark_current_dn_per_s.value is None  # the mean rate is wrong by what all pixels share
    shot = None
    if dark.rate is not None and gain is not None:
        from_variance = parameters.dark_current_from_variance_e_per_s.value if withheld else None
        shared = 0.0 if from_variance is None else from_variance * gain - float(dark.rate.mean(dtype=np.float64))
        # Shot noise of the dark current, DN^2 per second; none for a negative rate.
        shot = np.maximum(dark.rate + np.float32(shared), 0.0) * np.float32(gain)
    blinking, distance, traces = _blinking(dark, series, suspects, shot)
    row_noise_dn, column_noise_dn = temporal.row_noise_dn.value or 0.0, temporal.column_noise_dn.value or 0.0
    shared_dn2 = QUANTIZATION_DN2 + signed_square(row_noise_dn) + signed_square(column_noise_dn)
    shared_dn2 += 0.0 if shot is None else dark.exposure_s * float(shot.mean(dtype=np.float64))
    temporal = _with_distribution(replace(temporal, traces=traces), dark, series.shape[1], blinking, shared_dn2)
    unsteady = _unsteady(dark, blinking, distance)
    maps = dark.maps(level, shot)
    del shot
    rate_names = ("dark_rate_dn_per_s", "dark_rate_uncertainty_dn_per_s")
    if response is not None:
        unknown = np.zeros((1, 1), np.float32)
        rate, uncertainty = (maps.get(name, unknown) for name in rate_names)
        maps["prnu"], maps["prnu_uncertainty"] = response.relative(rate, uncertainty, dark.tile)
    short = too_short_for_dark_current(np.array([entry.group.exposure_s for entry in dark.groups])) is not None
    known = {name: values for name, values in maps.items() if name not in rate_names}
    # The response above uses the same times and levels, and stays valid; so do hot pixels, relative to the others.
    found = defects.merged([*_defects(dark, known if short else maps, glow), *unsteady])
    if withheld:
        maps = known
    chip = MeasuredChip(
        **maps,
        read_noise_freedom=dark.freedom,
        row_noise_dn=row_noise_dn,
        column_noise_dn=column_noise_dn,
        black_level_dn=black,
        system_gain_dn_per_e=gain,
        reference_exposure_s=dark.exposure_s,
        defects=found,
        blinking=blinking,
    )
    return chip, temporal


def _with_distribution(
    temporal: TemporalNoise, dark: _DarkMaps, frames: int, blinking: Blinking, shared_dn2: float
) -> TemporalNoise:
    steady = np.ones(dark.variance.shape, np.bool_)
    steady[blinking.row, blinking.col] = False
    spread, steady_dn = read_noise_distribution(dark.variance[steady], dark.freedom, shared_dn2)
    median = float(np.median(dark.variance))
    noise_dn = math.sqrt(median) * math.exp(_NOISY_PIXEL * (spread.value or 0.0))
    _, ratio = dark.noisier(_SUSPECT_P_VALUE)
    least = float(np.sort(ratio)[-MOST_SUSPECTS]) if len(ratio) > MOST_SUSPECTS else 1.0
    used = min(frames, pixel_noise.MOST_FRAMES)
    fraction, amplitude = blinking_distribution(blinking, dark.variance.size, used, noise_dn, least)
    if fraction.value is not None and fraction.interval_95 is not None:
        ordinary = float(steady.mean())
        unfound, most = (
            min(max(total - 1.0 + ordinary, 0.0) / ordinary, 0.5) for total in (fraction.value, fraction.interval_95[1])
        )
        found = read_noise_distribution(dark.variance[steady], dark.freedom, shared_dn2, (unfound, most))
        spread, steady_dn = found
    elif len(blinking) >= _FEW_BLINKING and spread.value is not None:
        why = f"{len(blinking)} pixels blink, and the number of those too faint to be found is unknown"
        spread, steady_dn = (Estimate(reason=why, method=entry.method) for entry in (spread, steady_dn))
    return replace(
        temporal,
        read_noise_log_spread=spread,
        steady_noise_dn=steady_dn,
        blinking_fraction=fraction,
        blinking_amplitude_dn=amplitude,
    )


def _defects(dark: _DarkMaps, maps: dict[str, FloatMap], glow: GlowMap | None) -> Iterator[Defects]:
    """Yield the pixels whose offset, dark current or response is far from that of their channel."""
    far = defects.FAR_SIGMA
    offset = maps["offset_dn"]
    off = defects.deviations(offset, maps["offset_uncertainty_dn"], dark.tile)
    for rows in dark.strips:
        own = off[rows]
        yield defects.listed(DefectKind.OFFSET, np.abs(own) > far, offset[rows], own, rows.start)
    if "dark_rate_dn_per_s" in maps:
        rate = maps["dark_rate_dn_per_s"]
        flat = rate if glow is None else glow.without(rate)
        off = defects.deviations(flat, maps["dark_rate_uncertainty_dn_per_s"], dark.tile)
        for rows in dark.strips:
            own = off[rows]
            yield defects.listed(DefectKind.HOT, own > far, rate[rows], own, rows.start)
        del flat, off
    if "prnu" in maps:
        off = defects.deviations(maps["prnu"], maps["prnu_uncertainty"], dark.tile)
        for rows in dark.strips:
            own, relative = off[rows], 1.0 + maps["prnu"][rows]
            dead = relative < defects.DEAD_RESPONSE
            yield defects.listed(DefectKind.DEAD, dead, relative, own, rows.start)
            odd = (np.abs(own) > far) & ~dead
            yield defects.listed(DefectKind.RESPONSE, odd, relative, own, rows.start)


def _unsteady(dark: _DarkMaps, blinking: Blinking, distance: NDArray[np.float64]) -> tuple[Defects, Defects]:
    """Return blinking and noisy pixels; `distance` is that of the blinking ones' levels in units of their noise."""
    jumping, shape = (blinking.row, blinking.col), dark.variance.shape
    found = defects.of_kind(DefectKind.BLINKING, jumping, blinking.amplitude_dn, distance)
    place, ratio = dark.noisier(defects.NOISY_P_VALUE)
    noisy = defects.of_kind(DefectKind.NOISY, place, np.sqrt(dark.variance[place]), ratio**0.5)
    steady = ~np.isin(np.ravel_multi_index(place, shape), np.ravel_multi_index(jumping, shape))
    return found, noisy.where(steady)


def _blinking(
    dark: _DarkMaps, series: NDArray[np.float32], place: _Place, shot: FloatMap | None
) -> tuple[Blinking, NDArray[np.float64], tuple[Trace, ...]]:
    """Return the blinking suspects, the distance of their levels in units of their noise, and some of their traces."""
    if series.shape[1] < pixel_noise.LEAST_FRAMES or not len(series):
        return no_blinking(), np.zeros(0), ()
    jumps, levels = pixel_noise.find_blinking(series)
    row, col = place[0][jumps], place[1][jumps]
    within = levels.within[jumps] - QUANTIZATION_DN2
    if shot is not None:
        within = within - dark.exposure_s * shot[row, col]
    noise = np.copysign(np.sqrt(np.abs(within)), within)
    distance = levels.distance[jumps]
    clearest = np.flatnonzero(jumps)[np.argsort(-distance, kind="stable")[:TRACES]]
    traces = tuple(
        Trace(int(place[0][i]), int(place[1][i]), series[i], float(levels.lower[i]), float(levels.upper[i]))
        for i in clearest
    )
    amplitude = (levels.upper - levels.lower)[jumps]
    return Blinking(row, col, amplitude, levels.high_fraction[jumps], noise), distance, traces
