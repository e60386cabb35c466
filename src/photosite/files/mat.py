"""MATLAB files of version 4 to 7.2, read by SciPy in a child process: SciPy's reader crashes on some damaged files.

These versions compress each variable as a whole, so the child process holds each in memory once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, message_of
from photosite.files.child import ChildError, call_in_child
from photosite.files.small_files import check_stored_file

_MOST_VALUES = 1 << 27
"""Values of one array: a mosaic of 134 million pixels, a cube of 4 million samples of 31 bands."""
_MEMORY_BYTES = 8 << 30
_TIME_S, _BYTES_PER_S, _LONGEST_S = 60.0, 1e6, 3600.0


@dataclass(frozen=True)
class ArrayFile:
    """An array of three axes in a file of plain numbers, plane by plane of its last axis.

    Parameters
    ----------
    path, dtype
        The file and the type of its numbers.
    shape
        The shape in MATLAB.
    """

    path: Path
    dtype: np.dtype[Any]
    shape: tuple[int, int, int]


def load_mat(file: Path, array_folder: Path | None = None) -> dict[str, Any]:
    """Read the variables of a MATLAB file: NumPy arrays, and structures of one element as dictionaries.

    Parameters
    ----------
    file
        The file.
    array_folder
        A folder for real arrays of three axes, which are then returned as `ArrayFile`.
    """
    check_stored_file(file)
    time_s = min(_TIME_S + file.stat().st_size / _BYTES_PER_S, _LONGEST_S)
    try:
        content: dict[str, Any] = call_in_child(read_mat, file, array_folder, time_s=time_s, memory_bytes=_MEMORY_BYTES)
    except ChildError as error:
        raise FileError(file, f"is not a MATLAB file, or is damaged ({error})") from None
    return content


def read_mat(file: Path, array_folder: Path | None) -> dict[str, Any]:
    """Read the variables as `load_mat` does; for the child process."""
    from scipy.io import loadmat, whosmat

    with file.open("rb") as stream:
        try:
            for name, shape, _ in whosmat(stream):
                if math.prod(shape) > _MOST_VALUES:
                    raise FileError(file, f"has more than {_MOST_VALUES} values", where=f"variable '{name}'")
            stream.seek(0)
            content = loadmat(stream, struct_as_record=False)
        except NotImplementedError:
            raise FileError(file, "is a MATLAB file of version 7.3", hint="Save it with -v7") from None
    values = {name: _plain(value) for name, value in content.items() if not name.startswith("__")}
    return values if array_folder is None else _read_array_files(values, array_folder, [0])


def _read_array_files(value: Any, folder: Path, count: list[int]) -> Any:
    if isinstance(value, dict):
        return {name: _read_array_files(part, folder, count) for name, part in value.items()}
    if not (isinstance(value, np.ndarray) and value.ndim == 3 and value.dtype.kind in "fiu"):
        return value
    count[0] += 1
    path = folder / f"array{count[0]}"
    try:
        with path.open("wb") as stream:
            for plane in range(value.shape[2]):
                stream.write(np.ascontiguousarray(value[:, :, plane]).data)
    except OSError as error:
        raise FileError(folder, f"cannot be written: {message_of(error)}") from None
    return ArrayFile(path, value.dtype, value.shape)


def _plain(value: Any) -> Any:
    """Return structures of one element as dictionaries, cells as lists, text as text."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        if value.size == 1 and hasattr(value.item(), "_fieldnames"):
            return _plain(value.item())
        return [_plain(cell) for cell in value.ravel()]
    if hasattr(value, "_fieldnames"):
        return {name: _plain(getattr(value, name)) for name in value._fieldnames}
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        return "".join(value.ravel().tolist())
    return value if isinstance(value, np.ndarray) else None
