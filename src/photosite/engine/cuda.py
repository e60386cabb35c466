"""The pixel model on an NVIDIA GPU: one thread per pixel, with the same functions and the same bits as on the CPU.

numba's CUDA target compiles the functions of `pixel_model`. Two optimizations would change bits and are switched off:
the compiler's fusing of a * b + c into one rounding, and the link-time step that would fuse it later. The compiled code
is searched, and rejected if it contains a fused or inexact operation.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Any

import numba.cuda
import numpy as np
from numpy.typing import NDArray

from photosite.engine.jit import F32
from photosite.engine.pixel_model import DrawnConstants, DrawnMaps, Exposure, drawn_pixel, expose_pixel

cuda: Any = numba.cuda  # numba's own, numba-cuda, or the simulator
types: Any = numba.types

_THREADS = (32, 8)

_DEVIATES, _FLOATS = types.Array(types.int16, 2, "C"), types.Array(types.float32, 2, "C")
_LINES = types.Array(types.float64, 1, "C")
SIGNATURE = (
    _FLOATS,
    types.NamedTuple([_DEVIATES, _DEVIATES, _FLOATS, _LINES, _LINES], DrawnMaps),
    types.NamedTuple([types.float64] * 3, DrawnConstants),
    types.NamedTuple([types.float64] * 5 + [types.int64] * 3 + [types.uint32] * 3, Exposure),
    types.Array(types.uint16, 2, "C"),
)
"""Argument types of `expose_thread`."""

# Every floating-point operation that rounds must state how (.rn: to nearest); otherwise the assembler may fuse it.
_INEXACT = re.compile(
    r"\b(?:(?:fma|mad|sin|cos|tanh|ex2|lg2|rsqrt)|(?:add|sub|mul|div|rcp|sqrt)(?!\.rn\.f(?:32|64)))\.[a-z.]*f(?:32|64)"
)


class NoCudaError(RuntimeError):
    """The kernel cannot be compiled for a GPU; the message states what is missing."""


def expose_drawn_cuda(
    photo_e: F32, maps: DrawnMaps, constants: DrawnConstants, exposure: Exposure
) -> NDArray[np.uint16]:
    """Return the digital numbers of `pixel_model.expose_drawn`, with the same arguments, computed on the GPU.

    Raises `NoCudaError` if the GPU, its driver or numba-cuda is missing, or its code rounds differently.
    """
    kernel = _kernel()
    out = cuda.device_array(photo_e.shape, np.uint16)
    blocks = tuple(-(-size // threads) for size, threads in zip(photo_e.shape[::-1], _THREADS, strict=True))
    on_device = DrawnMaps(*(_on_device(values) for values in maps))
    kernel[blocks, _THREADS](_on_device(photo_e), on_device, constants, exposure, out)
    frame_dn: NDArray[np.uint16] = out.copy_to_host()
    return frame_dn


def _on_device(values: NDArray[Any]) -> Any:
    return cuda.to_device(np.ascontiguousarray(values))


@lru_cache(maxsize=1)
def _kernel() -> Any:
    """Return the compiled kernel; failed attempts are not cached."""
    settings: Any = numba.config
    if settings.ENABLE_CUDASIM:
        return cuda.jit(SIGNATURE)(expose_thread)
    if importlib.util.find_spec("numba_cuda") is None:
        raise NoCudaError("the package numba-cuda is not installed")
    if not cuda.is_available():
        raise NoCudaError("numba-cuda finds no GPU with a driver and a toolkit")
    with unfused():
        kernel = cuda.jit(SIGNATURE, lto=False)(expose_thread)
        for ptx in kernel.inspect_asm().values():
            check_unfused(ptx)
    return kernel


def expose_thread(photo_e: Any, maps: Any, constants: Any, exposure: Any, out: Any) -> None:
    """Compute one pixel of a drawn chip's frame."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    # In a map of shape (1, 1) or (1,), which is one value for all pixels or lines, every index becomes 0.
    prnu = maps.prnu[min(r, maps.prnu.shape[0] - 1), min(c, maps.prnu.shape[1] - 1)]
    offset = maps.offset[min(r, maps.offset.shape[0] - 1), min(c, maps.offset.shape[1] - 1)]
    rates = maps.dark_rate_e_per_s
    dark_rate = rates[min(r, rates.shape[0] - 1), min(c, rates.shape[1] - 1)]
    line_dn = maps.row_dn[min(r, maps.row_dn.shape[0] - 1)] + maps.column_dn[min(c, maps.column_dn.shape[0] - 1)]
    pixel = drawn_pixel(prnu, offset, dark_rate, line_dn, constants, exposure)
    out[r, c] = expose_pixel(photo_e[r, c], pixel, r, c, exposure)


@contextmanager
def unfused() -> Iterator[None]:
    """Make numba-cuda call NVVM without fusing multiply and add; numba-cuda has no public option for it."""
    from numba.cuda.cudadrv import nvvm

    original: Callable[..., bytes] = nvvm.compile_ir
    nvvm.compile_ir = partial(original, fma=False)
    try:
        yield
    finally:
        nvvm.compile_ir = original


def check_unfused(ptx: str) -> None:
    """Reject PTX in which an operation may round differently from the CPU.

    Raises `NoCudaError` if an operation is fused, approximate, or leaves its rounding to the assembler.

    Examples
    --------
    >>> check_unfused("mul.rn.f64 %fd3, %fd1, %fd2; add.rn.f64 %fd4, %fd3, %fd5; cvt.rmi.f64.f64 %fd6, %fd4;")
    >>> check_unfused("fma.rn.f64 %fd4, %fd1, %fd2, %fd3;")
    Traceback (most recent call last):
    photosite.engine.cuda.NoCudaError: numba-cuda compiles to fma.rn.f64, which rounds differently from the CPU
    """
    found = _INEXACT.search(ptx)
    if found:
        raise NoCudaError(f"numba-cuda compiles to {found[0]}, which rounds differently from the CPU")
