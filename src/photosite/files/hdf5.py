"""HDF5 files of unknown origin: opened, listed and checked, with every failure as a `FileError`.

libhdf5 (2.0.0) can loop for ever, crash or allocate gigabytes when it reads damaged data of variable length (global
heaps, where most programs keep text attributes). Such data are read in a child process; the parent never reads them.
"""

from __future__ import annotations

import math
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, PhotositeError, message_of
from photosite.files.child import ChildError, call_in_child
from photosite.files.small_files import check_stored_file

SIGNATURE = b"\x89HDF\r\n\x1a\n"

TIME_LIMIT_S = 2.0
"""Limit of the child's processor time for a small file, and for each further MB; valid files take milliseconds."""
_WAITING = 10.0
"""Time limit over that of the processor: a machine with four times as many busy processes as cores left files that take
milliseconds without an answer for 9 s."""
_LONGEST_S = 120.0
_MEMORY_BYTES = 1 << 30
_HEAP_SIGNATURE = b"GCOL"
_LARGEST_SEARCHED = 64 << 20
"""Bytes of a file that is searched for heaps; a larger one is always inspected by the child."""
_MOST_VALUES = 1 << 22
"""Values of a dataset that is read at once: spectra and lists, not images."""
_HIGHEST_COMPRESSION = 2000
"""Bytes of values to a byte in the file; deflate reaches 1030."""


class Hdf5File:
    """An open file.

    Parameters
    ----------
    path
        The file.
    file
        The file as h5py opened it.

    Attributes
    ----------
    datasets
        All datasets by name, without a leading slash.
    """

    def __init__(self, path: Path, file: Any) -> None:
        import h5py

        self.path, self.file = path, file
        self.datasets: dict[str, Any] = {}
        if _has_heap(path):
            _ = self._texts
        check_own_data(path, file)

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                self.datasets[name] = item

        file.visititems(collect)

    def attributes(self, item: Any, *, inherited: bool = False) -> dict[str, Any]:
        """Return an item's attributes as `plain` values.

        Parameters
        ----------
        item
            A dataset, group or the file.
        inherited
            Add the attributes of the groups above it, where the item has none of that name.
        """
        found: dict[str, Any] = {}
        while True:
            texts: dict[str, Any] = {}
            for name in item.attrs:
                if item.attrs.get_id(name).dtype.hasobject:
                    texts = self._texts.get(item.name, {})
                    if name in texts:
                        found.setdefault(name, plain(texts[name]))
                else:
                    found.setdefault(name, plain(item.attrs[name]))
            if not inherited or item.name == "/":
                return found
            item = item.parent

    @cached_property
    def _texts(self) -> dict[str, dict[str, Any]]:
        """Text attributes of variable length, by item and name."""
        processor_s = min(TIME_LIMIT_S * (1 + self.path.stat().st_size / 1e6), _LONGEST_S)
        time_s = _WAITING * processor_s
        try:
            found: dict[str, dict[str, Any]] = call_in_child(
                read_texts, str(self.path), time_s=time_s, memory_bytes=_MEMORY_BYTES, processor_s=processor_s
            )
        except ChildError as error:
            raise FileError(self.path, f"is damaged: its attributes cannot be read ({error})") from None
        return found


@contextmanager
def open_hdf5(path: Path) -> Iterator[Hdf5File]:
    """Open a file for reading."""
    import h5py

    check_stored_file(path)
    try:
        with h5py.File(path, "r") as file:
            yield Hdf5File(path, file)
    except PhotositeError:
        raise
    except Exception as error:  # h5py passes on OSError, KeyError, RuntimeError, ValueError, MemoryError ...
        raise FileError(
            path, f"cannot be read as HDF5 ({message_of(error)})", hint="Check that the file is complete"
        ) from None


@contextmanager
def create_hdf5(path: Path, **options: Any) -> Iterator[Any]:
    """Create a file for writing, and yield it as h5py's file; `options` are those of `h5py.File`.

    libhdf5 (1.14 and 2.0) cannot close a file after a failed write: the process crashes there or when it ends. So it
    writes through a stream that reports no failure, which is raised here when the file is closed.

    Raises
    ------
    OSError
        If the file cannot be written; the first failure, such as that of a full disk.
    """
    import h5py

    with path.open("w+b", buffering=0) as file:
        stream = _Stream(file.fileno())
        try:
            with h5py.File(stream, "w", **options) as opened:
                yield opened
                stream.check()
        except BaseException:
            stream.check()  # what follows a failed write is not its own error
            raise
        stream.check()


