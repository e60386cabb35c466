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

from photosite.engine.charge import (
    ConversionMaps,
    between,
    collected_pixel,
    converter_input,
    mean_charge,
    read_deviate,
    rounded,
    step_below,
)
from photosite.engine.charge_stages import Register, coupled, multiplied_pixel, overflow, taken
from photosite.engine.jit import F32, F64
from photosite.engine.pixel_model import DrawnConstants, DrawnMaps, Exposure, drawn_pixel, expose_pixel

cuda: Any = numba.cuda  # numba's own, numba-cuda, or the simulator
types: Any = numba.types

_THREADS = (32, 8)

_DEVIATES, _FLOATS = types.Array(types.int16, 2, "C"), types.Array(types.float32, 2, "C")
_LINES, _GROUPS = types.Array(types.float64, 1, "C"), types.Array(types.int64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_NUMBERS, _CODES = types.Array(types.uint16, 2, "C"), types.Array(types.uint16, 1, "C")
_EXPOSURE = types.NamedTuple([types.float64] * 5 + [types.int64] * 3 + [types.uint32] * 3, Exposure)
_CONVERSION = types.NamedTuple(
    [*[_FLOATS] * 2, *[_LINES] * 2, _GROUPS, *[_TABLE] * 2, _LINES, types.float64, _LINES, _CODES], ConversionMaps
)
SIGNATURE = (
    _FLOATS,
    types.NamedTuple([_DEVIATES, _DEVIATES, _FLOATS, _LINES, _LINES], DrawnMaps),
    types.NamedTuple([types.float64] * 3, DrawnConstants),
    _EXPOSURE,
    _NUMBERS,
)
"""Argument types of `expose_thread`."""
COLLECT_SIGNATURE = (_FLOATS, _FLOATS, _FLOATS, _EXPOSURE, _FLOATS)
"""Argument types of `collect_thread`."""
CONVERT_SIGNATURE = (_FLOATS, _CONVERSION, _EXPOSURE, _NUMBERS)
"""Argument types of `convert_thread`."""
BLOOM_SIGNATURE = (_FLOATS, types.float64, types.float64, _FLOATS)
"""Argument types of `bloom_thread`."""
TRANSFER_SIGNATURE = (_FLOATS, _TABLE, _TABLE, _FLOATS)
"""Argument types of `transfer_thread`."""
MULTIPLY_SIGNATURE = (_FLOATS, types.NamedTuple([types.float64] * 4, Register), _EXPOSURE, _FLOATS)
"""Argument types of `multiply_thread`."""
COUPLE_SIGNATURE = (_FLOATS, types.float64, types.float64, _FLOATS)
"""Argument types of `couple_thread`."""

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
    frame_dn: NDArray[np.uint16] = _run(SIGNATURE, expose_thread, np.uint16, photo_e, maps, constants, exposure)
    return frame_dn


def collect_charge_cuda(photo_e: F32, prnu: F32, dark_rate_e_per_s: F32, exposure: Exposure) -> F32:
    """Return the electrons of `charge.collect_charge`, computed on the GPU. Raises as `expose_drawn_cuda`."""
    charge_e: F32 = _run(COLLECT_SIGNATURE, collect_thread, np.float32, photo_e, prnu, dark_rate_e_per_s, exposure)
    return charge_e


def convert_charge_cuda(charge_e: F32, maps: ConversionMaps, exposure: Exposure) -> NDArray[np.uint16]:
    """Return the digital numbers of `charge.convert_charge`, computed on the GPU. Raises as `expose_drawn_cuda`."""
    frame_dn: NDArray[np.uint16] = _run(CONVERT_SIGNATURE, convert_thread, np.uint16, charge_e, maps, exposure)
    return frame_dn


def bloom_columns_cuda(charge_e: F32, well_e: float, kept: float) -> F32:
    """Return the charge of `charge_stages.bloom_columns`, computed on the GPU. Raises as `expose_drawn_cuda`."""
    bloomed_e: F32 = _run(BLOOM_SIGNATURE, bloom_thread, np.float32, charge_e, well_e, kept)
    return bloomed_e


def transfer_charge_cuda(charge_e: F32, row_shares: F64, column_shares: F64) -> F32:
    """Return the charge of `charge_stages.transfer_charge`, computed on the GPU. Raises as `expose_drawn_cuda`."""
    moved_e: F32 = _run(TRANSFER_SIGNATURE, transfer_thread, np.float32, charge_e, row_shares, column_shares)
    return moved_e


def multiply_charge_cuda(charge_e: F32, register: Register, exposure: Exposure) -> F32:
    """Return the charge of `charge_stages.multiply_charge`, computed on the GPU. Raises as `expose_drawn_cuda`."""
    multiplied_e: F32 = _run(MULTIPLY_SIGNATURE, multiply_thread, np.float32, charge_e, register, exposure)
    return multiplied_e


def couple_pixels_cuda(charge_e: F32, side_share: float, corner_share: float) -> F32:
    """Return the signals of `charge_stages.couple_pixels`, computed on the GPU. Raises as `expose_drawn_cuda`."""
    coupled_e: F32 = _run(COUPLE_SIGNATURE, couple_thread, np.float32, charge_e, side_share, corner_share)
    return coupled_e


def _run(signature: Any, thread: Callable[..., None], dtype: Any, pixels: NDArray[Any], *arguments: Any) -> Any:
    """Return a (rows, cols) array that a kernel with a thread for each pixel fills."""
    kernel = _kernel(signature, thread)
    out = cuda.device_array(pixels.shape, dtype)
    blocks = tuple(-(-size // threads) for size, threads in zip(pixels.shape[::-1], _THREADS, strict=True))
    kernel[blocks, _THREADS](*map(_on_device, (pixels, *arguments)), out)
    return out.copy_to_host()


def _on_device(argument: Any) -> Any:
    """Return an argument with its arrays copied to the GPU."""
    if isinstance(argument, np.ndarray):
        return cuda.to_device(np.ascontiguousarray(argument))
    return type(argument)(*map(_on_device, argument)) if isinstance(argument, tuple) else argument


@lru_cache
def _kernel(signature: Any, thread: Callable[..., None]) -> Any:
    """Return the compiled kernel; failed attempts are not cached."""
    settings: Any = numba.config
    if settings.ENABLE_CUDASIM:
        return cuda.jit(signature)(thread)
    if importlib.util.find_spec("numba_cuda") is None:
        raise NoCudaError("the package numba-cuda is not installed")
    if not cuda.is_available():
        raise NoCudaError("numba-cuda finds no GPU with a driver and a toolkit")
    with unfused():
        kernel = cuda.jit(signature, lto=False)(thread)
        for ptx in kernel.inspect_asm().values():
            check_unfused(ptx)
    return kernel


def _device_function(function: Callable[..., Any]) -> Any:
    """Return a function for use in kernels; numba's simulator calls it as it is."""
    settings: Any = numba.config
    return function if settings.ENABLE_CUDASIM else cuda.jit(device=True, inline=True)(function)


@_device_function
def _at(values: Any, r: int, c: int) -> Any:
    """Return the value of a map; every index of a map of shape (1, 1), one value for all pixels, becomes 0."""
    return values[min(r, values.shape[0] - 1), min(c, values.shape[1] - 1)]


@_device_function
def _line(values: Any, i: int) -> Any:
    """Return the value of a line; every index of shape (1,), one value for all lines, becomes 0."""
    return values[min(i, values.shape[0] - 1)]


def expose_thread(photo_e: Any, maps: Any, constants: Any, exposure: Any, out: Any) -> None:
    """Compute one pixel of a drawn chip's frame."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    prnu, offset = _at(maps.prnu, r, c), _at(maps.offset, r, c)
    dark_rate = _at(maps.dark_rate_e_per_s, r, c)
    line_dn = _line(maps.row_dn, r) + _line(maps.column_dn, c)
    pixel = drawn_pixel(prnu, offset, dark_rate, line_dn, constants, exposure)
    out[r, c] = expose_pixel(photo_e[r, c], pixel, r, c, exposure)


def collect_thread(photo_e: Any, prnu: Any, dark_rate_e_per_s: Any, exposure: Any, out: Any) -> None:
    """Compute the charge of one pixel."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    response, dark_rate = np.float64(_at(prnu, r, c)), np.float64(_at(dark_rate_e_per_s, r, c))
    mean_e = mean_charge(np.float64(photo_e[r, c]), response, dark_rate, exposure)
    out[r, c] = collected_pixel(mean_e, r, c, exposure)


def convert_thread(charge_e: Any, maps: Any, exposure: Any, out: Any) -> None:
    """Compute the digital number of one pixel from its charge."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    curve, error = maps.curve_e, maps.converter_error_dn
    signal_e: Any = np.float64(charge_e[r, c])
    if curve.shape[0] > 1:
        place = max(signal_e, 0.0) / maps.curve_step_e
        low = step_below(place, curve.shape[0])
        signal_e = between(curve[low], curve[low + 1], place - low)
    group = _line(maps.row_group, r)
    offset_e = np.float64(_at(maps.offset_e, r, c)) + _at(maps.channel_offset_e, group, c)
    read_e = offset_e + np.float64(_at(maps.noise_e, r, c)) * read_deviate(r, c, exposure)
    line_dn = _line(maps.row_dn, r) + _line(maps.column_dn, c)
    dn = converter_input(signal_e, read_e, _at(maps.channel_gain, group, c), line_dn, exposure)
    if error.shape[0] > 1:
        place = max(dn, 0.0) * ((error.shape[0] - 1) / exposure.white_level_dn)
        low = step_below(place, error.shape[0])
        dn += between(error[low], error[low + 1], place - low)
    number = rounded(dn, exposure)
    out[r, c] = maps.output_dn[number] if maps.output_dn.shape[0] > 1 else number


def bloom_thread(charge_e: Any, well_e: float, kept: float, out: Any) -> None:
    """Compute one column; the threads of the other rows have nothing to do."""
    c, row = cuda.grid(2)
    if row > 0 or c >= out.shape[1]:
        return
    rows = out.shape[0]
    flow = 0.0
    for passing in range(3 * rows):
        sweep, step = passing // rows, passing % rows
        r = rows - 1 - step if sweep == 1 else step
        charge = np.float64(charge_e[r, c])
        held = min(np.float64(out[r, c]) if sweep > 0 else charge, well_e)
        more = taken(held, flow, well_e)
        out[r, c] = held + more
        flow += overflow(charge, well_e, kept if sweep < 2 else 0.0) - more


def transfer_thread(charge_e: Any, row_shares: Any, column_shares: Any, out: Any) -> None:
    """Compute the charge that arrives as one pixel."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    total = 0.0
    for columns_late in range(min(column_shares.shape[0], c + 1)):
        source = c - columns_late
        moved = 0.0
        for rows_late in range(min(row_shares.shape[0], r + 1)):
            moved += row_shares[rows_late, r - rows_late] * np.float64(charge_e[r - rows_late, source])
        total += column_shares[columns_late, source] * moved
    out[r, c] = total


def multiply_thread(charge_e: Any, register: Any, exposure: Any, out: Any) -> None:
    """Compute the charge of one pixel behind the multiplication register."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    out[r, c] = multiplied_pixel(np.float64(charge_e[r, c]), r, c, register, exposure)


def couple_thread(charge_e: Any, side_share: float, corner_share: float, out: Any) -> None:
    """Compute the signal of one pixel that is coupled to its neighbors."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    above, below = max(r - 1, 0), min(r + 1, out.shape[0] - 1)
    before, after = max(c - 1, 0), min(c + 1, out.shape[1] - 1)
    sides = (np.float64(charge_e[above, c]) + np.float64(charge_e[below, c])) + (
        np.float64(charge_e[r, before]) + np.float64(charge_e[r, after])
    )
    corners = (np.float64(charge_e[above, before]) + np.float64(charge_e[below, before])) + (
        np.float64(charge_e[above, after]) + np.float64(charge_e[below, after])
    )
    out[r, c] = coupled(np.float64(charge_e[r, c]), sides, corners, side_share, corner_share)


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
