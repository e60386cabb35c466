"""Defective pixels that are left out."""

from __future__ import annotations

from collections.abc import Iterator

from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.reduction.defective_pixels import FAR_SIGMA
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

DEFECTIVE_PIXELS = DiagnosticKind(
    "defective-pixels",
    "note",
    f"A few pixels lie {FAR_SIGMA:g} standard deviations or more from those of their color around them, or are far "
    "noisier: hot, stuck, dead or blinking ones, lines or clusters of them.",
    "All figures are those of the other pixels. The sensor file has the defects as a section of their own.",
    "Nothing. Maps (--maps) list the pixels. Above 3 % of the pixels, none is left out.",
    (
        *("read_noise_*", "dsnu*", "prnu*", "black_level_dn", "dark_current_*", "dark_voltage_*", "dcnu_percent"),
        "system_gain_dn_per_e",
    ),
    "fraction of the pixels",
    "below 1 of 1000 sets",
)


def defective_pixels(evidence: Evidence) -> Iterator[Diagnostic]:
    """Defective pixels, and the figures that would be others with them."""
    if (found := evidence.left_out) is not None:
        yield DEFECTIVE_PIXELS(str(found), found.pixels.fraction)


CHECKS = (Check("result", 175, defective_pixels),)
