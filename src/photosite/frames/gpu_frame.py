"""A raw frame in the memory of a GPU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from photosite.engine.arrays import Arrays
from photosite.frames.raw_frame import RawFrame


@dataclass(frozen=True, eq=False)
class GpuFrame:
    """A raw frame whose digital numbers are in the memory of a GPU.

    `torch.from_dlpack(frame)`, `cupy.asarray(frame)` and other libraries take them without a copy.

    Parameters
    ----------
    array
        (rows, cols) uint16, digital numbers, black level included; an array of the device.
    fields
        The other arguments of `RawFrame`: "bits", "cfa", "black_level_dn", "white_level_dn", "exposure_s", "metadata"
        and more.
    arrays
        The device's arrays.
    """

    array: Any
    fields: Mapping[str, Any]
    arrays: Arrays = field(repr=False)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        rows, cols = self.array.shape
        return rows, cols

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        interface: dict[str, Any] = self.array.__cuda_array_interface__
        return interface

    def __dlpack__(self, **options: Any) -> Any:
        """Return the digital numbers as a DLPack capsule, which shares their memory."""
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return type and number of the device, as DLPack defines them."""
        kind, number = self.array.__dlpack_device__()
        return kind, number

    def to_host(self) -> RawFrame:
        """Return the frame with a copy of its digital numbers on the host."""
        return RawFrame(self.arrays.get(self.array), **self.fields)
