"""MATLAB files of version 4 to 7.2, read by SciPy in a process of its own: on some damaged files its reader crashes."""

from __future__ import annotations

import math
import pickle
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError

_MOST_VALUES = 1 << 27
"""Of one array: a mosaic of 134 million pixels."""


def load_mat(file: Path) -> dict[str, Any]:
    """The variables of a MATLAB file: NumPy arrays, and structures of one element as dictionaries.

    Parameters
    ----------
    file
        The file.

    Raises
    ------
    FileError
        If the file cannot be read, is damaged, or of version 7.3.
    """
    if not file.is_file():
        raise FileError(file, "there is no such file")
    command = [sys.executable, "-m", "photosite.mat_file", str(file.absolute())]
    child = subprocess.run(command, capture_output=True, check=False)
    if child.returncode:
        raise FileError(file, "is no MATLAB file, or a damaged one: its reader crashed")
    content = pickle.loads(child.stdout)  # written by `_main` below, of arrays and dictionaries only
    if isinstance(content, str):
        raise FileError(file, content)
    return dict(content)


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
    sys.stdout.buffer.write(pickle.dumps(_read(sys.argv[1])))
