"""What frames do about their mean: fourth powers per pixel, and a histogram over all pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import compiled, prange


@compiled(parallel=True)
def add_residuals(
    frame: NDArray[Any],
    total: NDArray[Any],
    count: int,
    row_shift: NDArray[np.float64],
    column_shift: NDArray[np.float64],
    bins_per_dn: float,
    fourth: NDArray[np.float32],
    histogram: NDArray[np.int64],
) -> None:
    """Add one frame's residuals, its digital numbers less the pixels' means over the stack.

    Parameters
    ----------
    frame
        (rows, cols) uint8 or uint16.
    total, count
        (rows, cols) sum over the stack that the frame is from, and the frames in it.
    row_shift, column_shift
        (rows,), (cols,) what the frame adds to each line; taken off for the histogram only.
    bins_per_dn
        Bins of the histogram for one digital number.
    fourth
        (rows, cols) sum of the residuals' fourth powers; added to.
    histogram
        (blocks, bins) residuals by block of rows: the rows are cut into as many equal parts as it has rows. Added to;
        the middle of the bins is 0, the first and the last hold all beyond.
    """
    rows, cols = frame.shape
    blocks, bins = histogram.shape
    inverse = 1.0 / count
    middle = 0.5 * bins
    for block in prange(blocks):
        counts = histogram[block]
        for r in range(block * rows // blocks, (block + 1) * rows // blocks):
            for c in range(cols):
                d = float(frame[r, c]) - float(total[r, c]) * inverse
                square = d * d
                fourth[r, c] += np.float32(square * square)
                place = (d - row_shift[r] - column_shift[c]) * bins_per_dn + middle
                counts[int(min(max(place, 0.0), bins - 1.0))] += 1
