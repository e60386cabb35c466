"""A cache of computed arrays on disk, by content: what takes seconds is computed once for all processes.

A key is the SHA-256 digest of everything that a result depends on, the program's sources included, so that no entry is
ever out of date. An entry is one file: a header with the key and the digest of the rest, and arrays in NumPy's format
without pickle. A file whose header does not match is removed. Nothing here raises an error because of the disk: without
a cache, results are computed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import os
import stat
import time
import types
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from photosite.errors import FileError
from photosite.files.writing import atomic_path

CACHE_VARIABLE = "PHOTOSITE_CACHE"
"""Environment variable with the folder of the cache; "off" for none."""
LARGEST_BYTES = 2_000_000_000
"""Size of the cache; the entries that were not used for the longest time are removed."""

_MAGIC = b"photosite arrays 1\n"
_SUFFIX = ".arrays"
_ABANDONED_S = 3600.0
"""Age of a temporary file that a process has left behind."""
_SOURCES = ("camera", "color", "engine", "files", "optics", "values")
"""Folders of this package whose functions compute what is cached."""

Arrays = Mapping[str, NDArray[Any]]


def cache_folder() -> Path | None:
    """Return the folder of the cache, which may not exist yet; None if it is off.

    It is `$PHOTOSITE_CACHE`, else `arrays` in the user's cache folder for photosite, on Linux
    `$XDG_CACHE_HOME/photosite` or `~/.cache/photosite`.

    Examples
    --------
    >>> from unittest import mock
    >>> with mock.patch.dict(os.environ, {"PHOTOSITE_CACHE": "off"}):
    ...     cache_folder() is None
    True
    """
    named = os.environ.get(CACHE_VARIABLE)
    if named:
        return None if named.lower() == "off" else Path(named)
    return user_cache_path("photosite", appauthor=False) / "arrays"


def cached_arrays(
    name: str, inputs: tuple[object, ...], compute: Callable[[], Arrays], largest_bytes: int = LARGEST_BYTES
) -> Arrays:
    """Return named arrays, from the cache if they were computed before.

    Parameters
    ----------
    name
        What is computed; part of the key and of the file's name.
    inputs
        Everything that the result depends on, see `content_digest`. If it contains something whose content cannot be
        known, such as a function of the user's, the result is computed each time.
    compute
        Computes the arrays.
    largest_bytes
        Size of the cache, in bytes.

    Examples
    --------
    >>> import tempfile
    >>> from unittest import mock
    >>> def squares():
    ...     print("computed")
    ...     return {"squares": np.arange(3) ** 2}
    >>> with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, {"PHOTOSITE_CACHE": folder}):
    ...     for _ in range(2):
    ...         print(cached_arrays("squares", (3,), squares)["squares"])
    computed
    [0 1 4]
    [0 1 4]
    """
    folder = cache_folder()
    key = None if folder is None else content_digest(name, _program(), *inputs)
    if folder is None or key is None:
        return compute()
    path = folder / f"{name}-{key[:32]}{_SUFFIX}"
    found = _read(path, key, largest_bytes)
    if found is None:
        found = compute()
        _write(path, key, found, largest_bytes)
    return found


def content_digest(*values: object) -> str | None:
    """Return the SHA-256 digest, hexadecimal, of what values contain; None if that cannot be known.

    Known are numbers, text, arrays, sequences, mappings, and this package's functions, methods and data classes.

    Examples
    --------
    >>> content_digest(1, np.zeros(2)) == content_digest(1, np.zeros(2)) != content_digest(1, np.zeros((2, 1)))
    True
    >>> content_digest(lambda: 1) is None
    True
    """
    digest = hashlib.sha256()
    try:
        for value in values:
            _add(digest.update, value)
    except _UnknownError:
        return None
    return digest.hexdigest()


class _UnknownError(Exception):
    """A value whose content cannot be known."""


def _add(update: Callable[[bytes], object], value: Any) -> None:
    """Add a value's type, length and content, so that different values never give the same bytes."""
    kind = type(value)
    if value is None or kind in (bool, int, float, complex, str, bytes) or isinstance(value, np.generic):
        text = repr(value).encode()
        update(f"{kind.__name__} {len(text)} ".encode() + text)
    elif kind is np.ndarray and not value.dtype.hasobject:
        update(f"array {value.dtype.str} {value.shape} ".encode())
        update(np.ascontiguousarray(value).tobytes())
    elif kind in (tuple, list):
        _add_all(update, kind.__name__, value)
    elif kind is partial:
        _add_all(update, "partial", (value.func, value.args, value.keywords))
    elif kind is types.MethodType:
        _add_all(update, f"method {value.__func__.__qualname__}", (value.__self__,))
    elif isinstance(value, types.FunctionType | type):
        if not _is_ours(value) or "<" in value.__qualname__:
            raise _UnknownError
        _add_all(update, f"{value.__module__}.{value.__qualname__}", ())
    elif isinstance(value, Mapping) and (kind is dict or _is_ours(kind)):
        _add_all(update, "mapping", [part for item in value.items() for part in item])
    elif dataclasses.is_dataclass(value) and _is_ours(kind):
        fields = [getattr(value, field.name) for field in dataclasses.fields(value) if field.init]
        _add_all(update, f"{kind.__module__}.{kind.__qualname__}", fields)
    elif _is_ours(kind) and "__reduce__" in vars(kind):
        _add_all(update, "object", value.__reduce__())
    else:
        raise _UnknownError


