"""Amplifier glow: light of the sensor's own circuits, at an edge or a corner."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.engine.lazy_maps import row_strips
from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import NO_UNIT, about

Place = Literal["top", "bottom", "left", "right", "top_left", "top_right", "bottom_left", "bottom_right"]


class Glow(EffectSection):
    """Electrons per second that fall off exponentially with the distance from edges or corners.

    Examples
    --------
    >>> Glow(places=("left",), peak_e_per_s=8, decay_pixels=1 / np.log(2)).map(1, 4).tolist()
    [[8.0, 4.0, 2.0, 1.0]]
    """

    placed = True

    places: tuple[Place, ...] = about("Edges and corners that glow.", NO_UNIT, ["top_left"], min_length=1)
    peak_e_per_s: Annotated[float, Field(ge=0.0)] = about("Glow at each of them.", "e-/s", 5.0)
    decay_pixels: Annotated[float, Field(gt=0.0)] = about(
        "Distance at which the glow has fallen to 1/e.", "pixels", 100.0
    )

    def map(self, rows: int, cols: int) -> NDArray[np.float32]:
        """Return the glow of a whole chip, (rows, cols) electrons per second."""
        r, c = np.arange(rows, dtype=np.float64)[:, None], np.arange(cols, dtype=np.float64)[None]
        from_line = {"top": r, "bottom": rows - 1.0 - r, "left": c, "right": cols - 1.0 - c}
        glow = np.empty((rows, cols), np.float32)
        for first, last in row_strips(glow):
            total = np.zeros((last - first, cols))
            for place in self.places:
                distance = np.hypot(0.0, 0.0)
                for line in place.split("_"):
                    own = from_line[line]
                    distance = np.hypot(distance, own[first:last] if line in ("top", "bottom") else own)
                total += self.peak_e_per_s * np.exp(-distance / self.decay_pixels)
            glow[first:last] = total
        return glow
