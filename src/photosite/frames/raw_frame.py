"""One raw frame: the digital numbers of a mosaic and what is needed to read them."""

from __future__ import annotations

from dataclasses import dataclass, field
from os import PathLike
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.values.cfa import MONOCHROME, Cfa, channel_names


@dataclass(frozen=True, eq=False)
class RawFrame:
    """A raw frame.

    Parameters
    ----------
    dn
        (rows, cols) uint16, digital numbers, black level included.
    bits
        Bits of the analogue-to-digital converter; the highest number is 2^bits - 1.
    cfa
        The colour filter array's tile; `(("M",),)` for a monochrome chip.
    black_level_dn
        What a pixel without light reads on average.
    white_level_dn
        The number at which the output saturates; 2^bits - 1 unless the file says less.
    exposure_s
        Exposure time, or None where the file does not say.
    color_matrix
        (channels, 3), CIE XYZ under D65 to camera channels (in the order of `channels`), as DNG's ColorMatrix; None
        where it is not known.
    noise_profile
        (channels, 2), DNG's NoiseProfile: the variance of a signal s in 0..1 (black 0, white 1) is scale s + offset;
        None where it is not known.
    metadata
        What else the file said: camera, ISO, temperature, seed, ... Values are strings and numbers.

    Raises
    ------
    InputError
        If the array is not two-dimensional uint16, is empty, or holds numbers above 2^bits - 1, or if the
        levels cannot be.

    Examples
    --------
    >>> frame = RawFrame(np.full((2, 2), 64, np.uint16), bits=12, black_level_dn=64)
    >>> frame.shape, frame.white_level_dn, frame.is_mosaic
    ((2, 2), 4095.0, False)
    """

    dn: NDArray[np.uint16]
    bits: int
    cfa: Cfa = MONOCHROME
    black_level_dn: float = 0.0
    white_level_dn: float = field(default=-1.0)
    exposure_s: float | None = None
    color_matrix: NDArray[np.float64] | None = None
    noise_profile: NDArray[np.float64] | None = None
    metadata: MappingProxyType[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        dn = np.asarray(self.dn)
        if dn.ndim != 2 or dn.size == 0 or dn.dtype != np.uint16:
            raise InputError(f"a raw frame is (rows, cols) of uint16, not {dn.shape} of {dn.dtype}")
        if not 1 <= self.bits <= 16:
            raise InputError(f"a raw frame has 1 to 16 bits, not {self.bits}")
        top = (1 << self.bits) - 1
        if self.white_level_dn == -1.0:
            object.__setattr__(self, "white_level_dn", float(top))
        if not 0 <= self.black_level_dn < self.white_level_dn <= top:
            raise InputError(
                f"levels must obey 0 <= black < white <= {top} DN, not black {self.black_level_dn}, "
                f"white {self.white_level_dn}"
            )
        if self.bits < 16 and (highest := int(dn.max())) > top:
            raise InputError(f"a {self.bits}-bit frame cannot hold {highest} DN; its highest number is {top}")
        if not isinstance(self.metadata, MappingProxyType):
            object.__setattr__(self, "metadata", MappingProxyType(dict(self.metadata)))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        rows, cols = self.dn.shape
        return rows, cols

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of the mosaic, each once, in reading order of the tile."""
        return channel_names(self.cfa)

    @property
    def is_mosaic(self) -> bool:
        """Whether pixels differ in colour."""
        return len(self.channels) > 1

    def save(self, path: str | PathLike[str]) -> None:
        """Write the frame; the format follows the name: .dng, .tif / .tiff, .png or .h5 / .hdf5.

        Raises
        ------
        InputError
            If the name's ending is none of these.
        FileError
            If the file cannot be written. A file of that name stays as it was.
        """
        from photosite.frames.io.write import write_raw

        write_raw(self, path)
