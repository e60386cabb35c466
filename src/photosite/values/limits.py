"""Magnitudes that values in a unit can have: physically wide, so that arithmetic with them stays finite."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from photosite.errors import InputError
from photosite.values.uncertain import Measured

_SMALLEST = 1e-100

LIMITS: Mapping[str, tuple[float, float]] = {
    "1": (_SMALLEST, 1e9),
    "%": (_SMALLEST, 1e6),
    "um": (1e-4, 1e3),
    "nm": (1.0, 1e6),
    "deg": (_SMALLEST, 360.0),
    "deg C": (_SMALLEST, 1000.0),
    "s": (_SMALLEST, 1e9),
    "e-": (_SMALLEST, 1e12),
    "e-/s": (_SMALLEST, 1e15),
    "us": (_SMALLEST, 1e9),
    "mm": (_SMALLEST, 1e5),
    "LSB": (_SMALLEST, 1e6),
    "frames": (_SMALLEST, 1e9),
    "1, DN or e-/s": (_SMALLEST, 1e15),
    "V": (_SMALLEST, 1e6),
    "mV": (_SMALLEST, 1e9),
    "mV/s": (_SMALLEST, 1e12),
    "uV/e-": (1e-6, 1e9),
    "DN": (_SMALLEST, 1e10),
    "DN/s": (_SMALLEST, 1e15),
    "DN/e-": (1e-9, 1e9),
    "e-/DN": (1e-9, 1e9),
}
"""Unit -> the smallest magnitude of values other than 0, and the largest."""


LIMITS_BY_NAME: Mapping[str, tuple[float, float]] = {
    "f_number": (0.1, 1e4),
    "_m": (1e-9, 1e20),
    "_nm": (1e-6, 1e6),
    "_c": (_SMALLEST, 1e4),
    "_percent": (_SMALLEST, 1e9),
}
"""The same by the end of a field's name, for fields that state no unit; for other names, see `LIMITS_OF_OTHERS`."""
LIMITS_OF_OTHERS = (_SMALLEST, 1e15)


def check_magnitude(name: str, value: Any, unit: str | None = None) -> None:
    """Raise `InputError` if a number, or one of a table, is outside the limits of its unit.

    Parameters
    ----------
    name
        Name of the field.
    value
        A number, a `Measured`, or sequences and mappings of them; others are not checked.
    unit
        Unit of the field; units without limits are not checked. None: the limits follow from the name, and only finite
        floats are checked.

    Examples
    --------
    >>> check_magnitude("pixel_width_um", Measured(6.1), "um")
    >>> check_magnitude("pixel_width_um", 65_536, "um")
    Traceback (most recent call last):
    photosite.errors.InputError: pixel_width_um must be 0 or from 0.0001 to 1000 um in magnitude, got 65536
    >>> check_magnitude("distance_m", 1e300)
    Traceback (most recent call last):
    photosite.errors.InputError: distance_m must be 0 or from 1e-09 to 1e+20 in magnitude, got 1e+300
    """
    if unit is None:
        smallest, largest = next((at for end, at in LIMITS_BY_NAME.items() if name.endswith(end)), LIMITS_OF_OTHERS)
    elif unit in LIMITS:
        smallest, largest = LIMITS[unit]
    else:
        return
    for number, least in _numbers(value, smallest):
        if unit is None and not (isinstance(number, float) and math.isfinite(number)):
            continue
        if not (number == 0.0 or least <= abs(number) <= largest):
            in_unit = f" {unit}" if unit not in (None, "1") else ""
            raise InputError(name, value=number, expected=f"0 or from {least:g} to {largest:g}{in_unit} in magnitude")


def _numbers(value: Any, smallest: float) -> Iterator[tuple[float, float]]:
    """Yield the numbers of a value, each with its smallest magnitude."""
    if isinstance(value, Measured):
        yield value.value, smallest
        yield value.standard_uncertainty, _SMALLEST
    elif isinstance(value, Mapping):
        for entry in value.values():
            yield from _numbers(entry, smallest)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for entry in value:
            yield from _numbers(entry, smallest)
    elif isinstance(value, int | float):
        yield value, smallest
