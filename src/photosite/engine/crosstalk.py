"""Crosstalk between the pixels of a mosaic, and angular response by position."""

from __future__ import annotations

import numpy as np

from photosite.engine.jit import F32, F64, I64, compiled, prange

_BLOCK = 256
"""Columns that are summed at a time; their sums and weights fit the first-level cache."""


def gathered(mosaic: F32, shares: F64) -> F32:
    """Return each pixel's sum of shares of the pixels around it.

    Beyond its border the mosaic repeats the nearest pixels of the same site in the color filter array's tile.

    - `mosaic`: (rows, cols), one whole tile or more.
    - `shares`: (tile rows, tile cols, size, size), size odd: the share that a pixel at that site receives of the pixel
      (i - size // 2) rows below it and (j - size // 2) columns to its right.
    """
    period_c, size = shares.shape[1:3]
    taps = np.argwhere((shares != 0).any(axis=(0, 1)))
    block = -(-_BLOCK // period_c) * period_c
    # weights[r, t, c]: share of tap t at site (r, c mod period), along a block of columns.
    by_site = shares[:, :, taps[:, 0], taps[:, 1]].transpose(0, 2, 1).astype(np.float32)
    weights = np.ascontiguousarray(np.tile(by_site, block // period_c))
    offsets = np.ascontiguousarray(taps - size // 2)
    out = np.empty_like(mosaic)
    _gather(mosaic, weights, offsets, period_c, size // 2, out)
    return out


@compiled(parallel=True)
def _gather(mosaic: F32, weights: F32, offsets: I64, period_c: int, reach: int, out: F32) -> None:
    rows, cols = mosaic.shape
    period_r, taps, block = weights.shape
    for r in prange(rows):
        weight = weights[r % period_r]
        for begin in range(0, cols, block):
            end = min(begin + block, cols)
            total = out[r, begin:end]
            total[:] = np.float32(0)
            # first to last: columns whose neighbors are all inside the frame.
            first, last = min(max(begin, reach), end), max(min(end, cols - reach), begin)
            last = max(first, last)
            for t in range(taps):
                source = mosaic[_inside(r + offsets[t, 0], rows, period_r)]
                shift = offsets[t, 1]
                for c in range(begin, first):
                    total[c - begin] += weight[t, c - begin] * source[_inside(c + shift, cols, period_c)]
                _add(total[first - begin : last - begin], weight[t, first - begin :], source[first + shift :])
                for c in range(last, end):
                    total[c - begin] += weight[t, c - begin] * source[_inside(c + shift, cols, period_c)]


@compiled()
def _add(total: F32, weight: F32, source: F32) -> None:
    for c in range(total.size):
        total[c] += weight[c] * source[c]


@compiled()
def _inside(index: int, size: int, period: int) -> int:
    """Return the nearest index inside the frame at the same site of the tile."""
    if index < 0:
        return index % period
    if index >= size:
        return size - period + (index - size) % period
    return index


@compiled(parallel=True)
def scale_by_angle(mosaic: F32, y: F64, x: F64, channel_of: I64, angle: F64, response: F64) -> None:
    """Multiply each pixel by its channel's response at the angle of its position, in place.

    - `mosaic`: (rows, cols).
    - `y`, `x`: (rows,), (cols,) positions; the angle is atan(hypot(y, x)).
    - `channel_of`: (tile rows, tile cols) channel of each site.
    - `angle`, `response`: (n,) radians, increasing from 0 to at least the largest angle; (channels, n), linear between.
    """
    rows, cols = mosaic.shape
    period_r, period_c = channel_of.shape
    last = angle.size - 2
    for r in prange(rows):
        k = 0
        for c in range(cols):
            theta = np.arctan(np.sqrt(y[r] * y[r] + x[c] * x[c]))
            # Neighbors have nearly the same angle: start from the previous interval.
            while k < last and theta > angle[k + 1]:
                k += 1
            while k > 0 and theta < angle[k]:
                k -= 1
            share = (theta - angle[k]) / (angle[k + 1] - angle[k])
            of = response[channel_of[r % period_r, c % period_c]]
            mosaic[r, c] *= np.float32(of[k] + share * (of[k + 1] - of[k]))
