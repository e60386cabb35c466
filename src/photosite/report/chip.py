"""The chip in a calibration's report: temporal noise in the dark, and defects."""

from __future__ import annotations

from dataclasses import fields

from photosite.calibration.chip_maps.noise_shape import NORMAL_SHAPE
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.calibration.result import Calibration
from photosite.report.figures.chip import defect_map_figure, noise_histogram_figure, telegraph_figure
from photosite.report.numbers import format_number, format_time, format_uncertain
from photosite.report.page import Block, Column, Details, Paragraph, Table, figure_block, reason_block
from photosite.report.tables import format_estimate, interval_text
from photosite.sensor.measured_chip import DefectKind, Defects
from photosite.values.estimate import Estimate

_LISTED = 200
"""Largest number of pixels in a list."""

_TRACES = 4
"""Number of blinking pixels shown frame by frame."""

_NO_MAPS = "the chip was not mapped; calibrate with maps (--maps)"

_NOISE = {
    "pixel_noise_dn": ("Pixel noise", "DN"),
    "row_noise_dn": ("Row noise", "DN"),
    "column_noise_dn": ("Column noise", "DN"),
    "frame_noise_dn": ("Frame noise (shifts of whole frames)", "DN"),
}

_TAIL = {
    "excess_kurtosis": ("Excess kurtosis of the values (normal: 0)", "1"),
    "within_pixels": ("– due to non-normal noise of single pixels", "1"),
    "between_pixels": ("– due to different noise of the pixels", "1"),
    "tukey_lambda": (f"Tukey lambda shape (normal: {NORMAL_SHAPE:.4f})", "1"),
}

_DEFECTS = {
    DefectKind.HOT: ("Hot: dark current far above the channel's", "DN/s"),
    DefectKind.OFFSET: ("Offset: dark level far from the channel's", "DN"),
    DefectKind.DEAD: ("Dead: response below half of the channel's", "relative response"),
    DefectKind.RESPONSE: ("Response: far from the channel's", "relative response"),
    DefectKind.BLINKING: ("Blinking: jumps between two levels", "DN between levels"),
    DefectKind.NOISY: ("Noisy: noise far above the channel's", "DN"),
}


def temporal_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return temporal noise in the dark by pixel, row, column and frame, its distribution, and periodic bands."""
    noise = calibration.temporal
    if noise is None:
        why = calibration.no_maps_reason
        return (reason_block(_NO_MAPS if why is None else f"the chip was not mapped: {why}"),)
    parts = {_NOISE[name]: getattr(noise, name) for name in _NOISE}
    tail = {_TAIL[entry.name]: getattr(noise.shape, entry.name) for entry in fields(noise.shape)}
    columns = (Column("Quantity"), Column("Value", numeric=True), Column("Unit"), Column("95 % interval"))
    rows = tuple(_row(label, unit, entry) for (label, unit), entry in (parts | tail).items())
    stack = f"{noise.frames} dark frames of {format_time(noise.exposure_s)}"
    return (
        Table(f"Temporal noise in {stack}", columns, rows),
        figure_block(
            noise_histogram_figure(noise),
            "Logarithmic histogram of the deviations from the pixels' means, with the normal distribution",
            "Deviations of the dark values from their pixels' means, without shifts of frames, rows and columns. "
            "Error bars are one standard deviation of a count. Points above the normal distribution show heavy "
            "tails. A Tukey lambda distribution is drawn if its shape differs significantly from normal; with a "
            "shape above 0 it has a largest deviation.",
        ),
        *_bands(noise),
    )


def _row(label: str, unit: str, entry: Estimate) -> tuple[str, ...]:
    return label, format_estimate(entry), unit, interval_text(entry)


def _bands(noise: TemporalNoise) -> tuple[Block, ...]:
    found = [(name, band) for name, bands in noise.bands.items() for band in bands]
    if not found:
        return (Paragraph("No periodic bands were found in rows or columns, neither fixed nor temporal."),)
    columns = (
        Column("Kind"),
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
    return (Table("Periodic bands, ± standard uncertainty; rows are horizontal bands", columns, rows),)


def defect_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the defects of the chip, if it was mapped: counts by kind, a map, and lists."""
    if (chip := calibration.chip) is None:
        return ()
    defects = chip.defects
    columns = (Column("Kind"), Column("Pixels", numeric=True), Column("Percentage (%)", numeric=True))
    pixels = chip.offset_dn.size
    rows = tuple(
        (_DEFECTS[kind][0], str(count), format_number(100.0 * count / pixels, 3))
        for kind in DefectKind
        for count in [len(defects.of(kind))]
    )
    blocks: list[Block] = [Table("Defective pixels by kind; a pixel may have several kinds", columns, rows)]
    if not len(defects):
        return (*blocks, Paragraph("No pixel is defective."))
    blocks.append(
        figure_block(
            defect_map_figure(defects, chip.offset_dn.shape),
            "Map of the chip with a marker for each defective pixel, by kind",
            "Positions of the defective pixels, row 0 at the top. Markers are much larger than pixels.",
        )
    )
    if calibration.temporal is not None and calibration.temporal.traces:
        blocks.append(
            figure_block(
                telegraph_figure(calibration.temporal.traces[:_TRACES]),
                "Values of blinking pixels frame by frame, with their two levels and histograms",
                "Blinking pixels (random telegraph noise): values frame by frame, and their histograms. Dashed: the "
                "two levels.",
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
    some = f"the first {_LISTED} of {len(defects)}" if len(defects) > _LISTED else str(len(defects))
    return Details(f"{label}: {some}", (Table("Positions counted from 0, sorted by deviation", columns, rows),))
