"""Checks of the levels that refuse a calibration: clipping, bit depth, copies, swapped or lit frames, wrong light.

A protocol or descriptor is written by hand or by another tool. A wrong unit in it leaves every frame readable, but
makes the results wrong. Each error here rests on something impossible in the levels, and names the likely cause.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.diagnostics import Check
from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.photon_transfer import STILL_FRACTION
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION
from photosite.calibration.reduction.reduce import Reduction
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.exposure import format_exposure

LARGEST_FACTOR = 1.5
"""Factor by which a signal may deviate from the proportion of the others; lamps and shutters are better."""

LEAST_SIGNAL = 0.02
"""Signal, as a fraction of the brightest in the linear range, below which stray light hides the proportion."""

FULL_SCALE_FRACTION, LEAST_BITS = 0.98, 6
"""Fraction of a light level's pixels at the full scale of a smaller converter that shows that converter's bit depth,
and the smallest bit depth that is searched."""

_FACTORS = {1e3: "a thousand", 1e6: "a million", 1e9: "a thousand million", 60.0: "sixty", 3600.0: "3600"}


def _refusal(id: str, seen: str, remedy: str) -> DiagnosticKind:
    return DiagnosticKind(id, "refused", seen, "There is no result: every figure would be wrong.", remedy, ("*",))


SHIFTED_NUMBERS = _refusal(
    "shifted-numbers",
    "All numbers are multiples of a power of two.",
    "State the smaller bit depth (--bits), by which the numbers of files of 16 bits are divided.",
)
BLACK_DARKS = _refusal(
    "black-darks",
    "All numbers of the dark frames are 0.",
    "Raise the camera's black level (pedestal), and take the dark frames again.",
)
SATURATED_DARKS = _refusal(
    "saturated-darks", "Pixels of the dark frames are saturated.", "Cover the lens, or shorten the exposure time."
)
IDENTICAL_FRAMES = _refusal(
    "identical-frames",
    "The frames of a group differ in no pixel, or much less than brighter ones.",
    "Use independent frames.",
)
DARK_FLATS = _refusal(
    "dark-flats",
    "The brightest flat fields are not brighter than the dark frames.",
    "Check that dark frames and flat fields are not swapped, and that the lamp was on.",
)
WRONG_BIT_DEPTH = _refusal(
    "wrong-bit-depth",
    "The flat fields are clipped at the full scale of a smaller converter than stated or assumed.",
    "Correct the bit depth (--bits).",
)
LIT_DARKS = _refusal(
    "lit-darks",
    "Dark frames are far brighter than dark frames of longer exposure.",
    "Cover the lens, or correct the list of dark frames and flat fields.",
)
WRONG_LIGHT = _refusal(
    "wrong-light",
    "The signals are not proportional to the stated light, by a factor of 1.5 or more.",
    "Correct photons, exposure times and their units in the protocol; switch automatic exposure off.",
)


EQUAL_PIXELS = 0.01
"""Spatial variance, DN^2, up to which frames without noise are not copies: quantization may hide all of it."""


def shifted_numbers(reduction: Reduction) -> None:
    """Check that the numbers are not all multiples of a power of two: shifted numbers of fewer bits."""
    group, bits = reduction.first_group, reduction.frames.bits
    bits_used = reduction.bits_used
    if reduction.reference_mean is not None:
        bits_used |= int(np.bitwise_or.reduce(reduction.reference_mean.sum, axis=None))
    step = bits_used & -bits_used
    if step > 1 and any(level.spatial_variance > 0.0 for level in group.levels):
        shift = step.bit_length() - 1
        # Numbers of files that store more bits than stated are divided (`photosite.frames.stored_numbers`).
        divided = bits == 16 and any(source.path is not None for source in group.group.frames)
        raise reduction.error(
            SHIFTED_NUMBERS,
            f"all numbers are multiples of {step}: they have {bits - shift} bits shifted by {shift} bits, not "
            f"{bits} bits",
            f"Pass {{bits}}: the numbers are then divided by {step}"
            if divided
            else f"Divide them by {step} and state {bits - shift} bits",
            group,
            arguments={"bits": bits - shift},
        )


def impossible_darks(reduction: Reduction) -> None:
    """Check that dark frames are neither black nor saturated, and that they have noise."""
    for group in reduction.darks:
        for name, level in zip(reduction.names, group.levels, strict=True):
            if level.low_fraction == 1.0:
                hint = "Raise the camera's black level (pedestal) and take the dark frames again"
                raise reduction.error(BLACK_DARKS, "all numbers are clipped at 0 DN", hint, group, name)
            if level.high_fraction > CLIPPED_DARK_FRACTION:
                raise reduction.error(
                    SATURATED_DARKS,
                    f"{100 * level.high_fraction:.3g} % of the pixels are at {(1 << reduction.frames.bits) - 1} DN, "
                    f"but dark frames cannot be saturated",
                    "Cover the lens, or shorten the exposure time",
                    group,
                    name,
                )
            if level.repeated and level.variance == 0.0 and level.spatial_variance > EQUAL_PIXELS:
                what = f"the {level.frames} frames do not differ in a single pixel"
                raise reduction.error(IDENTICAL_FRAMES, what, "Use independent frames", group, name)


def dark_flats(reduction: Reduction) -> None:
    """Check that the brightest light group is brighter than the shortest dark exposure."""
    if not reduction.darks or not reduction.lights:
        return
    brightest = max(reduction.lights, key=lambda group: max(level.mean for level in group.levels))
    pairs = [(light.mean, dark.mean) for light, dark in zip(brightest.levels, reduction.darks[0].levels, strict=True)]
    if all(light <= dark for light, dark in pairs):
        raise reduction.error(
            DARK_FLATS,
            f"the brightest {brightest.label} have a mean of {pairs[0][0]:.2f} DN, not above the dark frames' "
            f"{pairs[0][1]:.2f} DN",
            "Check that dark and light frames are not swapped, and that the lamp was on",
        )


def identical_flats(reduction: Reduction) -> None:
    """Check that no flat fields are without noise though brighter ones have noise: clipping leaves none brighter."""
    for k, name in enumerate(reduction.names):
        repeated = [entry for entry in reduction.lights if entry.levels[k].repeated]
        for entry in repeated:
            level = entry.levels[k]
            brighter = [other.levels[k].variance for other in repeated if other.levels[k].mean > 1.05 * level.mean]
            if (
                brighter
                and level.low_fraction < CLIPPED_DARK_FRACTION
                and level.variance < STILL_FRACTION * min(brighter)
            ):
                raise reduction.error(
                    IDENTICAL_FRAMES,
                    f"the {level.frames} frames nearly agree (variance {level.variance:.2g} DN^2), but brighter flats "
                    f"do ({min(brighter):.2g} DN^2 or more)",
                    "Use independent frames",
                    entry,
                    name,
                )


def wrong_full_scale(reduction: Reduction) -> None:
    """Check that flat fields do not end at the full scale of a smaller converter than stated.

    Pixels clipped by a converter all read the same number; pixels clipped by a well spread around any number. Some
    pixels may respond less.
    """
    bits = reduction.frames.bits
    if not reduction.lights or any(steps is not None for steps in reduction.steps):  # numbers after a digital gain
        return
    for k, name in enumerate(reduction.names):
        top = reduction.whites[k]
        fraction = max(group.levels[k].high_fraction for group in reduction.lights)
        if fraction >= FULL_SCALE_FRACTION and top & (top + 1) == 0 and LEAST_BITS <= top.bit_length() < bits:
            pixels = "every pixel" if fraction == 1.0 else f"{100 * fraction:.3g} % of the pixels"
            raise reduction.error(
                WRONG_BIT_DEPTH,
                f"the brightest flat fields{reduction.channel_label(name, ' of channel {}')} have {top} DN in "
                f"{pixels}, the full scale of {top.bit_length()} bits, but {bits} bits are stated or assumed",
                "Correct the bits",
            )


def lit_darks(reduction: Reduction, channels: Sequence[Channel]) -> None:
    """Check that no dark group is far brighter than all dark frames of longer exposure."""
    if not channels:
        return
    brightest_dn = max(float(channel.levels.signal.max()) for channel in channels)
    order = sorted(reduction.darks, key=lambda entry: entry.group.exposure_s)
    for index, entry in enumerate(order[:-1]):
        for k, level in enumerate(entry.levels):
            others = max(other.levels[k].mean for other in order[index + 1 :])
            if level.mean - others > max(LEAST_SIGNAL * brightest_dn, 5.0 * math.sqrt(level.spatial_variance)):
                raise reduction.error(
                    LIT_DARKS,
                    f"{entry.label} have a mean of {level.mean:.4g} DN, but all dark frames of longer exposure "
                    f"{others:.4g} DN or less: light fell on them, or flat fields are listed as dark frames",
                )


@dataclass(frozen=True)
class _Proportion:
    """Signals that should be proportional to an axis, with their uncertainties; (levels,) each."""

    x: NDArray[np.float64]
    signal: NDArray[np.float64]
    uncertainty: NDArray[np.float64]

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Signal per unit of the axis, relative to its median over the levels."""
        per_unit = self.signal / self.x
        return np.asarray(per_unit / np.median(per_unit))

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Whether a level deviates by more than `LARGEST_FACTOR`, and beyond chance."""
        expected = np.median(self.signal / self.x) * self.x
        significant = np.abs(self.signal - expected) > 5.0 * self.uncertainty
        return np.asarray(((self.ratio > LARGEST_FACTOR) | (self.ratio < 1.0 / LARGEST_FACTOR)) & significant)


def disproportion(reduction: Reduction, channels: Sequence[Channel]) -> None:
    """Check that signals in the linear range are proportional to the stated light."""
    for name, channel in zip(reduction.names, channels, strict=False):  # none without flat fields
        levels = channel.levels
        take = channel.used & levels.trusted & (levels.x > 0.0)
        take &= levels.signal > LEAST_SIGNAL * levels.signal[take].max(initial=0.0)
        if take.sum() < 3:
            continue
        found = _Proportion(levels.x[take], levels.signal[take], np.sqrt(np.diag(levels.signal_covariance)[take]))
        ratio, beyond = found.ratio, found.beyond
        if not beyond.any():
            continue
        by_photons = levels.photons_known
        worst = int(np.argmax(np.abs(np.log(ratio)) * beyond))
        level = f"{found.x[worst]:g} photons" if by_photons else f"{format_exposure(float(found.x[worst]))} s"
        cause, hint = _likely_cause(found, levels.exposure_s[take] if by_photons else None)
        raise reduction.error(
            WRONG_LIGHT,
            f"the signal is not proportional to the stated {'photons' if by_photons else 'exposure times'}: flat "
            f"fields at {level}{reduction.channel_label(name, ' (channel {})')} have {found.signal[worst]:.4g} DN "
            f"above dark, {ratio[worst]:.3g} times the proportion of the others, and {int(beyond.sum())} of "
            f"{len(ratio)} levels deviate; {cause}",
            hint,
        )


def _likely_cause(found: _Proportion, exposure_s: NDArray[np.float64] | None) -> tuple[str, str]:
    """Return the likely cause of a missing proportion, to photons if `exposure_s` is given, and what to do."""
    if exposure_s is not None and len(np.unique(exposure_s)) > 1 and not replace(found, x=exposure_s).beyond.any():
        return "it is proportional to the exposure times instead", "Correct the photons"
    off = found.ratio[found.beyond]
    for factor, words in _FACTORS.items():
        power = np.abs(np.log(off) / math.log(factor))
        if np.all(power > 0.9) and np.all(power < 1.1):
            return f"they deviate by a factor of {words}: units are mixed (s, ms, us, ns)", "State all in one unit"
    if float(found.signal.max()) < LARGEST_FACTOR * float(found.signal.min()):
        cause = "the signal is the same at every level: automatic exposure, or a lamp dimmed against the exposure time"
        return cause, "Switch the automatic exposure off and keep the lamp constant"
    order = np.argsort(found.signal)
    in_order = np.array_equal(order, np.argsort(found.x))
    if not in_order and not _Proportion(np.sort(found.x), found.signal[order], found.uncertainty[order]).beyond.any():
        return "sorted by signal they fit: levels were swapped", "Correct the list of files and levels"
    hint = "Check the list of files and levels, the lamp, and automatic aperture, gain or exposure"
    return "the cause is unknown", hint


CHECKS = (
    Check("levels", 10, shifted_numbers),
    Check("levels", 20, impossible_darks),
    Check("levels", 30, dark_flats),
    Check("levels", 40, identical_flats),
    Check("levels", 50, wrong_full_scale),
    Check("channels", 10, lit_darks),
    Check("channels", 20, disproportion),
)
