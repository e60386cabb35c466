"""Reading of files in compiled code, without the interpreter between two reads (Linux)."""

from __future__ import annotations

import sys
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import I64, compiled, intrinsic, pointer

CAN_READ = sys.platform == "linux"
"""Whether the functions of this module can be called."""


@intrinsic
def _pread(typingctx: Any, file: Any, to: Any, size: Any, place: Any) -> Any:
    """Return the number of bytes that `pread` of the C library reads."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types
    from numba.core import cgutils

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number, byte = ir.IntType(32), ir.IntType(64), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(number, (word, byte, number, number))
        function = cast(Any, cgutils).get_or_insert_function(builder.module, kind, "pread")
        return builder.call(function, arguments)

    return types.int64(types.int32, types.voidptr, types.uint64, types.int64), codegen


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
