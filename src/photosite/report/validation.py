"""The report of a validation: raw frames of a chart against their simulation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import ImageDraw

from photosite.report.figures.validation import color_difference_figure, patch_means_figure, patch_snr_figure
from photosite.report.numbers import format_number, format_uncertain
from photosite.report.page import (
    WIDEST,
    Block,
    Details,
    Heading,
    Image,
    Images,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    Table,
    columns,
    figure_block,
    jpeg_bytes,
    numeric,
    sentence,
    shrink,
)
from photosite.validation.agreement import ChiSquare
from photosite.validation.fill_factor import ChannelFillFactor, FillFactorFit
from photosite.validation.frame_validation import FrameValidation
from photosite.validation.regression import Coefficient, Regression
from photosite.values.cfa import tile_text
from photosite.values.exposure import format_exposure

_FOOTER = (
    "Intervals contain the true value in 95 % of comparisons. A p-value is the probability that two identical cameras "
    "differ at least this much."
)

_Picture = NDArray[np.float32]


def validation_page(result: FrameValidation) -> Page:
    """Return the report of a validation as a page."""
    frames, simulated = result.frames
    lead = (
        f"{_counted(frames).capitalize()} of a ColorChecker against {_counted(simulated)} that the simulator made from "
        f"the sensor file “{result.conditions.sensor.name}”: compared on the raw mosaic, before any processing."
    )
    sections = (
        Section("Verdict", _verdict_blocks(result)),
        Section("Conditions of the simulation", _conditions_blocks(result)),
        Section("Pictures", _picture_blocks(result)),
        Section("Patches", _patch_blocks(result)),
        Section("Colors", _color_blocks(result)),
        Section("Numbers", _number_blocks(result)),
    )
    return Page("Measured against simulated", lead, sections, _FOOTER)


def _counted(frames: int) -> str:
    return "one raw frame" if frames == 1 else f"{frames} raw frames"


def _verdict_blocks(result: FrameValidation) -> tuple[Block, ...]:
    found = result.validation
    allowed = f" with a tolerance of {found.tolerance_percent:g} %" if found.tolerance_percent else ""
    verdict = (
        f"Measured and simulated {'agree' if result.agrees else 'do not agree'}{allowed}. If the description of the "
        f"camera is exact, at most {100 * found.level:g} % of comparisons end in “do not agree”."
    )
    named = [("Patch means", found.means), ("Spatial noise", found.noise)]
    if found.temporal_noise is not None:
        named.append(("Temporal noise", found.temporal_noise))
    level = found.level / len(named)
    titles = columns("Test", numeric("Chi-square"), numeric("Degrees of freedom"), numeric("p-value"), "Result")
    rows = tuple(_test_row(name, test, level) for name, test in named)
    caption = f"Tests; “differ” means p below {level:.3g}"
    blocks: list[Block] = [Notice(verdict, warning=not result.agrees), Table(caption, titles, rows)]
    if result.fit_summary is not None:
        blocks.append(Paragraph(sentence(result.fit_summary)))
    if not result.agrees or found.tolerance_percent:  # otherwise they repeat the table
        blocks.append(Listing(tuple(sentence(line) for line in result.reasons)))
    notes = (*result.notes, *found.notes)
    if notes:
        blocks.append(Details("Assumptions and omissions", (Listing(tuple(sentence(line) for line in notes)),)))
    return tuple(blocks)


def _test_row(name: str, test: ChiSquare, level: float) -> tuple[str, ...]:
    p_value = test.p_text.removeprefix("p ").removeprefix("= ")
    result = "agree" if test.p_value >= level else "differ"
    return name, f"{test.statistic:.1f}", str(test.degrees_of_freedom), p_value, result


def _conditions_blocks(result: FrameValidation) -> tuple[Block, ...]:
    conditions, frame = result.conditions, result.measured
    rows: list[tuple[str, str]] = [
        ("Sensor file", f"{conditions.sensor.name}, color filter array {tile_text(conditions.sensor.array.cfa)}"),
        ("Frames", f"{frame.shape[0]} × {frame.shape[1]} pixels, {frame.bits} bits, black {frame.black_level_dn:g} DN"),
        ("Illuminant", conditions.lamp.name),
    ]
    if conditions.luminance_cd_m2 is not None:
        fitted = " (fitted)" if result.fitted == "light" else ""
        rows.append(("Mean luminance of the patches", f"{conditions.luminance_cd_m2:.4g} cd/m²{fitted}"))
    if conditions.exposure_s is not None:
        stated = "" if frame.exposure_s is None else f"; {format_exposure(frame.exposure_s)} s in the frames"
        rows.append(("Exposure time", f"{format_exposure(conditions.exposure_s)} s{stated}"))
    if conditions.lens_text is not None:
        rows.append(("Lens", conditions.lens_text))
    fill_factor = f"{conditions.sensor.pixel.fill_factor.value:.4g}"
    if result.fit is not None and result.fitted == "fill_factor":
        fill_factor = f"{result.fit.value:.4g} (fitted)"
    rows += [
        ("Fill factor", fill_factor),
        ("Distance to the chart", f"{conditions.distance_m:g} m"),
        ("Corners of the patch area", "; ".join(f"row {r:.0f}, column {c:.0f}" for r, c in result.corners)),
    ]
    limits = Paragraph(
        "The simulated chart is flat, matte and evenly lit, on black, with the ColorChecker's published reflectances. "
        "The tests treat these values as exact."
    )
    return Table("Camera, scene and light", columns("Property", "Value"), tuple(rows)), limits


def _picture_blocks(result: FrameValidation) -> tuple[Block, ...]:
    measured, simulated, origin = result.pictures()
    factor = -(-measured.shape[1] // WIDEST)
    outlined = _outlined(shrink(measured), result, origin, factor)
    caption = (
        "The chart, developed with bilinear demosaicing and the same color matrix and exposure for both. The outlines "
        "in the measured picture mark the compared regions; check that they lie within the patches."
    )
    images = (
        Image(jpeg_bytes(outlined), "image/jpeg", "Measured chart with the outlines of its patches", "Measured"),
        Image(jpeg_bytes(shrink(simulated)), "image/jpeg", "Simulated chart", "Simulated"),
    )
    return (Images(images, caption),)


def _outlined(picture: _Picture, result: FrameValidation, origin: tuple[int, int], factor: int) -> _Picture:
    """Return the picture with the outlines of the patches, white on black."""
    whole = Pillow.fromarray(np.rint(np.clip(picture, 0.0, 1.0) * 255.0).astype(np.uint8))
    draw = ImageDraw.Draw(whole)
    for patch in result.patches:
        points = [((col - origin[1]) / factor, (row - origin[0]) / factor) for row, col in patch.corners]
        for width, color in ((3, "black"), (1, "white")):
            draw.line([*points, points[0]], fill=color, width=width)
    return np.asarray(whole, dtype=np.float32) / np.float32(255.0)


def _patch_blocks(result: FrameValidation) -> tuple[Block, ...]:
    found = result.validation
    return (
        figure_block(
            patch_means_figure(found),
            "Patch means, measured against simulated, and their relative differences",
            "Patch means of each channel on the raw mosaic, with the line of equality. Below: relative difference from "
            "the simulation. Error bars are 95 % intervals.",
        ),
        figure_block(
            patch_snr_figure(found),
            "Patch signal-to-noise ratios, measured against simulated, and their differences",
            "Signal-to-noise ratio over the pixels of each patch, including the fixed pattern. Below: the difference. "
            "Error bars are 95 % intervals. Uneven light within a patch counts as noise.",
        ),
    )


def _color_blocks(result: FrameValidation) -> tuple[Block, ...]:
    colors = result.validation.color
    if colors is None:
        return ()
    caption = (
        "Color difference between measured and simulated patch means, with a color matrix fitted to the simulated "
        "patches under D65. The smallest visible difference between adjacent surfaces is about 1."
    )
    summary = (
        f"CIEDE2000: median {np.median(colors.delta_e_2000):.2f}, largest {colors.delta_e_2000.max():.2f} "
        f"({colors.names[int(colors.delta_e_2000.argmax())]})."
    )
    figure = figure_block(color_difference_figure(colors), "Color difference of each patch", caption)
    return (Paragraph(summary), figure)


def _number_blocks(result: FrameValidation) -> tuple[Block, ...]:
    found = result.validation
    lines = [("all", found.regression), *found.regression_by_channel.items()]
    titles = columns("Channel", *map(numeric, ("Points", "Ratio", "Slope", "Intercept (DN)")))
    rows = tuple(_line_row(name, line) for name, line in lines if line is not None)
    caption = (
        "Regression of measured on simulated means. Ratio: slope of a line through the origin. Slope and intercept: "
        "free line. In brackets: 95 % intervals from the scatter of the patches"
    )
    fit = () if result.fit is None else (_fit_table(result.fit),)
    return Table(caption, titles, rows), *fit, Details("Every patch and channel", (_patch_table(result),))


def _fit_table(fit: FillFactorFit) -> Table:
    """Return the fitted fill factor, from all channels and from each channel."""
    fits: dict[str, FillFactorFit | ChannelFillFactor] = {"all": fit, **fit.by_channel}
    rows = tuple((name, format_uncertain(found.value, found.standard_error)) for name, found in fits.items())
    caption = (
        "The fit as a fill factor, which absorbs every common scale of the patches, such as the light level. Channels "
        "that differ by more than their errors indicate other differences. Scatter of the patches beyond noise: "
        f"{100 * fit.patch_scatter:.2g} %"
    )
    return Table(caption, columns("Channels", numeric("Fill factor ± standard error")), rows)


def _line_row(name: str, line: Regression) -> tuple[str, ...]:
    slopes = (_interval(line.slope_through_origin, 4), _interval(line.slope, 4))
    return name, str(line.points), *slopes, _interval(line.intercept, 2)


def _interval(found: Coefficient, digits: int) -> str:
    value, low, high = (f"{x:.{digits}f}".replace("-", "−") for x in (found.value, found.lower_95, found.upper_95))
    return f"{value} ({low} to {high})"


def _patch_table(result: FrameValidation) -> Table:
    found = result.validation
    seen, made = found.measured, found.simulated
    sides: list[tuple[str, NDArray[np.float64], NDArray[np.float64]]] = [
        ("mean (DN)", seen.mean_dn, made.mean_dn),
        ("SNR (dB)", seen.spatial_snr_db, made.spatial_snr_db),
    ]
    if seen.temporal_snr_db is not None and made.temporal_snr_db is not None:
        sides.append(("temporal SNR (dB)", seen.temporal_snr_db, made.temporal_snr_db))
    pairs = (numeric(f"{what}, {side}") for what, _, _ in sides for side in ("measured", "simulated"))
    titles = columns("Channel", *pairs, numeric("Difference of means (%)"), "Used")
    rows: list[tuple[str, ...] | Heading] = []
    difference = found.relative_difference
    for patch, name in enumerate(seen.names):
        rows.append(Heading(name))
        for k, channel in enumerate(seen.channels):
            percent = difference[patch, k]
            rows.append(
                (
                    channel,
                    *(_shown(side[patch, k]) for _, one, other in sides for side in (one, other)),
                    "" if percent is np.ma.masked else f"{100 * percent:+.2f}".replace("-", "−"),
                    "yes" if found.used[patch, k] else "no, saturated",
                )
            )
    return Table("Patch means and signal-to-noise ratios, on the raw mosaic", titles, tuple(rows))


def _shown(value: float) -> str:
    return format_number(float(value), 4) if math.isfinite(value) else "none"
