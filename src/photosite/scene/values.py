"""What kinds of values the options of scenes are: numbers, yes or no; anything else is refused in one line."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np

from photosite.errors import InputError

_BRIGHTEST_CD_M2 = 1e20


def is_number(value: Any) -> bool:
    """Whether a value is a number, not text that looks like one and not true or false."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def check_number(name: str, value: Any, *, whole: bool = False) -> None:
    """Refuse what is no number; None, where nothing is said, passes.

    Raises
    ------
    InputError
        If the value is no number, or no whole one where it has to be.

    Examples
    --------
    >>> check_number("tolerance", "abc")
    Traceback (most recent call last):
    photosite.errors.InputError: tolerance is a number, not 'abc'
    """
    if value is not None and not (is_number(value) and (isinstance(value, Integral) or not whole)):
        raise InputError(f"{name} is a {'whole ' if whole else ''}number, not {value!r:.40}")


def check_luminance(name: str, value: float) -> None:
    """Refuse a luminance that is none, or that no light has: the sun's disc has 1.6e9 cd/m2.

    Raises
    ------
    InputError
        If it is not above 0, or above 1e20.

    Examples
    --------
    >>> check_luminance("mean_luminance_cd_m2", 1e300)
    Traceback (most recent call last):
    photosite.errors.InputError: mean_luminance_cd_m2 must be above 0 and at most 1e+20, not 1e+300
    """
    if not 0 < value <= _BRIGHTEST_CD_M2:
        most = f" and at most {_BRIGHTEST_CD_M2:g}" if value > _BRIGHTEST_CD_M2 else ""
        raise InputError(f"{name} must be above 0{most}, not {value:g}")


def check_flag(name: str, value: Any) -> None:
    """Refuse what is neither true nor false: the text 'no' would count as yes.

    Raises
    ------
    InputError
        If it is neither.

    Examples
    --------
    >>> check_flag("sort_bands", "no")
    Traceback (most recent call last):
    photosite.errors.InputError: sort_bands is true or false, not 'no'
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} is true or false, not {value!r:.40}")


def check_numbers(name: str, values: Any) -> None:
    """Refuse what is no list of finite numbers.

    Raises
    ------
    InputError
        If it is empty, no list, or holds what is no number.

    Examples
    --------
    >>> check_numbers("wavelength_nm", "400:700:10")
    Traceback (most recent call last):
    photosite.errors.InputError: wavelength_nm is a list of numbers, such as [400, 410, 420], not '400:700:10'
    """
    try:
        numbers = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.size == 0 or isinstance(values, str) or not np.isfinite(numbers).all():
        raise InputError(f"{name} is a list of numbers, such as [400, 410, 420], not {values!r:.40}")
