"""A frame's file: its place in a listing, its header, and the description that photosite writes into it.

DNG has tags for levels, mosaic and color; TIFF and PNG have none. All three carry the same description, so that a
frame is read back exactly as it was saved.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.frames.conditions import stated_conditions
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.layout import Layout
from photosite.frames.raw_frame import MOST_BITS, Numbers, RawFrame
from photosite.frames.sections import Section
from photosite.frames.stored_numbers import NumberKind
from photosite.values.cfa import MONOCHROME, Cfa, cfa_from, tile_text
from photosite.values.region import Border, Region

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor


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
    names
        Texts that select the frame, such as "1", "1,3" and "AMP1" for `x.fits[1]`.
    """

    label: str
    part: str | int
    index: int = 0
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class FrameHeader:
    """What a file states about its frame; None where it states nothing.

    Parameters
    ----------
    rows, cols
        Size of the frame.
    stored_bits
        Bits per pixel in the file, 8, 16 or 32; 16 for floats; None if only decoding shows the bit depth (camera raw).
    bits, cfa, black_level_dn, white_level_dn, exposure_s, color_matrix, color_matrix_a, noise_profile, metadata
        As in `RawFrame`. The metadata kind, gain_setting (or iso), temperature_c and photons_per_pixel are settings.
    notes
        Limitations of the values, for a warning.
    location
        Location in a file of several frames; None if the file is a single frame.
    masked_border
        Whether the file states that pixels outside the frame are masked.
    border
        Lines around the frame, as in `FrameSet`, that `read_whole` reads with it.
    overscan
        Whether the file states overscan, whose level `read_frame` takes for the black level if none is stated.
    problem
        Why the stated lines with light are not those of the image; a region that the caller states is needed then.
    numbers
        How the numbers are stored. Those of signed ones and floats are converted (`photosite.frames.stored_numbers`).
    amplifiers
        The parts of the frame that amplifiers of their own read, by their names; empty where the file states none.
    first_pixel
        Position in the file, in bytes, of the first pixel of uint16, if all follow as they do in memory; else None.
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
    color_matrix_a: NDArray[np.float64] | None = None
    noise_profile: NDArray[np.float64] | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    location: FrameLocation | None = None
    masked_border: bool = False
    border: Border | None = None
    overscan: bool = False
    problem: FileError | None = None
    numbers: NumberKind = "unsigned"
    first_pixel: int | None = None
    amplifiers: tuple[Region, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Texts that select the frame in its file."""
        return self.location.names if self.location else ("0",)

    @property
    def conditions(self) -> dict[str, str]:
        """The conditions that the file states, by the names of `photosite.frames.conditions.CONDITIONS`."""
        return stated_conditions(self.metadata)

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

    def check_sections(self, path: Path) -> None:
        """Raise the error of stated lines with light that are not those of the image."""
        if self.problem is not None:
            size, hint = {"region": f"0:{self.rows},0:{self.cols}"}, "Pass {region} with the pixels that receive light"
            if self.problem.arguments and self.problem.hint:
                size, hint = self.problem.arguments, self.problem.hint
            fields = {name: value for name, value in self.problem.fields.items() if name not in ("hint", "arguments")}
            raise FileError(path, self.problem.what, **fields, hint=hint, arguments=size)

    def resolve_bits(self, path: Path, bits: int | None) -> int:
        """Return the bit depth: what the file states, else what the caller states, else what the file stores."""
        if self.bits is not None and bits is not None and self.bits != bits:
            raise FileError(path, "bits", value=bits, expected=f"{self.bits}, as the file states")
        if self.stored_bits is not None and bits is not None and bits > self.stored_bits:
            raise FileError(
                path, "bits", value=bits, expected=f"at most the {self.stored_bits} bits that the file stores"
            )
        resolved = self.bits or bits or (None if self.stored_bits == 32 else self.stored_bits)
        if resolved is None:
            raise FileError(path, "the file does not state its bit depth", hint="Pass {bits}", arguments={"bits": 12})
        most = MOST_BITS if self.stored_bits == 32 else 16
        if not 1 <= resolved <= most:
            raise FileError(path, "bits", value=resolved, expected=f"1 to {most}")
        return resolved

    def resolve_cfa(self, path: Path, cfa: Cfa | None) -> Cfa | None:
        """Return the color filter array: what the file states, else what the caller states, else None."""
        if self.cfa is not None and cfa is not None and self.cfa != cfa:
            raise FileError(path, "cfa", value=tile_text(cfa), expected=f"{tile_text(self.cfa)}, as the file states")
        return self.cfa or cfa

    def to_frame(self, path: Path, dn: Numbers, bits: int | None, cfa: Cfa | None) -> RawFrame:
        """Return the raw frame; the caller's bits and cfa are used where the file states none."""
        if self.exposure_s is not None and not 0 <= self.exposure_s < math.inf:
            raise FileError(path, "exposure_s", value=self.exposure_s, expected="finite and 0 (a bias frame) or above")
        resolved = self.resolve_bits(path, bits)
        try:
            return RawFrame(
                of_bits(path, dn, resolved),
                bits=resolved,
                cfa=self.resolve_cfa(path, cfa) or MONOCHROME,
                black_level_dn=self.black_level_dn or 0.0,
                white_level_dn=self.white_level_dn,  # type: ignore[arg-type]  # None: the highest number
                exposure_s=self.exposure_s,
                color_matrix=self.color_matrix,
                color_matrix_a=self.color_matrix_a,
                noise_profile=self.noise_profile,
                metadata=dict(self.metadata),
            )
        except InputError as error:
            raise error.in_file(path) from None


