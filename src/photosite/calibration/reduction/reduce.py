"""Stage "reduce": a frame set becomes statistics per group and channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.codes import (
    Steps,
    Sums,
    find_steps,
    find_sums,
    find_white_level,
    fraction_above,
)
from photosite.calibration.reduction.dark_exposures import WRONG_DARK_EXPOSURE, find_wrong_exposure
from photosite.calibration.reduction.defective_pixels import DefectivePixels, PixelSurvey, classified
from photosite.calibration.reduction.foreign_frames import FOREIGN_FRAMES, GroupSample, find_foreign_groups
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.frame_screening import LEAST_PIXELS, sample_grid
from photosite.calibration.reduction.groups import CLIPPED_FRACTION, GroupStatistics, Level, reference_dark
from photosite.calibration.reduction.provenance import UsedFrame
from photosite.calibration.reduction.turned_frames import TURNED_FRAME
from photosite.calibration.spatial.pixel_slopes import PixelSlopes, slope_coefficients
from photosite.engine.frame_sums import FrameSums, LabelTotals, MeanFrame
from photosite.errors import CalibrationError
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.frames.repaired_frames import PixelReplacement
from photosite.values.cfa import channel_names
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

UNSATURATED = 0.7
"""Level, as a fraction of that of the largest variance, up to which all pixels have the noise of the mean."""


class TakenFrames(NamedTuple):
    """The frames of a set, and those that were used."""

    frames: FrameSet
    used: tuple[UsedFrame, ...]


@dataclass(frozen=True)
class Reduction:
    """A frame set reduced to statistics."""

    frames: FrameSet
    darks: tuple[GroupStatistics, ...]
    lights: tuple[GroupStatistics, ...]
    reference: int | None  # index of the dark group for read noise and DSNU (`reference_dark`); None without one
    reference_mean: MeanFrame | None
    dark_slopes: PixelSlopes | None  # map of per-pixel dark slopes, DN/s; None with one dark exposure
    whites: tuple[int, ...]  # number at which each channel's flats are clipped
    steps: tuple[Steps | None, ...]  # of the converter's codes in each channel; None where they are 1 DN
    sums: tuple[Sums | None, ...]  # whether each channel's numbers are sums of several codes
    bits_used: int  # bits that occur in the sampled numbers
    rejected: tuple[Diagnostic, ...]  # frames left out
    used: tuple[UsedFrame, ...]
    # Pixels that `frames` and `used` are without, and both as they were taken; None without such pixels
    defects: DefectivePixels | None = None
    taken: TakenFrames | None = None

    @property
    def as_taken(self) -> TakenFrames:
        """The frames with all pixels."""
        return self.taken or TakenFrames(self.frames, self.used)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return channel_names(self.frames.cfa)

    @property
    def reference_group(self) -> GroupStatistics | None:
        """The dark group for read noise and DSNU; None without dark frames."""
        return None if self.reference is None else self.darks[self.reference]

    @property
    def first_group(self) -> GroupStatistics:
        """The reference group, or the dimmest flat fields without dark frames."""
        return self.reference_group or min(self.lights, key=lambda entry: entry.levels[0].mean)

    def channel_label(self, name: str, text: str = ", channel {}") -> str:
        """Return the channel's name in a text, "" for a monochrome chip."""
        return text.format(name) if len(self.names) > 1 else ""

    def error(
        self,
        kind: DiagnosticKind,
        what: str,
        hint: str | None = None,
        group: GroupStatistics | None = None,
        channel: str = "",
        arguments: Mapping[str, Any] = MappingProxyType({}),
    ) -> CalibrationError:
        """Return an error of a kind about these frames, or about one of the groups and a channel of it."""
        where = self.frames.source
        if group is not None:
            where += f": {group.label}" + (self.channel_label(channel) if channel else "")
        return kind.error(what, where=where, hint=hint, arguments=arguments)


SEVERAL_CHIPS = DiagnosticKind(
    "several-chips",
    "refused",
    "The groups have different fixed patterns, and none has the majority.",
    "There is no result: the frames are those of several chips.",
    "Calibrate the frames of each chip separately.",
    ("*",),
)


