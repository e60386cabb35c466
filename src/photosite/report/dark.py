"""Dark frames in a calibration's report: amplifier glow, and the drift of the black level."""

from __future__ import annotations

from photosite.calibration.result import Calibration
from photosite.report.figures.dark import drift_figure, glow_figure
from photosite.report.page import Block, Subheading, Table, columns, figure_block, numeric, reason_block
from photosite.report.tables import format_estimate, interval_text
from photosite.values.estimate import Estimate

_COLUMNS = columns("Quantity", numeric("Value"), "Unit", "95 % interval")


def glow_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the map of the dark current and the glow in it; nothing without a map."""
    if (found := calibration.glow) is None:
        return ()
    heading = Subheading("Amplifier glow")
    if not found.places:
        return heading, reason_block(found.peak_dn_per_s.reason or "none was found")
    figure = figure_block(
        glow_figure(found),
        "Map of the dark current with contours of the fitted glow",
        "Dark current in blocks of the chip, without hot pixels. Contours: where the fitted glow of a place has fallen "
        "to 1/e, 1/e² and 1/e³ of its peak.",
    )
    if found.peak_dn_per_s.value is None:
        return heading, figure, reason_block(found.peak_dn_per_s.reason or "it could not be fitted")
    entries = {
        ("Glow at its place", "DN/s"): found.peak_dn_per_s,
        ("Glow at its place", "e⁻/s"): found.peak_e_per_s,
        ("Distance at which it has fallen to 1/e", "pixels"): found.decay_pixels,
    }
    where = ", ".join(place.replace("_", " ") for place in found.places)
    return heading, figure, _table(f"Amplifier glow: {where}", entries)


def drift_blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the drift of the black level from frame to frame; nothing with too few dark frames."""
    if (found := calibration.black_level_drift) is None:
        return ()
    judged = "beyond chance" if found.significant else "no drift beyond chance"
    entries = {("Standard deviation", "DN"): found.drift_dn, ("Standard deviation", "e⁻"): found.drift_e}
    table = _table(f"1/f drift over {found.frames} frames, noise taken off: {judged}", entries)
    heading = Subheading("Drift of the black level")
    if not found.significant:
        return heading, table
    figure = figure_block(
        drift_figure(found),
        "Means of successive dark frames less that of their series",
        "Means of successive dark frames, less that of their exposure time; the longest series first, in blue. Gray: "
        "95 % of what the noise of pixels, rows and columns explains.",
    )
    return heading, figure, table


def _table(title: str, entries: dict[tuple[str, str], Estimate]) -> Table:
    rows = [
        (label, format_estimate(entry), unit, interval_text(entry))
        for (label, unit), entry in entries.items()
        if entry.value is not None
    ]
    return Table(title, _COLUMNS, tuple(rows))
