"""The pixel model on an NVIDIA GPU: one thread per pixel, with the same functions and the same bits as on the CPU.

numba's CUDA target compiles the functions of `pixel_model`. Two optimizations would change bits and are switched off:
the compiler's fusing of a * b + c into one rounding, and the link-time step that would fuse it later. The compiled code
is searched, and rejected if it contains a fused or inexact operation.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numba.cuda
import numpy as np
from numpy.typing import NDArray

from photosite.engine.arrays import Arrays
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
from photosite.engine.pixel_model import (
    BlinkingPixels,
    DrawnConstants,
    DrawnMaps,
    Exposure,
    MeasuredConstants,
    MeasuredMaps,
    blinking_state,
    constant_or,
    drawn_pixel,
    expose_pixel,
    measured_pixel,
)

cuda: Any = numba.cuda  # numba's own, numba-cuda, or the simulator
types: Any = numba.types

THREADS = (32, 8)
"""Threads of a block along columns and rows of a frame."""
LIST_THREADS = 32

_DEVIATES, _FLOATS = types.Array(types.int16, 2, "C"), types.Array(types.float32, 2, "C")
_LINES, _GROUPS = types.Array(types.float64, 1, "C"), types.Array(types.int64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_NUMBERS, _CODES = types.Array(types.uint16, 2, "C"), types.Array(types.uint16, 1, "C")
_EXPOSURE = types.NamedTuple([types.float64] * 5 + [types.int64] * 3 + [types.uint32] * 3, Exposure)
_DRAWN = types.NamedTuple([_DEVIATES, _DEVIATES, _FLOATS, _LINES, _LINES], DrawnMaps)
_MEASURED = types.NamedTuple([_FLOATS] * 5 + [_LINES] * 2 + [types.float64] * 2, MeasuredMaps)
_BLINKING = types.NamedTuple([types.Array(types.int64, 2, "C"), *[_LINES] * 3], BlinkingPixels)
_CONVERSION = types.NamedTuple(
    [*[_FLOATS] * 2, *[_LINES] * 2, _GROUPS, *[_TABLE] * 2, _LINES, types.float64, _LINES, _CODES], ConversionMaps
)

# Every floating-point operation that rounds must state how (.rn: to nearest); otherwise the assembler may fuse it.
_INEXACT = re.compile(
    r"\b(?:(?:fma|mad|sin|cos|tanh|ex2|lg2|rsqrt)|(?:add|sub|mul|div|rcp|sqrt)(?!\.rn\.f(?:32|64)))\.[a-z.]*f(?:32|64)"
)


class NoCudaError(RuntimeError):
    """The kernel cannot be compiled for a GPU; the message states what is missing."""


class _CupyArrays(Arrays):
    """CuPy's arrays, which numba's kernels read and write in place."""

    def get(self, values: Any) -> NDArray[Any]:
        return np.asarray(values.get())

    def wait(self) -> None:
        self.xp.cuda.get_current_stream().synchronize()

    def for_kernel(self, values: Any) -> Any:
        # Kernels and CuPy use the same stream, the default one.
        return cuda.as_cuda_array(values, sync=False)


@lru_cache(maxsize=1)
def gpu_arrays() -> Arrays:
    """Return the arrays of the GPU: CuPy's, or NumPy's in numba's simulator.

    Raises `NoCudaError` if the GPU, its driver, numba-cuda or CuPy is missing.
    """
    if _simulated():
        return Arrays(np)
    if importlib.util.find_spec("numba_cuda") is None:
        raise NoCudaError("the package numba-cuda is not installed")
    if not cuda.is_available():
        raise NoCudaError("numba-cuda finds no GPU with a driver and a toolkit")
    try:
        import cupy
    except ImportError as error:
        raise NoCudaError(f"CuPy cannot be imported ({error})") from None
    return _CupyArrays(cupy)


def run(arrays: Arrays, name: str, *arguments: Any) -> Any:
    """Return what a CPU kernel of the engine returns, computed on the GPU and left there.

    A kernel that changes its first argument in place returns it. Raises `NoCudaError` if the code rounds differently.

    - `arrays`: The device's arrays.
    - `name`: Name of the kernel, a key of `KERNELS`.
    - `arguments`: Those of the kernel, on the host or on the device; the first has the rows and columns of the result.
    """
    kernel, first, *others = KERNELS[name], *(_on_device(arrays, argument) for argument in arguments)
    if kernel.dtype is None:  # one thread for each of a list
        if count := _first_array(others).shape[0]:
            _compiled(name)[-(-count // LIST_THREADS), LIST_THREADS](*_for_kernel(arrays, (first, *others)))
        return first
    out = arrays.zeros(first.shape, getattr(arrays.xp, kernel.dtype))
    blocks = tuple(-(-size // threads) for size, threads in zip(first.shape[::-1], THREADS, strict=True))
    _compiled(name)[blocks, THREADS](*_for_kernel(arrays, (first, *others, out)))
    return out


def _first_array(arguments: Sequence[Any]) -> Any:
    return arguments[0][0] if isinstance(arguments[0], tuple) else arguments[0]


def _is_array(argument: Any) -> bool:
    return hasattr(argument, "shape") and bool(argument.shape)


def _on_device(arrays: Arrays, argument: Any) -> Any:
    """Return an argument with its arrays on the GPU."""
    if isinstance(argument, tuple):
        return type(argument)(*(_on_device(arrays, part) for part in argument))
    return arrays.put(argument) if _is_array(argument) else argument


def _for_kernel(arrays: Arrays, argument: Any) -> Any:
    if isinstance(argument, tuple):
        parts = [_for_kernel(arrays, part) for part in argument]
        return tuple(parts) if type(argument) is tuple else type(argument)(*parts)
    return arrays.for_kernel(argument) if _is_array(argument) else argument


@lru_cache
def _compiled(name: str) -> Any:
    """Return the compiled kernel; failed attempts are not cached."""
    kernel = KERNELS[name]
    if _simulated():
        return cuda.jit(kernel.signature)(kernel.thread)
    with unfused():
        compiled = cuda.jit(kernel.signature, lto=False)(kernel.thread)
        for ptx in compiled.inspect_asm().values():
            check_unfused(ptx)
    return compiled


def _simulated() -> bool:
    settings: Any = numba.config
    return bool(settings.ENABLE_CUDASIM)


def _device_function(function: Callable[..., Any]) -> Any:
    """Return a function for use in kernels; numba's simulator calls it unchanged."""
    return function if _simulated() else cuda.jit(device=True, inline=True)(function)


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
    chip_r, chip_c = r + exposure.first_row, c + exposure.first_col
    prnu, offset = _at(maps.prnu, chip_r, chip_c), _at(maps.offset, chip_r, chip_c)
    dark_rate = _at(maps.dark_rate_e_per_s, chip_r, chip_c)
    line_dn = _line(maps.row_dn, r) + _line(maps.column_dn, c)
    pixel = drawn_pixel(prnu, offset, dark_rate, line_dn, constants, exposure)
    out[r, c] = expose_pixel(photo_e[r, c], pixel, r, c, exposure)


