"""The page of a closed loop: true and estimated parameters, pictures, comparison, and fits."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.develop.develop import develop_pair
from photosite.report.calibration import FOOTER, provenance_blocks, rejected_blocks, warning_blocks
from photosite.report.figures.sensor import noise_budget_figure
from photosite.report.figures.validation import (
    color_difference_figure,
    deviations_figure,
    patch_means_figure,
    patch_snr_figure,
)
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import (
    Block,
    Column,
    Details,
    Image,
    Images,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    Table,
    figure_block,
    sentence,
)
from photosite.report.pictures import enlarge, jpeg_bytes, magnified, shrink
from photosite.report.plots import curve_blocks
from photosite.report.write import write_report
from photosite.scene.charts import macbeth_regions
from photosite.values.measured import COVERAGE_95

if TYPE_CHECKING:
    from photosite.studies.closed_loop.study import ClosedLoop, ParameterRow

_TRUE, _CALIBRATED = "true sensor", "calibrated sensor"

_MAGNIFICATION = 8.0
"""Factor for differences between pictures and for noise around a mean color."""

_DETAIL = (48, 72)
"""Largest enlarged part of a picture, (rows, cols) in pixels."""

_DETAIL_ENLARGED = 6
_DETAIL_PATCH = "neutral 3.5"


def write_demo_report(result: ClosedLoop, path: str | PathLike[str]) -> None:
    """Write the page of a closed loop as one self-contained HTML file; an existing file is kept if it fails."""
    write_report(demo_page(result), path)


def demo_page(result: ClosedLoop) -> Page:
    """Return the page of a closed loop."""
    sensor, calibration = result.true_sensor, result.calibration
    array, frames = sensor.array, result.protocol.frame_count
    lead = (
        f"A virtual {sensor.name} of {array.rows} × {array.cols} pixels took {frames} dark frames and flat "
        "fields. A calibration estimated the sensor's parameters from these frames alone. The true and the calibrated "
        "sensor then captured a color chart."
    )
    notice = Notice(
        "All images on this page come from a virtual camera. “Measured” refers to frames of the virtual sensor with "
        "the true parameters; “simulated” refers to frames of the calibrated sensor."
    )
    provenance = (*warning_blocks(calibration), *rejected_blocks(calibration), *provenance_blocks(calibration))
    sections = (
        Section("Method", (notice, *_method(result))),
        Section("Parameters", parameter_blocks(result.parameters)),
        Section("Pictures", _picture_blocks(result)),
        Section("Comparison", _comparison_blocks(result)),
        Section("Noise budget", (_budget_block(result),)),
        Section("Fits", curve_blocks(calibration)),
        Section("Provenance", provenance),
    )
    return Page(f"Closed loop with a virtual {sensor.name}", lead, sections, FOOTER)


def _method(result: ClosedLoop) -> tuple[Block, ...]:
    metered = any(row.name == "quantum_efficiency_percent" and row.estimated is not None for row in result.parameters)
    protocol = result.protocol
    light = " and the photons per pixel of each exposure" if metered else ""
    steps = (
        f"The virtual sensor took the frames of a protocol ({protocol.name}): {protocol.frame_count} raw frames.",
        "The calibration read the frames. Known beforehand were the pixel's geometry, the converter, the voltage "
        f"swing, the spectral response{light}; the parameters below were not.",
        f"The true and the calibrated sensor captured the same scene ({result.scene.name}) with the same lens, as two "
        "chips of one design: temporal noise and fixed pattern differ.",
        "Patch means, noise and colors of the two raw frames were compared.",
    )
    columns = (Column("Frames"), Column("Exposure (s)", numeric=True), Column("Count", numeric=True))
    rows = tuple((step.kind, format_number(step.exposure_s, 4), str(step.count)) for step in protocol.steps)
    return (
        Listing(steps),
        Details("The protocol", (Table("Frames in the order in which they were taken", columns, rows),)),
    )


def parameter_blocks(parameters: tuple[ParameterRow, ...]) -> tuple[Block, ...]:
    """Return true and estimated values, the parameters without an estimate, and the deviations."""
    found = [row for row in parameters if row.estimated is not None]
    missing = [row for row in parameters if row.estimated is None]
    numeric = ("True", "Estimated ± standard uncertainty", "(Estimated − true) / uncertainty")
    columns = (Column("Parameter"), Column("Unit"), *(Column(title, numeric=True) for title in numeric))
    blocks: list[Block] = [Table("Truth and estimate", columns, tuple(_parameter_row(row) for row in found))]
    if missing:
        lines = tuple((row.label, row.unit, row.reason or "") for row in missing)
        blocks.append(Table("Not estimated", (Column("Parameter"), Column("Unit"), Column("Why")), lines))
    drawn = [(f"{row.label} ({row.unit})", row.deviation) for row in found if row.deviation is not None]
    if drawn:
        inside = sum(abs(deviation) <= COVERAGE_95 for _, deviation in drawn)
        caption = (
            "Estimate minus truth in standard uncertainties. 95 % of the estimates of a correct calibration lie in the "
            f"band, here {inside} of {len(drawn)}. They are not independent: all come from the same frames, some "
            "quantities appear in several units, and those in electrons and decibels share the error of the system "
            "gain."
        )
        figure = deviations_figure(*zip(*drawn, strict=True))
        blocks.append(figure_block(figure, "Estimate minus truth of each parameter", caption))
    return tuple(blocks)


def _parameter_row(row: ParameterRow) -> tuple[str, ...]:
    estimated = "" if row.estimated is None else format_uncertain(row.estimated, row.standard_uncertainty or 0.0)
    deviation = "" if row.deviation is None else f"{row.deviation:+.2f}".replace("-", "−")
    return row.label, row.unit, format_number(row.true, 5), estimated, deviation


def _picture_blocks(result: ClosedLoop) -> tuple[Block, ...]:
    colors = result.validation.color
    both = develop_pair(result.true_raw, result.calibrated_raw, None if colors is None else colors.matrix)
    small, small_calibrated = (shrink(picture) for picture in both)
    detail = _detail(result.true_raw.shape)
    level = both[0][detail].mean(axis=(0, 1))
    noise = (enlarge(magnified(picture[detail], level, _MAGNIFICATION), _DETAIL_ENLARGED) for picture in both)
    difference = jpeg_bytes(magnified(small_calibrated, small, _MAGNIFICATION))
    return (
        _pair(
            (small, small_calibrated),
            "the chart",
            "The chart captured by each sensor, developed in the same way: bilinear demosaic, one color matrix and "
            "one exposure for both.",
        ),
        _pair(
            noise,
            "noise in the chart",
            f"Center of the patch “{_DETAIL_PATCH}”, pixel by pixel: deviations from its mean color, magnified "
            f"{_MAGNIFICATION:g} times. The noise differs; its size and grain should not.",
        ),
        Images(
            (Image(difference, "image/jpeg", "Difference of the two pictures: noise around middle gray"),),
            f"Calibrated minus true, magnified {_MAGNIFICATION:g} times around middle gray. The noise and fixed "
            "pattern of two chips remain, strongest in dark patches, where the display curve is steep. A patch with a "
            "visible color would indicate a wrong parameter.",
        ),
    )


def _detail(shape: tuple[int, int]) -> tuple[slice, slice]:
    region = next(region for region in macbeth_regions(*shape) if region.name == _DETAIL_PATCH)
    rows, cols = (min(most, size) for most, size in zip(_DETAIL, region.shape, strict=True))
    r0, c0 = (region.r0 + region.r1 - rows) // 2, (region.c0 + region.c1 - cols) // 2
    return slice(r0, r0 + rows), slice(c0, c0 + cols)


def _comparison_blocks(result: ClosedLoop) -> tuple[Block, ...]:
    validation = result.validation
    blocks: list[Block] = [
        Paragraph("Result: the two cameras " + ("agree." if validation.agrees else "differ.")),
        Listing(tuple(sentence(line) for line in (*validation.reasons, *validation.notes))),
        figure_block(
            patch_means_figure(validation, _TRUE, _CALIBRATED),
            "Patch means of the true sensor against those of the calibrated sensor",
            "Patch means of each channel on the raw mosaic. Below, the difference relative to the calibrated sensor; "
            "bars are 95 % intervals.",
        ),
        figure_block(
            patch_snr_figure(validation, _TRUE, _CALIBRATED),
            "Patch signal-to-noise ratios of the true sensor against those of the calibrated sensor",
            "Signal-to-noise ratio over the pixels of each patch. Below, the difference; bars are 95 % intervals.",
        ),
    ]
    if validation.color is not None:
        caption = (
            "Color difference between the patch means of the true and the calibrated sensor, through one color "
            "matrix. A difference of about 1 is just visible between adjacent surfaces."
        )
        figure = color_difference_figure(validation.color)
        blocks.append(figure_block(figure, "Color difference of each patch", caption))
    return tuple(blocks)


def _budget_block(result: ClosedLoop) -> Images:
    caption = (
        "Signal-to-noise ratio of one frame of a uniform surface against the signal, in total and for each noise "
        "source alone: lines for the true sensor, rings for the calibrated sensor (Farrell, Okincha and Parmar 2008, "
        "Figure 6)."
    )
    figure = noise_budget_figure(result.true_sensor, result.calibration.sensor)
    return figure_block(figure, "Signal-to-noise ratio against signal, true and calibrated", caption)


def _pair(pictures: Iterable[NDArray[np.float32]], what: str, caption: str) -> Images:
    images = (
        Image(jpeg_bytes(picture), "image/jpeg", f"{what.capitalize()} by the {title}", title.capitalize())
        for picture, title in zip(pictures, (_TRUE, _CALIBRATED), strict=True)
    )
    return Images(tuple(images), caption)
