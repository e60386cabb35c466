"""The report of a calibration: EMVA 1288 data sheet, tables and plots, Table 1 of the 2008 paper, provenance."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.calibration.photon_transfer.linearity import Linearity
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.calibration.result import Calibration
from photosite.calibration.withheld import NO_FLAT_FIELDS
from photosite.errors import FileError
from photosite.files.writing import is_temporary
from photosite.report.chip import defect_lists, nonuniformity_blocks, outlier_pixel_blocks, temporal_blocks
from photosite.report.data_sheet import data_sheet_blocks
from photosite.report.diagnostics import explanations, notices
from photosite.report.effect import effect_figures
from photosite.report.figures.response import (
    Residuals,
    curve_figure,
    general_model_figure,
    linearity_figure,
    snr_figure,
)
from photosite.report.page import (
    Block,
    Details,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    Subheading,
    Table,
    Terms,
    columns,
    figure_block,
    first_reason,
    missing_channel_blocks,
    reason_block,
)
from photosite.report.paper import paper_blocks
from photosite.report.tables import channel_table, correlation_table, linear_range_table, parameter_tables
from photosite.values.uncertain import Missing

FOOTER = (
    "Values are estimate ± standard uncertainty (GUM). The 95 % intervals follow the distribution of each estimate and "
    "may be asymmetric."
)

_SHOWN_WARNINGS = 12

_DIGESTS = "SHA-256 of a frame's digital numbers as little-endian 16-bit integers, row by row."

_CURVES: dict[str, tuple[Residuals, str]] = {
    "response": (
        "percent",
        "Response: signal against light, with the line fitted to the linear range. Below: deviation from the line. "
        "Error bars are 95 % intervals from sampling; the band is that of the line.",
    ),
    "photon_transfer": (
        "standard",
        "Photon transfer: temporal variance against signal, both minus the dark value where it is known. The slope of "
        "the line is the system gain K. Below: residuals in standard uncertainties; 95 % should lie between the dotted "
        "lines. The band is that of the line.",
    ),
    "dark_signal": (
        "standard",
        "Dark signal: mean of the dark frames against exposure time. The slope of the line is the dark current. Below: "
        "residuals in standard uncertainties.",
    ),
    "dark_variance": (
        "standard",
        "Dark noise: temporal variance of the dark frames against exposure time; without dark current it is constant. "
        "Below: residuals in standard uncertainties.",
    ),
}


def calibration_page(calibration: Calibration) -> Page:
    """Return the report of a calibration as a page."""
    name = "an image sensor" if calibration.base is None else calibration.base.name
    correlations = correlation_table(calibration)
    channels: tuple[Block, ...] = (channel_table(calibration.channels),) if calibration.channels else ()
    problems = *rejected_blocks(calibration), *warning_blocks(calibration), *explanations(calibration.diagnostics)
    sections = (
        Section("Data sheet", data_sheet_blocks(calibration)),
        Section("Warnings and rejected frames", problems),
        *plot_sections(calibration),
        Section("2008 paper", paper_blocks(calibration)),
        Section("All parameters", (*parameter_tables(calibration), *([correlations] if correlations else []))),
        Section("Channels", channels),
        Section("Provenance", provenance_blocks(calibration)),
        Section(READING_TITLE, (*(Paragraph(text) for text in _READING), Subheading("Glossary"), Terms(_TERMS))),
    )
    lead = (
        f"Parameters of the sensor, estimated from {calibration.frame_count} dark frames and flat fields. Terms are "
        "those of EMVA 1288 release 4.0 and of Farrell, Okincha and Parmar (2008); a glossary follows at the end."
    )
    return Page(f"Calibration of {name}", lead, sections, FOOTER)


def warning_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the warnings as notices; all but the first twelve are folded."""
    shown = notices(calibration.diagnostics)
    rest = shown[_SHOWN_WARNINGS:]
    return (*shown[:_SHOWN_WARNINGS], *([Details(f"{len(rest)} more warnings", rest)] if rest else []))


