"""The chip itself in a calibration's report: how its readings scatter in the dark, and which pixels are defective."""

from __future__ import annotations

from dataclasses import fields

from photosite.calibration.chip_maps.noise_shape import NORMAL_SHAPE
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.result import Calibration
from photosite.report.blocks import figure_block, reason_block
from photosite.report.figures.defect_map import defect_map_figure
from photosite.report.figures.noise_histogram import noise_histogram_figure
from photosite.report.figures.telegraph import telegraph_figure
from photosite.report.html import Block, Column, Details, Paragraph, Table
from photosite.report.numbers import format_number, format_time, format_uncertain
from photosite.report.tables import format_estimate, interval_text
from photosite.sensor.measured_chip import DefectKind, Defects
from photosite.values.estimate import Estimate

_LISTED = 200
"""Pixels of a list at most: the farthest off."""

_TRACES = 4
"""Blinking pixels that are shown frame by frame."""

_NO_MAPS = "the chip was not measured pixel by pixel; calibrate with maps (--maps)"

_NOISE = {
    "pixel_noise_dn": ("Noise of a pixel by itself", "DN"),
    "row_noise_dn": ("Shared by a row", "DN"),
    "column_noise_dn": ("Shared by a column", "DN"),
    "frame_noise_dn": ("Shared by a whole frame", "DN"),
}

_TAIL = {
    "excess_kurtosis": ("Excess kurtosis of the readings (normal: 0)", "1"),
    "within_pixels": ("of it, noise of a pixel not normal", "1"),
    "between_pixels": ("of it, pixels of different noise", "1"),
    "tukey_lambda": (f"Tukey lambda shape (normal: {NORMAL_SHAPE:.4f})", "1"),
}

_DEFECTS = {
    DefectKind.HOT: ("Hot: dark current far above that of its channel", "DN/s"),
    DefectKind.OFFSET: ("Offset: dark level far off that of its channel", "DN"),
    DefectKind.DEAD: ("Dead: less than half of its channel's response", "relative response"),
    DefectKind.RESPONSE: ("Response to light far off that of its channel", "relative response"),
    DefectKind.BLINKING: ("Blinking between two levels", "DN between them"),
    DefectKind.NOISY: ("Noise far above that of its channel", "DN"),
}


def temporal_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Temporal noise of the dark by what shares it, its tail, and bands that come and go."""
    noise = calibration.temporal
    if noise is None:
        why = calibration.no_maps_reason
        return (reason_block(_NO_MAPS if why is None else f"the chip was not measured pixel by pixel: {why}"),)
    parts = {_NOISE[name]: getattr(noise, name) for name in _NOISE}
    tail = {_TAIL[entry.name]: getattr(noise.shape, entry.name) for entry in fields(noise.shape)}
    columns = (Column("What"), Column("Value", numeric=True), Column("Unit"), Column("95 % interval"))
    rows = tuple(_row(label, unit, entry) for (label, unit), entry in (parts | tail).items())
    stack = f"{noise.frames} dark frames of {format_time(noise.exposure_s)}"
    return (
        Table(f"Scatter of readings from frame to frame, in {stack}", columns, rows),
        figure_block(
            noise_histogram_figure(noise),
            "Histogram of the readings about their pixels' means, logarithmic, with the normal distribution",
            "Readings of the dark about their pixels' means, shifts of frames, rows and columns taken off. Bars are "
            "one standard deviation of a count. Where the points leave the normal distribution, large deviations are "
            "more frequent than a single standard deviation tells. A Tukey lambda distribution is drawn where its "
            "shape can be told from the normal one's; of a shape above 0 it has an end, beyond which it says nothing.",
        ),
        *_bands(noise),
    )


def _row(label: str, unit: str, entry: Estimate) -> tuple[str, ...]:
    return label, format_estimate(entry), unit, interval_text(entry)


def _bands(noise: TemporalNoise) -> tuple[Block, ...]:
    found = [(name, band) for name, bands in noise.bands.items() for band in bands]
    if not found:
        return (Paragraph("No regular bands were found in rows or columns, neither fixed nor from frame to frame."),)
    columns = (
        Column("Where"),
        Column("Period (pixels)", numeric=True),
        Column("Amplitude (DN)", numeric=True),
        Column("False-alarm probability", numeric=True),
    )
    rows = tuple(
        (
            name,
            format_number(1.0 / band.cycles_per_pixel, 4),
            format_uncertain(band.amplitude_dn, band.standard_uncertainty_dn),
            format_number(band.false_alarm_probability, 2),
        )
        for name, band in found
    )
    return (Table("Regular bands, ± one standard uncertainty; rows are horizontal bands", columns, rows),)


def defect_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """The defects of the chip, if it was measured: how many of each kind, where, and the farthest of each by name."""
    if (chip := calibration.chip) is None:
        return ()
    defects = chip.defects
    columns = (Column("Kind"), Column("Pixels", numeric=True), Column("Share (%)", numeric=True))
    pixels = chip.offset_dn.size
    rows = tuple(
        (_DEFECTS[kind][0], str(count), format_number(100.0 * count / pixels, 3))
        for kind in DefectKind
        for count in [len(defects.of(kind))]
    )
    blocks: list[Block] = [Table("Defective pixels by kind; a pixel may be of several", columns, rows)]
    if not len(defects):
        return (*blocks, Paragraph("No pixel is defective by these rules."))
    blocks.append(
        figure_block(
            defect_map_figure(defects, chip.offset_dn.shape),
            "Map of the chip with a mark for each defective pixel, by kind",
            "Where the defective pixels are, row 0 on top. Marks are much larger than pixels.",
        )
    )
    if calibration.temporal is not None and calibration.temporal.traces:
        blocks.append(
            figure_block(
                telegraph_figure(calibration.temporal.traces[:_TRACES]),
                "Readings of blinking pixels frame by frame, with their two levels and histograms",
                "Blinking pixels (random telegraph noise): their readings frame by frame, and how often each is read. "
                "Dashed, the two levels.",
            )
        )
    blocks += [_list(defects.of(kind), kind) for kind in DefectKind if len(defects.of(kind))]
    return tuple(blocks)


def _list(defects: Defects, kind: DefectKind) -> Details:
    label, unit = _DEFECTS[kind]
    order = abs(defects.deviation).argsort(kind="stable")[::-1][:_LISTED]
    columns = (
        Column("Row", numeric=True),
        Column("Column", numeric=True),
        Column(f"Value ({unit})", numeric=True),
        Column("Deviation (standard deviations)", numeric=True),
    )
    rows = tuple(
        (
            str(defects.row[i]),
            str(defects.col[i]),
            format_number(float(defects.value[i]), 4),
            format_number(float(defects.deviation[i]), 3),
        )
        for i in order
    )
    some = f"the {_LISTED} farthest of {len(defects)}" if len(defects) > _LISTED else str(len(defects))
    return Details(f"{label}: {some}", (Table("Places counted from 0, the farthest off first", columns, rows),))
