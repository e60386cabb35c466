"""Field points of a radial table: image heights on the sensor, or field angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.checks import check_height_unit, number_array
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_RIGHT_ANGLE_DEG = 90.0


@dataclass(frozen=True, eq=False)
class FieldPoints(Shown):
    """Points along a radius of the field, from the axis outwards, as heights or as angles.

    Parameters
    ----------
    height_mm
        (n,) increasing from 0 or more: distances from the axis on the sensor.
    angle_deg
        (n,) increasing from 0 or more: angles to the axis in front of the lens, below 90.

    Raises
    ------
    InputError
        If both or neither are given, values do not increase, are negative or not finite, or heights end below 0.05 mm,
        as heights given in m do.

    Examples
    --------
    >>> FieldPoints(angle_deg=[0, 45]).ideal_m(0.05).round(4)
    array([0.  , 0.05])
    """

    height_mm: Array | None = None
    angle_deg: Array | None = None

    def __post_init__(self) -> None:
        if (self.height_mm is None) == (self.angle_deg is None):
            raise InputError("field points need either height_mm or angle_deg", hint="Give one of the two")
        name, given = ("height_mm", self.height_mm) if self.angle_deg is None else ("angle_deg", self.angle_deg)
        values = number_array(name, given)
        if values.ndim != 1 or not values.size:
            raise InputError(name, value=values.shape, expected="a list of one field point or more")
        if not np.isfinite(values).all() or values[0] < 0 or (np.diff(values) <= 0).any():
            hint = "Sort the table, and give one side of the axis only"
            raise InputError(name, value=values.tolist(), expected="increasing from 0 or more", hint=hint)
        if name == "angle_deg" and values[-1] >= _RIGHT_ANGLE_DEG:
            raise InputError(name, value=values[-1], expected="below 90", hint="Give height_mm for a fisheye")
        if name == "height_mm":
            check_height_unit(name, float(values[-1]))
        object.__setattr__(self, name, values)

    @property
    def size(self) -> int:
        """Number of points."""
        return self._values.size

    @property
    def starts_on_axis(self) -> bool:
        """Whether the first point is the axis."""
        return bool(self._values[0] == 0)

    @property
    def _values(self) -> Array:
        values = self.angle_deg if self.height_mm is None else self.height_mm
        assert values is not None
        return values

    def ideal_m(self, image_distance_m: float) -> Array:
        """Return (n,) heights: as given, or image distance times the tangent of the angle."""
        if self.height_mm is not None:
            return self.height_mm * 1e-3
        return image_distance_m * np.tan(np.radians(self._values))

    def check_off_axis(self) -> None:
        """Raise `InputError` if the axis is the only point."""
        if self.size == 1 and self.starts_on_axis:
            raise InputError("field", expected="field points off the axis", value=[0])


def even_curve(height_m: Array, values: Array, at_m: Array) -> Array:
    """Interpolate an even function of height: a monotone cubic (Fritsch and Carlson 1980) in the squared height.

    Beyond the last height the last value is used.

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
