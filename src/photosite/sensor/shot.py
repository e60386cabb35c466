"""A shot: what a frame depends on besides camera, light and exposure time."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral
from typing import TypedDict

from photosite.errors import InputError
from photosite.sensor.device import Device, Gpu
from photosite.values.cfa import Cfa, shifted

Part = tuple[slice, slice]
"""Rows and columns of a rectangle."""

Rectangle = tuple[int, int, int, int]
"""(r0, r1, c0, c1): rows r0 to r1 and columns c0 to c1, the second of each excluded."""


class SequenceOptions(TypedDict, total=False):
    """Fields of a `Shot` that the frames of a sequence share, as keywords."""

    seed: int
    region: Rectangle | None
    device: Device | Gpu
    temperature_c: float | None


class ShotOptions(SequenceOptions, total=False):
    """Fields of a `Shot`, as keywords."""

    frame: int


@dataclass(frozen=True)
class Shot:
    """What a frame depends on besides camera, light and exposure time.

    Parameters
    ----------
    seed, frame
        Key of the temporal noise, 0 to 2^64 - 1, and frame number in a sequence, 0 to 2^32 - 1.
    region
        Rectangle of the chip; None is the whole chip. Its digital numbers are those of the whole frame.
    device
        "cpu", or "cuda" for an NVIDIA GPU (extra `gpu`). With a `Gpu`, the digital numbers stay there.
    temperature_c
        Temperature of the sensor, for the dark current; None: that of its description.

    Raises
    ------
    InputError
        If seed or frame number is out of range.

    Examples
    --------
    >>> Shot(seed=7, region=(10, 30, 51, 99)).part(100, 200)
    (slice(10, 30, None), slice(51, 99, None))
    """

    seed: int = 0
    frame: int = 0
    region: Rectangle | None = None
    device: Device | Gpu = "cpu"
    temperature_c: float | None = None

    def __post_init__(self) -> None:
        for name, number, bits in (("seed", self.seed, 64), ("frame", self.frame, 32)):
            whole = isinstance(number, Integral) and not isinstance(number, bool)
            if not (whole and 0 <= number < 1 << bits):
                raise InputError(name, value=number, expected=f"an integer from 0 to 2^{bits} - 1")

    def part(self, rows: int, cols: int) -> Part:
        """Return the region on a chip of a size; raise `InputError` if it does not lie on the chip."""
        r0, r1, c0, c1 = self.region or (0, rows, 0, cols)
        if not (0 <= r0 < r1 <= rows and 0 <= c0 < c1 <= cols):
            expected = f"(r0, r1, c0, c1) with r0 < r1 <= {rows} and c0 < c1 <= {cols}"
            raise InputError("region", value=self.region, expected=expected)
        return slice(r0, r1), slice(c0, c1)

    def cfa(self, cfa: Cfa) -> Cfa:
        """Return the color filter array of the region, from that of the chip."""
        return cfa if self.region is None else shifted(cfa, self.region[0], self.region[2])