def expose_measured_thread(photo_e: Any, maps: Any, exposure: Any, out: Any) -> None:
    """Compute one pixel of a measured chip's frame."""
    c, r = cuda.grid(2)
    if r >= out.shape[0] or c >= out.shape[1]:
        return
    prnu, offset_dn, dark_rate, noise_dn = (
        maps.prnu[r, c],
        maps.offset_dn[r, c],
        maps.dark_rate_dn_per_s[r, c],
        maps.read_noise_dn[r, c],
    )
    shared = MeasuredConstants(maps.line_variance_dn2, maps.gain_dn_per_e)
    row_dn, column_dn = maps.row_dn[r], maps.column_dn[c]
    ratio = constant_or(maps.gain_ratio, r, c)
    pixel = measured_pixel(prnu, offset_dn, dark_rate, noise_dn, ratio, row_dn, column_dn, shared, exposure)
    out[r, c] = expose_pixel(photo_e[r, c], pixel, r, c, exposure)


def expose_blinking_thread(out: Any, blinking: Any, photo_e: Any, maps: Any, exposure: Any) -> None:
    """Replace one blinking pixel."""
    j = cuda.grid(1)
    if j >= blinking.place.shape[0]:
        return
    r, c = blinking.place[j, 0], blinking.place[j, 1]
    prnu, offset_dn, dark_rate = maps.prnu[r, c], maps.offset_dn[r, c], maps.dark_rate_dn_per_s[r, c]
    shared = MeasuredConstants(maps.line_variance_dn2, maps.gain_dn_per_e)
    row_dn, column_dn, noise_dn = maps.row_dn[r], maps.column_dn[c], blinking.noise_dn[j]
    ratio = constant_or(maps.gain_ratio, r, c)
    mean = measured_pixel(prnu, offset_dn, dark_rate, noise_dn, ratio, row_dn, column_dn, shared, exposure)
    pixel = blinking_state(mean, blinking.amplitude_dn[j], blinking.high_fraction[j], r, c, exposure)
    out[r, c] = expose_pixel(photo_e[r, c], pixel, r, c, exposure)


