"""Checks of the fixed pattern: periods, taps, and outlying pixels."""

from __future__ import annotations

from collections.abc import Iterator

from photosite.calibration.amplifiers import AMPLIFIER_GAINS
from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.spatial.periodic_structure import PERIOD_P_VALUE, TAPS_P_VALUE, UNSTATED_MOSAIC
from photosite.values.diagnostic import Diagnostic, DiagnosticKind, one_in

PERIODIC_GAIN = DiagnosticKind(
    "periodic-gain",
    "warning",
    "The flat fields differ with a period of a few rows or columns.",
    "Readout channels have different gains. PRNU includes this difference; PRNU within readout channels does not.",
    "Nothing: the sensor file has the readout channels.",
    ("prnu*",),
    "difference as a fraction of the signal",
    f"below {one_in(PERIOD_P_VALUE)} sets",
)
PERIODIC_OFFSET = DiagnosticKind(
    "periodic-offset",
    "warning",
    "The dark frames differ with a period of a few rows or columns.",
    "Readout channels have different offsets. DSNU includes this difference; DSNU within readout channels does not.",
    "Nothing: the sensor file has the readout channels.",
    ("dsnu*",),
    "difference, DN",
    f"below {one_in(PERIOD_P_VALUE)} sets",
)
TAP_STEPS = DiagnosticKind(
    "steps-between-taps",
    "warning",
    "Halves or quadrants of the frames differ.",
    "Taps have different gains or offsets. PRNU or DSNU includes the step; those within readout channels do not. The "
    "system gain is that of the mean variance and the mean signal, which is above the mean of different gains.",
    "Nothing: the sensor file has the readout channels. --region calibrates one of them.",
    ("prnu*", "dsnu*", "system_gain_dn_per_e", "*_e", "*_e_per_s"),
    "step as a fraction of the signal, or in DN for dark frames",
    f"below {one_in(TAPS_P_VALUE)} mean frames",
)
FAR_PIXELS = DiagnosticKind(
    "far-pixels",
    "warning",
    "A few pixels, such as dead or stuck ones, make a fifth of the variance over pixels or more.",
    "DSNU1288 of the named exposure time, or PRNU, which are those of all pixels, describe these pixels more than the "
    "others.",
    "Measure maps (--maps), which list them.",
    ("prnu*", "dsnu*"),
    "fraction of the variance",
)


_LEAST_EXCESS = 1e-3
"""Difference of the system gain from the mean of the taps' that is told, as a fraction."""


def patterns(evidence: Evidence) -> Iterator[Diagnostic]:
    """Periods, steps between taps and far pixels of the mean frames."""
    found = evidence.patterns
    if (light := found.structure) is not None:
        kind = UNSTATED_MOSAIC if light.is_mosaic() else PERIODIC_GAIN
        yield kind(str(light), light.difference)
    if (dark := found.dark_structure) is not None:
        yield PERIODIC_OFFSET(str(dark), dark.difference)
    for taps in found.taps:
        # Taps of gains k have the mean variance <k^2> n at the mean signal <k> n.
        excess = 0.0 if taps.dark or evidence.amplifiers else float((taps.level**2).mean())
        if excess > _LEAST_EXCESS:
            text = f"{taps}. If their gains differ, the system gain is {100 * excess:.2g} % above the mean of the taps'"
            yield TAP_STEPS(text, taps.step, ("prnu*", "system_gain_dn_per_e", "*_e", "*_e_per_s"))
        else:
            yield TAP_STEPS(str(taps), taps.step, ("dsnu*",) if taps.dark else ("prnu*",))
    if (gains := evidence.amplifier_gains) is not None:
        yield AMPLIFIER_GAINS(str(gains), gains.difference)
    for far in found.far:
        explained = found.unlit is not None if far.what == "PRNU" else evidence.dark.rounding_shows
        if explained:
            continue
        yield FAR_PIXELS(str(far), far.fraction, ("prnu*" if far.what == "PRNU" else "dsnu*",))


CHECKS = (Check("result", 180, patterns, linear=True),)
