"""Configuration of numba, in one place: compiled functions, their cache, array types, LLVM intrinsics.

numba is imported when a compiled function is first called: that takes 0.2 s, and many commands call none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from photosite.engine.kernel_folder import kernel_folder

F = TypeVar("F", bound=Callable[..., Any])

# Arrays of any shape, by the type of their numbers.
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
C64 = NDArray[np.complex64]
I64 = NDArray[np.int64]


class Deferred:
    """An object of numba that is made when it is first used, for the function that it is made from.

    It has the attributes and the class of the object, so that numba takes it for one in compiled functions.
    """

    def __init__(self, function: Callable[..., Any], make: Callable[[Callable[..., Any]], Any]) -> None:
        update_wrapper(self, function)
        self._make = make

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        return self._made(*arguments, **options)

    def __getattr__(self, name: str) -> Any:
        if name != "_made":
            return getattr(self._made, name)
        return self.__dict__.setdefault(name, self._make(self.__wrapped__))  # threads may get here at the same time

    @property
    def _numba_type_(self) -> Any:
        if (own := getattr(self._made, "_numba_type_", None)) is not None:
            return own
        from numba.core.registry import cpu_target

        context: Any = cpu_target.typing_context
        context.refresh()  # it may have been made since the last time
        return context.resolve_value_type(self._made)

    @property  # type: ignore[misc]
    def __class__(self) -> type:
        return type(self._made)

    def __reduce__(self) -> str:
        return str(self.__qualname__)


def compiled(*, inline: bool = False, fused: bool = False) -> Callable[[F], F]:
    """Return a decorator that compiles a function at its first call and caches the result on disk.

    Floating point stays strict (no fast-math): the same input gives the same bits whatever the vector width.
    `inline` inlines the function into its callers. `fused` lets a processor round a * b + c once: for results that are
    only compared with others beyond the bound of their errors.

    A function is compiled for calls from Python, or, without what converts its arguments, for calls from compiled ones.
    Loops over several threads are those of `threads.parallel_for`: numba's own compile each function four times.
    """
    options: dict[str, Any] = {"inline": "always"} if inline else {"fastmath": {"contract"} if fused else False}

    def make(function: Callable[..., Any]) -> Any:
        kernel = _dispatcher(function, kernel_folder(), **options)
        if not inline:
            _call_inner(kernel, _dispatcher(function, kernel_folder() / "inner", no_cpython_wrapper=True, **options))
        return kernel

    def decorate(function: F) -> F:
        return cast(F, Deferred(function, make))

    return decorate


_SETTING = Lock()
"""Of numba's folder: two threads that make kernels at the same time would exchange theirs."""


def _dispatcher(function: Callable[..., Any], folder: Path, **options: Any) -> Any:
    import numba

    from photosite.engine.kernel_cache import KernelCache

    # numba reads this setting when it decorates; restore it for other users of numba in this process.
    settings: Any = numba.config
    with _SETTING:
        before, settings.CACHE_DIR = settings.CACHE_DIR, str(folder)
        try:
            njit: Any = numba.njit
            kernel = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
            kernel._cache = KernelCache(function)
        finally:
            settings.CACHE_DIR = before
    return kernel


def _call_inner(kernel: Any, inner: Any) -> None:
    """Let compiled functions that call a kernel use its form for them, which Python cannot call.

    Numbers that are constants in the caller are arguments like all others: one form serves both.
    """
    from numba import types

    unliteral: Any = types.unliteral

    def template(arguments: Any, keywords: Any) -> Any:
        return inner.get_call_template(tuple(unliteral(each) for each in arguments), keywords)

    kernel.get_call_template, kernel.get_overload = template, inner.get_overload


T = TypeVar("T", bound=np.generic)


def read_only(values: NDArray[T]) -> NDArray[T]:
    """Return a contiguous, read-only array for a kernel's input; a copy only if the values are not contiguous.

    numba compiles a kernel for each combination of writable, read-only and strided arguments, seconds each.
    """
    view = np.ascontiguousarray(values).view()
    view.flags.writeable = False
    return view


def intrinsic(function: Callable[..., Any]) -> Any:
    """Make a function that returns a signature, and what builds its code, a part of compiled functions."""

    def make(function: Callable[..., Any]) -> Any:
        from numba import extending

        return extending.intrinsic(function)

    return Deferred(function, make)


def _reinterpreted(source: Any, target: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], context.get_value_type(target))

    return target(source), codegen


@intrinsic
def _bits_of_double(typingctx: Any, value: Any) -> Any:
    from numba import types

    return _reinterpreted(types.float64, types.int64)


@intrinsic
def _double_of_bits(typingctx: Any, value: Any) -> Any:
    from numba import types

    return _reinterpreted(types.int64, types.float64)


@intrinsic
def _bits_of_single(typingctx: Any, value: Any) -> Any:
    from numba import types

    return _reinterpreted(types.float32, types.int32)


@intrinsic
def _single_of_bits(typingctx: Any, value: Any) -> Any:
    from numba import types

    return _reinterpreted(types.int32, types.float32)


@intrinsic
def _pointer(typingctx: Any, address: Any) -> Any:
    from numba import types

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(address), codegen


@intrinsic
def _prefetch(typingctx: Any, address: Any) -> Any:
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import types

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, byte = ir.IntType(32), ir.IntType(8).as_pointer()
        call = builder.module.declare_intrinsic(
            "llvm.prefetch", (byte,), ir.FunctionType(ir.VoidType(), (byte, *[word] * 3))
        )
        to_read, keep, data = word(0), word(3), word(1)
        builder.call(call, (builder.inttoptr(arguments[0], byte), to_read, keep, data))
        return context.get_dummy_value()

    return types.void(address), codegen


@intrinsic
def _counted(typingctx: Any, address: Any) -> Any:
    from llvmlite import ir
    from numba import types

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number = ir.IntType(64)
        return builder.atomic_rmw("add", builder.inttoptr(arguments[0], number.as_pointer()), number(1), "seq_cst")

    return types.int64(address), codegen


def _carray(pointer: Any, shape: Any, dtype: Any) -> Any:
    """Stand for `numba.carray`, which returns the array at a pointer."""


def _numba_carray(function: Callable[..., Any]) -> Any:
    import numba

    return cast(Any, numba).carray


# Inside compiled code only.
bits_of_double = cast(Callable[[float], int], _bits_of_double)
double_of_bits = cast(Callable[[int], float], _double_of_bits)
bits_of_single = cast(Callable[[np.float32], np.int32], _bits_of_single)
single_of_bits = cast(Callable[[np.int32], np.float32], _single_of_bits)
carray = cast(Any, Deferred(_carray, _numba_carray))
pointer = cast(Callable[[int], Any], _pointer)
"""Convert an address (int64) to a pointer for `carray`; the caller keeps the array alive."""
prefetch = cast(Callable[[int], None], _prefetch)
"""Prefetch the cache line at an address (int64), which need not be valid."""
counted = cast(Callable[[int], int], _counted)
"""Return the number (int64) at an address, and add 1 to it; each thread that calls this gets another number."""
