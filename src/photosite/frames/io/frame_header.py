"""The header of a frame: what its file states besides the pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import MONOCHROME, Cfa, tile_text


@dataclass(frozen=True)
class FrameLocation:
    """Location of one frame in a file that can hold several.

    Parameters
    ----------
    label
        Text after the file's name in messages: "[3]", ":/dark[3]".
    part
        Name of the HDF5 dataset, number of the FITS unit, or byte offset of the TIFF directory.
    index
        Index of the frame in the part, counted from 0.
    """

    label: str
    part: str | int
    index: int = 0


@dataclass(frozen=True)
class FrameHeader:
    """What a file states about its frame; None where it states nothing.

    Parameters
    ----------
    rows, cols
        Size of the frame.
    stored_bits
        Bits per pixel in the file, 8 or 16; None if only decoding shows the bit depth (camera raw).
    bits, cfa, black_level_dn, white_level_dn, exposure_s, color_matrix, noise_profile, metadata
        As in `RawFrame`. The metadata kind, gain_setting (or iso), temperature_c and photons_per_pixel are settings.
    notes
        Limitations of the values, for a warning.
    location
        Location in a file of several frames; None if the file is a single frame.
    masked_border
        Whether the file states that pixels outside the frame are masked.
    """

    rows: int
    cols: int
    stored_bits: int | None
    bits: int | None = None
    cfa: Cfa | None = None
    black_level_dn: float | None = None
    white_level_dn: float | None = None
    exposure_s: float | None = None
    color_matrix: NDArray[np.float64] | None = None
    noise_profile: NDArray[np.float64] | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    location: FrameLocation | None = None
    masked_border: bool = False

    @property
    def settings(self) -> FrameSettings:
        """The settings that the file states, as it states them: not validated."""
        gain = self.metadata.get("gain_setting")
        return FrameSettings(
            self.metadata.get("kind"),
            self.exposure_s,
            self.metadata.get("photons_per_pixel"),
            self.metadata.get("iso") if gain is None else gain,
            self.metadata.get("temperature_c"),
        )

    def resolve_bits(self, path: Path, bits: int | None) -> int:
        """Return the bit depth: what the file states, else what the caller states, else what the file stores."""
        if self.bits is not None and bits is not None and self.bits != bits:
            raise FileError(path, "bits", value=bits, expected=f"{self.bits}, as the file states")
        if self.stored_bits is not None and bits is not None and bits > self.stored_bits:
            raise FileError(
                path, "bits", value=bits, expected=f"at most the {self.stored_bits} bits that the file stores"
            )
        resolved = self.bits or bits or self.stored_bits
        if resolved is None:
            raise FileError(path, "the file does not state its bit depth", hint="Pass {bits}", arguments={"bits": 12})
        if not 1 <= resolved <= 16:
            raise FileError(path, "bits", value=resolved, expected="1 to 16")
        return resolved

    def resolve_cfa(self, path: Path, cfa: Cfa | None) -> Cfa | None:
        """Return the color filter array: what the file states, else what the caller states, else None."""
        if self.cfa is not None and cfa is not None and self.cfa != cfa:
            raise FileError(path, "cfa", value=tile_text(cfa), expected=f"{tile_text(self.cfa)}, as the file states")
        return self.cfa or cfa

    def to_frame(self, path: Path, dn: NDArray[np.uint16], bits: int | None, cfa: Cfa | None) -> RawFrame:
        """Return the raw frame; the caller's bits and cfa are used where the file states none."""
        if self.exposure_s is not None and not 0 <= self.exposure_s < math.inf:
            raise FileError(path, "exposure_s", value=self.exposure_s, expected="finite and 0 (a bias frame) or above")
        try:
            return RawFrame(
                dn,
                bits=self.resolve_bits(path, bits),
                cfa=self.resolve_cfa(path, cfa) or MONOCHROME,
                black_level_dn=self.black_level_dn or 0.0,
                white_level_dn=self.white_level_dn,  # type: ignore[arg-type]  # None: the highest number
                exposure_s=self.exposure_s,
                color_matrix=self.color_matrix,
                noise_profile=self.noise_profile,
                metadata=dict(self.metadata),
            )
        except InputError as error:
            raise error.in_file(path) from None
