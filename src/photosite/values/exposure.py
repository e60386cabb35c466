"""Exposure times: checked, and read as people write them."""

from __future__ import annotations

import math
from fractions import Fraction
from numbers import Real

from photosite.errors import InputError


def check_exposure(exposure_s: float) -> float:
    """The exposure time as a float, if it can be one.

    Raises
    ------
    InputError
        If it is not a number, or not finite and above 0. Text is for `parse_exposure`.

    Examples
    --------
    >>> check_exposure(1 / 4)
    0.25
    """
    # NumPy's numbers register as Real; its booleans do not, and Python's are whole numbers.
    if isinstance(exposure_s, bool) or not isinstance(exposure_s, Real):
        raise InputError(f"exposure_s is a number of seconds, such as 0.005 or 1 / 8000, not {exposure_s!r}")
    if not (math.isfinite(exposure_s) and exposure_s > 0):
        raise InputError(f"an exposure time must be above 0 s, not {exposure_s}")
    return float(exposure_s)


def parse_exposure(text: str | float) -> float:
    """An exposure time in seconds from a number or from text such as 1/8000, 0.005 or 5e-3.

    Raises
    ------
    InputError
        If it is not a number, or not finite and above 0.

    Examples
    --------
    >>> parse_exposure("1/8000")
    0.000125
    """
    try:
        # A fraction of decimals would be computed digit by digit, a billion of them for 1e999999999.
        seconds = float(Fraction(text)) if isinstance(text, str) and "/" in text else float(text)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(f"an exposure time is seconds, such as 0.005 or 1/8000, not '{text}'") from None
    return check_exposure(seconds)


def format_exposure(exposure_s: float) -> str:
    """An exposure time as `parse_exposure` reads it back, bit for bit: 1/n where that is exact, else decimal.

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
