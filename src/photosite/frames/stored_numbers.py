"""From the numbers that a file stores to digital numbers: signed ones, floats, numbers that wrapped or are shifted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.raw_frame import Numbers
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

NumberKind = Literal["unsigned", "signed", "float"]
"""How numbers are stored; floats may be whole numbers."""

StoredNumbers = Numbers | NDArray[np.signedinteger] | NDArray[np.floating]
"""Numbers as a file stores them."""

WRAPPED_NUMBERS = DiagnosticKind(
    "wrapped-numbers",
    "note",
    "Unsigned numbers of 16 bits are stored as signed ones.",
    "The numbers from 32768 on are negative in the file; they are read as they were.",
    "None. FITS states unsigned numbers by BZERO = 32768.",
    false_alarms="none: numbers below -16384 are not those of processed frames",
)
NEGATIVE_NUMBERS = DiagnosticKind(
    "negative-numbers",
    "warning",
    "Frames have negative numbers. A constant is added to all numbers.",
    "The frames were processed: a dark frame or a bias was subtracted. Noise and dark level are not those of the "
    "camera alone; the black level contains the constant.",
    "Use the frames as the camera wrote them.",
    ("black_level_dn", "read_noise_*", "dsnu*", "dark_current*"),
    "constant that is added, DN",
    "none: numbers are compared",
)
FRACTIONAL_NUMBERS = DiagnosticKind(
    "fractional-numbers",
    "warning",
    "Frames have numbers with fractions. They are rounded, or scaled and rounded.",
    "Averages of frames have less noise than a frame, and frames that were divided by a flat field have no PRNU. The "
    "results are those of the processed numbers.",
    "Use the frames as the camera wrote them.",
    ("read_noise_*", "system_gain_dn_per_e", "prnu*", "dsnu*"),
    "factor of the numbers",
    "none: numbers are compared",
)
SHIFTED_NUMBERS = DiagnosticKind(
    "numbers-shifted-down",
    "note",
    "The numbers are those of the stated bits, shifted up to fill more bits.",
    "They are shifted down, without loss.",
    "None. Without the stated bits, the numbers are read as they are stored.",
    size="bits of the shift",
    false_alarms="none: each number is compared",
)

_WRAPS_BELOW = -16384
_MOST = 65535
_FEW_LEVELS = 255
"""Range of numbers with fractions below which they are scaled: rounding would lose the noise."""


@dataclass(frozen=True)
class NumberRange:
    """The lowest and highest numbers of frames, whether all are whole, and the bits that none of them has set."""

    lowest: float
    highest: float
    whole: bool
    clear_bits: int

    @classmethod
    def of(cls, name: str | PathLike[str], stored: NDArray[Any]) -> NumberRange:
        """Return the range of a frame; raise `FileError` for values that are no numbers."""
        lowest, highest = float(stored.min()), float(stored.max())
        if not np.isfinite((lowest, highest)).all():
            raise FileError(name, "the frame has pixels without a number (NaN or infinite)")
        whole = stored.dtype.kind in "iu" or bool((stored == np.rint(stored)).all())
        bits = int(np.bitwise_or.reduce(stored, axis=None)) if stored.dtype.kind in "iu" else 1
        return cls(lowest, highest, whole, (bits & -bits).bit_length() - 1 if bits else 0)

    def join(self, other: NumberRange) -> NumberRange:
        """Return the range of both."""
        return NumberRange(
            min(self.lowest, other.lowest),
            max(self.highest, other.highest),
            self.whole and other.whole,
            min(self.clear_bits, other.clear_bits),
        )


@dataclass(frozen=True)
class Conversion:
    """Digital numbers of stored ones: (stored * factor + added), or the low 16 bits, or shifted down.

    Parameters
    ----------
    added, factor
        Constant and factor of the numbers.
    wrapped
        Whether negative numbers are those from 32768 on.
    shift
        Bits by which the numbers are shifted down.
    whole
        Whether all numbers are whole.
    below_zero
        Whether numbers of 16 bits from 32768 on are those below 0, less 65536.
    """

    added: int = 0
    factor: float = 1.0
    wrapped: bool = False
    shift: int = 0
    whole: bool = True
    below_zero: bool = False

    @property
    def plain(self) -> bool:
        """Whether the digital numbers are the stored ones."""
        return self == Conversion()

    def apply(self, name: str | PathLike[str], stored: NDArray[Any]) -> Numbers:
        """Return the digital numbers of stored ones.

        Raises
        ------
        FileError
            If a number has no digital number: it is negative, too large, or has a fraction where others have none.

        Examples
        --------
        >>> Conversion(added=4).apply("a.tif", np.array([[-3, 5]], np.int16))
        array([[1, 9]], dtype=uint16)
        >>> Conversion(wrapped=True).apply("a.tif", np.array([[-3, 5]], np.int16))
        array([[65533,     5]], dtype=uint16)
        """
        if self.below_zero:
            stored = as_signed(stored)
        if self.wrapped:
            return stored.astype(np.int64).astype(np.uint16)
        if self.shift:
            if (stored & ((1 << self.shift) - 1)).any():
                expected = f"multiples of {1 << self.shift}, as in the other frames, whose numbers are shifted"
                raise FileError(name, "dn", expected=expected)
            shifted: Any = stored >> self.shift
            return shifted  # type: ignore[no-any-return]
        if stored.dtype.kind == "u" and self.plain:
            return stored
        if self.whole and stored.dtype.kind == "f" and not (stored == np.rint(stored)).all():
            raise FileError(name, "the frame has numbers with fractions, and the frames that were read first have none")
        numbers = np.rint(stored.astype(np.float64) * self.factor) + self.added
        lowest, highest = float(numbers.min()), float(numbers.max())
        most = (1 << 32) - 1 if stored.dtype.itemsize >= 4 and stored.dtype.kind != "f" else _MOST
        if lowest < 0 or not highest <= most:
            value = lowest - self.added if lowest < 0 else highest
            signed = "" if stored.dtype.kind == "u" else f", after {self.added} is added" if self.added else ""
            raise FileError(name, "dn", value=value, expected=f"0 to {most}{signed}")
        return numbers.astype(np.uint32) if most > _MOST else numbers.astype(np.uint16)

    def bits(self, bits: int | None, found: NumberRange) -> int | None:
        """Return the bit depth of the digital numbers, for numbers of stated bits."""
        if bits is None or not self.added:
            return bits
        return min(max(bits, (int(found.highest) + self.added).bit_length()), 16)


MOST_BELOW_ZERO = 1024
"""Magnitude of the lowest number of a dark frame that is stored as an unsigned one."""


def falls_below_zero(dark: NDArray[Any]) -> bool:
    """Return whether numbers below 0 of a dark frame are stored as unsigned ones: -1 as 65535.

    They go on from 0 to 65535, 65534 and 65533, where saturated pixels are all alike, and nothing lies between.

    Examples
    --------
    >>> numbers = np.rint(np.random.default_rng(1).normal(1.0, 2.0, (40, 50))).astype(np.int16)
    >>> falls_below_zero(numbers.view(np.uint16)), falls_below_zero((numbers + 9).view(np.uint16))
    (True, False)
    """
    if dark.dtype != np.uint16 or int(dark.max()) < (1 << 16) - 3:
        return False
    counts = np.bincount(dark.ravel(), minlength=1 << 16)
    near, between = int(counts[-MOST_BELOW_ZERO:].sum()), int(counts[1 << 14 : -MOST_BELOW_ZERO].sum())
    return bool(counts[:3].all() and counts[-3:].all() and counts[-1] < 0.9 * near and between < 0.1 * near)


def as_signed(stored: NDArray[Any]) -> NDArray[np.int16]:
    """Return unsigned numbers of 16 bits as signed ones of the same bits."""
    return np.ascontiguousarray(stored, np.uint16).view(np.int16)


def conversion_of(found: NumberRange, kind: NumberKind, bits: int | None, stored_bits: int | None) -> Conversion:
    """Return the conversion of numbers of a range.

    Parameters
    ----------
    found
        Range of the numbers.
    kind
        How they are stored.
    bits
        The stated bit depth, None if none is stated.
    stored_bits
        Bits per number in the file.
    """
    if kind == "unsigned":
        if bits is None or stored_bits is None or found.highest < 1 << bits or found.clear_bits != stored_bits - bits:
            return Conversion()
        return Conversion(shift=max(stored_bits - bits, 0))
    if kind == "signed" and stored_bits == 16 and found.lowest <= _WRAPS_BELOW:
        return Conversion(wrapped=True)
    factor = 1.0 if found.whole else _factor(found)
    added = 1 << max(int(np.ceil(-found.lowest * factor)) - 1, 0).bit_length() if found.lowest < 0 else 0
    return Conversion(added, factor, whole=found.whole)


def _factor(found: NumberRange) -> float:
    """Return the factor of numbers with fractions: 1, or what makes a small range that of 16 bits."""
    span = found.highest - min(found.lowest, 0.0)
    if span >= _FEW_LEVELS:
        return 1.0
    return float(_MOST) if span <= 1.0 and found.lowest >= 0 else (_MOST // 2) / span


def conversion_diagnostics(conversion: Conversion, found: NumberRange, bits: int | None) -> tuple[Diagnostic, ...]:
    """Return what a conversion changes, as diagnostics."""
    entries = []
    if conversion.wrapped:
        text = f"the numbers are stored as signed ones, down to {found.lowest:g}; they are read as 0 to 65535"
        entries.append(WRAPPED_NUMBERS(text))
    if not conversion.whole:
        scaled = "rounded" if conversion.factor == 1 else f"multiplied by {conversion.factor:.6g} and rounded"
        text = (
            f"the frames have numbers with fractions, from {found.lowest:g} to {found.highest:g}, which are {scaled}: "
            "they were processed (averages? divided by a flat field?)"
        )
        entries.append(FRACTIONAL_NUMBERS(text, conversion.factor))
    if conversion.added:
        text = (
            f"the frames have negative numbers, down to {found.lowest:g}; {conversion.added} is added to all numbers "
            "and to the black level. A dark frame or a bias was subtracted"
        )
        entries.append(NEGATIVE_NUMBERS(text, float(conversion.added)))
    if conversion.shift:
        text = (
            f"the numbers are multiples of {1 << conversion.shift}: {bits} bits, shifted up by {conversion.shift}, and "
            "are shifted down"
        )
        entries.append(SHIFTED_NUMBERS(text, float(conversion.shift)))
    return tuple(entries)


def joined(ranges: Iterable[NumberRange]) -> NumberRange:
    """Return the range of several frames."""
    first, *others = ranges
    for other in others:
        first = first.join(other)
    return first
