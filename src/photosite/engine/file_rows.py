"""Reading of files in compiled code, without the interpreter between two reads (Linux)."""

from __future__ import annotations

import sys
from typing import Any, cast

import numpy as np
from numba import types
from numpy.typing import NDArray

from photosite.engine.jit import I64, compiled, pointer

CAN_READ = sys.platform == "linux"
"""Whether the functions of this module can be called."""

_pread: Any = cast(Any, types).ExternalFunction(
    "pread", types.intp(types.intc, types.voidptr, types.uintp, types.int64)
)


@compiled()
def read_at(file: int, address: int, size: int, place: int) -> bool:
    """Read bytes at a place of an open file into memory; return whether there were so many and no error occurred."""
    done = np.int64(0)
    while done < size:
        to = pointer(int(np.int64(address) + done))
        got = _pread(np.int32(file), to, np.uint64(size - done), np.int64(place) + done)
        if got <= 0:
            return False
        done += got
    return True


@compiled()
def read_lines(file: int, places: I64, out: NDArray[np.uint16]) -> bool:
    """Read a line (n, length) at each of several places of an open file; return whether all could be read."""
    good = True
    for k in range(places.size):
        good &= read_at(file, out[k].ctypes.data, 2 * out.shape[1], places[k])
    return good
