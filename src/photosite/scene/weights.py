"""Weights of a scene that can be larger than memory: mapped from their file and checked in blocks."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_BLOCK_VALUES = 1 << 22


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
    if array.size <= _BLOCK_VALUES or not array.flags.c_contiguous:
        return bool(np.isfinite(array).all())
    mapped = _mapping(array)
    flat = array.reshape(-1)
    for first in range(0, flat.size, _BLOCK_VALUES):
        if not np.isfinite(flat[first : first + _BLOCK_VALUES]).all():
            return False
        if mapped is not None and hasattr(mapped, "madvise"):
            mapped.madvise(mmap.MADV_DONTNEED)
    return True


def component_means(weights: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the mean (K,) of each component over all samples; of a mapped file at most a block stays in memory."""
    if not weights.flags.c_contiguous:
        return np.asarray(weights.mean(axis=(1, 2), dtype=np.float64))
    mapped = _mapping(weights)
    totals = np.zeros(len(weights))
    for k, component in enumerate(weights):
        flat = component.reshape(-1)
        for first in range(0, flat.size, _BLOCK_VALUES):
            totals[k] += flat[first : first + _BLOCK_VALUES].sum(dtype=np.float64)
            if mapped is not None and hasattr(mapped, "madvise"):
                mapped.madvise(mmap.MADV_DONTNEED)
    means: NDArray[np.float64] = totals / (weights.shape[1] * weights.shape[2])
    return means


def _mapping(array: NDArray[Any]) -> mmap.mmap | None:
    """The read-only mapping of a file that holds an array, if any; its pages can be dropped and read again."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, memoryview):
        owner = owner.obj
    return owner if isinstance(owner, mmap.mmap) and not array.flags.writeable else None
