"""Weights of a scene that may be larger than memory: looked through in blocks, and mapped from their file."""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_BLOCK_VALUES = 1 << 22


class MappedWeights(np.memmap):
    """Weights that lie in a file, mapped read-only; who opened them has looked at every one."""


def checked_weights(weights: ArrayLike) -> tuple[NDArray[np.float32], bool]:
    """Weights as float32, and whether all are finite. What is float32 already, mapped files too, is not copied."""
    array: NDArray[np.float32] = np.asarray(weights, dtype=np.float32)
    owner: Any = array
    while isinstance(owner, np.ndarray):
        # The product of one lies in memory, and is none.
        if isinstance(owner, MappedWeights) and getattr(owner, "_mmap", None) is not None:
            return array, True
        owner = owner.base
    return array, all_finite(array)


def all_finite(array: NDArray[np.float32]) -> bool:
    """Whether every value is finite; of a mapped file no more than a block stays in memory."""
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
    """(K,) mean of each component over all samples; of a mapped file no more than a block stays in memory."""
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
    """The read-only file mapping that an array lies in, where it does: its pages may be dropped, to be read again."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, memoryview):
        owner = owner.obj
    return owner if isinstance(owner, mmap.mmap) and not array.flags.writeable else None
