"""Frames in HDF5: every dataset of unsigned integers with the shape of a frame or of a stack of frames.

A dataset (rows, cols) of uint8, uint16 or uint32 is a frame, one of (frames, rows, cols) a stack; in a file without
them, datasets of signed integers or floats are. Attributes of the dataset, of the groups above it and of the file state
the other fields; the nearest one counts:

    exposure_s          exposure time in seconds (or exposure_ms, exposure_us, exposure_ns)
    kind                "dark" or "light"
    gain_setting        the camera's setting (or iso, gain)
    temperature_c       of the sensor, in degrees Celsius
    photons_per_pixel   mean photons during the exposure
    bits                bit depth of the converter
    black_level_dn, white_level_dn
    cfa                 "rggb", "RG/GB", or the tile as an array of names
    color_matrix, color_matrix_a, noise_profile

The first five may be arrays with one value per frame. Names of datasets and groups state missing settings, as file
names do (`photosite.frames.frame_settings`). Other attributes with text or numbers become metadata.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, message_of
from photosite.files.hdf5 import Hdf5File, check_stored, create_hdf5, open_hdf5, plain
from photosite.frames.frame_file import FrameHeader, FrameLocation, OwnOutputError, check_metadata
from photosite.frames.raw_frame import RawFrame
from photosite.frames.stored_numbers import NumberKind, StoredNumbers
from photosite.values.cfa import NAMED, Cfa, cfa_from, tile_name

_DATASET = "frame"
_SECONDS = {"exposure_s": 1.0, "exposure_ms": 1e3, "exposure_us": 1e6, "exposure_ns": 1e9}
_GAINS = ("gain_setting", "iso", "gain")
_PER_FRAME = ("kind", "temperature_c", "photons_per_pixel", *_SECONDS, *_GAINS)
_WITHOUT_UNIT = ("exposure", "exposure_time", "exposuretime", "exptime", "integration_time")
_MOST_COLORS = 4
_NUMBERS: Mapping[str, NumberKind] = {"u": "unsigned", "i": "signed", "f": "float"}
_DEFLATE, _SHUFFLE = 1, 2
"""Numbers of the filters of HDF5."""


def write(frame: RawFrame, path: Path) -> None:
    """Write the frame as one dataset with attributes."""
    check_metadata(frame)
    cfa = tile_name(frame.cfa) if frame.cfa in NAMED.values() else np.char.encode(np.array(frame.cfa), "utf-8")
    attributes: dict[str, Any] = {"bits": frame.bits, "cfa": cfa}
    for name in ("black_level_dn", "white_level_dn", "exposure_s", "color_matrix", "color_matrix_a", "noise_profile"):
        if (value := getattr(frame, name)) is not None:
            attributes[name] = value
    for name, value in frame.metadata.items():
        if name in attributes:
            raise InputError("metadata", value=name, expected="named differently from the frame's own fields")
        attributes[name] = value
    with create_hdf5(path) as file:
        data = file.create_dataset(_DATASET, data=frame.dn)
        for name, value in attributes.items():
            # Text of fixed length is stored in the attribute itself, not in a heap of the file.
            data.attrs[name] = np.bytes_(value.encode("utf-8")) if isinstance(value, str) else value


def read_headers(path: Path) -> tuple[FrameHeader, ...]:
    """Read the headers of all frames in an HDF5 file, by the names of the datasets."""
    with open_hdf5(path) as file:
        datasets = file.datasets.values()
        if kind := _own_output(file):
            raise OwnOutputError(path, kind)
        unsigned = [item for item in datasets if _can_be_frames(item, "u")]
        parts = [_read_part(file, item) for item in unsigned or datasets if _can_be_frames(item, "uif")]
        others = [f"{item.name} {item.shape} {item.dtype}" for item in datasets if not _can_be_frames(item, "u")]
    if not parts:
        found = ", ".join(others[:8]) or "no datasets"
        hint = "A frame is (rows, cols), a stack (frames, rows, cols), of uint8, uint16 or uint32"
        raise FileError(path, f"the file holds no frames, but {found}", hint=hint)
    single = len(parts) == 1 and len(parts[0].shape) == 2
    return tuple(header for part in parts for header in _headers(path, part, single))


_OWN_OUTPUTS = {
    "photosite_maps": "a file of a chip's maps",
    "photosite_scene": "a scene",
}
"""Outputs of photosite, by an attribute of the file."""

_OWN_DATASETS = {
    frozenset(("clean",)): "a noise-free mosaic",
    frozenset(("s0", "s1", "s2", "dolp", "aolp_deg")): "a file of polarization maps",
}
"""Outputs of photosite, by their datasets."""


def _own_output(file: Hdf5File) -> str | None:
    if (found := next((kind for name, kind in _OWN_OUTPUTS.items() if name in file.file.attrs), None)) is not None:
        return found
    return _OWN_DATASETS.get(frozenset(file.datasets))


def read_pixels(path: Path, location: FrameLocation) -> StoredNumbers:
    """Read the (rows, cols) numbers of one frame."""
    with open_hdf5(path) as file:
        data = file.datasets[str(location.part)]
        chunks = _compressed_chunks(data, location.index if data.ndim == 3 else None)
        if chunks is None:
            dn = data[location.index] if data.ndim == 3 else data[()]
    if chunks is not None:
        dn = chunks.decoded(path)
    if dn.dtype.kind != "u":
        return np.ascontiguousarray(dn, dn.dtype.newbyteorder("="))
    return np.ascontiguousarray(dn, np.uint32) if dn.dtype.itemsize == 4 else np.ascontiguousarray(dn, np.uint16)


@dataclass(frozen=True)
class _Chunks:
    """The compressed chunks of a frame: h5py decodes one at a time in a process, threads decode these together."""

    name: str
    shape: tuple[int, int]  # of the frame
    chunk: tuple[int, ...]
    index: int  # of the frame in a chunk of several
    dtype: np.dtype[Any]
    shuffled: bool
    parts: list[tuple[tuple[int, int], bytes]]  # first row and column, and compressed bytes

    def decoded(self, path: Path) -> NDArray[Any]:
        """Decode the chunks into (rows, cols) numbers."""
        from imagecodecs import zlib_decode

        out = np.empty(self.shape, self.dtype.newbyteorder("="))
        size = math.prod(self.chunk) * self.dtype.itemsize
        for (row, col), stored in self.parts:
            try:
                values = np.frombuffer(zlib_decode(stored, out=size), np.uint8)
            except Exception as error:  # the decoder's own exceptions
                raise FileError(path, f"is damaged: it cannot be decoded ({message_of(error)})") from None
            if values.size != size:
                raise FileError(path, "is damaged", where=f"dataset {self.name}", value=f"{values.size} bytes")
            if self.shuffled:  # the first bytes of all values, then the second ones
                values = np.ascontiguousarray(values.reshape(self.dtype.itemsize, -1).T)
            part = values.reshape(-1).view(self.dtype).reshape(self.chunk)
            if part.ndim == 3:
                part = part[self.index]
            inside = out[row : row + part.shape[0], col : col + part.shape[1]]
            inside[:] = part[: inside.shape[0], : inside.shape[1]]
        return out


def _compressed_chunks(data: Any, index: int | None) -> _Chunks | None:
    """Return the chunks of a frame that are compressed by gzip, None where the dataset is stored in another way."""
    if data.chunks is None:
        return None
    stored = data.id.get_create_plist()
    filters = [stored.get_filter(n)[0] for n in range(stored.get_nfilters())]
    if filters not in ([_DEFLATE], [_SHUFFLE, _DEFLATE]):
        return None
    chunk, shape = data.chunks, data.shape
    first = () if index is None else (index // chunk[0] * chunk[0],)
    parts = []
    for row in range(0, shape[-2], chunk[-2]):
        for col in range(0, shape[-1], chunk[-1]):
            try:
                mask, content = data.id.read_direct_chunk((*first, row, col))
            except (OSError, RuntimeError):  # a chunk that was never written has no bytes
                return None
            if mask:
                return None
            parts.append(((row, col), content))
    within = 0 if index is None else index % chunk[0]
    return _Chunks(data.name, (shape[-2], shape[-1]), chunk, within, data.dtype, len(filters) > 1, parts)


@dataclass(frozen=True)
class _Part:
    """A dataset of frames: name, shape, stored bits, and its attributes with those of the groups above it."""

    name: str
    shape: tuple[int, ...]
    stored_bits: int
    attributes: Mapping[str, Any]
    numbers: NumberKind = "unsigned"

    @property
    def frames(self) -> int | None:
        """Number of frames of a stack; None for a single frame."""
        return self.shape[0] if len(self.shape) == 3 else None

    def of_frame(self, path: Path, name: str, index: int) -> Any:
        """Return an attribute's value for one frame of the stack."""
        value = self.attributes[name]
        if not isinstance(value, np.ndarray):
            return value
        if value.shape != (self.frames,):
            expected = "one value, or one per frame"
            raise FileError(path, name, where=f"dataset /{self.name}", value=value.shape, expected=expected)
        return plain(value[index])


