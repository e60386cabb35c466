"""Arrays in the memory of a device, through an array module with the functions of the array API standard."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Arrays:
    """Arrays in the memory of a device.

    Read-only memory of the host, such as the maps of a chip, is copied to the device once, while it exists.

    Parameters
    ----------
    xp
        NumPy, CuPy, or another module with the functions of the array API standard, FFTs included.
    """

    def __init__(self, xp: Any) -> None:
        self.xp = xp
        self._kept: dict[tuple[Any, ...], Any] = {}

    def put(self, values: Any) -> Any:
        """Return values, of the host or of the device, as a contiguous array on the device."""
        if not isinstance(values, np.ndarray):
            return self.contiguous(values)
        owner = values if values.base is None else values.base
        if not isinstance(owner, np.ndarray) or owner.flags.writeable:
            return self.copied(np.ascontiguousarray(values))
        key = id(owner), values.ctypes.data, values.shape, values.strides, values.dtype.str
        if key not in self._kept:
            self._kept[key] = self.copied(np.ascontiguousarray(values))
            weakref.finalize(owner, self._kept.pop, key, None)
        return self._kept[key]

    def contiguous(self, values: Any) -> Any:
        """Return an array of the device, or of another library on it, as a contiguous array of `xp`."""
        return self.xp.ascontiguousarray(self.xp.asarray(values))

    def copied(self, values: NDArray[Any]) -> Any:
        """Return a copy of host values on the device."""
        return self.xp.array(values)

    def get(self, values: Any) -> NDArray[Any]:
        """Return a copy of an array of the device on the host."""
        return np.array(values)

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Any:
        """Return an array of zeros on the device; `dtype` is one of `xp`."""
        return self.xp.zeros(shape, dtype=dtype)

    def wait(self) -> None:
        """Wait until the device has done all work."""

    def for_kernel(self, values: Any) -> Any:
        """Return an array of the device as numba's kernels take it; both share memory."""
        return values
