"""Settings of memory for a process that runs photosite only: a command, or a worker."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from typing import Any

_NEW_OBJECTS = 50_000
"""Objects made since the last search for cycles that start the next one; Python's own number is 700."""

_KEPT_BYTES = (1 << 31) - 1
_RETURNED_BYTES = 32 << 20
"""Size from which the memory of arrays is returned after `return_large_arrays`."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of malloc.h


def prepare_process() -> None:
    """Search for cycles of objects less often, and let the C library keep freed memory for the next arrays.

    Importing modules makes objects by the hundred thousand and frees few: the searches take a tenth of a short command.
    """
    gc.set_threshold(_NEW_OBJECTS)
    keep_freed_memory()


def keep_freed_memory() -> None:
    """Let the C library keep freed memory for the next arrays.

    The GNU C library returns large arrays to the system when they are freed, which must clear the memory before it
    gives it out again: a tenth to a third of a calibration, and of a training pair. A variable that is set has
    priority.
    """
    stated = {"MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "GLIBC_TUNABLES"} & set(os.environ)
    if not sys.platform.startswith("linux") or stated:
        return
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_MMAP_THRESHOLD, _KEPT_BYTES)
        set_option(_TRIM_THRESHOLD, _KEPT_BYTES)
        _kept.append(ctypes.CDLL(None))


_kept: list[Any] = []
"""The C library, once `keep_freed_memory` has set its options."""


def return_large_arrays() -> None:
    """Return freed memory to the system now, and that of large arrays whenever they are freed.

    Call this between steps of work on large frames: free parts of kept memory lie between used ones, and may be too
    small for the next array. Without `keep_freed_memory` it does nothing.
    """
    for library in _kept:
        library.mallopt(_MMAP_THRESHOLD, _RETURNED_BYTES)
        library.malloc_trim(0)
