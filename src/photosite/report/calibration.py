"""The report of a calibration: an EMVA 1288 data sheet, the 2008 paper's view, what was left out and why."""

from __future__ import annotations

import os
from os import PathLike

from photosite.calibration.result import Calibration
from photosite.errors import FileError
from photosite.report.blocks import sentence
from photosite.report.datasheet import data_sheet_blocks
from photosite.report.glossary import reading_blocks
from photosite.report.html import (
    Block,
    Column,
    Details,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    Table,
)
from photosite.report.paper import paper_blocks
from photosite.report.plots import plot_sections
from photosite.report.tables import channel_table, correlation_table, parameter_tables
from photosite.report.write import write_report

FOOTER = (
    "Values are estimate ± one standard uncertainty (GUM). The 95 % intervals are those of each estimate's own "
    "distribution, and need not lie evenly around it."
)

_SHOWN_WARNINGS = 12

_DIGESTS = "SHA-256 of a frame's digital numbers as little-endian 16-bit integers, row by row."


def write_calibration_report(
    calibration: Calibration, path: str | PathLike[str], *, virtual_camera: bool = False
) -> None:
    """Write the report of a calibration: one file that needs no other.

    Parameters
    ----------
    calibration
        What `calibrate` gave.
    path
        The file: a PDF where it ends in .pdf, an HTML page otherwise.
    virtual_camera
        Whether the frames were simulated; the page then says so.

    Raises
    ------
    FileError
        If it cannot be written; a file that had the name stays as it was.
    """
    write_report(calibration_page(calibration, virtual_camera=virtual_camera), path)


def calibration_page(calibration: Calibration, *, virtual_camera: bool = False) -> Page:
    """The report of a calibration as a page, before it is HTML or PDF.

    Parameters
    ----------
    calibration, virtual_camera
        As for `write_calibration_report`.
    """
    name = "an image sensor" if calibration.base is None else calibration.base.name
    together = correlation_table(calibration)
    correlations: tuple[Block, ...] = () if together is None else (together,)
    channels: tuple[Block, ...] = (channel_table(calibration.channels),) if calibration.channels else ()
    sections = (
        Section("Data sheet", (*_virtual(virtual_camera), *data_sheet_blocks(calibration))),
        Section("Warnings and frames left out", (*rejected_blocks(calibration), *warning_blocks(calibration))),
        *plot_sections(calibration),
        Section("2008 paper", paper_blocks(calibration)),
        Section("All parameters", (*parameter_tables(calibration), *correlations)),
        Section("Channels", channels),
        Section("Provenance", provenance_blocks(calibration)),
        Section("How to read this report", reading_blocks()),
    )
    lead = (
        f"{calibration.frame_count} frames of darkness and flat light, reduced to the parameters of the sensor. "
        "Terms are those of EMVA 1288 release 4.0 and of Farrell, Okincha and Parmar (2008); what they mean stands at "
        "the end."
    )
    return Page(f"Calibration of {name}", lead, sections, FOOTER)


def warning_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """The warnings, each in its own box; a flood of them is folded away behind the first dozen."""
    notices = [Notice(sentence(text), warning=True) for text in calibration.warnings]
    if len(notices) <= _SHOWN_WARNINGS:
        return tuple(notices)
    rest = tuple(notices[_SHOWN_WARNINGS:])
    return (*notices[:_SHOWN_WARNINGS], Details(f"{len(rest)} more warnings", rest))


def rejected_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Frames left out, and why."""
    if not calibration.rejected:
        return (Paragraph(f"All {calibration.frame_count} frames were used, none was left out."),)
    title = f"{len(calibration.rejected)} frames left out, and why"
    return (Details(title, (Listing(calibration.rejected),)),)


def provenance_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """What was opened, which frames were used, and their digests."""
    folder, names = _without_folder([frame.name for frame in calibration.frames_used])
    place = f" The frames lie in {folder}." if folder else ""
    opened = Paragraph(f"What was opened: {calibration.source}.{place}")
    title = f"The {len(names)} frames used"
    try:
        digests = calibration.frame_digests
    except FileError as error:
        reason = Notice(f"The frames could not be hashed: {error}.", warning=True)
        return opened, reason, Details(title, (Listing(tuple(names), code=True),))
    rows = tuple(zip(names, digests, strict=True))
    table = Table(_DIGESTS, (Column("Frame"), Column("SHA-256")), rows)
    return opened, Details(f"{title}, with their digests", (table,))


def _without_folder(names: list[str]) -> tuple[str, list[str]]:
    """The folder that all paths share, "" if none, and the paths from there."""
    folders = [os.path.dirname(name) for name in names]
    try:
        folder = os.path.commonpath(folders)
    except ValueError:  # some are relative and some are not, or they lie on two drives
        return "", names
    return (folder, [os.path.relpath(name, folder) for name in names]) if folder.strip(os.sep) else ("", names)


def _virtual(virtual_camera: bool) -> tuple[Block, ...]:
    return (Notice("These frames were made by a virtual camera, not by a real one."),) if virtual_camera else ()
