"""Exposure times: validation, and text such as 1/8000 or 0.5 ms."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from fractions import Fraction
from numbers import Real
from typing import Any

from photosite.errors import InputError

SHORTEST_S, LONGEST_S = 1e-15, 1e9
_EXPECTED = f"a number of seconds above 0, from {SHORTEST_S:g} to {LONGEST_S:g}"
_HINT = "Write 0.005, 1/200, 5ms or 5000us"

PER_SECOND = {"s": 1, "sec": 1, "ms": 10**3, "us": 10**6, "µs": 10**6, "μs": 10**6, "ns": 10**9}
"""Units of exposure times, and how many of them make a second."""

_TEXT = re.compile(
    rf"(?:(?:exposure|exp)[_= ]*)?(?P<number>[^\s_a-z]+(?:e[+-]?\d+)?)[ _]?(?P<unit>{'|'.join(PER_SECOND)})?"
)


def check_exposure(exposure_s: Any) -> float:
    """Return an exposure time as a float.

    Raises
    ------
    InputError
        If it is not a number from `SHORTEST_S` to `LONGEST_S`. Text is for `parse_exposure`.

    Examples
    --------
    >>> check_exposure(1 / 4)
    0.25
    """
    # NumPy's numbers register as Real; its booleans do not, but Python's do.
    number = isinstance(exposure_s, Real) and not isinstance(exposure_s, bool)
    if not (number and SHORTEST_S <= exposure_s <= LONGEST_S):
        raise InputError("exposure_s", value=exposure_s, expected=_EXPECTED, hint=_HINT)
    return float(exposure_s)


def check_start(start_s: Any) -> float:
    """Return the time at which a frame starts as a float; raise `InputError` if it is not a finite number."""
    if isinstance(start_s, bool | str) or not math.isfinite(start_s):
        raise InputError("start_s", value=start_s, expected="a finite number of seconds")
    return float(start_s)


def exposure_sequence(exposures_s: Any, frames: int, first_frame: int) -> list[tuple[float, range]]:
    """Return each exposure time of a sequence with the numbers of its frames.

    Parameters
    ----------
    exposures_s
        One exposure time, or several.
    frames, first_frame
        Frames at each of them, and number of the first frame.

    Raises
    ------
    InputError
        If an exposure time is invalid, or `frames` is below 1.

    Examples
    --------
    >>> exposure_sequence([1 / 4, 1 / 2], frames=2, first_frame=5)
    [(0.25, range(5, 7)), (0.5, range(7, 9))]
    """
    if frames < 1:
        raise InputError("frames", value=frames, expected="1 or more")
    times = exposures_s if isinstance(exposures_s, Iterable) and not isinstance(exposures_s, str) else [exposures_s]
    first = range(first_frame, first_frame + frames)
    return [
        (check_exposure(time_s), range(first.start + n * frames, first.stop + n * frames))
        for n, time_s in enumerate(times)
    ]


def parse_exposure(text: Any) -> float:
    """Return an exposure time in seconds from a number or from text.

    Parameters
    ----------
    text
        A number of seconds, or text: a decimal number or a fraction, then a unit of `PER_SECOND`; seconds without one.
        A prefix "exp" or "exposure" is allowed, as in file names.

    Raises
    ------
    InputError
        If it is not a number from `SHORTEST_S` to `LONGEST_S`.

    Examples
    --------
    >>> [parse_exposure(text) for text in ("1/8000", "0.5ms", "5 ms", "1/60 s", "exp0.001")]
    [0.000125, 0.0005, 0.005, 0.016666666666666666, 0.001]
    """
    if not isinstance(text, str):
        return check_exposure(text)
    found = _TEXT.fullmatch(text.strip().lower())
    try:
        if found is None:
            raise ValueError
        number = found["number"]
        # A fraction of decimals would be computed digit by digit, a billion of them for 1e999999999.
        seconds = float(Fraction(number)) if "/" in number else float(number)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError("exposure_s", value=text, expected=_EXPECTED, hint=_HINT) from None
    return check_exposure(seconds / PER_SECOND[found["unit"] or "s"])


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