def _can_be_frames(item: Any, kinds: str) -> bool:
    return item.ndim in (2, 3) and item.dtype.kind in kinds and item.dtype.itemsize <= (8 if kinds != "u" else 4)


def _read_part(file: Hdf5File, item: Any) -> _Part:
    path, where = file.path, f"dataset {item.name}"
    if 0 in item.shape:
        raise FileError(path, f"the dataset is empty: {item.shape}", where=where)
    if item.ndim == 3 and item.shape[2] <= _MOST_COLORS < item.shape[0]:
        hint = "A stack is (frames, rows, cols)"
        raise FileError(path, f"the shape {item.shape} is that of a color picture", where=where, hint=hint)
    check_stored(path, item)
    numbers = _NUMBERS[item.dtype.kind]
    bits = 16 if numbers == "float" else min(8 * item.dtype.itemsize, 32)
    return _Part(item.name.lstrip("/"), item.shape, bits, file.attributes(item, inherited=True), numbers)


def _headers(path: Path, part: _Part, single: bool) -> Iterator[FrameHeader]:
    shared = {name: value for name, value in part.attributes.items() if name not in _PER_FRAME}
    try:
        fields = {name: convert(shared[name]) for name, convert in _FIELDS.items() if name in shared}
    except (ValueError, TypeError, OverflowError) as error:
        raise FileError(path, f"an attribute is invalid ({error})", where=f"dataset /{part.name}") from None
    metadata = {n: v for n, v in shared.items() if n not in _FIELDS and isinstance(v, str | int | float)}
    per_frame = [name for name in _PER_FRAME if name in part.attributes]
    for index in range(part.frames or 1):
        own = {name: part.of_frame(path, name, index) for name in per_frame}
        number = "" if part.frames is None else f"[{index}]"
        names = (part.name, f"{part.name},{index}")
        yield FrameHeader(
            part.shape[-2],
            part.shape[-1],
            part.stored_bits,
            exposure_s=_exposure_s(path, part, own),
            metadata=metadata | _settings(own),
            numbers=part.numbers,
            location=FrameLocation("" if single else f":/{part.name}{number}", part.name, index, names),
            **fields,
        )


