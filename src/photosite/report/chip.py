"""The chip in a calibration's report: noise in the dark, nonuniformity, and defects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps.defect_groups import SHAPES, DefectGroup, group_defects, shapes_text
from photosite.calibration.chip_maps.noise_shape import NORMAL_SHAPE
from photosite.calibration.chip_maps.pixel_gain import PixelGains
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.result import Calibration
from photosite.calibration.spatial.spatial_analysis import FramePattern, SpatialAnalysis
from photosite.report.effects.pixel_defects import DEFECT_LABELS
from photosite.report.figures.chip import histogram_figure, noise_histogram_figure, profiles_figure, spectrogram_figure
from photosite.report.numbers import format_number, format_time, format_uncertain
from photosite.report.page import (
    Block,
    Details,
    Images,
    Paragraph,
    Subheading,
    Table,
    columns,
    figure_block,
    first_reason,
    missing_channel_blocks,
    numeric,
    reason_block,
)
from photosite.report.tables import format_estimate, interval_text
from photosite.values.uncertain import Missing

_LISTED = 200  # largest number of pixels in a list
_NO_MAPS = "the chip was not mapped; calibrate with maps (--maps)"

_NOISE = {
    "pixel_noise_dn": ("Pixel noise", "DN"),
    "row_noise_dn": ("Row noise", "DN"),
    "column_noise_dn": ("Column noise", "DN"),
    "frame_noise_dn": ("Frame noise (shifts of whole frames)", "DN"),
}

_DISTRIBUTION = {
    "read_noise_log_spread": ("Spread of the read noise over the pixels, standard deviation of its logarithm", "1"),
    "steady_noise_dn": ("Read noise of the pixels that do not blink, root mean square", "DN"),
    "blinking_fraction": ("Fraction of the pixels that blink (telegraph noise), small amplitudes included", "1"),
    "blinking_amplitude_dn": ("Mean distance of their levels", "DN"),
}

_TAIL = {
    "excess_kurtosis": ("Excess kurtosis of the values (normal: 0)", "1"),
    "within_pixels": ("– due to non-normal noise of single pixels", "1"),
    "between_pixels": ("– due to different noise of the pixels", "1"),
    "tukey_lambda": (f"Tukey lambda shape (normal: {NORMAL_SHAPE:.4f})", "1"),
}


_FRAMES = {"dark": "the mean dark frame", "light": "the mean flat field near half saturation, minus dark"}


def temporal_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return temporal noise in the dark by pixel, row, column and frame, its distribution, and periodic bands."""
    noise = calibration.temporal
    if noise is None:
        why = calibration.no_maps_reason
        return (reason_block(_NO_MAPS if why is None else f"the chip was not mapped: {why}"),)
    entries = {_NOISE[name]: getattr(noise, name) for name in _NOISE}
    entries |= {_DISTRIBUTION[name]: getattr(noise, name) for name in _DISTRIBUTION}
    if isinstance(gains := calibration.pixel_gains, PixelGains):
        entries["Spread of the gains of the pixels", "%"] = gains.spread_percent
    entries |= {_TAIL[entry.name]: getattr(noise.shape, entry.name) for entry in fields(noise.shape)}
    rows = tuple(
        (label, format_estimate(entry), unit, interval_text(entry)) for (label, unit), entry in entries.items()
    )
    stack = f"{noise.frames} dark frames of {format_time(noise.exposure_s)}"
    return (
        Table(f"Temporal noise in {stack}", columns("Quantity", numeric("Value"), "Unit", "95 % interval"), rows),
        figure_block(
            noise_histogram_figure(noise),
            "Logarithmic histogram of the deviations from the pixels' means, with the normal distribution",
            "Deviations of the dark values from their pixels' means, without shifts of frames, rows and columns. "
            "Error bars are one standard deviation of a count. Points above the normal distribution show heavy "
            "tails. A Tukey lambda distribution is drawn if its shape differs significantly from normal; with a "
            "shape above 0 it has a largest deviation.",
        ),
        _bands(noise),
    )


def _bands(noise: TemporalNoise) -> Block:
    rows = tuple(
        (
            name,
            format_number(1.0 / band.cycles_per_pixel, 4),
            format_uncertain(band.amplitude_dn, band.standard_uncertainty_dn),
            format_number(band.false_alarm_probability, 2),
        )
        for name, bands in noise.bands.items()
        for band in bands
    )
    if not rows:
        return Paragraph("No periodic bands were found in rows or columns, neither fixed nor temporal.")
    numbers = map(numeric, ("Period (pixels)", "Amplitude (DN)", "False-alarm probability"))
    return Table("Periodic bands, ± standard uncertainty; rows are horizontal bands", columns("Kind", *numbers), rows)


