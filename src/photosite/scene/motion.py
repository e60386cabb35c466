"""Affine motion of the image on the sensor: of what is seen, or of the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.values.limits import check_magnitude
from photosite.values.shown import Shown

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion(Shown):
    """Translation, rotation and scaling of an image at constant rates.

    A point that is at q from the center of the frame at time 0 is at exp(s t) R(w t) q + v t at time t. The image moves
    the other way if the camera does.

    Parameters
    ----------
    rows_per_s, cols_per_s
        Velocity v, pixels of the frame per second: down and to the right.
    rotation_deg_per_s
        Rate w of rotation about the center of the frame, clockwise as seen.
    scale_per_s
        Relative growth s per second: 0.1 for an image that is 10 % larger after 1 s (exactly, by exp(0.1)).

    Examples
    --------
    >>> Motion(cols_per_s=200).is_translation, Motion(scale_per_s=0.1).is_translation
    (True, False)
    >>> [round(float(at), 6) + 0.0 for at in Motion(10, 20, rotation_deg_per_s=90).at_rest(10.0, 25.0, 1.0)]
    [-5.0, 0.0]
    """

    rows_per_s: float = 0.0
    cols_per_s: float = 0.0
    rotation_deg_per_s: float = 0.0
    scale_per_s: float = 0.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
                hint = "Give each rate alone: Motion(rows_per_s, cols_per_s)" if np.ndim(value) else None
                raise InputError(entry.name, where="Motion", value=value, expected="a finite number", hint=hint)
            check_magnitude(entry.name, float(value))

    @property
    def is_translation(self) -> bool:
        """Whether all points have the same velocity."""
        return self.rotation_deg_per_s == 0.0 and self.scale_per_s == 0.0

    def at_rest(self, row: Array | float, col: Array | float, time_s: Array | float) -> tuple[Array, Array]:
        """Return where points were at time 0, from their place at a time; in pixels from the center of the frame."""
        time = np.asarray(time_s, np.float64)
        turn, size = np.radians(self.rotation_deg_per_s) * time, np.exp(-self.scale_per_s * time)
        down, right = row - self.rows_per_s * time, col - self.cols_per_s * time
        along, across = size * np.cos(turn), size * np.sin(turn)
        return along * down - across * right, along * right + across * down
