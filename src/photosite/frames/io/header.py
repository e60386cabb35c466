"""What a file says of its frame besides the pixels, and how photosite writes that into files of its own.

DNG has tags for the levels, the mosaic and the colour; TIFF and PNG have none. All three carry the same description
as one line of JSON, so that a frame comes back as it was saved, to the last digit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import MONOCHROME, Cfa, cfa_from, tile_text

MARK = "photosite_frame"
"""The description's first key; its value is the version of the format."""


@dataclass(frozen=True)
class Place:
    """Where one frame lies in a file that can hold several.

    Parameters
    ----------
    label
        What to add to the file's name in messages: "[3]", ":/dark[3]".
    part
        The HDF5 dataset's name, the number of the FITS unit, or the byte at which the TIFF directory begins.
    index
        Which frame of the part, counted from 0.
    """

    label: str
    part: str | int
    index: int = 0


@dataclass(frozen=True)
class FrameHeader:
    """What a file says of its frame; None where it says nothing.

    Parameters
    ----------
    rows, cols
        Size of the frame.
    stored_bits
        Bits a pixel takes in the file: 8 or 16; None where it has to be decoded first (camera raw).
    bits, cfa, black_level_dn, white_level_dn, exposure_s, color_matrix, noise_profile, metadata
        As in `RawFrame`.
    notes
        What the reader of the frame should know, for a warning.
    place
        Where in its file the frame lies; None where the file is the frame.
    masked_border
        Whether the file has pixels outside the frame that it says are kept from light.
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
    metadata: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()
    place: Place | None = None
    masked_border: bool = False

    def frame(self, path: Path, dn: NDArray[np.uint16], bits: int | None, cfa: Cfa | None) -> RawFrame:
        """The raw frame, the file's gaps filled by what the caller knows.

        Raises
        ------
        FileError
            If file and caller contradict each other, or the pixels do not fit what they say.
        """
        if self.exposure_s is not None and not 0 <= self.exposure_s < math.inf:
            raise FileError(path, f"an exposure is 0 s (a bias frame's) or more, not {self.exposure_s:g} s")
        try:
            return RawFrame(
                dn,
                bits=agreed_bits(path, self, bits),
                cfa=agreed_cfa(path, self, cfa) or MONOCHROME,
                black_level_dn=self.black_level_dn or 0.0,
                white_level_dn=-1.0 if self.white_level_dn is None else self.white_level_dn,
                exposure_s=self.exposure_s,
                color_matrix=self.color_matrix,
                noise_profile=self.noise_profile,
                metadata=MappingProxyType(dict(self.metadata)),
            )
        except InputError as error:
            raise FileError(path, f"{error}; if the bits are wrong, say how many the converter has") from None


def agreed_bits(path: Path, header: FrameHeader, bits: int | None) -> int:
    """The converter's bits: what the file says, else what the caller says, else what the file stores.

    Raises
    ------
    FileError
        If the file says otherwise than the caller, or stores fewer.
    """
    if header.bits is not None and bits is not None and header.bits != bits:
        raise FileError(path, f"is a {header.bits}-bit frame by its own account, not the {bits}-bit frame asked for")
    if header.stored_bits is not None and bits is not None and bits > header.stored_bits:
        raise FileError(path, f"stores {header.stored_bits} bits a pixel, too few for a {bits}-bit frame")
    agreed = header.bits or bits or header.stored_bits
    if agreed is None:
        raise FileError(path, "does not say how many bits its converter has; say how many")
    if not 1 <= agreed <= 16:
        raise FileError(path, f"a raw frame has 1 to 16 bits, not {agreed}")
    return agreed


def stated_number(path: Path, header: FrameHeader, *names: str) -> float | None:
    """The first of these metadata that the file states, as a number, or None.

    `gain_setting` (or `iso`), `temperature_c` and `photons_per_pixel` are read this way.

    Raises
    ------
    FileError
        If what it states is no finite number.
    """
    for name in names:
        value = header.metadata.get(name)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
            raise FileError(path, f"states {name} {value!r}, which is no number")
        return float(value)
    return None


def agreed_cfa(path: Path, header: FrameHeader, cfa: Cfa | None) -> Cfa | None:
    """The colour filter array: what the file says, else what the caller says, else None.

    Raises
    ------
    FileError
        If the two contradict each other.
    """
    if header.cfa is not None and cfa is not None and header.cfa != cfa:
        raise FileError(
            path, f"has the colour filter array {tile_text(header.cfa)}, not the {tile_text(cfa)} asked for"
        )
    return header.cfa or cfa


def describe(frame: RawFrame) -> str:
    """The frame's description: one line of JSON, ASCII, everything but the pixels.

    Raises
    ------
    InputError
        If the metadata hold something else than strings and finite numbers.
    """
    for name, value in frame.metadata.items():
        if not isinstance(name, str) or not isinstance(value, str | int | float | np.integer | np.floating):
            raise InputError(f"metadata are strings and numbers by name; {name!r} is {type(value).__name__}")
    content = {
        MARK: 1,
        "bits": frame.bits,
        "cfa": [list(row) for row in frame.cfa],
        "black_level_dn": frame.black_level_dn,
        "white_level_dn": frame.white_level_dn,
        "exposure_s": frame.exposure_s,
        "color_matrix": None if frame.color_matrix is None else np.asarray(frame.color_matrix).tolist(),
        "noise_profile": None if frame.noise_profile is None else np.asarray(frame.noise_profile).tolist(),
        "metadata": dict(frame.metadata),
    }
    try:
        return json.dumps(content, allow_nan=False, default=lambda number: number.item())
    except ValueError:
        raise InputError("a frame with numbers that are not finite in its description cannot be saved") from None


def described(path: Path, text: str, rows: int, cols: int, stored_bits: int) -> FrameHeader | None:
    """The header from a description, or None where the text is somebody else's.

    Raises
    ------
    FileError
        If the text is photosite's and says what cannot be.
    """
    if not text.startswith(f'{{"{MARK}"'):
        return None
    try:
        content = json.loads(text)
        if content[MARK] != 1:
            raise FileError(path, f"is a frame of format version {content[MARK]}; this photosite reads version 1")
        return FrameHeader(
            rows,
            cols,
            stored_bits,
            bits=int(content["bits"]),
            cfa=cfa_from(content["cfa"]),
            black_level_dn=float(content["black_level_dn"]),
            white_level_dn=float(content["white_level_dn"]),
            exposure_s=None if content["exposure_s"] is None else float(content["exposure_s"]),
            color_matrix=_table(content["color_matrix"]),
            noise_profile=_table(content["noise_profile"]),
            metadata=MappingProxyType(dict(content["metadata"])),
        )
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(path, f"has a damaged description of its frame ({error})") from None


def _table(rows: Any) -> NDArray[np.float64] | None:
    return None if rows is None else np.asarray(rows, dtype=np.float64)
