"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

from photosite.errors import FileError

_FULL_BYTES = 1 << 16
"""Free space below which a disk is full: what file systems keep for their own books."""


@contextmanager
def atomic_path(path: str | PathLike[str]) -> Iterator[Path]:
    """A temporary path beside the wanted one; what was written there takes the name when the block ends well.

    If the block fails, nothing remains of it, and a file that had the name keeps it. The temporary path ends like the
    wanted one, so that writers which go by the ending choose the same format.

    Parameters
    ----------
    path
        The file wanted.

    Raises
    ------
    FileError
        If the folder is missing or cannot be written, the name is a folder's or a device's, or writing fails in the
        operating system.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> with atomic_path(Path(folder.name) / "note.txt") as temporary:
    ...     _ = temporary.write_text("whole")
    >>> (Path(folder.name) / "note.txt").read_text()
    'whole'
    """
    wanted = Path(os.path.realpath(path))  # a link stays a link, and what it points to is replaced
    if wanted.exists() and not wanted.is_file():
        raise FileError(path, "cannot be written: it is a folder or a device, not a file")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{wanted.stem}-", suffix=wanted.suffix, dir=wanted.parent)
        os.close(handle)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from None
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)  # mkstemp keeps files to their owner; a plain open would not
        os.replace(temporary, wanted)
    except OSError as error:
        raise FileError(path, f"cannot be written: {_reason(error, temporary)}") from None
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | PathLike[str], *, add: bool = False) -> Iterator[Path]:
    """A temporary folder beside the wanted one, which takes its name when the block ends well.

    If the block fails, or is interrupted, nothing remains of it, and an error about a file in it names the wanted
    folder instead. A folder that holds something is not touched unless `add` is true.

    Parameters
    ----------
    path
        The folder wanted; it must not exist, or be empty.
    add
        Let the folder hold something: the temporary folder is then in it, and at the end each of its entries is moved
        up, in place of a file of that name.

    Raises
    ------
    FileError
        If something of that name exists and is not an empty folder, the folder above it is missing or cannot be
        written, or writing fails in the operating system.

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
            raise FileError(path, "exists already and is not an empty folder; choose another name")
        temporary = Path(tempfile.mkdtemp(prefix=f".{wanted.name}-", dir=wanted if within else wanted.parent))
    except OSError as error:
        raise FileError(path, f"cannot be written: {error.strerror or error}") from None
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
        # The temporary name means nothing to whoever reads the line, and is gone by then.
        if not (place := Path(error.path)).is_relative_to(temporary):
            raise
        raise FileError(Path(path) / place.relative_to(temporary), error.what, error.line, **error.fields) from None
    except OSError as error:
        raise FileError(path, f"cannot be written: {_reason(error, temporary)}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _reason(error: OSError, place: Path) -> str:
    """Why writing failed. NumPy says of a full disk only how much was written: then the disk itself is asked."""
    if error.strerror is None and shutil.disk_usage(place.parent).free < _FULL_BYTES:
        return os.strerror(errno.ENOSPC)
    return error.strerror or str(error)
