"""Small files, read whole; JSON files are read with an error in one line, and written whole or not at all."""

from __future__ import annotations

import json
import math
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
    """Raise errors of the operating system as a `FileError` of the file that is read."""
    try:
        yield
    except FileNotFoundError:
        raise FileError(path, "there is no such file") from None
    except OSError as error:
        raise FileError(path, f"cannot be read: {message_of(error)}") from None


LARGEST_BYTES = 1 << 26


def read_json_object(path: Path) -> Mapping[str, Any]:
    """Read a JSON file that holds an object."""
    content = read_small(path, "a JSON file", LARGEST_BYTES)
    try:
        data = json.loads(content)
    # A plain ValueError is a whole number of thousands of digits.
    except (ValueError, RecursionError) as error:
        line = error.lineno if isinstance(error, json.JSONDecodeError) else None
        raise FileError(path, f"the file is not JSON ({type(error).__name__})", line) from None
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
        number = math.nan if isinstance(value, bool | str) else float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"'{name}' must be a finite number, got {str(value)[:40]}")
    return number
