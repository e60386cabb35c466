"""Section 2 on the page: Table 1 beside its estimates, and what eight frames can say."""

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
    "The paper gives the number of frames and the ends of each range of exposures. That the exposures between them lie "
    "in equal ratios, 10, 5 or 2 frames each, is an assumption.",
    "The virtual D200 has a black level of 32 DN. The raw files of a real one are clipped at black, and half of their "
    "dark noise is lost.",
    "The virtual sensors have the noise of Table 1 and no other. Noise shared by rows and columns, frames and "
    "temperatures that drift, and defects would widen the uncertainties of a real measurement.",
    "The paper gives no uncertainties, so that there are none of its own to compare with.",
)
"""Where this measurement differs from the paper's."""


def table1_part(result: Table1) -> Part:
    """Both cameras' tables, how far the estimates are from the truth, and what 8 darks can and cannot say."""
    return (
        Paragraph(
            "The paper measured two sensors: a Nikon D200, and a 2.2 µm sensor of a vendor whose name and some of its "
            "figures it keeps confidential. Here virtual sensors with the values of Table 1 shot as many frames as the "
            "paper did. A calibration that was told nothing but the frames’ exposures, the voltage swing and the "
            "converter’s bits and gain estimated the table. That it finds the paper’s values again is no news of the "
            "paper’s sensors: it shows that frames like these suffice, and how well they tell each figure."
        ),
        Listing(_DIFFERENCES),
        *(block for table in result.cameras.values() for block in _camera_blocks(table)),
        _deviations(result),
        *_eight_blocks(result.eight),
    )


def _camera_blocks(table: CameraTable) -> tuple[Block, ...]:
    rows, cols = table.size
    share = rows * cols / (table.whole[0] * table.whole[1])
    pixels = f"{table.protocol.frame_count} frames of {rows} × {cols} pixels, all of the sensor’s."
    if share < 1:
        pixels = (
            f"{table.protocol.frame_count} frames of {rows} × {cols} pixels, {100 * share:.3g} % of the sensor’s, so "
            "that the study takes minutes. Uncertainties of spreads and mean noise shrink with the root of the number "
            f"of pixels: all of them would tell each {share**-0.5:.2g} times as well."
        )
    columns = (
        Column("Parameter"),
        Column("Unit"),
        Column("Paper", numeric=True),
        Column("Virtual sensor", numeric=True),
        Column("Estimated", numeric=True),
        Column("95 % interval", numeric=True),
        Column("The difference"),
    )
    steps = tuple((step.kind, format_time(step.exposure_s), str(step.count)) for step in table.protocol.steps)
    return (
        Subheading(table.case.title),
        Paragraph(pixels),
        Table(f"Table 1, {table.case.title}", columns, tuple(_line(row) for row in table.rows)),
        Details(
            "What was shot",
            (
                Table(
                    "In this order; the exposures between the ends of each range are an assumption",
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
    """An exact value, without zeros at its end."""
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
        "Distance of each estimate of Table 1 from the virtual sensor’s value, in standard uncertainties",
        "Estimates of Table 1 less what the virtual sensors have, in standard uncertainties. In the band lie 95 % of "
        f"an honest calibration’s estimates, here {inside} of {len(away)}. Those of conversion gain, system "
        "gain and saturation capacity follow from one gain, and err together.",
    )


def _eight_blocks(eight: EightFrames) -> tuple[Block, ...]:
    return (
        Subheading(f"What {eight.frames} frames can and cannot say"),
        Paragraph(
            f"The vendor’s sensor has a DSNU of 6 mV beside a read noise of 4.58 mV, and the paper measured both from "
            f"{eight.frames} dark frames at {1e3 * eight.exposure_s:g} ms. They can say:"
        ),
        Listing(eight.can),
        Paragraph("They cannot say:"),
        Listing(eight.cannot),
        Table(
            f"{eight.frames} dark frames: as computed from them, and as expected",
            (
                Column("Quantity"),
                Column("Unit"),
                Column("From the frames", numeric=True),
                Column("Expected", numeric=True),
            ),
            (
                (
                    "Spread of the mean frame",
                    "mV",
                    format_number(eight.naive_dsnu_mv, 5),
                    format_number(eight.naive_expected_mv, 5),
                ),
                (
                    "DSNU, estimated; of this very chip",
                    "mV",
                    format_uncertain(eight.dsnu_mv, eight.dsnu_uncertainty_mv),
                    format_number(eight.chip_spread_mv, 5),
                ),
                (
                    "Error of one pixel’s offset, RMS",
                    "mV",
                    format_number(eight.pixel_offset_error_mv, 4),
                    format_number(eight.pixel_offset_expected_mv, 4),
                ),
                (
                    "Correlation of the mean frame with the chip’s offsets",
                    "",
                    format_number(eight.map_correlation, 4),
                    format_number(eight.map_correlation_expected, 4),
                ),
                (
                    "Spread of the pixels’ variances over their mean",
                    "",
                    format_number(eight.pixel_variance_scatter, 3),
                    format_number(eight.pixel_variance_scatter_expected, 3),
                ),
            ),
        ),
    )
