"""Checks of the digital numbers: gains, companding and sums behind the converter."""

from __future__ import annotations

from collections.abc import Iterator

from photosite.calibration.diagnostics import Check
from photosite.calibration.evidence import Evidence
from photosite.calibration.reduction.codes import SUMMED_CODES
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

DIGITAL_GAIN = DiagnosticKind(
    "digital-gain",
    "warning",
    "Some numbers are left out, or stand for two codes of the converter.",
    "The system gain holds for the numbers of the file; the quantization noise is that of the gain. Figures from the "
    "converter's bit depth (millivolts) are wrong by the gain.",
    "Use raw numbers if the camera gives them.",
    ("*_mv", "*_mv_per_s", "conversion_gain_*"),
    "distance of the numbers, DN",
)

DECODED_NUMBERS = DiagnosticKind(
    "decoded-companding",
    "warning",
    "Neighboring numbers are farther apart at high levels than at low ones: companded numbers were decoded.",
    "The quantization noise of each level was subtracted from its temporal variance.",
    "Nothing, or use the companded numbers with their table (--linearize).",
    ("system_gain_dn_per_e",),
    "largest distance of the numbers, DN",
)


def digital_gains(evidence: Evidence) -> Iterator[Diagnostic]:
    """Channels with a digital gain: its size, and what it means for the results."""
    reduction = evidence.reduction
    for name, steps, level in zip(reduction.names, reduction.steps, reduction.first_group.levels, strict=True):
        if steps is None:
            continue
        text = f"{steps}{reduction.channel_label(name)}"
        if not steps.uniform:
            yield DECODED_NUMBERS(
                f"{text}, as with companded numbers that were decoded; the quantization noise of each level was taken "
                f"off its temporal variance",
                steps.step,
            )
            continue
        if (bits := steps.stretched_from(reduction.frames.bits)) is not None:
            text += f": numbers of {bits} bits stretched to {reduction.frames.bits} bits"
        yield DIGITAL_GAIN(
            f"{text}; the system gain holds for the numbers of the file, quantization noise of "
            f"{level.quantization:.3g} DN² was subtracted in place of 1/12 DN², and figures from the converter's "
            f"bit depth (millivolts) are wrong by the gain; use raw numbers if the camera gives them",
            steps.step,
        )


def summed_codes(evidence: Evidence) -> Iterator[Diagnostic]:
    """Numbers that are sums of several of the converter's."""
    for text, number in {str(found): found.number for found in evidence.reduction.sums if found is not None}.items():
        yield SUMMED_CODES(text, number)


CHECKS = (Check("result", 100, digital_gains), Check("result", 110, summed_codes))