def reduce_frames(reader: FrameReader, survey: PixelSurvey | None = None) -> Reduction:
    """Read every frame once and return the statistics of each group, without the defective pixels that `survey` finds.

    Mean frames of light groups that may be needed again are kept within `KEPT_BYTES`. A few groups of another chip, and
    dark frames whose exposure time is wrong, are left out, and the remaining frames are read again.

    Raises
    ------
    CalibrationError
        If the groups belong to several chips, and none has the majority.
    """
    reduction, samples = _reduce(reader, survey)
    if foreign := _foreign_groups(reader, reduction, samples):
        reader.leave_out_groups([(group, *_reason_left_out(reader, group, foreign)) for group in foreign])
        reduction, _ = _reduce(reader, survey)
    # The codes, which widen the uncertainties, are those of the pixels that are left.
    if find_wrong_exposure(reduction.darks) is not None and (
        (wrong := find_wrong_exposure(_with_codes(reader, reduction).darks)) is not None
    ):
        reader.leave_out_groups([(reduction.darks[wrong.group].group, WRONG_DARK_EXPOSURE, str(wrong))])
        reduction, _ = _reduce(reader, survey)
    if survey is not None and (defective := _find_defective_pixels(reader, reduction, survey)) is not None:
        reduction = _without_pixels(reader, reduction, survey, defective)
    return _with_codes(reader, reduction)


def _find_defective_pixels(reader: FrameReader, reduction: Reduction, survey: PixelSurvey) -> NDArray[np.int64] | None:
    """Return the few pixels that must not decide a figure, as numbers in the order of the rows; None without such.

    Dark frames whose pixels differ in noise are read again for the variance of each pixel, and so are flat fields whose
    pixels differ by more than uneven light makes them, until one shows no more pixels.
    """
    replacement = survey.replacement(survey.found())
    for index, entry in enumerate(reduction.darks):
        reference = index == reduction.reference
        if survey.noise_differs(entry, reference=reference) and survey.noise_differs(
            _with_replaced(reader, entry, survey, replacement), reference=reference
        ):
            reader.expect(entry.frames)
            survey.add_noise(reader.variances(entry.group), entry.frames)
    noisy = survey.noisy_flats(reduction.lights)
    if noisy:
        replacement = survey.replacement(survey.found())
        noisy = survey.noisy_flats([_with_replaced(reader, entry, survey, replacement) for entry in noisy])
    for entry in noisy:
        reader.expect(entry.frames)
        if not survey.add_noise(reader.variances(entry.group), entry.frames):
            break  # a pixel may be still in all frames of one group
    reader.release()
    return survey.found()


def _without_pixels(reader: FrameReader, before: Reduction, survey: PixelSurvey, index: NDArray[np.int64]) -> Reduction:
    """Return a reduction after its defective pixels are replaced in all frames, and in those that are read later.

    `index` are numbers in the order of the rows, and `survey` has the totals of the groups. The sums are exact; of the
    frames, only the numbers of these pixels and of those that replace them are read.
    """
    replacement = survey.replacement(index)
    own, other = replacement.bad, replacement.sources
    taken = TakenFrames(before.frames, before.used)
    entries = [_with_replaced(reader, entry, survey, replacement) for entry in (*before.darks, *before.lights)]
    reader.replace_pixels(replacement)
    listed = (*reader.frames.of_kind("dark"), *reader.frames.of_kind("light"))
    groups = [replace(entry, group=group) for entry, group in zip(entries, listed, strict=True)]
    if before.dark_slopes is not None:
        before.dark_slopes.slopes[own] = before.dark_slopes.slopes[other]
    if before.reference_mean is not None:
        before.reference_mean.sum[own] = before.reference_mean.sum[other]
    numbers = [reader.replaced[id(group)].own for group in listed]
    return replace(
        before,
        frames=reader.frames,
        darks=tuple(groups[: len(before.darks)]),
        lights=tuple(groups[len(before.darks) :]),
        used=tuple(reader.used_frames),
        defects=classified(index, (reader.frames.rows, reader.frames.cols), reader.tile, groups, numbers),
        taken=taken,
    )


def _with_replaced(
    reader: FrameReader, entry: GroupStatistics, survey: PixelSurvey, replacement: PixelReplacement
) -> GroupStatistics:
    """Return the statistics of a group after the numbers of some pixels are replaced."""
    if not len(replacement.bad_row):
        return entry
    exact, numbers = survey.totals[id(entry.group)], reader.replaced_numbers(entry.group, replacement)
    row, col = replacement.bad
    labels = reader.tile[row % reader.tile.shape[0], col % reader.tile.shape[1]]
    levels, of_frames = [], np.zeros(len(exact.frames), object)
    for k, totals in enumerate(exact.labels):
        chosen = np.flatnonzero(labels == k)
        found, frames = totals.with_replaced(exact.frames[:, k].tolist(), chosen, *numbers, 0, reader.white)
        levels.append(Level.of(found))
        of_frames += np.array(frames, object)
    pixels = sum(totals.pixels for totals in exact.labels)
    return GroupStatistics(entry.group, tuple(levels), frame_means=tuple(float(total / pixels) for total in of_frames))


