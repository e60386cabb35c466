"""Writing to disk: files and folders that appear complete or not at all, temporary folders, and a folder's lock."""

from __future__ import annotations

import errno
import os
import re
import shutil
import sqlite3
import tempfile
import time
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, message_of

_FULL_BYTES = 1 << 16
"""Free bytes below which a disk counts as full; file systems reserve some."""


@contextmanager
def atomic_path(path: str | PathLike[str], *, durable: bool = True) -> Iterator[Path]:
    """Yield a temporary path beside a file, which replaces the file when the block succeeds.

    If the block fails, the temporary file is removed and an existing file is kept. The temporary path has the file's
    suffix, so that writers choose the same format. What killed processes left in the folder is removed
    (`remove_abandoned`).

    Parameters
    ----------
    path
        The file.
    durable
        Wait until the disk holds the file: after a power failure it is the new one or the one before. Files that can be
        computed again and have a digest do not need it.

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
    alone = _begin(wanted.parent)
    temporary = wanted.with_name(_temporary_name(wanted.suffix))
    try:
        try:
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except OSError as error:
            raise FileError(path, f"cannot be written: {message_of(error)}") from None
        yield temporary
        if alone and durable:
            sync(temporary)
        os.replace(temporary, wanted)
        if alone and durable:
            sync(wanted.parent)
    except OSError as error:
        raise FileError(path, f"cannot be written: {_reason(error, temporary)}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | PathLike[str], *, add: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside a folder, which takes its name when the block succeeds.

    If the block fails or is interrupted, the temporary folder is removed, and errors name the final folder. The folder
    must not exist, or be empty; with `add`, each new entry is moved into it, and replaces an entry of the same name.
    The disk holds all files before the folder takes its name.

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
    parent = wanted if within else wanted.parent
    alone = _begin(parent)
    temporary = parent / _temporary_name()
    try:
        try:
            if not within and wanted.exists() and (not wanted.is_dir() or any(wanted.iterdir())):
                raise FileError(path, "exists already and is not an empty folder", hint="Choose another name")
            temporary.mkdir()
        except OSError as error:
            raise FileError(path, f"cannot be written: {message_of(error)}") from None
        yield temporary
        if alone:
            _sync_below(temporary)
        if within:
            for entry in sorted(temporary.iterdir()):
                os.replace(entry, wanted / entry.name)
        else:
            os.replace(temporary, wanted)
        if alone:
            sync(parent)
    except FileError as error:
        if not (place := Path(error.path)).is_relative_to(temporary):
            raise
        raise FileError(Path(path) / place.relative_to(temporary), error.what, error.line, **error.fields) from None
    except OSError as error:
        raise FileError(path, f"cannot be written: {_reason(error, temporary)}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def sync(path: Path) -> None:
    """Wait until the disk holds a file's content, or a folder's names; file systems that cannot wait do not."""
    folder = path.is_dir()
    if folder and os.name == "nt":  # folders cannot be opened there
        return
    handle = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


_SYNC_THREADS = 8
"""Files that are synced at once: a disk writes their metadata together."""


def _sync_below(folder: Path) -> None:
    found = [(Path(place), names) for place, _, names in os.walk(folder)]
    files = [place / name for place, names in found for name in names]
    if len(files) > 1:
        from concurrent.futures import ThreadPoolExecutor  # which takes milliseconds of each command's start

        with ThreadPoolExecutor(min(_SYNC_THREADS, len(files))) as threads:
            list(threads.map(sync, files))
    else:
        for file in files:
            sync(file)
    for place, _ in reversed(found):
        sync(place)


# Temporary names. They say which process writes, so that a later one can tell whether it still does. A lock would not
# do: not every shared file system has locks that hold between machines, and some have none for folders.

_NAME = re.compile(r"\.?photosite-(?P<system>[0-9a-f]{8})-(?P<process>\d+)-(?P<started>\d+)-[0-9a-f]{8}(\..*)?")
_ABANDONED_S = 86_400.0
"""Time without a change after which a file of another machine, or of one that was restarted, counts as abandoned."""
_looked_at: set[Path] = set()


def is_temporary(name: str) -> bool:
    """Return whether a name is that of a temporary file or folder that is being written, or was.

    Examples
    --------
    >>> is_temporary(".photosite-0f1e2d3c-4711-123456-89abcdef.h5"), is_temporary("photosite.h5")
    (True, False)
    """
    return _NAME.fullmatch(name) is not None


def remove_abandoned(folder: Path) -> None:
    """Remove the user's temporary files and folders whose process has ended.

    A process of this machine is looked up. Those of other machines, and from before a restart, count as ended after a
    day without a change.
    """
    try:
        with os.scandir(folder) as entries:
            found = [entry for entry in entries if is_temporary(entry.name)]
    except OSError:
        return  # the folder is missing, or cannot be read: writing there says what is wrong
    for entry in found:
        with suppress(OSError):  # another process may remove it at the same time
            if not _is_abandoned(entry):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                os.unlink(entry.path)


def _is_abandoned(entry: os.DirEntry[str]) -> bool:
    state = entry.stat(follow_symlinks=False)
    if hasattr(os, "geteuid") and state.st_uid != os.geteuid():
        return False
    name = _NAME.fullmatch(entry.name)
    assert name is not None
    if name["system"] == _system() != _UNKNOWN:
        return _started(int(name["process"])) != int(name["started"])
    before = time.time() - _ABANDONED_S
    if state.st_mtime > before or not entry.is_dir(follow_symlinks=False):
        return state.st_mtime <= before
    changes = (os.lstat(os.path.join(place, file)) for place, _, files in os.walk(entry.path) for file in ["", *files])
    return all(change.st_mtime <= before for change in changes)


def _begin(folder: Path) -> bool:
    """Return whether a folder is not part of a temporary one, which is synced as a whole.

    What is abandoned in it is removed, once for each folder and process: large folders take milliseconds.
    """
    if any(is_temporary(part) for part in folder.parts):
        return False
    if folder not in _looked_at:
        _looked_at.add(folder)
        remove_abandoned(folder)
    return True


def _temporary_name(suffix: str = "", start: str = ".") -> str:
    process = os.getpid()
    return f"{start}photosite-{_system()}-{process}-{_started(process) or 0}-{os.urandom(4).hex()}{suffix}"


_UNKNOWN = "0" * 8


@lru_cache(maxsize=1)
def _system() -> str:
    """Return digits for the running system and its table of processes (a container has its own)."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
        table = os.readlink("/proc/self/ns/pid")
    except OSError:  # not Linux
        return _UNKNOWN
    import hashlib

    return hashlib.sha256(f"{boot} {table}".encode()).hexdigest()[:8]


