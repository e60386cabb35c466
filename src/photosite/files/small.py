"""Small files, read whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike

from photosite.errors import FileError, message_of


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
