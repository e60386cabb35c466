"""Section 2 on the page: Table 1 with its estimates, and what eight frames determine."""

from __future__ import annotations

from photosite.report.figures.validation import deviations_figure
from photosite.report.numbers import format_interval, format_number, format_time, format_uncertain
from photosite.report.page import Block, Column, Details, Listing, Paragraph, Subheading, Table
from photosite.studies.farrell2008.eight_frames import EightFrames
from photosite.studies.farrell2008.page.drawing import Drawing, Part
from photosite.studies.farrell2008.table1 import CameraTable, Table1, Table1Row
from photosite.values.estimate import Estimate
from photosite.values.measured import COVERAGE_95

_DIFFERENCES = (
    "The paper gives the number of frames and the ends of each range of exposure times. Equal ratios between them, "
    "with 10, 5 or 2 frames each, are an assumption.",
    "The virtual D200 has a black level of 32 DN. The raw files of a real one are clipped at black, which removes half "
    "of their dark noise.",
    "The virtual sensors have the noise of Table 1 and no other. Row, column and frame noise, temperature drift and "
    "defects would increase the uncertainties of a real measurement.",
    "The paper gives no uncertainties to compare with.",
)
"""Differences between this measurement and that of the paper."""


def table1_part(result: Table1) -> Part:
    """Return the tables of both cameras, the deviations from the truth, and the section on eight dark frames."""
    return (
        Paragraph(
            "The paper measured two sensors: a Nikon D200, and a 2.2 µm sensor of a vendor, some of whose values are "
            "confidential. Here virtual sensors with the values of Table 1 took as many frames as in the paper. A "
            "calibration estimated the table from the frames, their exposure times, the voltage swing, and bit depth "
            "and gain of the converter. That it recovers the values shows that such frames suffice, and how precisely "
            "they determine each parameter; it is not a test of the real sensors."
        ),
        Listing(_DIFFERENCES),
        *(block for table in result.cameras.values() for block in _camera_blocks(table)),
        _deviations(result),
        *_eight_blocks(result.eight),
    )


def _camera_blocks(table: CameraTable) -> tuple[Block, ...]:
    rows, cols = table.size
    share = rows * cols / (table.whole[0] * table.whole[1])
    pixels = f"{table.protocol.frame_count} frames of {rows} × {cols} pixels, all pixels of the sensor."
    if share < 1:
        pixels = (
            f"{table.protocol.frame_count} frames of {rows} × {cols} pixels, {100 * share:.3g} % of the sensor, so "
            "that the study takes minutes. The uncertainties of noise and nonuniformity fall with the square root of "
            f"the number of pixels: the whole sensor would give {share**-0.5:.2g} times smaller ones."
        )
    columns = (
        Column("Parameter"),
        Column("Unit"),
        Column("Paper", numeric=True),
        Column("Virtual sensor", numeric=True),
        Column("Estimated", numeric=True),
        Column("95 % interval", numeric=True),
        Column("Difference"),
    )
    steps = tuple((step.kind, format_time(step.exposure_s), str(step.count)) for step in table.protocol.steps)
    return (
        Subheading(table.case.title),
        Paragraph(pixels),
        Table(f"Table 1, {table.case.title}", columns, tuple(_line(row) for row in table.rows)),
        Details(
            "Frames",
            (
                Table(
                    "In this order; exposure times between the ends of each range are an assumption",
                    (Column("Frames"), Column("Exposure", numeric=True), Column("Count", numeric=True)),
                    steps,
                ),
            ),
        ),
    )


def _line(row: Table1Row) -> tuple[str, ...]:
    paper = "confidential" if row.paper is None else _plain(row.paper)
    return (
        row.label,
        row.unit,
        paper,
        _plain(row.true),
        _estimated(row.estimate),
        _interval(row.estimate),
        row.words,
    )


def _plain(value: float) -> str:
    """Format an exact value without trailing zeros."""
    return format_uncertain(float(f"{value:.5g}"), 0.0)


def _estimated(estimate: Estimate) -> str:
    if estimate.value is None:
        return "–"
    return format_uncertain(estimate.value, estimate.standard_uncertainty or 0.0)


def _interval(estimate: Estimate) -> str:
    if estimate.interval_95 is None:
        return "–"
    return format_interval(*estimate.interval_95, estimate.standard_uncertainty or 0.0)


def _deviations(result: Table1) -> Drawing:
    labels, away = [], []
    for table in result.cameras.values():
        for row in table.rows:
            value, uncertainty = row.estimate.value, row.estimate.standard_uncertainty
            if value is not None and uncertainty:
                labels.append(f"{table.case.title}: {row.label} ({row.unit})")
                away.append((value - row.true) / uncertainty)
    inside = sum(abs(entry) <= COVERAGE_95 for entry in away)
    return Drawing.of(
        "table1-deviations",
        deviations_figure(labels, away),
        "Estimate minus true value of each parameter of Table 1, in standard uncertainties",
        "Estimates of Table 1 minus the values of the virtual sensors, in standard uncertainties. 95 % of the "
        f"estimates of a correct calibration lie in the band, here {inside} of {len(away)}. Conversion gain, system "
        "gain and saturation capacity follow from one gain, so that their errors are correlated.",
    )


def _eight_blocks(eight: EightFrames) -> tuple[Block, ...]:
    def row(what: str, unit: str, measured: float, expected: float, digits: int) -> tuple[str, ...]:
        return what, unit, format_number(measured, digits), format_number(expected, digits)

    dsnu = format_uncertain(eight.dsnu_mv, eight.dsnu_uncertainty_mv)
    offset = eight.pixel_offset_error_mv, eight.pixel_offset_expected_mv
    scatter = eight.pixel_variance_scatter, eight.pixel_variance_scatter_expected
    rows = (
        row("Standard deviation of the mean frame", "mV", eight.naive_dsnu_mv, eight.naive_expected_mv, 5),
        ("DSNU, estimated; true value of this chip", "mV", dsnu, format_number(eight.chip_spread_mv, 5)),
        row("RMS error of a pixel’s offset", "mV", *offset, 4),
        row(
            "Correlation of the mean frame with the true offsets",
            "",
            eight.map_correlation,
            eight.map_correlation_expected,
            4,
        ),
        row("Standard deviation of the pixel variances over their mean", "", *scatter, 3),
    )
    numeric = (Column("Measured", numeric=True), Column("Expected", numeric=True))
    return (
        Subheading(f"What {eight.frames} dark frames determine"),
        Paragraph(
            f"The vendor sensor has a DSNU of 6 mV and a read noise of 4.58 mV, and the paper measured both from "
            f"{eight.frames} dark frames at {1e3 * eight.exposure_s:g} ms. They determine:"
        ),
        Listing(eight.can),
        Paragraph("They do not determine:"),
        Listing(eight.cannot),
        Table(
            f"{eight.frames} dark frames: measured and expected", (Column("Quantity"), Column("Unit"), *numeric), rows
        ),
    )
