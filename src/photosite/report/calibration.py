"""The report of a calibration: every parameter, every fit, what was left out and why."""

from __future__ import annotations

from os import PathLike

from matplotlib.figure import Figure

from photosite.calibration.result import Calibration
from photosite.report.figures.curve import Residuals, curve_figure
from photosite.report.figures.noise_budget import noise_budget_figure
from photosite.report.figures.spectral_sensitivity import spectral_sensitivity_figure
from photosite.report.html import (
    Block,
    Details,
    Image,
    Images,
    Listing,
    Notice,
    Page,
    Paragraph,
    Section,
    write_page,
)
from photosite.report.style import svg_bytes
from photosite.report.tables import channel_table, frames_table, linear_range_table, parameter_tables

FOOTER = "Values are estimate ± one standard uncertainty (GUM); intervals are estimate ± 1.96 standard uncertainties."

_SHOWN_WARNINGS = 12

_CURVES: tuple[tuple[str, Residuals, str], ...] = (
    (
        "photon_transfer",
        "standard",
        "Photon transfer: temporal variance against signal, both less the dark's. The slope of the line is the system "
        "gain K. Below: what the line leaves, in standard uncertainties; 95 % should lie between the dotted lines.",
    ),
    (
        "response",
        "percent",
        "Response: signal against the amount of light, and its deviation from the fitted line; bars are 95 % intervals "
        "from sampling alone.",
    ),
    (
        "dark_signal",
        "standard",
        "Dark signal: mean of the dark frames against exposure. The slope of the line is the dark current. Below: "
        "what the line leaves, in standard uncertainties.",
    ),
    (
        "dark_variance",
        "standard",
        "Dark noise: temporal variance of the dark frames against exposure; without dark current it stays that of the "
        "read noise. Below: what the line leaves, in standard uncertainties.",
    ),
)


def write_calibration_report(
    calibration: Calibration, path: str | PathLike[str], *, virtual_camera: bool = False
) -> None:
    """Write the report of a calibration: one HTML file that needs no other.

    Parameters
    ----------
    calibration
        What `calibrate` gave.
    path
        The file.
    virtual_camera
        Whether the frames were simulated; the page then says so.

    Raises
    ------
    FileError
        If it cannot be written; a file that had the name stays as it was.
    """
    write_page(calibration_page(calibration, virtual_camera=virtual_camera), path)


def calibration_page(calibration: Calibration, *, virtual_camera: bool = False) -> Page:
    """The report of a calibration as a page, before it is HTML.

    Parameters
    ----------
    calibration, virtual_camera
        As for `write_calibration_report`.
    """
    name = "an image sensor" if calibration.base is None else calibration.base.name
    by_channel: list[Block] = [channel_table(calibration.channels)] if calibration.channels else []
    if calibration.linear_range:
        by_channel.append(linear_range_table(calibration.linear_range))
    sections = (
        Section("Measurement", (*_virtual(virtual_camera), frames_table(calibration), *warning_blocks(calibration))),
        Section("Parameters", parameter_tables(calibration)),
        Section("Channels" if calibration.channels else "Linear range", tuple(by_channel)),
        Section("Fits", curve_blocks(calibration)),
        Section("Sensor", _sensor_blocks(calibration)),
        Section("Provenance", provenance_blocks(calibration)),
    )
    lead = (
        f"{calibration.frame_count} frames of darkness and flat light, reduced to the parameters of the sensor. "
        "Terms are those of EMVA 1288 release 4.0 and of Farrell, Okincha and Parmar (2008)."
    )
    return Page(f"Calibration of {name}", lead, sections, FOOTER)


def figure_block(figure: Figure, alternative: str, caption: str) -> Images:
    """A figure with its caption, as a block of a page."""
    return Images((Image(svg_bytes(figure), "image/svg+xml", alternative),), caption)


def curve_blocks(calibration: Calibration, kinds: tuple[str, ...] | None = None) -> tuple[Block, ...]:
    """A figure for each kind of curve that has two points or more in some channel.

    Parameters
    ----------
    calibration
        Whose curves.
    kinds
        Which; None for all.
    """
    blocks: list[Block] = []
    for kind, residuals, caption in _CURVES:
        curves = {channel: found[kind] for channel, found in calibration.curves.items() if kind in found}
        if (kinds is None or kind in kinds) and any(len(curve.x) > 1 for curve in curves.values()):
            title = next(iter(curves.values())).title
            blocks.append(figure_block(curve_figure(curves, residuals), f"{title}: points and fitted lines", caption))
    return tuple(blocks)


def warning_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """The warnings, each in its own box; a flood of them is folded away behind the first dozen."""
    notices = [Notice(sentence(text), warning=True) for text in calibration.warnings]
    if len(notices) <= _SHOWN_WARNINGS:
        return tuple(notices)
    rest = tuple(notices[_SHOWN_WARNINGS:])
    return (*notices[:_SHOWN_WARNINGS], Details(f"{len(rest)} more warnings", rest))


def sentence(text: str) -> str:
    """With a capital at the beginning.

    Examples
    --------
    >>> sentence("no light frames")
    'No light frames'
    """
    return text[:1].upper() + text[1:]


def provenance_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Frames left out and why; digests of those that were used."""
    blocks: list[Block] = []
    if calibration.rejected:
        title = f"{len(calibration.rejected)} frames left out, and why"
        blocks.append(Details(title, (Listing(calibration.rejected),)))
    else:
        blocks.append(Paragraph("No frame was left out."))
    blocks.append(
        Details(
            f"SHA-256 digests of the {len(calibration.frames_sha256)} frames used",
            (
                Paragraph("Of the digital numbers as little-endian 16-bit integers, row by row; sorted."),
                Listing(calibration.frames_sha256, code=True),
            ),
        )
    )
    return tuple(blocks)


def _virtual(virtual_camera: bool) -> tuple[Block, ...]:
    return (Notice("These frames were made by a virtual camera, not by a real one."),) if virtual_camera else ()


def _sensor_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """The noise budget of the sensor as measured, and its spectral response as known beforehand."""
    if calibration.base is None:
        return ()
    blocks: list[Block] = []
    needed = ("read_noise_mv", "dsnu_mv", "prnu_percent")
    if all((getattr(calibration, name).value or 0.0) > 0.0 for name in needed):
        blocks.append(
            figure_block(
                noise_budget_figure(calibration.sensor),
                "Signal-to-noise ratio against signal, total and by cause",
                "Signal-to-noise ratio of one frame of an even surface, from the measured read noise, DSNU and PRNU "
                "(Farrell, Okincha and Parmar 2008, Figure 6). Each line but the total's is that of one noise alone.",
            )
        )
    blocks.append(
        figure_block(
            spectral_sensitivity_figure(calibration.base),
            "Quantum efficiency against wavelength",
            "Quantum efficiency as known beforehand; darkness and flat light of one colour do not measure it.",
        )
    )
    return tuple(blocks)
