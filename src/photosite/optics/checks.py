"""Checks of the arguments that describe a lens: types, ranges, arrays, wavelengths, and lengths in a wrong unit."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.spectrum import wavelength_grid
from photosite.errors import InputError
from photosite.values.limits import check_magnitude

SHORTEST_FOCAL_MM = 0.2
"""Endoscope lenses reach 0.3; 0.05 is 50 mm given in m."""
LOWEST_F_NUMBER = 0.5
"""Limit of a lens in air that is free of coma: the sine of the half angle of its cone is 1 / 2N."""
LOWEST_HEIGHT_MM = 0.05
"""Smallest last image height of a table; the corner of a full frame given in m is 0.022."""
_SHORTEST_NM = 100.0


def check_type(name: str, value: Any, kind: type, example: str) -> None:
    """Raise `InputError` unless the value is an instance of the class; `example` shows how to make one."""
    if not isinstance(value, kind):
        raise InputError(name, value=value, expected=f"a {kind.__name__}, such as {example}")


def check_number(
    name: str,
    value: Any,
    expected: str = "a finite number",
    *,
    above: float = -math.inf,
    below: float = math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    hint: str | None = None,
) -> None:
    """Raise `InputError` unless the value is one number within the bounds, which `expected` states in words.

    Booleans and text are not numbers; NumPy scalars are.

    Examples
    --------
    >>> check_number("f_number", -1, "above 0", above=0)
    Traceback (most recent call last):
    photosite.errors.InputError: f_number must be above 0, got -1
    """
    number = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
    valid = isinstance(number, Real) and not isinstance(number, bool | np.bool_)
    if not (valid and above < number < below and at_least <= number <= at_most and math.isfinite(number)):
        raise InputError(name, value=value, expected=expected, hint=hint)
    check_magnitude(name, float(number))


def check_whole(name: str, value: Any, expected: str, at_least: int, at_most: int) -> None:
    """Raise `InputError` unless the value is one whole number within the bounds, which `expected` states in words."""
    if not isinstance(value, Integral):
        raise InputError(name, value=value, expected=expected)
    check_number(name, value, expected, at_least=at_least, at_most=at_most)


def number_array(name: str, values: ArrayLike | None, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """Return a list or array of real numbers as floats, of one dimension or more; raise `InputError` for other values.

    With `shape`, the numbers must be finite and have that shape: one for each point of the field.
    """
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):  # rows of different lengths
        array = np.array("ragged")
    if values is None or array.dtype.kind not in "fiu":
        raise InputError(name, value=values, expected="an array of real numbers")
    array = np.atleast_1d(array.astype(np.float64))
    if array.size:  # the largest and smallest stand for all
        check_magnitude(name, [float(array.min()), float(array.max())])
    if shape is None:
        return array
    if array.shape != shape:
        raise InputError(name, value=array.shape, expected=f"an array of shape {shape}, one value per field point")
    if (wrong := np.argwhere(~np.isfinite(array))).size:
        index = tuple(wrong[0])
        raise InputError(f"{name}[{', '.join(map(str, index))}]", value=array[index], expected="a finite number")
    return array


def camera_wavelengths(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Return increasing wavelengths as an array; raise `InputError` for others, or below 100 nm, as um are."""
    try:
        grid = wavelength_grid(wavelength_nm)
    except InputError:
        raise
    except (TypeError, ValueError):
        raise InputError("wavelength_nm", value=wavelength_nm, expected="a list of positive numbers in nm") from None
    if grid[0] < _SHORTEST_NM:
        hint = "If the values are in um, multiply them by 1000"
        raise InputError("wavelength_nm", value=grid[0], expected=f"{_SHORTEST_NM:g} nm or more", hint=hint)
    return grid


def check_height_unit(name: str, last_mm: float) -> None:
    """Raise `InputError` for image heights that end within 0.05 mm of the axis, as heights given in m do."""
    if 0 < last_mm < LOWEST_HEIGHT_MM:
        expected = f"image heights up to {LOWEST_HEIGHT_MM} mm or more"
        raise InputError(name, value=last_mm, expected=expected, hint="If the heights are in m, multiply them by 1000")
