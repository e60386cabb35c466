"""Checks of flat fields against dark frames: the same chip, in the same state, and all of its pixels lit."""

from __future__ import annotations

from collections.abc import Iterator

from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.spatial.pattern_agreement import LIMIT, P_VALUE, Agreements
from photosite.calibration.spatial.unlit_lines import UNLIT_LINES
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in
from photosite.values.uncertain import Uncertain

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
LIT_DARKS = DiagnosticKind(
    "light-in-darks",
    "warning",
    "The dark current has the pattern of the response to light, or differs between colors.",
    "Light reached the dark frames: the dark current contains it. Pixels that differ in gain, and not in their "
    "response to light, show the same pattern.",
    "Cover the lens and the camera, and take the dark frames in the dark.",
    ("dark_current_*", "dark_voltage_*", "responsivity_*", "quantum_efficiency_*"),
    "fraction of the dark signal that is light",
    f"below {one_in(P_VALUE)} sets",
)

OTHER_COLOR = 0.2
"""Difference of the dark currents of two colors, relative to their mean, that no sensor has."""


def light_in_darks(evidence: Evidence) -> Iterator[Diagnostic]:
    """Light in the dark frames: by colors, or by the response of the pixels."""
    slopes = {
        name: m.dark_slope
        for name, m in zip(evidence.reduction.names, evidence.dark.channels, strict=True)
        if isinstance(m.dark_slope, Uncertain)
    }
    if len(slopes) > 1:
        low, high = (pick(slopes, key=lambda name: slopes[name].value) for pick in (min, max))
        more = slopes[high] - slopes[low]
        if more.value > OTHER_COLOR * abs(slopes[high].value) and more.beyond(LIMIT):
            yield LIT_DARKS(
                f"the dark current is {slopes[high].value:.3g} DN/s in channel {high} and {slopes[low].value:.3g} DN/s "
                f"in channel {low}: light reached the dark frames, and the dark current contains it",
                more.value / slopes[high].value,
            )
            return
    leak = evidence.patterns.agreements.leak
    if leak is not None and leak.seen:
        yield LIT_DARKS(
            f"the dark current has the pattern of the response to light: {100 * leak.fraction.value:.2g} ± "
            f"{100 * leak.fraction.standard_uncertainty:.1g} % of the dark signal is light that reached the dark "
            f"frames, or comes from pixels that differ in gain",
            leak.fraction.value,
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
    lit = any(True for _ in light_in_darks(evidence))
    if (rates := found.rates) is not None and rates.refuted and not lit:
        cause = (
            "the flat fields were warmer" if rates.ratio > 1.0 else "they were colder, or dark frames were subtracted"
        )
        if rates.ratio > 1.0 and not (found.leak and found.leak.warmer):
            cause += ", or light reached the dark frames"
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
    Check("result", 186, light_in_darks, linear=True),
)
