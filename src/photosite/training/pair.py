"""A training pair: a clean frame, a noisy one, and their metadata."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Pair(NamedTuple):
    """An item of a dataset, or a batch of them.

    Parameters
    ----------
    clean
        (rows, cols) float32 noise-free frame, in the unit of `noisy`.
    noisy
        (rows, cols): uint16 digital numbers (uint32 above 16 bits), black level included; float32 for electrons.
    metadata
        Numbers and texts by name, the same names for all items of a dataset: see `PairDataset`.

    Examples
    --------
    >>> clean, noisy, metadata = Pair(np.zeros((2, 2), np.float32), np.zeros((2, 2), np.uint16), {"light": 1.0})
    >>> metadata
    {'light': 1.0}
    """

    clean: NDArray[np.float32]
    noisy: NDArray[Any]
    metadata: dict[str, Any]
