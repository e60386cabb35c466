"""Atomic writing: files and folders appear complete or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from photosite.errors import FileError, message_of

_FULL_BYTES = 1 << 16
"""Free bytes below which a disk counts as full; file systems reserve some."""


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside a file, which replaces the file when the block succeeds.

    If the block fails, the temporary file is removed and an existing file is kept. The temporary path has the file's
    suffix, so that writers choose the same format.

    Raises
    ------
    FileError
        If the folder is missing or read-only, the path is a folder or a device, or writing fails in the operating
        system.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> with atomic_path(Path(folder.name) / "note.txt") as temporary:
    ...     _ = temporary.write_text("whole")
    >>> (Path(folder.name) / "note.txt").read_text()
    'whole'
    """
    wanted = Path(os.path.realpath(path))  # a link is kept, its target is replaced
    if wanted.exists() and not wanted.is_file():
        raise FileError(path, "cannot be written: it is a folder or a device, not a file")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{wanted.stem}-", suffix=wanted.suffix, dir=wanted.parent)
        os.close(handle)
    except OSError as error:
        raise FileError(path, f"cannot be written: {message_of(error)}") from None
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)  # mkstemp makes files private
        os.replace(temporary, wanted)
    except OSError as error:
        raise FileError(path, f"cannot be written: {_reason(error, temporary)}") from None
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | PathLike[str], *, add: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside a folder, which takes its name when the block succeeds.

    If the block fails or is interrupted, the temporary folder is removed, and errors name the final folder. The folder
    must not exist, or be empty; with `add`, each new entry is moved into it, and replaces an entry of the same name.

    Raises
    ------
    FileError
        If the path exists and is not an empty folder, its parent is missing or read-only, or writing fails in the
        operating system.

    Examples
    --------
    >>> import tempfile
    >>> above = tempfile.TemporaryDirectory()
    >>> with atomic_folder(Path(above.name) / "frames") as temporary:
    ...     _ = (temporary / "note.txt").write_text("whole")
    >>> [file.name for file in (Path(above.name) / "frames").iterdir()]
    ['note.txt']
    """
    wanted = Path(os.path.realpath(path))
    within = add and wanted.is_dir()
    try:
        if not within and wanted.exists() and (not wanted.is_dir() or any(wanted.iterdir())):
            raise FileError(path, "exists already and is not an empty folder", hint="Choose another name")
        temporary = Path(tempfile.mkdtemp(prefix=f".{wanted.name}-", dir=wanted if within else wanted.parent))
    except OSError as error:
        raise FileError(path, f"cannot be written: {message_of(error)}") from None
    try:
        yield temporary
        if within:
            for entry in sorted(temporary.iterdir()):
                os.replace(entry, wanted / entry.name)
            return
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o777 & ~mask)
        os.replace(temporary, wanted)
    except FileError as error:
        if not (place := Path(error.path)).is_relative_to(temporary):
            raise
        raise FileError(Path(path) / place.relative_to(temporary), error.what, error.line, **error.fields) from None
    except OSError as error:
        raise FileError(path, f"cannot be written: {_reason(error, temporary)}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _reason(error: OSError, place: Path) -> str:
    """Return why writing failed. NumPy's error of a full disk gives no reason; then test the free space."""
    if error.strerror is None and shutil.disk_usage(place.parent).free < _FULL_BYTES:
        return os.strerror(errno.ENOSPC)
    return error.strerror or str(error)
