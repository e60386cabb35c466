"""Compiled kernels on disk, a checked file each."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_DIGEST_BYTES = hashlib.sha256().digest_size
_TEMPORARY = ".tmp"
_LOCK = ".lock"
_LONGEST_COMPILATION_S, _POLL_S = 60.0, 0.01
_ABANDONED_S = 3600.0
"""Age of a temporary file, which is written in milliseconds, that a killed process has left behind."""


class KernelCache(FunctionCache):
    """The compiled forms of one function, in place of numba's own cache of it.

    numba keeps an index beside the files. A damaged file ends the program, a folder that cannot be written is an error,
    and two processes that compile different forms at the same time can give both the same file. Here the name of a file
    follows from what it was compiled for, its content is checked, and a file that cannot be read or written means that
    the function is compiled.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._locks: dict[Path, int] = {}

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled form for a signature; None if there is no valid one.

        While another process compiles the same, wait for its result. A compiled form needs numba's runtime, and none of
        the functions that it can compile: numba loads these, which takes 0.3 s, before it compiles.
        """
        rtsys.initialize(target_context)
        path = self._path(sig, target_context.codegen())
        data = _checked(path)
        if data is None:
            lock = _locked(path)
            data = _checked(path)
            if lock is not None and data is None:
                self._locks[path] = lock
            elif lock is not None:
                _unlock(path, lock)
        return None if data is None else self._impl.rebuild(target_context, pickle.loads(data))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the compiled form for a signature, if it can be written."""
        path = self._path(sig, data.codegen)
        try:
            if self._impl.check_cachable(data):
                _write(path, self._cache_file._dump(_without_modules(self._impl.reduce(data))))  # type: ignore[no-untyped-call]
        finally:
            if (lock := self._locks.pop(path, None)) is not None:
                _unlock(path, lock)

    def _path(self, sig: Any, codegen: Any) -> Path:
        compiled_for = self._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        key = self._cache_file._version, self._impl.locator.get_source_stamp(), compiled_for
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:20]
        return Path(self.cache_path) / f"{self._impl.filename_base}.{name}.nbc"


def _without_modules(reduced: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return what numba stores of a compiled form without environments that hold no objects.

    One is stored for each function that was compiled with it. It holds the objects of Python that the function uses,
    here none, and the module of the function: loading it would import parts of numba that are needed to compile.
    """
    *parts, environments = reduced
    return *parts, tuple(each for each in environments if each.consts)


def _checked(path: Path) -> bytes | None:
    """Return the content of a file; None if there is none, or it is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, data = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
    if hashlib.sha256(data).digest() == digest:
        return data
    with suppress(OSError):
        path.unlink()
    return None


def _write(path: Path, content: bytes) -> None:
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_abandoned(path.parent)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=_TEMPORARY)
        try:
            with open(handle, "wb") as stream:
                stream.write(hashlib.sha256(content).digest() + content)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise


def _locked(path: Path) -> int | None:
    """Lock a file that is about to be written; None if that cannot be done, or takes too long.

    The system unlocks it when the process ends, however it ends.
    """
    if fcntl is None:
        return None
    until = time.monotonic() + _LONGEST_COMPILATION_S
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = os.open(path.with_suffix(_LOCK), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except OSError:
            if time.monotonic() > until:
                os.close(lock)
                return None
        time.sleep(_POLL_S)


def _unlock(path: Path, lock: int) -> None:
    with suppress(OSError):
        path.with_suffix(_LOCK).unlink(missing_ok=True)
    os.close(lock)


def _remove_abandoned(folder: Path) -> None:
    for path in folder.glob(f"*{_TEMPORARY}"):
        with suppress(OSError):  # another process may rename or remove it at the same time
            if time.time() - path.stat().st_mtime > _ABANDONED_S:
                path.unlink()