def _foreign_groups(
    reader: FrameReader, reduction: Reduction, samples: Mapping[int, NDArray[np.float64]]
) -> list[FrameGroup]:
    shape = reader.frames.rows, reader.frames.cols
    rows, cols = sample_grid(shape, 1)
    labels = reader.tile[rows % reader.tile.shape[0], cols % reader.tile.shape[1]]
    if labels.size < LEAST_PIXELS:
        return []
    darks, lights = (
        [GroupSample(entry, samples[id(entry.group)]) for entry in entries]
        for entries in (reduction.darks, reduction.lights)
    )
    foreign: list[FrameGroup] = []
    for entries, found in zip(
        (darks, lights), find_foreign_groups(darks, lights, reduction.reference, labels), strict=True
    ):
        others = [entries[i].statistics for i in found]
        if others and 2 * len(others) >= len(entries):
            raise reduction.error(
                SEVERAL_CHIPS,
                f"the fixed pattern of the {', '.join(entry.label for entry in others)} is not that of the other "
                f"{others[0].group.kind} frames, and neither has the majority: the frames are those of several chips",
                "Calibrate the frames of each chip separately",
            )
        foreign += [entry.group for entry in others]
    return foreign


def _reason_left_out(
    reader: FrameReader, group: FrameGroup, foreign: Sequence[FrameGroup]
) -> tuple[DiagnosticKind, str]:
    """Return why a group with another fixed pattern is left out: it may be mirrored or rotated."""
    usual = [other for other in reader.frames.of_kind(group.kind) if not any(other is each for each in foreign)]
    nearest = min(usual, key=lambda other: abs(other.exposure_s - group.exposure_s))
    how = reader.how_turned(reader.used_sources(group), reader.used_sources(nearest))
    if how is not None:
        return TURNED_FRAME, f"its group is {how} relative to the other {group.kind} frames"
    return FOREIGN_FRAMES, "its fixed pattern is not that of the other groups: another chip, or another readout"


def _reduce(reader: FrameReader, survey: PixelSurvey | None) -> tuple[Reduction, dict[int, NDArray[np.float64]]]:
    """Return the reduction, and a sample of the mean frame of each group by the `id` of the group."""
    shape = reader.frames.rows, reader.frames.cols
    rows, cols = sample_grid(shape, 1)
    samples: dict[int, NDArray[np.float64]] = {}
    if survey is not None:
        survey.clear()

    def read(group: FrameGroup) -> tuple[GroupStatistics, FrameSums]:
        sums = reader.sums(group)
        totals = sums.label_totals()
        statistics = _statistics(group, sums, totals)
        samples[id(group)] = sums.sum[rows, cols] / sums.count
        if survey is not None and survey.add(statistics, sums, totals):
            reader.watch(survey.replacement(survey.suspects()))
        return statistics, sums

    planned = reader.frames.of_kind("dark")
    coefficients = dark_slope_coefficients(planned)
    slopes = None if coefficients is None else PixelSlopes(shape, reader.tile)
    wanted = reference_dark(planned) if planned else None
    darks: list[GroupStatistics] = []
    mean: MeanFrame | None = None
    for index, group in enumerate(planned):
        statistics, sums = read(group)
        darks.append(statistics)
        group_mean = sums.mean_frame()
        if index == wanted:
            mean = group_mean
        if slopes is not None and coefficients is not None:
            slopes.add(group_mean, [float(coefficients[index])] * len(statistics.levels))
    reference = reference_dark(darks) if darks else None
    if reference is not None and reference != wanted:  # frames of the planned reference group were rejected
        reader.expect(len(planned[reference]))
        mean = reader.mean(planned[reference])
    lights = []
    for group in reader.frames.of_kind("light"):
        statistics, sums = read(group)
        lights.append(statistics)
        if not all(level.clipped for level in statistics.levels):
            reader.keep(group, sums)
    reader.release()
    reduction = Reduction(
        frames=reader.frames,
        darks=tuple(darks),
        lights=tuple(lights),
        reference=reference,
        reference_mean=mean,
        dark_slopes=slopes,
        whites=(),
        steps=(),
        sums=(),
        bits_used=0,
        rejected=tuple(reader.rejected),
        used=tuple(reader.used_frames),
    )
    return reduction, samples