def of_bits(name: str | PathLike[str], dn: Numbers, bits: int) -> Numbers:
    """Return the numbers in the type of their bit depth; raise `FileError` for larger ones."""
    if bits not in (8, 16) and (highest := int(dn.max())) >= 1 << bits:
        raise FileError(name, "dn", value=highest, expected=f"at most {(1 << bits) - 1}, for {bits} bits")
    return dn.astype(np.uint16, copy=False) if bits <= 16 else dn.astype(np.uint32, copy=False)


class OwnOutputError(FileError):
    """The file is an output of photosite that is no frame: maps, a picture, a scene, a noise-free mosaic."""

    def __init__(self, path: str | PathLike[str], kind: str) -> None:
        self.kind = kind
        super().__init__(path, f"the file is {kind} that photosite wrote, not a frame")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.path, self.kind)


SOFTWARE = "photosite"
"""Software that developed pictures in PNG name, by which they are known."""


def check_sensor(where: str | PathLike[str], sensor: Sensor, bits: int, cfa: Cfa, *, stated: tuple[bool, bool]) -> None:
    """Check that a sensor has the bits and the mosaic of frames; the error names where these are from.

    Parameters
    ----------
    where
        File or folder of the frames, for the error.
    sensor, bits, cfa
        The sensor, and bits and mosaic of the frames.
    stated
        Whether files state bits and mosaic.
    """
    if bits not in (known := {sensor.readout.bits, sensor.output_bits}):
        theirs = " or ".join(map(str, sorted(known)))
        own = f"the files state {bits} bits" if stated[0] else f"{bits} bits are stated for the frames"
        raise FileError(where, f"{own}, but the sensor '{sensor.name}' has {theirs}", hint=WHICH_SENSOR)
    if sensor.array.cfa != cfa:
        own = "the files state the" if stated[1] else "the frames are stated to have the"
        theirs = f"the sensor '{sensor.name}' has {tile_text(sensor.array.cfa)}"
        what = f"{own} color filter array {tile_text(cfa)}, but {theirs}"
        raise FileError(where, what, hint=WHICH_SENSOR)


@contextmanager
def bits_from(sensor_name: str | None) -> Iterator[None]:
    """Name the sensor, if it gives the bit depth of files that state none, in the error for larger numbers."""
    try:
        yield
    except FileError as error:
        if sensor_name is None or error.what != "dn" or not str(error.expected).endswith(" bits"):
            raise
        expected = f"{error.expected}, which the sensor '{sensor_name}' has"
        raise FileError(error.path, "dn", value=error.value, expected=expected, hint=WHICH_SENSOR) from None


WHICH_SENSOR = "Name the sensor that took the frames, or correct its file"


MARK = "photosite_frame"
"""The description's first key; its value is the version of the format."""


_TABLES = ("color_matrix", "color_matrix_a", "noise_profile")


