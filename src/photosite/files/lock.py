"""Lock of a folder: one process works in it at a time."""

from __future__ import annotations

import os
import sqlite3
from contextlib import suppress
from pathlib import Path

from photosite.errors import FileError

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
