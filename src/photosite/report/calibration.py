"""The report of a calibration: EMVA 1288 data sheet, tables and plots, Table 1 of the 2008 paper, provenance."""

from __future__ import annotations

import os

from photosite.calibration.result import Calibration
from photosite.errors import FileError
from photosite.report.data_sheet import data_sheet_blocks
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
    sentence,
)
from photosite.report.paper import paper_blocks
from photosite.report.plots import plot_sections
from photosite.report.tables import channel_table, correlation_table, parameter_tables

FOOTER = (
    "Values are estimate ± standard uncertainty (GUM). The 95 % intervals follow the distribution of each estimate and "
    "may be asymmetric."
)

_SHOWN_WARNINGS = 12

_DIGESTS = "SHA-256 of a frame's digital numbers as little-endian 16-bit integers, row by row."


def calibration_page(calibration: Calibration) -> Page:
    """Return the report of a calibration as a page."""
    name = "an image sensor" if calibration.base is None else calibration.base.name
    correlations = correlation_table(calibration)
    channels: tuple[Block, ...] = (channel_table(calibration.channels),) if calibration.channels else ()
    sections = (
        Section("Data sheet", data_sheet_blocks(calibration)),
        Section("Warnings and rejected frames", (*rejected_blocks(calibration), *warning_blocks(calibration))),
        *plot_sections(calibration),
        Section("2008 paper", paper_blocks(calibration)),
        Section("All parameters", (*parameter_tables(calibration), *([correlations] if correlations else []))),
        Section("Channels", channels),
        Section("Provenance", provenance_blocks(calibration)),
        Section(
            "How to read this report",
            (*(Paragraph(text) for text in _READING), Subheading("Glossary"), Terms(_TERMS)),
        ),
    )
    lead = (
        f"Parameters of the sensor, estimated from {calibration.frame_count} dark frames and flat fields. Terms are "
        "those of EMVA 1288 release 4.0 and of Farrell, Okincha and Parmar (2008); a glossary follows at the end."
    )
    return Page(f"Calibration of {name}", lead, sections, FOOTER)


def warning_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the warnings as notices; all but the first twelve are folded."""
    notices = [Notice(sentence(text), warning=True) for text in calibration.warnings]
    shown, rest = notices[:_SHOWN_WARNINGS], notices[_SHOWN_WARNINGS:]
    return (*shown, Details(f"{len(rest)} more warnings", tuple(rest))) if rest else tuple(shown)


def rejected_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the rejected frames with the reasons."""
    if not calibration.rejected:
        return (Paragraph(f"All {calibration.frame_count} frames were used."),)
    title = f"{len(calibration.rejected)} rejected frames"
    return (Details(title, (Listing(calibration.rejected),)),)


def provenance_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the source, the frames used and their digests."""
    folder, names = _without_folder([frame.name for frame in calibration.frames_used])
    place = f" Folder of the frames: {folder}." if folder else ""
    opened = Paragraph(f"Measurement: {calibration.source}.{place}")
    title = f"The {len(names)} frames used"
    try:
        digests = calibration.frame_digests
    except FileError as error:
        reason = Notice(f"No digests of the frames: {error}.", warning=True)
        return opened, reason, Details(title, (Listing(tuple(names), code=True),))
    table = Table(_DIGESTS, columns("Frame", "SHA-256"), tuple(zip(names, digests, strict=True)))
    return opened, Details(f"{title}, with their digests", (table,))


def _without_folder(names: list[str]) -> tuple[str, list[str]]:
    """Return the common folder of all paths, or "", and the paths relative to it."""
    folders = [os.path.dirname(name) for name in names]
    try:
        folder = os.path.commonpath(folders)
    except ValueError:  # relative and absolute paths, or two drives
        return "", names
    return (folder, [os.path.relpath(name, folder) for name in names]) if folder.strip(os.sep) else ("", names)


_READING = (
    "Values are estimate ± standard uncertainty (GUM): the true value lies within one standard uncertainty in about "
    "two of three cases, and within the 95 % interval in 19 of 20. If a parameter could not be estimated from these "
    "frames, the report states the reason.",
    "In the plots, error bars are 95 % intervals from sampling, due to the finite number of frames and pixels. Bands "
    "around lines are the 95 % intervals of the lines, from the covariance of each fit. Filled points were fitted. "
    "Hollow points lie outside the linear range and were not. Each color channel has its own color, marker and line "
    "style.",
    "A standard deviation is the root of a variance, and a small variance is the difference of two larger ones, which "
    "chance can make negative. The value then has a minus sign, and an upper limit below which the true value lies "
    "with 95 % probability.",
)

_TERMS = (
    ("DN", "Digital number: the output of the converter."),
    ("e⁻", "Electrons, freed by photons and collected in the pixel."),
    ("Dark frame, flat field", "A frame without light; a frame under uniform light."),
    (
        "System gain K",
        "Digital numbers per electron. The number of electrons follows from their shot noise: K is the slope of the "
        "temporal variance against the signal (photon transfer).",
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
