"""Hot pixels: the tail of the dark current's distribution."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from photosite.sensor.quantity import about
from photosite.values.validated import Section


class HotPixels(Section):
    """Pixels with additional dark current, drawn from the serial: log-normal over these pixels.

    Examples
    --------
    >>> HotPixels(fraction=0.001, median_e_per_s=200).log_spread
    1.0
    """

    fraction: Annotated[float, Field(ge=0.0, le=1.0)] = about("Share of the pixels that are hot.", "1", 0.001)
    median_e_per_s: Annotated[float, Field(ge=0.0)] = about(
        "Median of their additional dark current, at the temperature of the dark current.", "e-/s", 200.0
    )
    log_spread: Annotated[float, Field(ge=0.0, le=5.0)] = about(
        "Standard deviation of its natural logarithm.", "1", 1.0, default=1.0
    )
