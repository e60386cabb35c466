"""Checks of flat fields against dark frames: the same chip, in the same state, and all of its pixels lit."""

from __future__ import annotations

from collections.abc import Iterator

from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.spatial.pattern_agreement import P_VALUE, Agreements
from photosite.calibration.spatial.unlit_lines import UNLIT_LINES
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in

OTHER_OFFSETS = DiagnosticKind(
    "other-offsets",
    "warning",
    "The pattern of the flat fields at no light is not that of the dark frames.",
    "DSNU is that of the dark frames, and not that of the flat fields. PRNU may contain the difference.",
    "Use frames as the camera reads them: the same mode, orientation and corrections for dark frames and flat fields.",
    ("dsnu*", "prnu*", "black_level_dn"),
    "pattern of the flat fields over that of the dark frames; 1 where they agree",
    f"below {one_in(P_VALUE)} sets",
)
OTHER_DARK_CURRENT = DiagnosticKind(
    "other-dark-current",
    "warning",
    "The dark current of the pixels in the flat fields is not that in the dark frames.",
    "PRNU contains the difference, and the responsivity its mean.",
    "Take dark frames and flat fields at one temperature, and without dark subtraction in the camera.",
    ("prnu*", "responsivity_*", "quantum_efficiency_*", "dark_current_*"),
    "dark current of the flat fields over that of the dark frames",
    f"below {one_in(P_VALUE)} sets",
)


def patterns_agree(evidence: Evidence) -> Iterator[Diagnostic]:
    """Offsets and dark currents of flat fields that are not those of the dark frames."""
    found = evidence.patterns.agreements
    if (offsets := found.offsets) is not None and offsets.refuted:
        yield OTHER_OFFSETS(
            f"the pattern of the flat fields at no light is {offsets.ratio:.2g} ± {offsets.uncertainty:.1g} times that "
            f"of the dark frames: {_offset_cause(found)}; DSNU and PRNU are not those of one chip",
            offsets.ratio,
        )
    if (rates := found.rates) is not None and rates.refuted:
        cause = (
            "the flat fields were warmer" if rates.ratio > 1.0 else "they were colder, or dark frames were subtracted"
        )
        yield OTHER_DARK_CURRENT(
            f"the dark current of the pixels in the flat fields is {rates.ratio:.3g} ± {rates.uncertainty:.1g} times "
            f"that in the dark frames: {cause}; PRNU contains the difference",
            rates.ratio,
        )


def _offset_cause(found: Agreements) -> str:
    if found.turned:
        return f"one kind of frame is {found.turned} relative to the other"
    assert found.offsets is not None
    if found.offsets.ratio < 0.5:
        return "a master frame was subtracted from one kind of frame, or one kind is of another chip"
    return "one kind of frame was corrected, or light reached the dark frames"


def unlit_lines(evidence: Evidence) -> Iterator[Diagnostic]:
    """Covered lines and overscan in the frames."""
    if (found := evidence.patterns.unlit) is not None:
        yield UNLIT_LINES(str(found), found.fraction)


CHECKS = (
    Check("result", 182, unlit_lines, linear=True),
    Check("result", 184, patterns_agree, linear=True),
)