def _with_codes(reader: FrameReader, before: Reduction) -> Reduction:
    """Return the reduction with the white level, steps and sums of each channel, and groups with their rounding."""
    counts = [reader.counts[id(entry.group)] for entry in before.lights]
    whites = tuple(find_white_level(counts, k, reader.white) for k in range(len(before.names)))
    groups = list(before.darks)
    for entry, found in zip(before.lights, counts, strict=True):
        # The fraction of samples at the white levels, where these are below full scale.
        levels = tuple(
            replace(level, high_fraction=fraction_above(found, k, white - 1)) if white < reader.white else level
            for k, (level, white) in enumerate(zip(entry.levels, whites, strict=True))
        )
        groups.append(replace(entry, levels=levels))
    steps = tuple(_steps(reader, groups, k, white) for k, white in enumerate(whites))
    sums = tuple(
        find_sums(white, 1.0 if found is None else found.step, reader.frames.bits)
        for white, found in zip(whites, steps, strict=True)
    )
    stepped = tuple(_with_steps(entry, i, steps, sums) for i, entry in enumerate(groups))
    return replace(
        before,
        darks=stepped[: len(before.darks)],
        lights=stepped[len(before.darks) :],
        whites=whites,
        steps=steps,
        sums=sums,
        bits_used=int(np.bitwise_or.reduce(np.concatenate([found[:, 1] for found in reader.counts.values()]))),
    )


def _steps(reader: FrameReader, groups: Sequence[GroupStatistics], channel: int, white: int) -> Steps | None:
    counts = [reader.counts[id(entry.group)] for entry in groups]
    levels = [entry.levels[channel] for entry in groups]
    peak = max(levels, key=lambda level: -math.inf if math.isnan(level.variance) else level.variance)
    # Near saturation, pixels at the limit of their wells have less noise than the level's mean.
    noise = [math.sqrt(level.variance) if level.mean <= UNSATURATED * peak.mean else math.nan for level in levels]
    return find_steps(counts, noise, channel, len(groups[0].levels), (0, white))


def _with_steps(
    entry: GroupStatistics, index: int, steps: Sequence[Steps | None], sums: Sequence[Sums | None]
) -> GroupStatistics:
    """Return a group with the quantization noise of its steps, and of the codes that make one number."""
    levels = list(entry.levels)
    for k, found in enumerate(steps):
        if found is None or levels[k].high_fraction > CLIPPED_FRACTION:
            continue
        level = replace(levels[k], step=found.by_group[index], quantization=found.quantization(index)).with_rounding()
        if not found.uniform:
            # Decoded numbers are rounded each by itself, which displaces them by sqrt(1/12) DN, and so bends the
            # response over the few numbers within a standard deviation.
            displaced = math.sqrt(level.variance / 12.0)
            level = replace(level, rounding_variance=math.hypot(level.rounding_variance, displaced))
        levels[k] = level
    for k, summed in enumerate(sums):
        if summed is not None and levels[k].high_fraction <= CLIPPED_FRACTION:
            levels[k] = replace(levels[k], quantization=summed.number * levels[k].quantization)
    return replace(entry, levels=tuple(levels))


def dark_slope_coefficients(darks: Sequence[FrameGroup]) -> NDArray[np.float64] | None:
    """Return the (groups,) weights of mean dark frames in the map of dark slopes, 1/s; None with one exposure.

    Groups count by their number of frames, because the weights must be known before the first frame is read. The dark
    variance grows little with exposure, so better weights would gain little precision.
    """
    exposure = np.array([group.exposure_s for group in darks])
    if len(np.unique(exposure)) < 2:
        return None
    return slope_coefficients(exposure, np.array([float(len(group)) for group in darks]))


def read_group(reader: FrameReader, group: FrameGroup, *, variance: bool = False) -> tuple[GroupStatistics, FrameSums]:
    """Return a group's statistics, and its sums as `FrameReader.sums` does, valid until the next group is read."""
    sums = reader.sums(group, variance=variance)
    return _statistics(group, sums, sums.label_totals()), sums


def _statistics(group: FrameGroup, sums: FrameSums, totals: Sequence[LabelTotals]) -> GroupStatistics:
    means = tuple(total / sums.sum.size for total in sums.frame_totals())
    return GroupStatistics(group, tuple(Level.of(each) for each in totals), frame_means=means)
