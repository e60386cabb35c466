"""HDF5 files opened with care: whatever is wrong with one becomes a line, and nothing is believed unchecked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, PhotositeError
from photosite.files.hdf5_heap import check_heaps

_MOST_SMALL = 1 << 22
"""Values of what is read at once: spectra and lists, not images."""
_DENSEST = 2000
"""Bytes of values to a byte in the file: deflate reaches 1030, so what says more was not written."""


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, dict[str, Any]]]:
    """The file, and its datasets by name.

    Raises
    ------
    FileError
        If it cannot be read, here or within the block.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            datasets: dict[str, Any] = {}

            def collect(name: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset):
                    datasets[name] = item

            file.visititems(collect)
            check_heaps(path, file, list(datasets.values()))
            yield file, datasets
    except PhotositeError:
        raise
    # h5py hands on whatever libhdf5 stumbles over, as OSError, KeyError, RuntimeError, ValueError, MemoryError ...
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read as HDF5 ({reason}); is it truncated?") from None


def numbers(path: Path, data: Any) -> NDArray[np.float64]:
    """A small dataset of numbers, whole.

    Raises
    ------
    FileError
        If it is large, holds no numbers, or was not written whole.
    """
    if data.dtype.kind not in "fiu" or math.prod(data.shape) > _MOST_SMALL:
        raise FileError(path, f"dataset {data.name} {data.shape} of {data.dtype} is no list of numbers")
    check_written(path, data)
    return np.asarray(data[()], dtype=np.float64)


def check_written(path: Path, data: Any) -> None:
    """Whether a dataset's values are in the file.

    Raises
    ------
    FileError
        If there are fewer bytes than its shape needs.
    """
    size = math.prod(data.shape) * data.dtype.itemsize
    stored = data.id.get_storage_size()
    short = stored < size if data.chunks is None and data.external is None else size > _DENSEST * stored
    if short and not data.is_virtual:
        raise FileError(path, f"dataset {data.name} says {size} bytes of values and stores {stored}; is it truncated?")


def plain(value: Any) -> Any:
    """Python's own text and numbers for HDF5's; arrays of one value are that value."""
    if isinstance(value, bytes | np.bytes_):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray):
        return plain(value.ravel()[0]) if value.size == 1 else value
    return value.item() if isinstance(value, np.generic) else value