def nonuniformity_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return spectrograms, profiles and histograms of the mean frames, in the dark and in the light.

    References
    ----------
    EMVA 1288 R4.0 Linear, 8.6 to 8.8.
    """
    found = _analyses(calibration)
    if not found:
        return (_not_analyzed(calibration),)
    light = {channel: analysis.light for channel, analysis in found.items()}
    blocks: list[Block] = [Subheading("Spectrograms"), *_by_frame_kind(found, _spectrogram)]
    if not _patterns(found, "light"):
        reasons = [entry.reason for entry in light.values() if isinstance(entry, Missing)]
        blocks.append(reason_block(f"the pattern in the light; {reasons[0] if reasons else 'no channel has one'}"))
    blocks += [*missing_channel_blocks(light, "pattern in the light"), Subheading("Profiles")]
    for channel, analysis in found.items():
        of_channel = f", channel {channel}" if len(found) > 1 else ""
        blocks.append(
            figure_block(
                profiles_figure(analysis),
                f"Horizontal and vertical profiles of the mean frames{of_channel}",
                f"Profiles of the mean frames{of_channel}. Left: mean, extremes and middle row along the columns. "
                "Right: the same along the rows. Uneven light bends the profiles; a defective line gives a spike.",
            )
        )
    return (*blocks, Subheading("Histograms"), *_by_frame_kind(found, _histogram))


def _analyses(calibration: Calibration) -> dict[str, SpatialAnalysis]:
    return {channel: found for channel, found in calibration.spatial.items() if isinstance(found, SpatialAnalysis)}


def _not_analyzed(calibration: Calibration) -> Paragraph:
    return first_reason(calibration.spatial, "the patterns of these frames were not analyzed")


def _patterns(found: Mapping[str, SpatialAnalysis], kind: str) -> dict[str, FramePattern]:
    """Return the pattern of one kind of frame, by channel."""
    patterns = {channel: getattr(analysis, kind) for channel, analysis in found.items()}
    return {channel: pattern for channel, pattern in patterns.items() if isinstance(pattern, FramePattern)}


def _by_frame_kind(
    found: Mapping[str, SpatialAnalysis], draw: Callable[[str, Mapping[str, FramePattern]], Images]
) -> list[Images]:
    """Draw the patterns of dark frames and of flat fields, of which there are any."""
    return [draw(frame, patterns) for kind, frame in _FRAMES.items() if (patterns := _patterns(found, kind))]


def _spectrogram(frame: str, patterns: Mapping[str, FramePattern]) -> Images:
    return figure_block(
        spectrogram_figure(patterns),
        f"Horizontal and vertical spectrogram of {frame}",
        f"Spectrograms of {frame}. A regular pattern gives a peak at its frequency, uneven light a rise at "
        "the left, and independent pixels a flat spectrum. The excess over the remaining temporal noise is due to "
        "the sensor.",
    )


def _histogram(frame: str, patterns: Mapping[str, FramePattern]) -> Images:
    return figure_block(
        histogram_figure(patterns),
        f"Logarithmic and accumulated histogram of {frame}",
        f"Histograms of {frame}. Left: pixels by deviation from the mean. Right: percentage of pixels with at "
        "least that deviation. Dashed: the normal distribution of the same standard deviation.",
    )


def defect_lists(calibration: Calibration) -> tuple[Block, ...]:
    """Return the defects of the chip by kind, as columns, rows, clusters and single pixels."""
    if (chip := calibration.chip) is None:
        return ()
    lists = []
    for kind, (label, unit) in DEFECT_LABELS.items():
        found = chip.defects.of(kind)
        if len(found):
            groups = group_defects(found.row, found.col, chip.shape)
            quantities = f"Value ({unit})", "Deviation (standard deviations)"
            lists.append(_group_list(label, groups, found.deviation, found.value, *quantities))
    return tuple(lists)


def outlier_pixel_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the outlier pixels of the histograms, candidates for a defect list, with the rule that found them."""
    found = _analyses(calibration)
    if not found:
        return (_not_analyzed(calibration),)
    patterns = [(channel, pattern) for kind in _FRAMES for channel, pattern in _patterns(found, kind).items()]
    titles = columns("Frame", "Channel", numeric("Pixels"), numeric("Listed beyond"), "Unit", "Rule")
    rows = tuple(
        (p.kind, channel, str(len(p.outliers.row)), format_number(p.outliers.threshold, 4), p.unit, p.outliers.rule)
        for channel, p in patterns
    )
    return (
        Paragraph(
            "Pixels that deviate from the mean of their map by more than a threshold. They are candidates for a defect "
            "list; the application decides what counts as a defect."
        ),
        Table("Candidates for a defect list", titles, rows),
        *(_outlier_list(channel, pattern, calibration) for channel, pattern in patterns if len(pattern.outliers.row)),
    )


def _outlier_list(channel: str, pattern: FramePattern, calibration: Calibration) -> Details:
    found = pattern.outliers
    size, reach = (calibration.rows, calibration.cols), max(len(calibration.cfa), len(calibration.cfa[0]))
    where = f", channel {channel}" if channel != "M" else ""
    groups = group_defects(found.row, found.col, size, reach)
    title = f"Outlier pixels of {_FRAMES[pattern.kind]}{where}"
    return _group_list(title, groups, found.deviation, None, f"Deviation ({pattern.unit})")


def _group_list(
    title: str,
    groups: Sequence[DefectGroup],
    deviation: NDArray[np.float64],
    value: NDArray[np.float64] | None,
    *quantities: str,
) -> Details:
    """Return columns, rows, clusters and single pixels as a table, with the numbers of the farthest pixel of each."""
    farthest = [int(group.index[np.argmax(np.abs(deviation[group.index]))]) for group in groups]
    order = sorted(
        range(len(groups)), key=lambda n: (SHAPES.index(groups[n].shape), -len(groups[n]), -abs(deviation[farthest[n]]))
    )
    rows = []
    for n in order[:_LISTED]:
        numbers = [] if value is None else [format_number(float(value[farthest[n]]), 4)]
        numbers.append(format_number(float(deviation[farthest[n]]), 3))
        rows.append((groups[n].shape, groups[n].place, str(len(groups[n])), *numbers))
    caption = "Rows and columns counted from 0; the last columns are those of the farthest pixel"
    if len(order) > _LISTED:
        caption += f"; the first {_LISTED} of {len(order)} entries"
    titles = columns("Shape", "Place", *map(numeric, ("Pixels", *quantities)))
    return Details(f"{title}: {shapes_text(groups)}", (Table(caption, titles, tuple(rows)),))
