"""Random telegraph noise: pixels whose level jumps between two states."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from photosite.sensor.effects.section import EffectSection
from photosite.sensor.quantity import NO_UNIT, about


class TelegraphNoise(EffectSection):
    """Blinking pixels, drawn from the serial; their states depend on the seed and the frame number.

    Examples
    --------
    >>> noise = TelegraphNoise(fraction=0.01, amplitude_e=30)
    >>> noise.amplitudes, round(noise.variance_e2, 6)
    ('exponential', 3.0)
    """

    fraction: Annotated[float, Field(ge=0.0, le=1.0)] = about("Fraction of the pixels that blink.", "1", 0.01)
    amplitude_e: Annotated[float, Field(ge=0.0)] = about("Mean distance of the two levels.", "e-", 20.0)
    amplitudes: Literal["exponential", "equal"] = about(
        "Distribution of the distance over these pixels: exponential, or equal for all.",
        NO_UNIT,
        "exponential",
        default="exponential",
    )
    high_fraction: Annotated[float, Field(ge=0.0, le=1.0)] | None = about(
        "Fraction of the time in the upper state. None: uniform from 0 to 1 over the pixels.", "1", 0.5, default=None
    )
    correlation_frames: Annotated[float, Field(ge=0.0, le=1e4)] = about(
        "Frames after which the correlation of the states has fallen to 1/e; 0 for independent frames.",
        "frames",
        3.0,
        default=0.0,
    )

    @property
    def variance_e2(self) -> float:
        """Mean temporal variance over all pixels of a long sequence, e-^2: fraction <a^2> <h (1 - h)>."""
        square = self.amplitude_e**2 * (2.0 if self.amplitudes == "exponential" else 1.0)
        high = self.high_fraction
        return self.fraction * square * (1.0 / 6.0 if high is None else high * (1.0 - high))
