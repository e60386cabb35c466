"""The maps beside a sensor file: HDF5 out and in, named and hashed."""

from __future__ import annotations

import hashlib
import math
import os
import shutil
from dataclasses import fields
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.files.atomic import atomic_path
from photosite.sensor.measured_chip import MAP_UNITS, Blinking, DefectKind, Defects, MeasuredChip
from photosite.sensor.model import Maps

FORMAT = 1
SUFFIX = ".maps.h5"
MOST_PIXELS = 1 << 28
"""Of a map that is read at all: eight maps of it are 8 GiB."""

_NUMBERS = ("black_level_dn", "reference_exposure_s", "row_noise_dn", "column_noise_dn")
_LISTS: dict[str, type[Defects] | type[Blinking]] = {"defects": Defects, "blinking": Blinking}


def write_maps(chip: MeasuredChip, path: str | PathLike[str]) -> Maps:
    """Write the maps of a chip to an HDF5 file, whole or not at all.

    The file holds a dataset for each map, with its unit; groups `defects` and `blinking` with a dataset per column; and
    the chip's numbers as attributes.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    import h5py

    with atomic_path(path) as temporary:
        with h5py.File(temporary, "w") as file:
            file.attrs["photosite_maps"] = FORMAT
            file.attrs["read_noise_freedom"] = chip.read_noise_freedom
            for name in _NUMBERS:
                file.attrs[name] = getattr(chip, name)
            if chip.system_gain_dn_per_e is not None:
                file.attrs["system_gain_dn_per_e"] = chip.system_gain_dn_per_e
            for name, values in chip.maps().items():
                file.create_dataset(name, data=values).attrs["unit"] = MAP_UNITS[name]
            for name, kind in _LISTS.items():
                group = file.create_group(name)
                for entry in fields(kind):
                    group.create_dataset(entry.name, data=getattr(getattr(chip, name), entry.name))
            file["defects/kind"].attrs["meaning"] = ", ".join(f"{k.value} {k.name.lower()}" for k in DefectKind)
        digest = file_sha256(temporary)
    return Maps(file=os.fspath(Path(path).absolute()), sha256=digest)


def copy_maps(maps: Maps, sensor_path: Path) -> Maps:
    """The maps as a sensor file at this path names them: copied beside it unless they lie there already.

    Raises
    ------
    FileError
        If the maps are missing or changed, or cannot be written.
    """
    source = Path(maps.file)
    _check_digest(maps)
    if source.parent.resolve() == sensor_path.parent.resolve():
        return Maps(file=source.name, sha256=maps.sha256)
    target = maps_path(sensor_path)
    with atomic_path(target) as temporary:
        shutil.copyfile(source, temporary)
    return Maps(file=target.name, sha256=maps.sha256)


def maps_path(sensor_path: str | PathLike[str]) -> Path:
    """Where the maps of a sensor file lie.

    Examples
    --------
    >>> maps_path("mine.sensor.yaml").name
    'mine.maps.h5'
    """
    path = Path(sensor_path)
    return path.with_name(path.name.removesuffix(path.suffix).removesuffix(".sensor") + SUFFIX)


def load_maps(maps: Maps) -> MeasuredChip:
    """The measured chip of a sensor file's maps; read once, and kept for the frames that follow.

    Raises
    ------
    FileError
        If the file is missing, is not the one that the sensor file hashed, or does not hold a chip's maps.
    """
    return _load(maps.file, maps.sha256)


# A chip of 10 megapixels is 280 MB: two are kept.
@lru_cache(maxsize=2)
def _load(file: str, sha256: str) -> MeasuredChip:
    _check_digest(Maps(file=file, sha256=sha256))
    return read_maps(file)


def read_maps(path: str | PathLike[str]) -> MeasuredChip:
    """The chip in a file of maps.

    Raises
    ------
    FileError
        If the file is missing or does not hold a chip's maps.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return _chip(path, file)
    except FileNotFoundError:
        raise FileError(path, "there is no such file of maps") from None
    except InputError as error:
        raise FileError(path, f"does not hold a chip's maps: {error}") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, OverflowError) as error:
        raise FileError(path, f"cannot be read as HDF5 maps: {' '.join(str(error).split())[:200]}") from None


def file_sha256(path: str | PathLike[str]) -> str:
    """SHA-256 of a file's bytes."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _check_digest(maps: Maps) -> None:
    try:
        digest = file_sha256(maps.file)
    except FileNotFoundError:
        raise FileError(maps.file, "there is no such file of maps; keep it where the sensor file names it") from None
    except (OSError, ValueError) as error:  # ValueError: a name that no file can have
        raise FileError(maps.file, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if digest != maps.sha256:
        raise FileError(
            maps.file,
            f"is not the file of maps that the sensor file means: its SHA-256 begins {digest[:12]}, expected "
            f"{maps.sha256[:12]}; put the right file there, or calibrate again",
        )


def _chip(path: str | PathLike[str], file: Any) -> MeasuredChip:
    version = file.attrs.get("photosite_maps")
    if version != FORMAT:
        raise FileError(path, f"holds no maps: expected the attribute photosite_maps = {FORMAT}, got {version!r:.60}")
    arguments: dict[str, Any] = {name: _number(path, file, name) for name in _NUMBERS}
    freedom = _number(path, file, "read_noise_freedom")
    if freedom < 1:
        raise FileError(path, f"read_noise_freedom is 1 or more, not {freedom:g}")
    arguments["read_noise_freedom"] = int(freedom)
    gain = _number(path, file, "system_gain_dn_per_e") if "system_gain_dn_per_e" in file.attrs else None
    for name in MAP_UNITS:
        arguments[name] = _values(path, file, name, 2, np.float32) if name in file else None
    for name in ("offset_dn", "offset_uncertainty_dn", "read_noise_dn"):
        if arguments[name] is None:
            raise FileError(path, f"lacks the map {name}")
    for name, kind in _LISTS.items():
        columns = [_values(path, file, f"{name}/{entry.name}", 1, _TYPES[entry.name]) for entry in fields(kind)]
        if len({len(column) for column in columns}) > 1:
            raise FileError(path, f"the columns of {name} differ in length")
        arguments[name] = kind(*columns)
    return MeasuredChip(system_gain_dn_per_e=gain, **arguments)


_TYPES: dict[str, type[np.generic]] = {
    "row": np.int64,
    "col": np.int64,
    "kind": np.uint8,
    **dict.fromkeys(("value", "deviation", "amplitude_dn", "high_fraction", "noise_dn"), np.float64),
}


def _number(path: str | PathLike[str], file: Any, name: str) -> float:
    value = file.attrs.get(name)
    if value is None or np.ndim(value) != 0 or not np.issubdtype(np.asarray(value).dtype, np.number):
        raise FileError(path, f"the attribute {name} is a number, not {value!r:.60}")
    if not math.isfinite(value):
        raise FileError(path, f"the attribute {name} is finite, not {value}")
    return float(value)


def _values(path: str | PathLike[str], file: Any, name: str, dimensions: int, kind: type[np.generic]) -> NDArray[Any]:
    import h5py

    found = file.get(name)
    if not isinstance(found, h5py.Dataset) or found.ndim != dimensions or not np.issubdtype(found.dtype, np.number):
        raise FileError(path, f"{name} is a dataset of numbers with {dimensions} dimension(s), and is not here")
    if found.size > MOST_PIXELS:
        raise FileError(path, f"{name} is {found.shape}: more than {MOST_PIXELS} numbers are not read")
    values = np.asarray(found[()]).astype(kind, copy=False)
    values.flags.writeable = False
    return values
