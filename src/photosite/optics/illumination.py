"""Illumination of the sensor through a lens: natural falloff and vignetting as a table, and veiling glare."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, PhotositeWarning
from photosite.optics.checks import check_number, check_type, number_array
from photosite.optics.field_points import FieldPoints, even_curve
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_TOLERATED_REACH = 1.02
"""Ratio of the frame's corner to the last height above which a warning is given."""


@dataclass(frozen=True, eq=False)
class IlluminationTable(Shown):
    """Irradiance over the field relative to that on the axis.

    Parameters
    ----------
    field
        Real image heights on the sensor, or field angles. The first point is the axis.
    relative
        (n,) above 0, 1 on the axis. Interpolated by a monotone cubic in squared height; beyond the last point the last
        value is used, with a warning if the frame reaches more than 2 % further.

    Raises
    ------
    InputError
        If the table does not begin with 1 on the axis, or holds a value that is not above 0.

    Examples
    --------
    >>> table = IlluminationTable(FieldPoints(height_mm=[0, 10, 14]), [1.0, 0.8, 0.5])
    >>> table.at(np.array([0.0, 10e-3, 14e-3]), table.field.ideal_m(0.05))
    array([1. , 0.8, 0.5])
    """

    field: FieldPoints
    relative: Array

    def __post_init__(self) -> None:
        check_type("field", self.field, FieldPoints, "FieldPoints(height_mm=[0, 7, 14])")
        relative = number_array("relative", self.relative, (self.field.size,))
        if not self.field.starts_on_axis or abs(relative[0] - 1) > 1e-3:
            hint = "Begin with height or angle 0, and divide all values by the first, or by 100 if they are in percent"
            raise InputError("relative", value=relative[0], expected="1 on the axis", hint=hint)
        if not (relative > 0).all() or relative.max() > 5:
            extreme = relative.min() if relative.min() <= 0 else relative.max()
            raise InputError("relative", value=extreme, expected="above 0 and about 1 at most")
        object.__setattr__(self, "relative", relative / relative[0])

    def at(self, image_height_m: Array, table_height_m: Array) -> Array:
        """Return the relative illumination at image heights, with a warning for heights more than 2 % beyond the table.

        `table_height_m` are the (n,) real image heights of the table's field points.
        """
        farthest = float(np.max(image_height_m, initial=0.0))
        if farthest > _TOLERATED_REACH * table_height_m[-1]:
            what = (
                f"relative illumination is known up to {table_height_m[-1] * 1e3:.4g} mm from the axis, and the frame "
                f"reaches {farthest * 1e3:.4g} mm; the last value is used beyond"
            )
            warnings.warn(PhotositeWarning(what, hint="Extend the table to the corner"), stacklevel=2)
        return even_curve(table_height_m, self.relative, image_height_m)


@dataclass(frozen=True)
class VeilingGlare(Shown):
    """Light that lens surfaces and the barrel scatter over the sensor.

    Parameters
    ----------
    fraction
        Scattered fraction of all arriving light, 0 to below 1: the veiling glare index of a uniform field (ISO 9358).
    spread_m
        Decay length on the sensor: the scatter falls as exp(-distance / spread_m). None: uniform over the frame.

    Examples
    --------
    >>> VeilingGlare(0.02, spread_m=3e-3)
    VeilingGlare(fraction=0.02, spread_m=0.003)
    """

    fraction: float
    spread_m: float | None = None

    def __post_init__(self) -> None:
        check_number("fraction", self.fraction, "a fraction from 0 to below 1", at_least=0, below=1)
        if self.spread_m is not None:
            hint = "Leave it out for uniform glare"
            check_number("spread_m", self.spread_m, "above 0", above=0, hint=hint)
