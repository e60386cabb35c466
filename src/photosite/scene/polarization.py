"""Linear polarization of a scene's light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError
from photosite.values.shown import Shown


@dataclass(frozen=True, eq=False)
class Polarization(Shown):
    """Degree and angle of linear polarization, the same at all wavelengths.

    Parameters
    ----------
    degree
        Polarized fraction of the light, 0 to 1: one number, or one for each of the scene's samples, (rows, cols).
    angle_deg
        Angle of the electric field, counterclockwise from the rows as the picture is seen; one number or (rows, cols).

    Raises
    ------
    InputError
        If a degree is outside 0 to 1, an angle is not finite, or the two have different shapes.

    Examples
    --------
    >>> Polarization(0.4, 45.0).stokes.round(3) + 0.0
    array([0. , 0.4])
    """

    degree: NDArray[np.float64]
    angle_deg: NDArray[np.float64]

    def __init__(self, degree: ArrayLike, angle_deg: ArrayLike) -> None:
        part, angle = np.asarray(degree, np.float64), np.asarray(angle_deg, np.float64)
        if not ((part >= 0) & (part <= 1)).all():
            raise InputError("degree", where="polarization", expected="within 0 to 1")
        if not np.isfinite(angle).all():
            raise InputError("angle_deg", where="polarization", expected="finite")
        shapes = {part.shape, angle.shape} - {()}
        if len(shapes) > 1 or any(len(shape) != 2 for shape in shapes):
            value = part.shape, angle.shape
            raise InputError("degree, angle_deg", where="polarization", value=value, expected="numbers or (rows, cols)")
        part, angle = np.broadcast_arrays(part, angle)
        object.__setattr__(self, "degree", part)
        object.__setattr__(self, "angle_deg", angle)

    @property
    def shape(self) -> tuple[int, ...]:
        """() for one number, else (rows, cols)."""
        return self.degree.shape

    @property
    def stokes(self) -> NDArray[np.float64]:
        """(2,) or (2, rows, cols): the Stokes parameters S1 and S2 over S0."""
        twice = np.radians(2.0 * self.angle_deg)
        return np.stack([self.degree * np.cos(twice), self.degree * np.sin(twice)])
