"""Relative illumination of a lens as a table: all of its fall-off, natural and by vignetting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.optics.arguments import check_kind
from photosite.optics.radial_table import FieldPoints, check_values, even_curve
from photosite.optics.warn import warn_user

Array = NDArray[np.float64]

_BEYOND = 1.02
"""Of the last height: how far the frame may reach before a warning is due."""


@dataclass(frozen=True, eq=False)
class IlluminationTable:
    """Irradiance over the field relative to that on the axis.

    Parameters
    ----------
    field
        Where: image heights as they fall on the sensor, or field angles. The first is the axis.
    relative
        (n,) above 0, 1 on the axis. Between places it is a monotone cubic in height; beyond the last it keeps its
        value, with a warning where the frame reaches more than 2 % beyond.

    Raises
    ------
    InputError
        If the table does not begin with 1 on the axis, or holds what is not above 0; percent are divided by 100.

    Examples
    --------
    >>> table = IlluminationTable(FieldPoints(height_mm=[0, 10, 14]), [1.0, 0.8, 0.5])
    >>> table.at(np.array([0.0, 10e-3, 14e-3]), table.field.ideal_m(0.05))
    array([1. , 0.8, 0.5])
    """

    field: FieldPoints
    relative: Array

    def __post_init__(self) -> None:
        check_kind(
            "IlluminationTable", "field", self.field, FieldPoints, "FieldPoints(height_mm=[...]) or (angle_deg=[...])"
        )
        relative = check_values("relative illumination", self.relative, (self.field.size,))
        if not self.field.starts_on_axis or abs(relative[0] - 1) > 1e-3:
            raise InputError(
                "relative illumination begins on the axis with 1: give height or angle 0 first, divide all by its "
                f"value (by 100 if in percent), not {relative[0]:g} first"
            )
        if not (relative > 0).all() or relative.max() > 5:
            raise InputError(
                f"relative illumination is above 0 and about 1 at most, not {relative.min():g} to {relative.max():g}"
            )
        object.__setattr__(self, "relative", relative / relative[0])

    def at(self, image_height_m: Array, table_height_m: Array) -> Array:
        """Relative illumination at distances from the axis.

        Parameters
        ----------
        image_height_m
            Any shape.
        table_height_m
            (n,) where on the sensor the table's places fall.

        Warns
        -----
        PhotositeWarning
            If a height lies more than 2 % beyond the table.
        """
        farthest = float(np.max(image_height_m, initial=0.0))
        if farthest > _BEYOND * table_height_m[-1]:
            warn_user(
                f"relative illumination is known up to {table_height_m[-1] * 1e3:.4g} mm from the axis, and the frame "
                f"reaches {farthest * 1e3:.4g} mm; beyond, the table's last value is used",
            )
        return even_curve(table_height_m, self.relative, image_height_m)