def _settings(own: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings for the metadata, with one name for the gain."""
    kept = {name: own[name] for name in ("kind", "temperature_c", "photons_per_pixel", "iso") if name in own}
    gain = next((own[name] for name in _GAINS if name in own and name != "iso"), None)
    return kept if gain is None else kept | {"gain_setting": gain}


def _exposure_s(path: Path, part: _Part, own: Mapping[str, Any]) -> float | None:
    where = f"dataset /{part.name}"
    for name, per_second in _SECONDS.items():
        if name in own:
            value = own[name]
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise FileError(path, name, where=where, value=value, expected="a number")
            return value / per_second
    for name in part.attributes:
        if name.lower() in _WITHOUT_UNIT:
            problem = f"the unit of the attribute '{name}' is unknown"
            raise FileError(path, problem, where=where, hint="Name it exposure_s, in seconds")
    return None


def _whole(value: Any) -> int:
    if value != int(value):
        raise ValueError(f"{value!r} is not a whole number")
    return int(value)


def _table(value: Any) -> NDArray[np.float64]:
    return np.asarray(value, dtype=np.float64)


def _cfa(value: Any) -> Cfa:
    if isinstance(value, np.ndarray):
        return cfa_from([[str(plain(name)) for name in row] for row in np.atleast_2d(value)])
    return cfa_from(value)


_FIELDS: Mapping[str, Callable[[Any], Any]] = {
    "bits": _whole,
    "cfa": _cfa,
    "black_level_dn": float,
    "white_level_dn": float,
    "color_matrix": _table,
    "color_matrix_a": _table,
    "noise_profile": _table,
}
"""Attributes that are fields of the header, with their conversions."""
