"""The shutter: when each row of the array is exposed. The section `shutter` of a sensor file."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from photosite.errors import InputError
from photosite.sensor.quantity import NO_UNIT, Positive, about
from photosite.values.validated import Section


class Shutter(Section):
    """A global shutter exposes all rows together, a rolling shutter one after the other, for the same time each.

    Row r of a rolling shutter starts r line times after the first row that is exposed.

    Examples
    --------
    >>> Shutter(line_time_us=10.0).row_start_s(3)
    array([0.e+00, 1.e-05, 2.e-05])
    >>> Shutter(line_time_us=10.0, direction="bottom_up").row_start_s(3)
    array([2.e-05, 1.e-05, 0.e+00])
    """

    kind: Literal["rolling", "global"] = about(
        "Whether rows are exposed one after the other or together: rolling or global.",
        NO_UNIT,
        "rolling",
        default="rolling",
    )
    line_time_us: Positive | None = about(
        "Time from the start of the exposure of a row to that of the next; required for a rolling shutter.",
        "us",
        14.8,
        default=None,
    )
    direction: Literal["top_down", "bottom_up"] = about(
        "Order in which the rows of the frame are exposed: top_down or bottom_up.",
        NO_UNIT,
        "top_down",
        default="top_down",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind == "rolling" and self.line_time_us is None:
            hint = "State it, or write 'kind: global'"
            raise InputError("line_time_us is missing for a rolling shutter", hint=hint)
        return self

    def row_start_s(self, rows: int) -> NDArray[np.float64]:
        """Return (rows,) seconds from the start of a frame to the start of the exposure of each row."""
        if self.kind == "global" or self.line_time_us is None:
            return np.zeros(rows)
        starts = np.arange(rows, dtype=np.float64) * (self.line_time_us.value * 1e-6)
        return np.asarray(starts if self.direction == "top_down" else starts[::-1], np.float64)
