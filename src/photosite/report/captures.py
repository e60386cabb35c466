"""The report of a sensor with several captures: a table of the captures, signal-to-noise ratios, knees."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.report.diagnostics import explanations, notices
from photosite.report.figures.captures import draw_captures_snr, draw_combined_snr, draw_knees
from photosite.report.page import Block, Page, Paragraph, Section, figure_block
from photosite.report.style import legend_above, new_figure, styled
from photosite.report.tables import comparison_blocks
from photosite.values.diagnostic import Diagnostic
from photosite.values.estimate import Estimate

_FOOTER = "Values are estimate ± standard uncertainty (GUM); intervals are 95 %."


def captures_page(found: CaptureCalibration) -> Page:
    """Return the report of the calibrated captures of a sensor as a page."""
    rows: dict[str, dict[str, Estimate]] = {}
    for name, calibration in found.captures.items():
        rows[name] = {
            "K (DN/e⁻)": calibration.system_gain_dn_per_e,
            "Read noise (e⁻)": calibration.read_noise_e,
            "Saturation (e⁻)": calibration.saturation_capacity_e,
            "Signal ratio": found.signal_ratio.get(name, Estimate(1.0, 0.0)),
            "Sensitivity ratio": found.sensitivity_ratio.get(name, Estimate(1.0, 0.0)),
        }
    figure = figure_block(
        _figure(lambda axes: draw_captures_snr(axes, found)),
        "Signal-to-noise ratio of the captures against the light",
        "From the measured values, up to saturation or the brightest level of each capture.",
    )
    lead = f"{len(found.captures)} captures of one exposure. Ratios are those to {next(iter(found.captures))}."
    sections = (Section("Captures", (*comparison_blocks(rows), figure)), *_warnings(found.diagnostics))
    return Page("Captures of a sensor", lead, sections, _FOOTER)


def combined_page(found: CombinedCalibration) -> Page:
    """Return the report of combined frames as a page."""
    rows = {
        f"capture {number}": {
            "Output (DN/e⁻)": each.output_gain_dn_per_e,
            "K (DN/e⁻)": each.system_gain_dn_per_e,
            "Read noise (e⁻)": each.read_noise_e,
            "Saturation (e⁻)": each.saturation_capacity_e,
            "Sensitivity ratio": each.sensitivity_ratio or Estimate(1.0, 0.0),
        }
        for number, each in enumerate(found.captures, start=1)
    }
    knees = {
        f"knee {number}": {"Output (DN)": each.signal_dn, "Light (e⁻)": each.signal_e, "Dip (dB)": each.dip_db}
        for number, each in enumerate(found.knees, start=1)
    }
    figures = (
        figure_block(
            _figure(lambda axes: draw_knees(axes, found)),
            "Photon transfer of the combined frames",
            "Temporal variance against the output. Gray bands are the 95 % intervals of the knees.",
        ),
        figure_block(
            _figure(lambda axes: draw_combined_snr(axes, found)),
            "Temporal signal-to-noise ratio of the combined frames",
            "It dips where the frame changes to a capture with fewer electrons or more read noise.",
        ),
    )
    shown: tuple[Block, ...] = comparison_blocks(knees) if knees else (Paragraph("No knee was found."),)
    sections = (
        Section("Captures", comparison_blocks(rows)),
        Section("Knees", (*shown, *figures)),
        *_warnings(found.diagnostics),
    )
    lead = f"Combined frames of {found.source}: {len(found.captures)} captures are distinguished by their noise."
    return Page("Captures in combined frames", lead, sections, _FOOTER)


@styled()
def _figure(draw: Callable[[Axes], None]) -> Figure:
    figure, axes = new_figure(height_in=4.4)
    draw(axes)
    legend_above(figure)
    return figure


def _warnings(diagnostics: tuple[Diagnostic, ...]) -> tuple[Section, ...]:
    shown = notices(diagnostics)
    return (Section("Warnings", (*shown, *explanations(diagnostics))),) if shown else ()