def rejected_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the rejected frames with the reasons."""
    if not calibration.rejected:
        return (Paragraph(f"All {calibration.frame_count} frames were used."),)
    title = f"{len(calibration.rejected)} rejected frames"
    return (Details(title, (Listing(calibration.rejected),)),)


def provenance_blocks(calibration: Calibration, beside: str = "frames") -> tuple[Block, ...]:
    """Return the source, the frames used and their digests, which a PDF has in the file `beside` (`Table.beside`)."""
    folder, names = _without_folder([frame.name for frame in calibration.frames_used])
    kept = folder and not any(is_temporary(part) for part in Path(folder).parts)  # those of the demo are not
    place = f" Folder of the frames: {folder}." if kept else ""
    opened = Paragraph(f"Measurement: {calibration.source}.{place}")
    title = f"The {len(names)} frames used"
    try:
        digests = calibration.frame_digests
    except FileError as error:
        reason = Notice(f"No digests of the frames: {error}.", warning=True)
        return opened, reason, Details(title, (Listing(tuple(names), code=True),))
    table = Table(_DIGESTS, columns("Frame", "SHA-256"), tuple(zip(names, digests, strict=True)), beside)
    return opened, Details(f"{title}, with their digests", (table,))


def _without_folder(names: list[str]) -> tuple[str, list[str]]:
    """Return the common folder of all paths, or "", and the paths relative to it."""
    folders = [os.path.dirname(name) for name in names]
    try:
        folder = os.path.commonpath(folders)
    except ValueError:  # relative and absolute paths, or two drives
        return "", names
    return (folder, [os.path.relpath(name, folder) for name in names]) if folder.strip(os.sep) else ("", names)


READING_TITLE = "How to read this report"

_READING = (
    "Values are estimate ± standard uncertainty (GUM): the true value lies within one standard uncertainty in about "
    "two of three cases, and within the 95 % interval in 19 of 20. If a parameter could not be estimated from these "
    "frames, the report states the reason.",
    "In the plots, error bars are 95 % intervals from sampling, due to the finite number of frames and pixels. Bands "
    "around lines are the 95 % intervals of the lines, from the covariance of each fit. Filled points were fitted. "
    "Hollow points lie outside the linear range and were not. Each color channel has its own color, marker and line "
    "style.",
    "A standard deviation is the root of a variance, and a small variance is the difference of two larger ones, which "
    "chance can make negative. Where it is not distinguishable from zero, the report states an upper limit, such as "
    "< 0.16: the 95 % interval of the standard deviation is then 0 to 0.16. The JSON output has the signed "
    "root of a negative variance as signed_value, for averages over measurements.",
)

_TERMS = (
    ("DN", "Digital number: the output of the converter."),
    ("e⁻", "Electrons, freed by photons and collected in the pixel."),
    ("Dark frame, flat field", "A frame without light; a frame under uniform light."),
    (
        "System gain K",
        "Digital numbers per electron. The number of electrons follows from their shot noise: K is the slope of the "
        "temporal variance against the signal (photon transfer). Where the response bends, it is the slope at small "
        "signal; the data sheet then states that of a straight line, as the standard defines it.",
    ),
    (
        "Quantum efficiency η",
        "Fraction of the photons on the pixel area that become electrons. It requires the number of photons, and "
        "applies to the light that was used.",
    ),
    (
        "Temporal noise",
        "Noise that changes from frame to frame. Read noise and temporal dark noise are the noise without light: read "
        "noise (2008 paper) at one exposure time, temporal dark noise (EMVA 1288) extrapolated to exposure time zero.",
    ),
    (
        "DSNU, PRNU",
        "Fixed differences between pixels: dark signal nonuniformity and photo-response nonuniformity. DSNU1288 and "
        "PRNU1288 follow EMVA 1288: at half saturation, with slow variations such as shading filtered out for PRNU. "
        "The variances of the row, column and pixel parts add up to the total.",
    ),
    ("Dark current", "Electrons that a pixel collects per second without light; it increases with temperature."),
    (
        "Saturation capacity, sensitivity threshold, dynamic range",
        "The largest measurable signal; the smallest detectable signal (SNR 1); their ratio.",
    ),
    (
        "SNR",
        "Signal-to-noise ratio: signal divided by noise; in decibels, 20 times its decimal logarithm; in bits, its "
        "binary logarithm.",
    ),
    (
        "Linearity",
        "Deviation of the response from a straight line. Gain and responsivity are fitted within the linear range.",
    ),
)


# The plots of a calibration's report, in the order of the EMVA 1288 data sheet, or the reasons for missing ones.


def curve_blocks(calibration: Calibration, kinds: tuple[str, ...] = tuple(_CURVES)) -> tuple[Block, ...]:
    """Return a figure for each kind of curve that has at least two points in some channel.

    Parameters
    ----------
    calibration
        Result of `calibrate`.
    kinds
        Kinds of curves: "response", "photon_transfer", "dark_signal", "dark_variance".
    """
    blocks: list[Block] = []
    for kind in kinds:
        residuals, caption = _CURVES[kind]
        curves = {channel: found[kind] for channel, found in calibration.curves.items() if kind in found}
        if any(len(curve.x) > 1 for curve in curves.values()):
            title = next(iter(curves.values())).title
            figure = curve_figure(curves, residuals)
            if kind == "photon_transfer" and calibration.response_curve:
                caption += (
                    " The response bends: this is the standard's straight line, and its slope is not the gain at small "
                    "signal, from which all tables but the data sheet follow."
                )
            blocks.append(figure_block(figure, f"{title}: points and fitted lines with 95 % bands", caption))
    return tuple(blocks)


def plot_sections(calibration: Calibration) -> tuple[Section, ...]:
    """Return the sections of the data sheet with plots, in the standard's order; a reason replaces a missing plot.

    References
    ----------
    EMVA 1288 R4.0 Linear, the plots of a data sheet.
    """
    ranges = [linear_range_table(calibration.linear_range)] if calibration.linear_range else []
    no_light = _no_gain_of_light(calibration) or (
        "the light of the levels is not known"
        if calibration.light_unknown
        else "there is only one light level; a curve needs at least two"
    )
    sections: dict[str, tuple[Block, ...]] = {
        "Sensitivity": (*_or_reason(calibration, "response", no_light), *ranges),
        "Photon transfer": _or_reason(calibration, "photon_transfer", no_light),
        "Signal-to-noise ratio": _snr_blocks(calibration),
        "Linearity": _linearity_blocks(calibration),
        "General model": _general_blocks(calibration),
        "Dark current": _dark_blocks(calibration),
        "Charge transfer": (),
        "Noise in the dark": temporal_blocks(calibration),
        "Nonuniformity": nonuniformity_blocks(calibration),
        "Rows, columns and readout channels": (),
        "Defects": (),
    }
    for figure in effect_figures().values():
        sections[figure.section] += figure.blocks(calibration)
    sections["Defects"] += (*defect_lists(calibration), *outlier_pixel_blocks(calibration))
    return tuple(Section(title, blocks) for title, blocks in sections.items())


def _no_gain_of_light(calibration: Calibration) -> str | None:
    """Return why flat fields give no system gain; without any, dark frames may give one."""
    no_flats = calibration.prnu_percent.reason_id == NO_FLAT_FIELDS.id
    return (calibration.prnu_percent if no_flats else calibration.system_gain_dn_per_e).reason


def _or_reason(calibration: Calibration, kind: str, lacking: str) -> tuple[Block, ...]:
    """Return the figure of a kind of curve, or the reason why it is missing."""
    return curve_blocks(calibration, (kind,)) or (reason_block(lacking),)


_Content = TypeVar("_Content")


def _known(found: Mapping[str, _Content | Missing]) -> dict[str, _Content]:
    return {channel: entry for channel, entry in found.items() if not isinstance(entry, Missing)}


def _snr_blocks(calibration: Calibration) -> tuple[Block, ...]:
    curves = {channel: curve for channel, curve in _known(calibration.snr).items() if curve.x.size}
    if not curves:
        otherwise = _no_gain_of_light(calibration) or "no level has a ratio"
        return (first_reason(calibration.snr, otherwise),)
    ideal = (
        "which turns every photon into an electron and adds no noise"
        if next(iter(curves.values())).photons
        else "which adds no noise to the shot noise of the electrons (the photons are unknown)"
    )
    figure = figure_block(
        snr_figure(curves, _patterns(calibration, curves)),
        "Signal-to-noise ratio against light: points, linear model with 95 % band, ideal sensor",
        "Temporal signal-to-noise ratio of a pixel. Points: measured, with 95 % intervals. Lines: from the fitted "
        f"gain, response and dark noise, with 95 % bands. Dotted: an ideal sensor, {ideal}. Thin line: total ratio, "
        "with the fixed pattern (DSNU and PRNU) included in the noise.",
    )
    return figure, *missing_channel_blocks(calibration.snr, "ratio")


def _patterns(calibration: Calibration, curves: Mapping[str, SnrCurve]) -> dict[str, tuple[float, float]]:
    """Return DSNU1288 in DN and PRNU1288 as a fraction, for the channels that have both."""
    found = {}
    for channel in curves:
        parameters = calibration.channels.get(channel, calibration)
        dsnu_e, prnu_percent = parameters.dsnu1288_e.value, parameters.prnu1288_percent.value
        gain = parameters.system_gain_dn_per_e.value
        if dsnu_e is not None and prnu_percent is not None and gain is not None:
            found[channel] = (gain * dsnu_e, prnu_percent / 100.0)
    return found


def _linearity_blocks(calibration: Calibration) -> tuple[Block, ...]:
    found: dict[str, Linearity] = _known(calibration.linearity)
    if not found:
        otherwise = calibration.linearity_error_percent.reason or "no light frames"
        return (first_reason(calibration.linearity, otherwise),)
    figure = figure_block(
        linearity_figure(found),
        "Deviation from linearity against light, by two definitions",
        "Deviation of the response from a straight line. Above: relative to the line, fitted to the relative "
        "deviations (EMVA 1288 R3.1 and R4.0), so that small signals have the same weight as large ones. Below: "
        "relative to full scale (R3.0). Error bars are 95 % intervals from sampling. Dotted lines are the extremes "
        "of the fitted levels, 5 to 95 % of saturation.",
    )
    return figure, *missing_channel_blocks(calibration.linearity, "deviation from linearity")


def _general_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the plots of EMVA 1288 R4.0 General, if the photons are unknown."""
    found: dict[str, GeneralModel] = _known(calibration.general)
    if calibration.model != "general" or not found:
        return ()
    figure = figure_block(
        general_model_figure(found),
        "Characteristic curve and signal-to-noise ratio of the input against exposure",
        "The general model, which assumes neither known photons nor a linear response. Above: the characteristic "
        "curve. Below: the signal-to-noise ratio of the input, which is the light divided by the input noise: the "
        "measured noise divided by the local slope of the curve. Error bars are 95 % intervals.",
    )
    return figure, *missing_channel_blocks(calibration.general, "figures of the general model")


def _dark_blocks(calibration: Calibration) -> tuple[Block, ...]:
    one = "dark frames at only one exposure time; a slope needs at least two"
    mean, variance = calibration.dark_current_dn_per_s, calibration.dark_current_from_variance_e_per_s
    return (
        Subheading("From the mean"),
        *_or_reason(calibration, "dark_signal", mean.reason or one),
        Subheading("From the variance"),
        *_or_reason(calibration, "dark_variance", variance.reason or f"{one}, with two frames each"),
    )
