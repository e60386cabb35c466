"""MATLAB files of version 4 to 7.2, read by SciPy in a process of its own: on some damaged files its reader crashes.

These versions compress a variable as a whole, so that process holds each in memory once.
"""

from __future__ import annotations

import math
import pickle
import struct
import subprocess
import sys
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError

_SPOOLED = "(spooled)"
_MOST_VALUES = 1 << 27
"""Of one array: a mosaic of 134 million pixels, a cube of 4 million samples of 31 bands."""


@dataclass(frozen=True)
class Spooled:
    """An array of three axes that was laid down in a file, one plane of its last axis after the other.

    Parameters
    ----------
    path, dtype
        The file and its numbers.
    shape
        As MATLAB has it.
    """

    path: Path
    dtype: np.dtype[Any]
    shape: tuple[int, int, int]


def load_mat(file: Path, spool: Path | None = None) -> dict[str, Any]:
    """The variables of a MATLAB file: NumPy arrays, and structures of one element as dictionaries.

    Parameters
    ----------
    file
        The file.
    spool
        A folder: real arrays of three axes are laid down there and come back as `Spooled`.

    Raises
    ------
    FileError
        If the file cannot be read, is damaged, or of version 7.3.
    """
    if not file.is_file():
        raise FileError(file, "there is no such file")
    command = [sys.executable, "-m", "photosite.files.mat", str(file.absolute())]
    if spool is not None:
        command.append(str(spool.absolute()))
    child = subprocess.run(command, capture_output=True, check=False)
    if child.returncode:
        raise FileError(file, "is no MATLAB file, or a damaged one: its reader crashed")
    content = pickle.loads(child.stdout)  # written by `_main` below, of arrays and dictionaries only
    if isinstance(content, str):
        raise FileError(file, content)
    return {name: _with_spooled(value) for name, value in content.items()}


def _read(path: str) -> dict[str, Any] | str:
    """The variables, or what is wrong with the file."""
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    try:
        with Path(path).open("rb") as stream:
            for name, shape, _ in whosmat(stream):
                if math.prod(shape) > _MOST_VALUES:
                    return f"'{name}' has more than {_MOST_VALUES} values"
            stream.seek(0)
            content = loadmat(stream, struct_as_record=False)
    except NotImplementedError:
        return "is a MATLAB file of version 7.3; save it with -v7"
    except (
        MatReadError,
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        AttributeError,
        OverflowError,
        MemoryError,
        OSError,
        struct.error,
        zlib.error,
    ) as error:
        return f"is no MATLAB file, or a damaged one: {' '.join(str(error).split())}"
    return {name: _plain(value) for name, value in content.items() if not name.startswith("__")}


def _with_spooled(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if _SPOOLED not in value:
        return {name: _with_spooled(part) for name, part in value.items()}
    path, dtype, shape = value[_SPOOLED]
    return Spooled(Path(path), np.dtype(dtype), shape)


def _laid_down(value: Any, spool: Path, number: list[int]) -> Any:
    """The value, its arrays of three axes in files; a dictionary stands for each."""
    if isinstance(value, dict):
        return {name: _laid_down(part, spool, number) for name, part in value.items()}
    if not (isinstance(value, np.ndarray) and value.ndim == 3 and value.dtype.kind in "fiu"):
        return value
    number[0] += 1
    path = spool / f"array{number[0]}"
    with path.open("wb") as stream:
        for plane in range(value.shape[2]):
            stream.write(np.ascontiguousarray(value[:, :, plane]).data)
    return {_SPOOLED: (str(path), value.dtype.str, value.shape)}


def _plain(value: Any) -> Any:
    """Structures of one element as dictionaries, cells of text as text."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        if value.size == 1 and hasattr(value.item(), "_fieldnames"):
            return _plain(value.item())
        return [_plain(cell) for cell in value.ravel()]
    if hasattr(value, "_fieldnames"):
        return {name: _plain(getattr(value, name)) for name in value._fieldnames}
    if isinstance(value, np.ndarray) and value.dtype.kind == "U":
        return "".join(value.ravel().tolist())
    return value if isinstance(value, np.ndarray) else None


if __name__ == "__main__":
    found: Any = _read(sys.argv[1])
    if len(sys.argv) > 2:
        try:
            found = _laid_down(found, Path(sys.argv[2]), [0])
        except OSError as problem:
            found = f"cannot be laid down in {sys.argv[2]}: {problem.strerror}"
    sys.stdout.buffer.write(pickle.dumps(found))
