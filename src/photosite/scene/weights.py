"""Weights of a scene that can be larger than memory: stored while they are computed, mapped and checked in blocks."""

from __future__ import annotations

import mmap
import shutil
import tempfile
from collections.abc import Iterator
from typing import IO, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import InputError

_BLOCK_VALUES = 1 << 22
_LARGE_BYTES = 256 << 20


class MappedWeights(np.memmap):
    """Weights in a file, mapped read-only, that were all checked when the file was opened."""


def checked_weights(weights: ArrayLike) -> tuple[NDArray[np.float32], bool]:
    """Return weights as float32, not copied where they are already, and whether all are finite."""
    array: NDArray[np.float32] = np.asarray(weights, dtype=np.float32)
    owner: Any = array
    while isinstance(owner, np.ndarray):
        # An array computed from mapped weights has the class too, but is in memory.
        if isinstance(owner, MappedWeights) and getattr(owner, "_mmap", None) is not None:
            return array, True
        owner = owner.base
    return array, all_finite(array)


def all_finite(array: NDArray[np.float32]) -> bool:
    """Return whether every value is finite; of a mapped file at most a block stays in memory."""
    if not array.flags.c_contiguous:
        return bool(np.isfinite(array).all())
    return all(np.isfinite(block).all() for block in _blocks(array))


def component_means(weights: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the mean (K,) of each component over all samples; of a mapped file at most a block stays in memory."""
    if not weights.flags.c_contiguous:
        return np.asarray(weights.mean(axis=(1, 2), dtype=np.float64))
    totals = np.zeros(len(weights))
    for k, component in enumerate(weights):
        for block in _blocks(component):
            totals[k] += block.sum(dtype=np.float64)
    means: NDArray[np.float64] = totals / (weights.shape[1] * weights.shape[2])
    return means


def _blocks(array: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    """Yield all values in flat blocks; pages of a read-only mapped file are dropped after each block."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, memoryview):
        owner = owner.obj
    droppable = isinstance(owner, mmap.mmap) and not array.flags.writeable and hasattr(owner, "madvise")
    flat = array.reshape(-1)
    for first in range(0, flat.size, _BLOCK_VALUES):
        yield flat[first : first + _BLOCK_VALUES]
        if droppable:
            owner.madvise(mmap.MADV_DONTNEED)


class WeightStore:
    """Weights (K, rows, cols) while they are computed, in an array or a data set; open within a `with` block."""

    def __init__(self, weights: Any) -> None:
        self._weights = weights

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        """Store the weights (K, n, cols) of the rows from `first` on."""
        self._weights[:, first : first + weights.shape[1]] = weights

    def finish(self) -> NDArray[np.float32]:
        """Return all weights."""
        weights: NDArray[np.float32] = self._weights
        return weights


def temporary_store(shape: tuple[int, int, int]) -> WeightStore:
    """Return memory for weights (K, rows, cols) up to 256 MiB, else a temporary file that is deleted with them."""
    size = 4 * int(np.prod(shape, dtype=np.int64))
    return WeightStore(np.empty(shape, np.float32)) if size <= _LARGE_BYTES else _FileStore(shape, size)


class _FileStore(WeightStore):
    """A file without a name, which is deleted with its last mapping."""

    def __init__(self, shape: tuple[int, int, int], size: int) -> None:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        if size > free:
            raise InputError(
                f"the scene's weights need {size / 1e9:.1f} GB; {tempfile.gettempdir()} has {free / 1e9:.1f} GB free",
                hint="Set TMPDIR to a larger disk, or write the scene to a file (photosite convert)",
            )
        self._shape = shape
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="photosite-scene-")  # noqa: SIM115 - __exit__ closes it

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def put(self, first: int, weights: NDArray[np.float32]) -> None:
        _, rows, cols = self._shape
        try:
            for k, component in enumerate(weights):
                self._file.seek(4 * (k * rows + first) * cols)
                self._file.write(np.ascontiguousarray(component).data)
        except OSError as error:
            raise InputError(f"weights cannot be stored in {tempfile.gettempdir()}: {error.strerror}") from None

    def finish(self) -> NDArray[np.float32]:
        self._file.flush()
        return MappedWeights(self._file, np.float32, "r", shape=self._shape)