def _started(process: int) -> int | None:
    """Return when a process started, in ticks since the system did; None if it has ended, or this is not Linux."""
    try:
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    fields = state.rpartition(")")[2].split()
    return None if fields[0] in "ZX" else int(fields[19])


def _reason(error: OSError, place: Path) -> str:
    """Return why writing failed. NumPy's error of a full disk gives no reason; then test the free space."""
    if error.strerror is None and shutil.disk_usage(place.parent).free < _FULL_BYTES:
        return os.strerror(errno.ENOSPC)
    return error.strerror or str(error)


Piece = tuple[int, int, NDArray[Any]]
"""First band, first row, and values (bands, rows, cols)."""


class TemporaryFolder:
    """A new folder at `path`, in the system's place for temporary files (`TMPDIR`).

    Those of killed processes are removed.

    Examples
    --------
    >>> folder = TemporaryFolder()
    >>> folder.path.is_dir(), folder.close(), folder.path.exists()
    (True, None, False)
    """

    def __init__(self) -> None:
        above = Path(tempfile.gettempdir())
        _begin(above)
        self.path = above / _temporary_name(start="")
        self.path.mkdir(0o700)
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
    folder = TemporaryFolder()
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

_TRIES = 100


class FolderLock:
    """Holds a folder, or a file in it, until `release`; a second holder, in this process or another, is refused.

    The lock is that of an SQLite database in the folder. The operating system releases it when the process ends,
    however it ends, so that no lock is left behind.

    Parameters
    ----------
    folder
        The folder.
    name
        Name of the lock's file: another one for each thing in the folder that is held by itself.
    wait_s
        Time to wait for another holder, in seconds.

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

    def __init__(self, folder: Path, name: str = LOCK_NAME, *, wait_s: float = 0.0) -> None:
        self._path, self._wait_s = folder / name, wait_s
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
            database = sqlite3.connect(self._path, timeout=self._wait_s, isolation_level=None, check_same_thread=False)
            database.execute("PRAGMA journal_mode=OFF")  # which could be left behind
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
