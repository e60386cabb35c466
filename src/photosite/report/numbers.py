"""Format numbers for readers: rounded to their uncertainty, with a true minus sign."""

from __future__ import annotations

import math

from photosite.errors import InputError

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_NARROW_SPACE = "\u202f"
_NO_BREAK = "\u00a0"
_TIMES = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def format_number(value: float, significant: int = 4) -> str:
    r"""Format a number with some significant digits; raise `InputError` if it is not finite.

    Examples
    --------
    >>> format_number(-0.0123456), format_number(0.00001234), format_number(4095, 3)
    ('−0.01235', '1.234\xa0×\xa010⁻⁵', '4095')
    """
    if value == 0:
        return "0"
    exponent = _exponent(value, significant)
    if exponent < -4 or exponent > 6:
        return f"{_fixed(value / 10.0**exponent, significant - 1)}{_power(exponent)}"
    return _fixed(value, max(significant - 1 - exponent, 0))


def format_duration(seconds: float) -> str:
    """Format a duration in the unit that people use: seconds, minutes, hours or days.

    Examples
    --------
    >>> [format_duration(seconds) for seconds in (0, 0.25, 36.6, 600, 5399, 8100, 300_000)]
    ['0 s', '0.25 s', '37 s', '10 min', '1 h 30 min', '2 h 15 min', '3 d 11 h']
    """
    if seconds < 10:
        return f"{seconds:.2g} s"
    if seconds < 90:
        return f"{round(seconds)} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    parts = (*divmod(minutes, 60), "h", "min") if minutes < 48 * 60 else (*divmod(round(seconds / 3600), 24), "d", "h")
    whole, rest, unit, smaller = parts
    return f"{whole} {unit} {rest} {smaller}" if rest else f"{whole} {unit}"


def format_uncertain(value: float, standard_uncertainty: float) -> str:
    r"""Format a value with its standard uncertainty, rounded to two significant digits of the uncertainty.

    An exact value, of uncertainty 0, is shown alone, with six digits.

    Raises
    ------
    InputError
        If a number is not finite or the uncertainty is negative.

    References
    ----------
    JCGM 100:2008 (GUM), 7.2.2 and 7.2.6.

    Examples
    --------
    >>> format_uncertain(0.52184, 0.00336), format_uncertain(35987.2, 412.0)
    ('0.5218 ± 0.0034', '35\u202f990 ± 410')
    >>> format_uncertain(-1.2e-6, 3.44e-6)
    '(−1.2 ± 3.4)\xa0×\xa010⁻⁶'
    """
    if not (math.isfinite(standard_uncertainty) and standard_uncertainty >= 0):
        raise InputError("standard_uncertainty", value=standard_uncertainty, expected="finite and 0 or more")
    if standard_uncertainty == 0:
        whole, point, rest = format_number(value, 6).partition(".")
        return whole + point + rest if "×" in rest else f"{whole}.{rest}".rstrip("0").rstrip(".")
    _finite(value)
    return _pair(value, " ± ", standard_uncertainty, standard_uncertainty)


def format_interval(lower: float, upper: float, standard_uncertainty: float) -> str:
    """Format the ends of an interval, to the last digit of the standard uncertainty rounded to two digits.

    Examples
    --------
    >>> format_interval(0.51524, 0.52843, 0.00336)
    '0.5152 to 0.5284'
    >>> format_interval(2.0, 2.0, 0.0)
    'exact'
    """
    if standard_uncertainty == 0:
        return "exact"
    return _pair(lower, " to ", upper, standard_uncertainty)


def format_time(seconds: float) -> str:
    r"""Format a positive time in s, ms or µs, with four digits.

    Examples
    --------
    >>> format_time(4e-5), format_time(0.01402), format_time(30.0)
    ('40\xa0µs', '14.02\xa0ms', '30\xa0s')
    """
    _finite(seconds)
    scale, unit = next((pair for pair in _TIMES if seconds >= pair[0]), _TIMES[-1])
    return f"{seconds / scale:.4g}{_NO_BREAK}{unit}"


def _finite(value: float) -> None:
    if not math.isfinite(value):
        raise InputError("value", value=value, expected="finite")


def _exponent(value: float, significant: int) -> int:
    """Return the decimal exponent of the number rounded to `significant` digits."""
    _finite(value)
    return int(f"{value:.{significant - 1}e}".split("e")[1])


def _pair(first: float, between: str, second: float, uncertainty: float) -> str:
    """Format two numbers to the second digit of the uncertainty, with a common power of ten if it is large or small."""
    digits = 1 - _exponent(uncertainty, 2)
    largest = _exponent(max(abs(first), abs(second)), 2)
    if -3 <= largest <= 7:
        return f"{_fixed(first, digits)}{between}{_fixed(second, digits)}"
    scale, digits = 10.0**largest, digits + largest
    return f"({_fixed(first / scale, digits)}{between}{_fixed(second / scale, digits)}){_power(largest)}"


def _fixed(value: float, digits: int) -> str:
    """Format in fixed point; negative `digits` round to tens, hundreds, ..."""
    _finite(value)
    text = f"{round(value, digits):.{max(digits, 0)}f}"
    sign = "−" if text.startswith("-") and float(text) != 0 else ""
    whole, _, fraction = text.removeprefix("-").partition(".")
    if len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", _NARROW_SPACE)
    return f"{sign}{whole}.{fraction}" if fraction else sign + whole


def _power(exponent: int) -> str:
    """Return a factor of a power of ten, with non-breaking spaces."""
    return f"{_NO_BREAK}×{_NO_BREAK}10{str(exponent).translate(_SUPERSCRIPTS)}"
