"""The pixel kernel on an NVIDIA GPU: one thread a pixel, the same functions, the same bits.

The functions are those of the CPU, compiled once more by numba's CUDA target. Two things could change a bit there, and
are switched off: the compiler's fusing of a * b + c into one rounding, and the link-time step that would do it later.
The machine code is read after compiling, and refused if any fused or inexact operation is left in it.
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

from photosite.engine.pixels import expose_pixel

cuda: Any = numba.cuda  # numba's own, or numba-cuda in its place, or the simulator: not of one type

_THREADS = (32, 8)

SIGNATURE = (
    "void(float32[:,::1], int16[:,::1], float64, int16[:,::1], float64, float32[:,::1], float64, "
    "float64, float64, float64, float64, float64, int64, int64, int64, uint32, uint32, uint32, uint16[:,::1])"
)

# Every floating-point operation that rounds must say so (.rn: to nearest); one without may be fused by the assembler.
_INEXACT = re.compile(
    r"\b(?:(?:fma|mad|sin|cos|tanh|ex2|lg2|rsqrt)|(?:add|sub|mul|div|rcp|sqrt)(?!\.rn\.f(?:32|64)))\.[a-z.]*f(?:32|64)"
)


class NoCudaError(RuntimeError):
    """There is no GPU that this kernel can be compiled for; the message says what is missing."""


def expose_cuda(
    photo_e: NDArray[np.float32],
    prnu: NDArray[np.int16],
    prnu_scale: float,
    offset: NDArray[np.int16],
    offset_scale_e: float,
    dark_rate_e_per_s: NDArray[np.float32],
    exposure_s: float,
    well_capacity_e: float,
    read_noise_e: float,
    gain_dn_per_e: float,
    black_level_dn: float,
    white_level_dn: float,
    corner: tuple[int, int],
    chip_cols: int,
    frame: np.uint32,
    k0: np.uint32,
    k1: np.uint32,
) -> NDArray[np.uint16]:
    """What `photosite.engine.pixels.expose` gives, computed on the GPU; the arrays go there and the frame comes back.

    Parameters
    ----------
    photo_e, prnu, ..., k1
        As for `expose`.

    Raises
    ------
    NoCudaError
        If the GPU, its driver or numba-cuda is missing, or numba-cuda gives code that would round otherwise.
    """
    kernel = _kernel()
    out = cuda.device_array(photo_e.shape, np.uint16)
    blocks = tuple(-(-size // threads) for size, threads in zip(photo_e.shape[::-1], _THREADS, strict=True))
    kernel[blocks, _THREADS](
        _on_device(photo_e),
        _on_device(prnu),
        float(prnu_scale),
        _on_device(offset),
        float(offset_scale_e),
        _on_device(dark_rate_e_per_s),
        float(exposure_s),
        float(well_capacity_e),
        float(read_noise_e),
        float(gain_dn_per_e),
        float(black_level_dn),
        float(white_level_dn),
        *corner,
        chip_cols,
        frame,
        k0,
        k1,
        out,
    )
    frame_dn: NDArray[np.uint16] = out.copy_to_host()
    return frame_dn


def _on_device(values: NDArray[Any]) -> Any:
    return cuda.to_device(np.ascontiguousarray(values))


@lru_cache(maxsize=1)
def _kernel() -> Any:
    """The compiled kernel. An attempt that fails is not kept."""
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


def expose_thread(
    photo_e: Any,
    prnu: Any,
    prnu_scale: Any,
    offset: Any,
    offset_scale_e: Any,
    dark_rate_e_per_s: Any,
    exposure_s: Any,
    well_capacity_e: Any,
    read_noise_e: Any,
    gain_dn_per_e: Any,
    black_level_dn: Any,
    white_level_dn: Any,
    first_row: Any,
    first_col: Any,
    chip_cols: Any,
    frame: Any,
    k0: Any,
    k1: Any,
    out: Any,
) -> None:
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    # In an array of one value, which stands for all pixels, every index ends at 0.
    out[r, c] = expose_pixel(
        photo_e[r, c],
        prnu[min(r, prnu.shape[0] - 1), min(c, prnu.shape[1] - 1)],
        prnu_scale,
        offset[min(r, offset.shape[0] - 1), min(c, offset.shape[1] - 1)],
        offset_scale_e,
        dark_rate_e_per_s[min(r, dark_rate_e_per_s.shape[0] - 1), min(c, dark_rate_e_per_s.shape[1] - 1)],
        exposure_s,
        well_capacity_e,
        read_noise_e,
        gain_dn_per_e,
        black_level_dn,
        white_level_dn,
        (r + first_row) * chip_cols + c + first_col,
        frame,
        k0,
        k1,
    )


@contextmanager
def unfused() -> Iterator[None]:
    """NVVM told not to fuse. numba-cuda has no public option for it, so its call of the compiler is given one."""
    from numba.cuda.cudadrv import nvvm

    original: Callable[..., bytes] = nvvm.compile_ir
    nvvm.compile_ir = partial(original, fma=False)
    try:
        yield
    finally:
        nvvm.compile_ir = original


def check_unfused(ptx: str) -> None:
    """Refuse PTX in which an operation may round otherwise than on the CPU.

    Raises
    ------
    NoCudaError
        If one is fused, approximate, or leaves its rounding to the assembler.

    Examples
    --------
    >>> check_unfused("mul.rn.f64 %fd3, %fd1, %fd2; add.rn.f64 %fd4, %fd3, %fd5; cvt.rmi.f64.f64 %fd6, %fd4;")
    >>> check_unfused("fma.rn.f64 %fd4, %fd1, %fd2, %fd3;")
    Traceback (most recent call last):
    photosite.engine.cuda.NoCudaError: this numba-cuda compiles to fma.rn.f64, which rounds otherwise than the CPU
    """
    found = _INEXACT.search(ptx)
    if found:
        raise NoCudaError(f"this numba-cuda compiles to {found[0]}, which rounds otherwise than the CPU")
