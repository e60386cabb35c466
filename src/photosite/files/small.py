"""Files that are read whole, because they should be small."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from photosite.errors import FileError


def read_small(path: str | PathLike[str], what: str, largest: int) -> bytes:
    """A file's bytes.

    Parameters
    ----------
    path
        The file.
    what
        What it should be, for messages: "a protocol".
    largest
        Bytes it may have: what is larger is something else, and is not read.

    Raises
    ------
    FileError
        If it cannot be read, or is larger.

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
