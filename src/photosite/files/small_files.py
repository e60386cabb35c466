"""Small files, read whole; JSON files are read with an error in one line, and written whole or not at all."""

from __future__ import annotations

import json
import math
import os
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.errors import FileError, message_of
from photosite.files.writing import atomic_path


def read_small(path: str | PathLike[str], what: str, largest: int) -> bytes:
    """Read a file's bytes; a file of more bytes than `largest` is not `what`, such as "a protocol".

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.NamedTemporaryFile() as file:
    ...     read_small(file.name, "a protocol", 1 << 20)
    b''
    """
    with reading(path), open(path, "rb") as stream:
        content = stream.read(largest + 1)
    if len(content) > largest:
        raise FileError(path, f"is not {what}: it is larger than {largest >> 20} MiB")
    return content


@contextmanager
def reading(path: str | PathLike[str]) -> Iterator[None]:
    """Check the file that is read (`check_stored_file`); raise errors of the operating system as its `FileError`."""
    check_stored_file(path)
    with _system_errors(path):
        yield


@contextmanager
def _system_errors(path: str | PathLike[str]) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError:
        raise FileError(path, "there is no such file") from None
    except OSError as error:
        raise FileError(path, f"cannot be read: {message_of(error)}") from None


_LARGEST_HOLES = 1 << 30
_HIGHEST_COMPRESSION = 1000
"""Bytes of a file to a byte on disk: more than file systems that compress reach with measured data."""


def check_stored_file(path: str | PathLike[str]) -> None:
    """Check that a path is a file whose bytes are stored: no folder, pipe or device, and not gigabytes of holes.

    The time that a reader needs then follows from what is on the disk.

    Raises
    ------
    FileError
        If it is something else, or there is no such file.

    Examples
    --------
    >>> check_stored_file("/dev/zero")
    Traceback (most recent call last):
    photosite.errors.FileError: /dev/zero: cannot be read: it is a device, not a file. Copy the data to a file
    """
    with _system_errors(path):
        try:
            found = os.stat(path)
        except ValueError as error:  # a null character in a name
            raise FileError(path, f"cannot be read: {error}") from None
    if stat.S_ISDIR(found.st_mode):
        raise FileError(path, "cannot be read: it is a folder, not a file")
    if not stat.S_ISREG(found.st_mode):
        kind = "a pipe" if stat.S_ISFIFO(found.st_mode) else "a socket" if stat.S_ISSOCK(found.st_mode) else "a device"
        raise FileError(path, f"cannot be read: it is {kind}, not a file", hint="Copy the data to a file")
    blocks = getattr(found, "st_blocks", 0)  # of 512 bytes; 0 where the file system does not state it
    if blocks and found.st_size > _LARGEST_HOLES + _HIGHEST_COMPRESSION * 512 * blocks:
        what = f"cannot be read: it consists of holes, {found.st_size} bytes, of which {512 * blocks} are stored"
        raise FileError(path, what, hint="Check that the file is complete")


SETTLED_NS = 2_000_000_000
"""Age of a file from which its times identify its content: file systems round them, to 2 s at most (FAT)."""


def file_stamp(path: str | PathLike[str] | None) -> tuple[int, ...] | None:
    """Return size, times and number of a file; None where they do not identify its content.

    The system sets the time of change whenever content or times are written, so that an equal stamp means an unchanged
    file. There is none without a path, or for files that have just changed; on Windows, where programs can restore all
    times, no file has one.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.NamedTemporaryFile() as file:  # has just been written
    ...     file_stamp(file.name) is None
    True
    """
    if path is None or os.name == "nt":
        return None
    try:
        found = os.stat(path)
    except OSError:
        return None
    settled = time.time_ns() - max(found.st_ctime_ns, found.st_mtime_ns) > SETTLED_NS
    return (found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino) if settled else None


LARGEST_BYTES = 1 << 26


def parse_json(content: bytes, path: str | PathLike[str]) -> Any:
    """Parse a file's content as JSON.

    Raises
    ------
    FileError
        With the reason that Python's json states, and the line, if the content is not JSON.

    Examples
    --------
    >>> parse_json(b'{"a": [1 2]}', "a.json")
    Traceback (most recent call last):
    photosite.errors.FileError: a.json:1: the file is not JSON: expecting ',' delimiter, column 10
    """
    line = None
    try:
        return json.loads(content)
    except json.JSONDecodeError as error:
        line = error.lineno
        reason = f"{error.msg[:1].lower()}{error.msg[1:]}, column {error.colno}"
    except UnicodeDecodeError:
        reason = "it is not text in UTF-8"
    except RecursionError:
        reason = "it is nested too deeply"
    except ValueError:
        reason = "a whole number has too many digits"
    raise FileError(path, f"the file is not JSON: {reason}", line)


def read_json_object(path: Path) -> Mapping[str, Any]:
    """Read a JSON file that holds an object."""
    data = parse_json(read_small(path, "a JSON file", LARGEST_BYTES), path)
    if not isinstance(data, dict):
        raise FileError(path, "the JSON file holds no object")
    return data


def write_json_object(content: Mapping[str, Any], path: str | PathLike[str]) -> None:
    """Write an object as JSON."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


@contextmanager
def valid_content(path: Path, what: str) -> Iterator[None]:
    """Raise missing keys and invalid values of a JSON object as a `FileError`: the file is not `what`."""
    try:
        yield
    except (KeyError, IndexError, TypeError, AttributeError, ValueError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise FileError(path, f"the file is not {what}: {reason}") from None


def finite_number(value: Any, name: str) -> float:
    """Return a number from JSON as a float; raise ValueError if it is not a finite number."""
    try:
        number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"'{name}' must be a finite number, got {str(value)[:40]}")
    return number
