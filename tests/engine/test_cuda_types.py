"""Types inside the kernels for a GPU: all arithmetic is in 64 bits, and only what is stored has 32.

numba's `float` keeps 32 bits, and Python's has 64, so that the simulator computes in 64 bits what a GPU would not. Here
numba infers the types of the same functions for the CPU.
"""

from __future__ import annotations

from types import FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from numba import njit, types
from numba.core import ir
from numba.extending import overload

from photosite.engine import cuda
from photosite.engine.cuda import KERNELS

DRAWING = ("expose_drawn", "expose_measured", "expose_blinking", "convert_charge", "collect_charge", "multiply_charge")
"""Kernels that draw random numbers, which take some seconds to compile."""


def _grid(dimensions: int) -> Any:
    """Stand for the place of a thread."""
    raise NotImplementedError


@overload(_grid, prefer_literal=True)
def _grid_of(dimensions):  # type: ignore[no-untyped-def]  # numba compares the names with annotations
    if getattr(dimensions, "literal_value", None) == 2:
        return lambda dimensions: (0, 0)
    return lambda dimensions: 0


def arithmetic_in_32_bits(thread: Any, signature: tuple[Any, ...]) -> list[str]:
    """Return the operations of a kernel's thread whose result has 32 bits, other than loads and conversions."""
    if numba.config.ENABLE_CUDASIM:
        pytest.skip("the simulator is active")
    on_cpu = ModuleType("cuda")
    on_cpu.grid = _grid  # type: ignore[attr-defined]
    functions = {name: njit(inline="always")(getattr(cuda, name).py_func) for name in ("_at", "_line")}
    names = {**thread.__globals__, **functions, "cuda": on_cpu}
    compiled = njit(error_model="numpy")(FunctionType(thread.__code__, names, thread.__name__))
    compiled.compile(signature)
    (result,) = compiled.overloads.values()
    inferred = result.type_annotation
    found = []
    for operation, signature in inferred.calltypes.items():
        if not isinstance(operation, ir.Expr) or signature is None or signature.return_type != types.float32:
            continue
        called = inferred.typemap[operation.func.name] if operation.op == "call" else None
        converts = isinstance(called, types.NumberClass) or getattr(called, "typing_key", None) is float
        if not converts and operation.op not in ("getitem", "static_getitem"):
            found.append(f"{operation}: {signature}")
    return found


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in DRAWING else []) for name in KERNELS]
)
def test_kernels_compute_in_64_bits(name: str) -> None:
    assert not arithmetic_in_32_bits(KERNELS[name].thread, KERNELS[name].signature)


def test_arithmetic_in_32_bits_is_found() -> None:
    def wrong(photo_e: Any, out: Any) -> None:
        value = float(photo_e[0, 0])
        out[0, 0] = 2.0 * (value * value)

    def right(photo_e: Any, out: Any) -> None:
        value = np.float64(photo_e[0, 0])
        out[0, 0] = 2.0 * (value * value)

    floats = types.Array(types.float32, 2, "C")
    assert len(arithmetic_in_32_bits(wrong, (floats, floats))) == 1
    assert not arithmetic_in_32_bits(right, (floats, floats))
