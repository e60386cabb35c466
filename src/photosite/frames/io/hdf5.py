"""Frames in HDF5: every dataset of unsigned integers that has the shape of a frame or of a stack of them.

The layout. A dataset (rows, cols) of uint8 or uint16 is a frame, one of (frames, rows, cols) a stack. Attributes say
the rest; they stand with the dataset, or with a group above it, or the file, and the nearest counts:

    exposure_s          exposure time in seconds (or exposure_ms, exposure_us, exposure_ns)
    kind                "dark" or "light"
    gain_setting        as the camera has it (or iso, gain)
    temperature_c       of the sensor, degrees Celsius
    photons_per_pixel   mean photons in the exposure
    bits                of the converter
    black_level_dn, white_level_dn
    cfa                 "rggb", "RG/GB", or the tile as an array of names
    color_matrix, noise_profile

The first five may be arrays of one value a frame. Where kind, exposure or gain are not among them, the names of dataset
and groups are read as file names are (`photosite.frames.names`). Other attributes of text and numbers are metadata.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.hdf5_heap import check_heaps
from photosite.frames.io.header import FrameHeader, Place
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import NAMED, Cfa, cfa_from

SIGNATURE = b"\x89HDF\r\n\x1a\n"
SUFFIXES = frozenset({".h5", ".hdf5", ".hdf"})

_DATASET = "frame"
_SECONDS = {"exposure_s": 1.0, "exposure_ms": 1e3, "exposure_us": 1e6, "exposure_ns": 1e9}
_GAINS = ("gain_setting", "iso", "gain")
_BY_FRAME = ("kind", "temperature_c", "photons_per_pixel", *_SECONDS, *_GAINS)
_UNITLESS = ("exposure", "exposure_time", "exposuretime", "exptime", "integration_time")
_MOST_COLOURS = 4
_DENSEST = 2000
"""Bytes of pixels to a byte in the file: deflate reaches 1030, so what says more was not written."""


def write_hdf5(frame: RawFrame, path: Path) -> None:
    """Write the frame as one dataset with its attributes.

    Raises
    ------
    InputError
        If the metadata hold something else than strings and finite numbers.
    """
    import h5py

    attributes: dict[str, Any] = {"bits": frame.bits, "cfa": _written(frame.cfa)}
    for name in ("black_level_dn", "white_level_dn", "exposure_s", "color_matrix", "noise_profile"):
        if (value := getattr(frame, name)) is not None:
            attributes[name] = value
    for name, value in frame.metadata.items():
        number = isinstance(value, int | float | np.integer | np.floating) and math.isfinite(value)
        if not isinstance(name, str) or not (number or isinstance(value, str)) or name in attributes:
            raise InputError(f"metadata are strings and numbers by names of their own, not {name!r}: {value!r}")
        attributes[name] = value
    with h5py.File(path, "w") as file:
        data = file.create_dataset(_DATASET, data=frame.dn)
        for name, value in attributes.items():
            # Text of fixed length: it lies with its attribute, and not in a heap of the file's.
            data.attrs[name] = np.bytes_(value.encode("utf-8")) if isinstance(value, str) else value


def _written(cfa: Cfa) -> Any:
    named = [name for name, tile in NAMED.items() if tile == cfa]
    return named[0] if named else np.char.encode(np.array(cfa), "utf-8")


def read_hdf5_headers(path: Path) -> tuple[FrameHeader, ...]:
    """What an HDF5 file says of its frames, dataset after dataset by name.

    Raises
    ------
    FileError
        If it is damaged, holds no frames, or an attribute says what cannot be.
    """
    import h5py

    with _opened(path) as file:
        datasets: list[Any] = []
        # A return value would end the visit.
        file.visititems(lambda _, item: datasets.append(item) if isinstance(item, h5py.Dataset) else None)
        check_heaps(path, file, datasets)
        parts = [_part(path, item) for item in datasets if _can_be_frames(item)]
        others = [f"{item.name} {item.shape} {item.dtype}" for item in datasets if not _can_be_frames(item)]
    if not parts:
        there = ", ".join(others[:8]) or "it has no datasets"
        raise FileError(path, f"holds no frames, (rows, cols) or (frames, rows, cols) of uint8 or uint16: {there}")
    alone = len(parts) == 1 and len(parts[0].shape) == 2
    return tuple(header for part in parts for header in _headers(path, part, alone))


def read_hdf5_pixels(path: Path, place: Place) -> NDArray[np.uint16]:
    """The (rows, cols) numbers of one frame.

    Raises
    ------
    FileError
        If they cannot be read.
    """
    with _opened(path) as file:
        data = file[place.part]
        dn = data[place.index] if data.ndim == 3 else data[()]
    return np.ascontiguousarray(dn, dtype=np.uint16)


@dataclass(frozen=True)
class _Part:
    """A dataset of frames: its name, shape, bits as stored, and what its attributes and those above it say."""

    name: str
    shape: tuple[int, ...]
    stored_bits: int
    attributes: Mapping[str, Any]

    @property
    def frames(self) -> int | None:
        """How many frames the stack has; None for a frame that is no stack."""
        return self.shape[0] if len(self.shape) == 3 else None

    def of_frame(self, path: Path, name: str, index: int) -> Any:
        """An attribute's value for one frame of the stack."""
        value = self.attributes[name]
        if not isinstance(value, np.ndarray):
            return value
        if value.shape != (self.frames,):
            said = f"{name} has shape {value.shape}; it is one value, or one a frame"
            raise FileError(path, f"dataset /{self.name}: {said}")
        return _plain(value[index])


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            yield file
    except FileError:
        raise
    # h5py hands on whatever libhdf5 stumbles over, as OSError, KeyError, RuntimeError, ValueError, MemoryError ...
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read as HDF5 ({reason}); is it truncated?") from None