class _Stream:
    """A file for libhdf5, which remembers the first failure and ignores all that follows it."""

    def __init__(self, handle: int) -> None:
        self._handle, self._place, self._size = handle, 0, 0
        self._failure: BaseException | None = None

    def check(self) -> None:
        """Raise the failure, if there was one."""
        if self._failure is not None:
            raise self._failure

    def seek(self, place: int, whence: int = os.SEEK_SET) -> int:
        self._place = place + {os.SEEK_SET: 0, os.SEEK_CUR: self._place, os.SEEK_END: self._size}[whence]
        return self._place

    def tell(self) -> int:
        return self._place

    def write(self, content: Any) -> int:
        left = memoryview(content).cast("B")
        size = len(left)
        try:
            while self._failure is None and left:
                done = os.pwrite(self._handle, left, self._place + size - len(left))
                left = left[done:]
        except BaseException as error:  # an interruption, too: it must not reach libhdf5
            self._failure = error
        self._place += size
        self._size = max(self._size, self._place)
        return size

    def read(self, size: int) -> bytes:
        content = bytearray(size)
        self.readinto(content)
        return bytes(content)

    def readinto(self, target: Any) -> int:
        view = memoryview(target).cast("B")
        try:
            content = b"" if self._failure is not None else os.pread(self._handle, len(view), self._place)
        except BaseException as error:
            self._failure, content = error, b""
        view[:] = content.ljust(len(view), b"\0")
        self._place += len(view)
        return len(view)

    def truncate(self, size: int) -> int:
        try:
            if self._failure is None:
                os.ftruncate(self._handle, size)
        except BaseException as error:
            self._failure = error
        self._size = size
        return size

    def flush(self) -> None:
        pass


def check_own_data(path: str | PathLike[str], file: Any) -> None:
    """Check that all data of an open file are in this file.

    External links, virtual datasets and external storage name other files, which a file of unknown origin could use to
    show the content of any file of the user as pixels.

    Raises
    ------
    FileError
        If a link or a dataset names another file.
    """
    import h5py

    elsewhere: dict[str, str] = {}

    def note_link(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            elsewhere[name] = "is a link to another file"

    def note_item(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.external is not None:
            elsewhere[name] = "has its values in another file"
        if isinstance(item, h5py.Dataset) and item.is_virtual:
            elsewhere[name] = "is a virtual dataset"

    file.visititems_links(note_link)
    file.visititems(note_item)
    for name, what in elsewhere.items():
        hint = "Copy the data into one file, for example with h5py"
        raise FileError(path, f"{what}, which is not read", where=f"/{name}", hint=hint)


def read_texts(path: str) -> dict[str, dict[str, Any]]:
    """Read all text attributes of variable length; for the child process.

    Raises
    ------
    FileError
        If an attribute is a list of variable length. Damage turns text into such lists; lists of references, as
        netCDF writes them, are skipped.
    """
    import h5py

    found: dict[str, dict[str, Any]] = {}

    def collect(item: Any) -> None:
        for name in item.attrs:
            dtype = item.attrs.get_id(name).dtype
            if not dtype.hasobject:
                continue
            if h5py.check_string_dtype(dtype) is not None:
                found.setdefault(item.name, {})[name] = item.attrs[name]
            elif h5py.check_ref_dtype(h5py.check_vlen_dtype(dtype) or dtype) is None:
                raise FileError(path, "attributes must not be lists of variable length", where=f"{item.name}: {name}")

    with h5py.File(path, "r") as file:
        collect(file)
        file.visititems(lambda _, item: collect(item))
    return found


def _has_heap(path: Path) -> bool:
    """Return whether the file may have a global heap."""
    if path.stat().st_size > _LARGEST_SEARCHED:
        return True
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(_HEAP_SIGNATURE) >= 0


def plain(value: Any) -> Any:
    """Return an attribute's value with Python's own text and numbers; arrays of several values stay arrays."""
    if isinstance(value, bytes | np.bytes_):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "S":
            value = np.char.decode(value, "utf-8", "replace")
        return plain(value.ravel()[0]) if value.size == 1 and value.ndim <= 1 else value
    return value.item() if isinstance(value, np.generic) else value


def read_numbers(path: Path, data: Any) -> NDArray[np.float64]:
    """Read a small dataset of numbers."""
    if data.dtype.kind not in "fiu" or math.prod(data.shape) > _MOST_VALUES:
        raise FileError(path, f"is {data.shape} of {data.dtype}, not a short list of numbers", where=data.name)
    check_stored(path, data)
    return np.asarray(data[()], dtype=np.float64)


def check_stored(path: Path, data: Any) -> None:
    """Check that the file is large enough for a dataset's shape."""
    size, stored = math.prod(data.shape) * data.dtype.itemsize, data.id.get_storage_size()
    if stored < size if data.chunks is None else size > _HIGHEST_COMPRESSION * stored:
        hint = "Check that the file is complete"
        raise FileError(path, f"stores {stored} bytes of {size}", where=data.name, hint=hint)
