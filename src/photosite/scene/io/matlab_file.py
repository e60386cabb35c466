"""The variables of a MATLAB file, of version 5 to 7.2 and of 7.3 alike; parts of structures by dotted names."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.mat import Spooled, load_mat
from photosite.files.temporary import TemporaryFolder
from photosite.scene.cube import RawCube, SpectralCube
from photosite.scene.io.hdf5_cube import MATLAB_AXES, cube_of_dataset
from photosite.scene.io.hdf5_file import numbers, opened
from photosite.scene.units import Units

Array = NDArray[np.float64]


class Variables(Protocol):
    """What is in a MATLAB file."""

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Of all variables of numbers, as MATLAB has them."""
        ...

    def numbers(self, name: str) -> Array:
        """A small variable."""
        ...

    def text(self, name: str) -> str | None:
        """A variable of text; None where there is none."""
        ...

    def cube(self, name: str, units: Units, wavelength_nm: Array, **head: Any) -> SpectralCube:
        """A variable (rows, cols, bands)."""
        ...


@contextmanager
def variables_of(path: Path) -> Iterator[Variables]:
    """The variables of a file.

    Raises
    ------
    FileError
        If it cannot be read.
    """
    with path.open("rb") as file:
        version_7_3 = file.read(10) == b"MATLAB 7.3"
    if version_7_3 or _is_hdf5(path):
        with opened(path) as (_, datasets):
            yield _Version73(path, datasets)
        return
    folder = TemporaryFolder("photosite-mat-")
    try:
        yield _Version5(path, load_mat(path, folder.path), folder)
    except BaseException:
        folder.close()
        raise


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(8) == b"\x89HDF\r\n\x1a\n"


class _Version5:
    def __init__(self, path: Path, content: dict[str, Any], folder: TemporaryFolder) -> None:
        self._path, self._folder = path, folder
        self._values = dict(_flat("", content))

    def shapes(self) -> dict[str, tuple[int, ...]]:
        return {
            name: value.shape
            for name, value in self._values.items()
            if isinstance(value, Spooled) or (isinstance(value, np.ndarray) and value.dtype.kind in "fiu")
        }

    def numbers(self, name: str) -> Array:
        value = self._values[name]
        if not isinstance(value, np.ndarray):
            raise FileError(self._path, f"variable '{name}' {value.shape} is no list of numbers")
        return np.asarray(value, np.float64)

    def text(self, name: str) -> str | None:
        value = self._values.get(name)
        return value if isinstance(value, str) else None

    def cube(self, name: str, units: Units, wavelength_nm: Array, **head: Any) -> SpectralCube:
        value = self._values[name]
        return RawCube(
            name=str(self._path),
            shape=value.shape,
            wavelength_nm=wavelength_nm,
            quantity=units.quantity,
            path=value.path,
            dtype=value.dtype,
            scale=units.scale,
            keep=self._folder,
            **head,
        )


def _flat(before: str, content: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _flat(f"{before}{name}.", value)
        else:
            yield f"{before}{name}", value


class _Version73:
    """MATLAB stores an array's first axis last in HDF5."""

    def __init__(self, path: Path, datasets: dict[str, Any]) -> None:
        self._path = path
        self._data = {name.replace("/", "."): data for name, data in datasets.items() if not name.startswith("#")}

    def shapes(self) -> dict[str, tuple[int, ...]]:
        return {
            name: data.shape[::-1]
            for name, data in self._data.items()
            if data.dtype.kind in "fiu" and not self._is_text(data)
        }

    def numbers(self, name: str) -> Array:
        return numbers(self._path, self._data[name]).T

    def text(self, name: str) -> str | None:
        data = self._data.get(name)
        if data is None or not self._is_text(data) or math.prod(data.shape) > 1000:
            return None
        return "".join(chr(int(code)) for code in numbers(self._path, data).T.ravel() if 0 < code < 0xD800)

    def cube(self, name: str, units: Units, wavelength_nm: Array, **head: Any) -> SpectralCube:
        said_here = {key: head.pop(key, None) for key in ("distance_m", "width_m")}
        return cube_of_dataset(
            self._path,
            name.replace(".", "/"),
            self._data[name],
            MATLAB_AXES,
            units=units,
            wavelength_nm=wavelength_nm,
            said_here=said_here,
            **head,
        )

    @staticmethod
    def _is_text(data: Any) -> bool:
        return bytes(np.bytes_(data.attrs.get("MATLAB_class", b""))) == b"char"