def describe_frame(frame: RawFrame) -> str:
    """Return the description of a frame: one line of ASCII JSON."""
    check_metadata(frame)
    content: dict[str, Any] = {
        MARK: 1,
        "bits": frame.bits,
        "cfa": [list(row) for row in frame.cfa],
        "black_level_dn": frame.black_level_dn,
        "white_level_dn": frame.white_level_dn,
        "exposure_s": frame.exposure_s,
        **{name: None if (rows := getattr(frame, name)) is None else np.asarray(rows).tolist() for name in _TABLES},
        "metadata": dict(frame.metadata),
    }
    try:
        return json.dumps(content, allow_nan=False, default=lambda number: number.item())
    except ValueError:
        raise InputError("the frame has numbers that are not finite and cannot be saved") from None


def check_metadata(frame: RawFrame) -> None:
    """Raise `InputError` for metadata that are not strings and finite numbers with names."""
    for name, value in frame.metadata.items():
        number = isinstance(value, int | float | np.integer | np.floating)
        if not isinstance(name, str) or not (isinstance(value, str) or (number and np.isfinite(value))):
            raise InputError(f"metadata[{name!r}]", value=value, expected="a string or a finite number")


def is_description(text: str) -> bool:
    """Return whether a text is photosite's description of a frame."""
    return text.startswith(f'{{"{MARK}"')


def parse_description(path: Path, text: str, rows: int, cols: int, stored_bits: int) -> FrameHeader | None:
    """Return the header of a description, or None if another program wrote the text."""
    if not is_description(text):
        return None
    try:
        content = json.loads(text)
        if content[MARK] != 1:
            raise FileError(path, MARK, value=content[MARK], expected="1, the format version that is supported")
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
            color_matrix_a=_table(content.get("color_matrix_a")),
            noise_profile=_table(content["noise_profile"]),
            metadata=dict(content["metadata"]),
        )
    except (ValueError, TypeError, KeyError) as error:
        raise FileError(path, f"the description of the frame is damaged ({error})") from None


def _table(rows: Any) -> NDArray[np.float64] | None:
    return None if rows is None else np.asarray(rows, dtype=np.float64)


@dataclass(frozen=True)
class FrameFile:
    """A frame's file, and the settings that its listing states.

    Parameters
    ----------
    path
        The file. Without `location` it stands for all frames in the file.
    settings
        Settings from the protocol, the descriptor or the caller. They override the file's metadata.
    listed_in, line
        The protocol or descriptor and its line, for messages; None for a file found in a folder.
    names
        Names that may state settings: the file's, then its folder's. Empty for files that a listing names.
    location
        Which frame of the file.
    conditions
        Conditions from the protocol, which override the file's.
    selection
        Text that names a part of the file, as in `photosite.frames.io.formats.select_headers`; None for all of it.
    """

    path: Path
    settings: FrameSettings
    listed_in: Path | None = None
    line: int | None = None
    names: tuple[str, ...] = ()
    location: FrameLocation | None = None
    conditions: Mapping[str, str] = field(default_factory=dict)
    selection: str | None = None

    @property
    def name(self) -> str:
        """Name of the frame in messages: its file, and which frame of it."""
        return f"{self.path}{self.location.label}" if self.location else str(self.path)

    def error(self, what: str, **fields: Any) -> FileError:
        """Return an error at the listing's line, or about the file if no listing names it."""
        if self.listed_in is None:
            return FileError(self.name, what, **fields)
        return FileError(self.listed_in, what, self.line, where=self.name, **fields)


_SELECTION = re.compile(r"(.*?[^\]])\[([^\[\]]+)\]")


def split_selection(path: str) -> tuple[str, str | None]:
    """Return the path of a file and the text that names a part of it, in brackets; None without one.

    A path that exists is a path.

    Examples
    --------
    >>> split_selection("night/a.fits[2]"), split_selection("night/a.fits"), split_selection("night/a[0-9].fits")
    (('night/a.fits', '2'), ('night/a.fits', None), ('night/a[0-9].fits', None))
    """
    found = _SELECTION.fullmatch(path)
    if found is None or os.path.exists(path) or not Path(found[1]).suffix:
        return path, None
    return found[1], found[2].strip()


@dataclass(frozen=True)
class SetProperties:
    """Properties that all frames of a set share, from a protocol, a descriptor or the caller; None if not stated.

    `exposure_s` is that of frames that state none.
    """

    bits: int | None = None
    cfa: Cfa | None = None
    shape: tuple[int, int] | None = None
    black_level_dn: float | None = None
    sensor: Sensor | None = None
    region: Section | None = None
    layout: Layout | None = None
    exposure_s: float | None = None
