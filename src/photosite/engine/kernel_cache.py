"""Compiled kernels on disk, a checked file each."""

from __future__ import annotations

import atexit
import hashlib
import os
import pickle
import shutil
import stat
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache
from platformdirs import user_cache_path

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

        While another process compiles the same, wait for its result.
        """
        target_context.refresh()
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
                _write(path, self._cache_file._dump(self._impl.reduce(data)))  # type: ignore[no-untyped-call]
        finally:
            if (lock := self._locks.pop(path, None)) is not None:
                _unlock(path, lock)

    def _path(self, sig: Any, codegen: Any) -> Path:
        compiled_for = self._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        key = self._cache_file._version, self._impl.locator.get_source_stamp(), compiled_for
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:20]
        return Path(self.cache_path) / f"{self._impl.filename_base}.{name}.nbc"


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


@lru_cache(maxsize=1)
def kernel_folder() -> Path:
    """Return the folder of compiled kernels, a different one for each state of the engine's sources.

    numba itself compares only the file of a kernel, so that a kernel would stay in use after a function that it calls
    has changed in another file. Where the user's cache cannot be written, the folder is in one of the user's own among
    temporary files; if that is not safe, or cannot be written, one for the lifetime of the process.
    """
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        sources.update(path.read_bytes())
    name = f"kernels-{sources.hexdigest()[:16]}"
    folder = user_cache_path("photosite", appauthor=False) / name
    if _is_writable(folder):
        return folder
    own = _own_temporary_folder()
    if own is not None and _is_writable(own / name):
        return own / name
    passing = tempfile.mkdtemp(prefix="photosite-kernels-")
    atexit.register(shutil.rmtree, passing, ignore_errors=True)
    return Path(passing)


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _own_temporary_folder() -> Path | None:
    """Return a folder among temporary files that this user alone can write; None if another has its name."""
    if not hasattr(os, "getuid"):
        return None
    folder = Path(tempfile.gettempdir()) / f"photosite-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    safe = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if safe else None


def is_cached(kernel: str = "*") -> bool:
    """Return whether a kernel of this state of the sources, "module.function", or any, has been compiled before."""
    return any(kernel_folder().glob(f"*/{kernel}-*.nbc"))
