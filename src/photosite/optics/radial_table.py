"""Where a table over the field is given: at image heights on the sensor, or at field angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_height_unit

Array = NDArray[np.float64]

_RIGHT_ANGLE_DEG = 90.0


@dataclass(frozen=True, eq=False)
class FieldPoints:
    """Places along a radius of the image, from the axis outwards. One of the two is given.

    Parameters
    ----------
    height_mm
        (n,) increasing from 0 or more: distances from the axis on the sensor.
    angle_deg
        (n,) increasing from 0 or more: angles from the axis in front of the lens, below 90.

    Raises
    ------
    InputError
        If both or none is given, values do not increase, are negative or not finite, or heights end below 0.05 mm, as
        those in m do.

    Examples
    --------
    >>> FieldPoints(angle_deg=[0, 45]).ideal_m(0.05).round(4)
    array([0.  , 0.05])
    """

    height_mm: Array | None = None
    angle_deg: Array | None = None

    def __post_init__(self) -> None:
        if (self.height_mm is None) == (self.angle_deg is None):
            raise InputError("places in the field are height_mm or angle_deg: give one of the two")
        name, given = ("height_mm", self.height_mm) if self.angle_deg is None else ("angle_deg", self.angle_deg)
        values = numbers(name, given)
        if not values.size:
            raise InputError(f"{name} is empty; a table has one place in the field or more")
        if values.ndim != 1 or not np.isfinite(values).all() or values[0] < 0 or (np.diff(values) <= 0).any():
            raise InputError(f"{name} must increase from 0 or more; sort the table by it, one side of the axis only")
        if name == "angle_deg" and values[-1] >= _RIGHT_ANGLE_DEG:
            raise InputError(f"angle_deg must stay below 90, not reach {values[-1]:g}; a fisheye needs height_mm")
        if name == "height_mm":
            check_height_unit(name, float(values[-1]))
        object.__setattr__(self, name, values)

    @property
    def size(self) -> int:
        """n."""
        return self._values.size

    @property
    def starts_on_axis(self) -> bool:
        """Whether the first is the axis."""
        return bool(self._values[0] == 0)

    @property
    def _values(self) -> Array:
        values = self.angle_deg if self.height_mm is None else self.height_mm
        assert values is not None
        return values

    def ideal_m(self, image_distance_m: float) -> Array:
        """(n,) heights: as given, or image distance times the tangent of the angle."""
        if self.height_mm is not None:
            return self.height_mm * 1e-3
        return image_distance_m * np.tan(np.radians(self._values))


def check_values(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Values of a table as floats, finite and of a shape.

    Raises
    ------
    InputError
        If they are not.
    """
    array = np.asarray(numbers(name, values))
    if array.shape != shape:
        raise InputError(f"{name} needs numbers of shape {shape}, one for each place in the field, not {array.shape}")
    if (wrong := np.argwhere(~np.isfinite(array))).size:
        where = ", ".join(str(index + 1) for index in wrong[0])
        raise InputError(f"{name} needs finite numbers; number {where} is {array[tuple(wrong[0])]}")
    return array


def numbers(name: str, values: ArrayLike | None) -> Array:
    """A list or array of numbers as floats, of one dimension or more.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        array = np.asarray(values) if values is not None else np.array("none")
    except (TypeError, ValueError):  # lists whose lengths differ
        array = np.array("ragged")
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} is a list of numbers, not {' '.join(repr(values).split()):.60}")
    return np.atleast_1d(array.astype(np.float64))


def even_curve(height_m: Array, values: Array, at_m: Array) -> Array:
    """An even function of height: a monotone cubic (Fritsch and Carlson 1980) in its square; ends are held.

    Examples
    --------
    >>> even_curve(np.array([0.0, 1.0]), np.array([1.0, 0.5]), np.array([0.0, 0.5, 1.0, 2.0]))
    array([1.   , 0.875, 0.5  , 0.5  ])
    """
    from scipy.interpolate import PchipInterpolator

    if height_m.size == 1:
        return np.full(np.shape(at_m), values[0])
    curve = PchipInterpolator(height_m**2, values)
    return np.asarray(curve(np.clip(at_m, height_m[0], height_m[-1]) ** 2), np.float64)