def _add_all(update: Callable[[bytes], object], name: str, values: Any) -> None:
    update(f"{name} {len(values)} ".encode())
    for value in values:
        _add(update, value)


def _is_ours(of: Any) -> bool:
    return str(of.__module__).split(".")[0] == __name__.split(".", maxsplit=1)[0]


@lru_cache(maxsize=1)
def _program() -> str:
    """Return a digest of the sources that compute results, and of the libraries' versions."""
    import scipy

    digest = hashlib.sha256(f"{np.__version__} {scipy.__version__}".encode())
    for folder in _SOURCES:
        for path in sorted((Path(__file__).parents[1] / folder).glob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _header(key: str, content: bytes) -> bytes:
    return _MAGIC + key.encode() + hashlib.sha256(content).digest()


def _read(path: Path, key: str, largest_bytes: int) -> Arrays | None:
    """Return an entry's arrays; None without an entry. A file that is not this entry is removed."""
    try:
        state = path.stat()
        if not stat.S_ISREG(state.st_mode) or state.st_size > largest_bytes:
            raise ValueError
        with path.open("rb") as stream:
            whole = stream.read()
        size = len(_header(key, b""))
        if whole[:size] != _header(key, whole[size:]):
            raise ValueError
        with np.load(io.BytesIO(whole[size:]), allow_pickle=False) as file:
            found = {name: file[name] for name in file.files}
    except OSError:
        return None
    except (ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile):
        with suppress(OSError):
            path.unlink()
        return None
    with suppress(OSError):
        os.utime(path)  # now the most recently used
    return found


def _write(path: Path, key: str, arrays: Arrays, largest_bytes: int) -> None:
    """Write an entry, if the disk permits, and remove the least recently used ones beyond the size of the cache."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    content = stream.getvalue()
    if len(content) > largest_bytes:
        return
    with suppress(OSError, FileError):
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with atomic_path(path, durable=False) as temporary:
            temporary.write_bytes(_header(key, content) + content)
        _trim(path.parent, largest_bytes)


def _trim(folder: Path, largest_bytes: int) -> None:
    """Remove entries beyond a size, the least recently used first, and what ended processes have left behind."""
    entries = []
    for path in folder.glob(f"*{_SUFFIX}"):
        with suppress(OSError):  # another process may remove it at the same time
            state = path.stat()
            if path.name.startswith("."):
                if time.time() - state.st_mtime > _ABANDONED_S:
                    path.unlink()
            else:
                entries.append((state.st_mtime_ns, state.st_size, path))
    total = 0
    for _, size, path in sorted(entries, reverse=True):
        total += size
        if total > largest_bytes:
            with suppress(OSError):
                path.unlink()
