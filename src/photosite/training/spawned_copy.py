"""The copy of a dataset in a process that is spawned: its arrays do not go through the pipe to the process.

A process that is spawned, or started by a fork server, reads its objects from a pipe of 64 KB, and first imports what
they need, torch for example. The parent waits until the rest of the objects fits the pipe. With arrays in memory that
the process inherits, objects are small, and several workers start at the same time.
"""

from __future__ import annotations

import copyreg
import mmap
import os
import pickle
import weakref
from multiprocessing.context import get_spawning_popen
from multiprocessing.reduction import DupFd
from typing import Any

from photosite.engine.process import keep_freed_memory

ALIGNED = 64
"""Arrays begin at multiples of this number of bytes."""


def reduced(whole: Any) -> tuple[Any, ...]:
    """Return what pickle makes an object from: the `__reduce__` of a class with large arrays.

    Arrays go to memory that the process inherits if the object is pickled for one (Linux), and into the pickle
    otherwise. `__getstate__` and `__setstate__` of derived classes are called.
    """
    state = whole.__getstate__() if hasattr(whole, "__getstate__") else vars(whole)  # object has it from Python 3.11 on
    inherits = get_spawning_popen() is not None and hasattr(os, "memfd_create")
    return copyreg.__newobj__, (type(whole),), _State(state) if inherits else state  # type: ignore[attr-defined]


class _State:
    """A state that is pickled for a process that inherits its arrays; there, it is the state itself."""

    def __init__(self, state: Any) -> None:
        self._state = state

    def __reduce__(self) -> tuple[Any, ...]:
        buffers: list[pickle.PickleBuffer] = []
        text = pickle.dumps(self._state, protocol=5, buffer_callback=buffers.append)
        descriptor = os.memfd_create("photosite")
        weakref.finalize(get_spawning_popen(), os.close, descriptor)  # the process inherits it after all is pickled
        places = []
        with open(descriptor, "wb", closefd=False) as file:
            for buffer in buffers:
                file.seek(-(-file.tell() // ALIGNED) * ALIGNED)
                places.append((file.tell(), file.write(buffer.raw())))
        return _inherited, (text, places, DupFd(descriptor))


def _inherited(text: bytes, places: list[tuple[int, int]], descriptor: Any) -> Any:
    """Return the state, in the worker that inherited its arrays; what it writes to them stays its own."""
    keep_freed_memory()
    opened = descriptor.detach()
    try:
        memory = memoryview(mmap.mmap(opened, 0, access=mmap.ACCESS_COPY) if places else b"")
    finally:
        os.close(opened)
    return pickle.loads(text, buffers=[memory[start : start + size] for start, size in places])
