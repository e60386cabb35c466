"""Warnings of a digital gain that was applied after the converter (`reduction/codes.py`)."""

from __future__ import annotations

from collections.abc import Iterator

from photosite.calibration.reduction.reduce import Reduction
from photosite.values.uncertain import Missing

EQUAL = 0.01
"""Relative difference up to which the digital gains of two channels are equal."""


def digital_gain_warnings(reduction: Reduction) -> Iterator[str]:
    """Yield a warning for each channel with a digital gain: its size, and what it means for the results."""
    darks = reduction.reference_group.levels
    for name, steps, level in zip(reduction.names, reduction.steps, darks, strict=True):
        if steps is None:
            continue
        text = f"{steps}{reduction.of_channel(name)}"
        if not steps.uniform:
            yield (
                f"{text}, as with companded numbers that were decoded; the quantization noise of each level was taken "
                f"off its temporal variance"
            )
            continue
        if (bits := steps.stretched_from(reduction.frames.bits)) is not None:
            text += f": numbers of {bits} bits stretched to {reduction.frames.bits} bits"
        yield (
            f"{text}; the system gain holds for the numbers of the file, quantization noise of "
            f"{level.quantisation:.3g} DN² was taken off in place of 1/12 DN², and figures from the converter's "
            f"bit depth (millivolts) are wrong by the gain; use raw numbers if the camera gives them"
        )


def unequal_gains(reduction: Reduction) -> Missing | None:
    """Return why the channels have no common system gain; None where they have."""
    gains = [1.0 if steps is None else steps.of_groups[reduction.reference] for steps in reduction.steps]
    if max(gains) < (1.0 + EQUAL) * min(gains):
        return None
    each = ", ".join(f"{name} {gain:.3g}" for name, gain in zip(reduction.names, gains, strict=True))
    return Missing(f"the channels have different digital gains ({each}); the system gain is stated for each of them")
