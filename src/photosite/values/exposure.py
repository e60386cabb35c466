"""Exposure times: validation, and text such as 1/8000."""

from __future__ import annotations

import math
from fractions import Fraction
from numbers import Real
from typing import Any

from photosite.errors import InputError

_EXPECTED = "a number of seconds above 0"
_HINT = "Give seconds, such as 0.005 or 1/8000"


def check_exposure(exposure_s: Any) -> float:
    """Return an exposure time as a float.

    Raises
    ------
    InputError
        If it is not a finite number above 0. Text is for `parse_exposure`.

    Examples
    --------
    >>> check_exposure(1 / 4)
    0.25
    """
    # NumPy's numbers register as Real; its booleans do not, but Python's do.
    number = isinstance(exposure_s, Real) and not isinstance(exposure_s, bool)
    if not (number and math.isfinite(exposure_s) and exposure_s > 0):
        raise InputError("exposure_s", value=exposure_s, expected=_EXPECTED, hint=_HINT)
    return float(exposure_s)


def parse_exposure(text: Any) -> float:
    """Return an exposure time in seconds from a number or from text such as 1/8000, 0.005 or 5e-3.

    Raises
    ------
    InputError
        If it is not a finite number above 0.

    Examples
    --------
    >>> parse_exposure("1/8000")
    0.000125
    """
    if not isinstance(text, str):
        return check_exposure(text)
    try:
        # A fraction of decimals would be computed digit by digit, a billion of them for 1e999999999.
        seconds = float(Fraction(text)) if "/" in text else float(text)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError("exposure_s", value=text, expected=_EXPECTED, hint=_HINT) from None
    return check_exposure(seconds)


def format_exposure(exposure_s: float) -> str:
    """Return an exposure time as text that `parse_exposure` reads back exactly: 1/n where that is exact, else decimal.

    Examples
    --------
    >>> format_exposure(1 / 8000), format_exposure(0.3), format_exposure(30.0)
    ('1/8000', '0.3', '30')
    """
    if 0 < exposure_s < 1:
        denominator = round(1 / exposure_s)
        if denominator < 1_000_000 and 1 / denominator == exposure_s and len(str(denominator)) < len(repr(exposure_s)):
            return f"1/{denominator}"
    return repr(float(exposure_s)).removesuffix(".0")
