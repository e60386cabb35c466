"""Small files, read whole."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from photosite.errors import FileError


def read_small(path: str | PathLike[str], what: str, largest: int) -> bytes:
    """Read a file's bytes.

    Parameters
    ----------
    path
        The file.
    what
        The expected content, for messages: "a protocol".
    largest
        Size limit in bytes; a larger file is something else, and is not read.

    Raises
    ------
    FileError
        If the file cannot be read, or is larger.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.NamedTemporaryFile() as file:
    ...     read_small(file.name, "a protocol", 1 << 20)
    b''
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            content = stream.read(largest + 1)
    except FileNotFoundError:
        raise FileError(file, "there is no such file") from None
    except OSError as error:
        raise FileError(file, f"cannot be read: {error.strerror or error}") from None
    if len(content) > largest:
        raise FileError(file, f"is not {what}: it is larger than {largest >> 20} MiB")
    return content
