"""Means of the blocks of a map without outliers, such as hot pixels."""

from __future__ import annotations

import numpy as np

from photosite.engine.jit import F64, I64, bits_of_double, compiled
from photosite.engine.threads import parallel_for

_PARTS = 8


def _medians(values: F64, side: int) -> F64:
    """Return the median of each whole block."""
    rows, cols = (length // side for length in values.shape)
    lines = values[: rows * side, : cols * side].reshape(rows, side, cols, side)
    return np.stack([np.median(line.swapaxes(0, 1).reshape(cols, -1), axis=1) for line in lines])


@compiled()
def _count_distances(
    start: int, stop: int, values: F64, side: int, middle: F64, prefix: int, shift: int, out: I64
) -> None:
    """Count the distances from the middle of the block by 16 of their bits, where the bits above are `prefix`."""
    rows, parts = middle.shape[0] * side, out.shape[0]
    for part in range(start, stop):
        counts = out[part]
        for r in range(part * rows // parts, (part + 1) * rows // parts):
            for block in range(middle.shape[1]):
                center = middle[r // side, block]
                for x in values[r, block * side : (block + 1) * side]:
                    bits = bits_of_double(abs(x - center)) >> shift
                    if bits >> 16 == prefix:
                        counts[bits & 0xFFFF] += 1


@compiled()
def _least_distances(start: int, stop: int, values: F64, side: int, middle: F64, beyond: float, out: F64) -> None:
    """Compute in each row the smallest distance from the middle of the block beyond a given one."""
    for r in range(start, stop):
        least = np.inf
        for block in range(middle.shape[1]):
            center = middle[r // side, block]
            for x in values[r, block * side : (block + 1) * side]:
                distance = abs(x - center)
                if beyond < distance < least:
                    least = distance
        out[r] = least


def _median_distance(values: F64, side: int, middle: F64) -> float:
    """Return the exact median of the distances of all pixels from the middle of their block.

    Positive numbers are in the order of their bits, of which each pass finds 16 more.
    """
    size = middle.size * side * side
    prefix = below = 0
    for shift in (48, 32, 16, 0):
        parts = np.zeros((_PARTS, 1 << 16), np.int64)
        parallel_for(_count_distances, _PARTS, values, side, middle, prefix, shift, parts)
        up_to = below + np.cumsum(parts.sum(axis=0))
        at = int(np.searchsorted(up_to, (size - 1) // 2, side="right"))
        below = int(up_to[at - 1]) if at else below
        prefix = prefix << 16 | at
    lower = float(np.array([prefix]).view(np.float64)[0])
    if size % 2 or up_to[at] > size // 2:
        return lower
    least = np.empty(middle.shape[0] * side)
    parallel_for(_least_distances, least.size, values, side, middle, lower, least)
    return 0.5 * (lower + float(least.min()))


@compiled()
def _means(start: int, stop: int, values: F64, side: int, middle: F64, reach: float, out: F64) -> None:
    for i in range(start, stop):
        for j in range(out.shape[1]):
            center, total, count = middle[i, j], 0.0, 0
            for r in range(i * side, (i + 1) * side):
                for x in values[r, j * side : (j + 1) * side]:
                    if abs(x - center) <= reach:
                        total += x
                        count += 1
            out[i, j] = total / max(count, 1)


def block_means(values: F64, side: int, reach: float) -> F64:
    """Return the means of the whole blocks of a map without pixels far from the median of their block.

    - `values`: (rows, cols), C-contiguous.
    - `side`: Rows and columns of a block.
    - `reach`: Largest distance from the median of a block, in medians of the distances of all pixels.

    Examples
    --------
    >>> values = np.array([[1.0, 2.0, 5.0, 6.0], [3.0, 99.0, 7.0, 8.0]])
    >>> block_means(values, 2, 4.0).tolist()
    [[2.0, 6.5]]
    """
    middle = _medians(values, side)
    out = np.empty_like(middle)
    reach *= _median_distance(values, side, middle)
    parallel_for(_means, len(out), values, side, middle, reach, out)
    return out
