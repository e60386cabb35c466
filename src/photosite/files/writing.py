"""Writing to disk: files and folders that appear complete or not at all, temporary folders, and a folder's lock."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


Piece = tuple[int, int, NDArray[Any]]
"""First band, first row, and values (bands, rows, cols)."""


class TemporaryFolder:
    """A new folder at `path`, in the system's place for temporary files (`TMPDIR`).

    Examples
    --------
    >>> folder = TemporaryFolder("photosite-")
    >>> folder.path.is_dir(), folder.close(), folder.path.exists()
    (True, None, False)
    """

    def __init__(self, prefix: str) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=prefix))
        self._end = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def close(self) -> None:
        """Remove the folder and its contents; a second call does nothing."""
        self._end()


def write_bands(
    path: Path, pieces: Iterable[Piece], shape: tuple[int, int, int], dtype: np.dtype[Any]
) -> tuple[Path, TemporaryFolder]:
    """Copy a cube that cannot be read by rows into a temporary file of plain numbers, band after band.

    Parameters
    ----------
    path
        The cube's own file, for messages.
    pieces
        The whole cube in pieces.
    shape, dtype
        Of the cube; (rows, cols, bands).

    Returns
    -------
    Path, TemporaryFolder
        The file, and the folder that removes it.
    """
    rows, cols, bands = shape
    size = rows * cols * bands * dtype.itemsize
    folder = TemporaryFolder("photosite-cube-")
    try:
        free = shutil.disk_usage(folder.path).free
        if size > free:
            raise FileError(
                path,
                f"needs a temporary copy of {size / 1e9:.1f} GB, and {tempfile.gettempdir()} has {free / 1e9:.1f} GB "
                "free",
                hint="Set TMPDIR to a larger disk, or store the cube in chunks of rows",
            )
        file = folder.path / "cube"
        with file.open("wb") as stream:
            for band, row, values in pieces:
                for k, plane in enumerate(values):
                    stream.seek(((band + k) * rows + row) * cols * dtype.itemsize)
                    stream.write(np.ascontiguousarray(plane, dtype).data)
            stream.truncate(size)
    except BaseException:
        folder.close()
        raise
    return file, folder


LOCK_NAME = ".lock"

_TRIES = 10


class FolderLock:
    """Holds a folder until `release`; a second holder, in this process or another, is refused.

    The lock is that of an SQLite database in the folder. The operating system releases it when the process ends,
    however it ends, so that no lock is left behind.

    Raises
    ------
    FileError
        If another holds the folder, or the file system has no locks.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     lock = FolderLock(Path(folder))
    ...     lock.release()
    ...     FolderLock(Path(folder)).release()
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOCK_NAME
        self._released = False
        for _ in range(_TRIES):
            before = self._file_number()
            self._database = self._locked(folder)
            # The last holder may have removed the file after it was opened here; then the lock is worth nothing.
            if before is not None and before == self._file_number():
                return
            self._database.close()
        raise FileError(folder, "the folder cannot be locked", hint="Use another folder")

    def release(self) -> None:
        """Release the folder, and remove the lock's file; a second call does nothing."""
        if self._released:
            return
        self._released = True
        if os.name == "nt":  # open files cannot be removed there
            self._database.close()
        with suppress(OSError):
            self._path.unlink()
        self._database.close()

    def _file_number(self) -> int | None:
        try:
            return self._path.stat().st_ino
        except OSError:
            return None

    def _locked(self, folder: Path) -> sqlite3.Connection:
        database = None
        try:
            database = sqlite3.connect(self._path, timeout=0.0, isolation_level=None, check_same_thread=False)
            database.execute("BEGIN EXCLUSIVE")
        except sqlite3.Error as error:
            if database is not None:
                database.close()
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                what, hint = "another process uses the folder", "Wait until it ends, or use another folder"
                raise FileError(folder, what, hint=hint) from None
            raise FileError(folder, f"the folder cannot be locked: {error}", hint="Use another folder") from None
        return database


def date_of_files() -> datetime:
    """Return the date for files: now, or the seconds since 1970 in SOURCE_DATE_EPOCH, so that equal files are equal.

    References
    ----------
    reproducible-builds.org, SOURCE_DATE_EPOCH specification.

    Examples
    --------
    >>> date_of_files().tzinfo
    datetime.timezone.utc
    """
    stated = os.environ.get("SOURCE_DATE_EPOCH")
    return datetime.now(UTC) if stated is None else datetime.fromtimestamp(int(stated), UTC)
