"""The device that computes pixels: the CPU, or an NVIDIA GPU."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Literal

import numpy as np

from photosite.engine.arrays import Arrays
from photosite.engine.jit import read_only
from photosite.engine.threads import threads_for
from photosite.errors import InputError
from photosite.values.choice import check_choice

Device = Literal["cpu", "cuda"]
"""Where pixels are computed; the digital numbers are the same."""


class Cpu:
    """Pixels computed on the CPU, in NumPy arrays."""

    xp: Any = np

    def put(self, values: Any) -> Any:
        """Return values as a contiguous array for kernels."""
        return read_only(values)

    def get(self, values: Any) -> Any:
        """Return values on the host: themselves."""
        return values

    def run(self, kernel: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a kernel of the engine, whose first argument has an entry for each pixel."""
        with threads_for(arguments[0].size):
            return kernel(*arguments)


class Gpu:
    """Pixels computed on an NVIDIA GPU, in arrays that stay there.

    Parameters
    ----------
    arrays
        The device's arrays; default CuPy's.

    Raises
    ------
    InputError
        If a GPU, its driver or the extra `gpu` is missing.
    """

    def __init__(self, arrays: Arrays | None = None) -> None:
        try:
            self._cuda = import_module("photosite.engine.cuda")
        except ImportError:
            raise _no_cuda("numba.cuda cannot be imported") from None
        try:
            self.arrays: Arrays = self._cuda.gpu_arrays() if arrays is None else arrays
        except self._cuda.NoCudaError as error:
            raise _no_cuda(str(error)) from None

    @property
    def xp(self) -> Any:
        """The device's array module."""
        return self.arrays.xp

    def put(self, values: Any) -> Any:
        """Return values of the host or the device as a contiguous array on the device."""
        return self.arrays.put(values)

    def get(self, values: Any) -> Any:
        """Return a copy of an array of the device on the host."""
        return self.arrays.get(values)

    def run(self, kernel: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a kernel of the engine as `Cpu.run`, on the device."""
        try:
            return self._cuda.run(self.arrays, kernel.__name__, *arguments)
        except self._cuda.NoCudaError as error:
            raise _no_cuda(str(error)) from None


class GpuToHost(Gpu):
    """Pixels computed on an NVIDIA GPU, in steps whose results are copied to the host."""

    def put(self, values: Any) -> Any:
        """Return values as a contiguous array of the host."""
        return read_only(values)

    def run(self, kernel: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a kernel on the host."""
        return self.get(super().run(kernel, *arguments))


Backend = Cpu | Gpu
"""What runs kernels, and where their arrays are."""


def backend_for(device: Device | Gpu) -> Backend:
    """Return the backend of a device.

    Raises
    ------
    InputError
        If the device is unknown; or "cuda", and a GPU, its driver or the extra `gpu` is missing.
    """
    if isinstance(device, Gpu):
        return device
    check_choice("device", device, Device)
    return Cpu() if device == "cpu" else Gpu()


def _no_cuda(reason: str) -> InputError:
    return InputError(
        f"device 'cuda' needs an NVIDIA GPU and photosite's extra 'gpu', but {reason}",
        hint="Run pip install '.[gpu]' in the clone, or pass {device}, which gives the same numbers",
        arguments={"device": "cpu"},
    )