def _can_be_frames(item: Any) -> bool:
    return item.ndim in (2, 3) and item.dtype.kind == "u" and item.dtype.itemsize <= 2


def _part(path: Path, item: Any) -> _Part:
    """A dataset of frames, checked.

    Raises
    ------
    FileError
        If it is empty, in colour, or was not written whole.
    """
    where = f"dataset {item.name}"
    if 0 in item.shape:
        raise FileError(path, f"{where} is empty: {item.shape}")
    if item.ndim == 3 and item.shape[2] <= _MOST_COLOURS < item.shape[0]:
        raise FileError(path, f"{where} is {item.shape}, a picture in colour; a stack is (frames, rows, cols)")
    size, stored = math.prod(item.shape) * item.dtype.itemsize, item.id.get_storage_size()
    if size > _DENSEST * stored and item.external is None and not item.is_virtual:
        raise FileError(path, f"{where} says {size} bytes of pixels and stores {stored}; it was not written whole")
    return _Part(item.name.lstrip("/"), item.shape, 8 * item.dtype.itemsize, _attributes(item))


def _attributes(item: Any) -> dict[str, Any]:
    """The attributes of a dataset, those of the groups above it filling the gaps."""
    found: dict[str, Any] = {}
    while True:
        for name, value in item.attrs.items():
            found.setdefault(name, _plain(value))
        if item.name == "/":
            return found
        item = item.parent


def _plain(value: Any) -> Any:
    """Python's own text and numbers for HDF5's; arrays stay arrays, of text where they hold bytes."""
    if isinstance(value, bytes | np.bytes_):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "S":
            return np.char.decode(value, "utf-8", "replace")
        return _plain(value.ravel()[0]) if value.size == 1 and value.ndim <= 1 else value
    return value.item() if isinstance(value, np.generic) else value


def _headers(path: Path, part: _Part, alone: bool) -> Iterator[FrameHeader]:
    shared = {name: value for name, value in part.attributes.items() if name not in _BY_FRAME}
    try:
        fields = {name: read(shared[name]) for name, read in _FIELDS.items() if name in shared}
    except (ValueError, TypeError, OverflowError) as error:
        raise FileError(path, f"dataset /{part.name}: an attribute cannot be ({error})") from None
    metadata = {n: v for n, v in shared.items() if n not in _FIELDS and isinstance(v, str | int | float)}
    by_frame = [name for name in _BY_FRAME if name in part.attributes]
    for index in range(part.frames or 1):
        own = {name: part.of_frame(path, name, index) for name in by_frame}
        number = "" if part.frames is None else f"[{index}]"
        yield FrameHeader(
            part.shape[-2],
            part.shape[-1],
            part.stored_bits,
            exposure_s=_exposure_s(path, part, own),
            metadata=MappingProxyType(metadata | _settings(own)),
            place=Place("" if alone else f":/{part.name}{number}", part.name, index),
            **fields,
        )


def _settings(own: Mapping[str, Any]) -> dict[str, Any]:
    """What goes to the metadata, the gain under one name."""
    kept = {name: own[name] for name in ("kind", "temperature_c", "photons_per_pixel", "iso") if name in own}
    gain = next((own[name] for name in _GAINS if name in own and name != "iso"), None)
    return kept if gain is None else kept | {"gain_setting": gain}


def _exposure_s(path: Path, part: _Part, own: Mapping[str, Any]) -> float | None:
    for name, per_second in _SECONDS.items():
        if name in own:
            value = own[name]
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise FileError(path, f"dataset /{part.name}: {name} is {value!r}, not a number")
            return value / per_second
    for name in part.attributes:
        if name.lower() in _UNITLESS:
            raise FileError(
                path, f"dataset /{part.name}: has an attribute '{name}' of unknown unit; name it exposure_s, in seconds"
            )
    return None


def _whole(value: Any) -> int:
    if value != int(value):
        raise ValueError(f"{value!r} is no whole number")
    return int(value)


def _table(value: Any) -> NDArray[np.float64]:
    return np.asarray(value, dtype=np.float64)


def _cfa(value: Any) -> Cfa:
    if isinstance(value, str) and "/" in value:
        return cfa_from([list(row) for row in value.split("/")])
    if isinstance(value, np.ndarray):
        return cfa_from([[str(_plain(name)) for name in row] for row in np.atleast_2d(value)])
    return cfa_from(value)


_FIELDS: Mapping[str, Callable[[Any], Any]] = {
    "bits": _whole,
    "cfa": _cfa,
    "black_level_dn": float,
    "white_level_dn": float,
    "color_matrix": _table,
    "noise_profile": _table,
}
"""Attributes that are fields of the header by the same name, and how each is read."""