def replace_pixels_thread(out: Any, place: Any, numbers: Any) -> None:
    """Replace one of the listed pixels."""
    j = cuda.grid(1)
    if j < place.shape[0]:
        out[place[j, 0], place[j, 1]] = numbers[j]


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


def couple_thread(charge_e: Any, side_fraction: float, corner_fraction: float, out: Any) -> None:
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
    out[r, c] = coupled(np.float64(charge_e[r, c]), sides, corners, side_fraction, corner_fraction)


class Kernel(NamedTuple):
    """A kernel: types of its arguments, function of a thread, and type of the result.

    Without a type of the result, it changes its first argument.
    """

    signature: tuple[Any, ...]
    thread: Callable[..., None]
    dtype: str | None


_REGISTER = types.NamedTuple([types.float64] * 4, Register)
_CONSTANTS = types.NamedTuple([types.float64] * 3, DrawnConstants)
_PLACES = types.Array(types.int64, 2, "C")
KERNELS = {
    "expose_drawn": Kernel((_FLOATS, _DRAWN, _CONSTANTS, _EXPOSURE, _NUMBERS), expose_thread, "uint16"),
    "expose_measured": Kernel((_FLOATS, _MEASURED, _EXPOSURE, _NUMBERS), expose_measured_thread, "uint16"),
    "expose_blinking": Kernel((_NUMBERS, _BLINKING, _FLOATS, _MEASURED, _EXPOSURE), expose_blinking_thread, None),
    "replace_pixels": Kernel((_NUMBERS, _PLACES, _CODES), replace_pixels_thread, None),
    "collect_charge": Kernel((_FLOATS, _FLOATS, _FLOATS, _EXPOSURE, _FLOATS), collect_thread, "float32"),
    "convert_charge": Kernel((_FLOATS, _CONVERSION, _EXPOSURE, _NUMBERS), convert_thread, "uint16"),
    "bloom_columns": Kernel((_FLOATS, types.float64, types.float64, _FLOATS), bloom_thread, "float32"),
    "transfer_charge": Kernel((_FLOATS, _TABLE, _TABLE, _FLOATS), transfer_thread, "float32"),
    "multiply_charge": Kernel((_FLOATS, _REGISTER, _EXPOSURE, _FLOATS), multiply_thread, "float32"),
    "couple_pixels": Kernel((_FLOATS, types.float64, types.float64, _FLOATS), couple_thread, "float32"),
}
"""By the name of the CPU kernel with the same arguments and result."""


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
