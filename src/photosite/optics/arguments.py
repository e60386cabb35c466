"""What arguments of lenses are, checked where they are given: a line names the argument, what came, and what goes.

Values are checked by whoever owns them; here stand kinds of things and units that one sees from the size of a number.
"""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any, NoReturn

import numpy as np

from photosite.errors import InputError

SHORTEST_FOCAL_MM = 0.2
"""The shortest lenses of endoscopes have 0.3; 0.05 is 50 mm in m."""
LOWEST_F_NUMBER = 0.5
"""Of a lens in air, free of coma: the sine of its cone's half angle is 1 / 2N."""
LOWEST_HEIGHT_MM = 0.05
"""Of a table's last image height: a full frame's corner is 0.022 m from the axis."""


def check_kind(of: str, name: str, value: Any, kinds: type | tuple[type, ...], expected: str) -> None:
    """Refuse what is not of a kind.

    Parameters
    ----------
    of, name
        Whose argument it is, and its name.
    value
        What came.
    kinds
        Types that go.
    expected
        These in words, with how one is made.

    Raises
    ------
    InputError
        If it is of none of them.

    Examples
    --------
    >>> check_kind("Lens", "name", 50, str, "a text")
    Traceback (most recent call last):
    photosite.errors.InputError: Lens: name is a text, not 50
    """
    if not isinstance(value, kinds):
        _refuse(of, name, value, expected)


def _refuse(of: str, name: str, value: Any, expected: str) -> NoReturn:
    came = f"the class {value.__name__}" if isinstance(value, type) else f"{' '.join(repr(value).split()):.60}"
    raise InputError(f"{of}: {name} is {expected}, not {came}")


def check_numbers(of: Any, *names: str, whole: bool = False) -> None:
    """Refuse attributes that are no numbers: text, lists, true and false.

    Parameters
    ----------
    of
        The object.
    names
        Of its attributes.
    whole
        Whether whole ones are asked for.

    Raises
    ------
    InputError
        If one is none.
    """
    for name in names:
        value = getattr(of, name)
        number = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
        kind, what = (Integral, "a whole number") if whole else (Real, "a number")
        if isinstance(number, bool | np.bool_):  # to Python a kind of whole number
            _refuse(type(of).__name__, name, bool(number), what)
        check_kind(type(of).__name__, name, number, kind, what)


def check_height_unit(name: str, last_mm: float) -> None:
    """Refuse image heights that end within 0.05 mm of the axis, as those in m do.

    Raises
    ------
    InputError
        If they do.
    """
    if 0 < last_mm < LOWEST_HEIGHT_MM:
        raise InputError(
            f"{name} ends at {last_mm:g} mm from the axis, which no sensor's corner does: if that is in m, multiply by "
            "1000"
        )
