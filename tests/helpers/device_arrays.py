"""Arrays of a device that refuse every implicit way to the host, in NumPy's memory (array-api-strict)."""

from __future__ import annotations

from typing import Any

import array_api_strict as strict
import numpy as np
from numpy.typing import NDArray

from photosite.engine.arrays import Arrays

DEVICE = strict.Device("device1")


class StrictArrays(Arrays):
    """As CuPy's: `np.asarray`, NumPy's functions and arithmetic with host arrays raise errors.

    Only the array API standard's functions exist. `host_copies` counts the arrays that were copied to the host.
    """

    def __init__(self) -> None:
        super().__init__(strict)
        self.host_copies = 0

    def contiguous(self, values: Any) -> Any:
        assert values.device == DEVICE
        return values if values._array.flags.c_contiguous else strict.asarray(values, copy=True)

    def copied(self, values: NDArray[Any]) -> Any:
        return strict.asarray(values, device=DEVICE, copy=True)

    def get(self, values: Any) -> NDArray[Any]:
        self.host_copies += 1
        return np.array(values._array)

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Any:
        return strict.zeros(shape, dtype=dtype, device=DEVICE)

    def for_kernel(self, values: Any) -> Any:
        return values._array
