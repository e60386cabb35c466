"""The one place where numba is configured."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(*, parallel: bool = False, inline: bool = False) -> Callable[[F], F]:
    """Compile a function to machine code at its first call, and keep the result on disk for the next process.

    Floating point stays strict (no fast-math): the same input gives the same bits whatever the vector width.

    Parameters
    ----------
    parallel
        Let `numba.prange` loops run on several threads.
    inline
        Put the function's body into its callers.
    """

    def decorate(function: F) -> F:
        options: dict[str, Any] = {"cache": True, "fastmath": False, "nogil": True, "error_model": "numpy"}
        if parallel:
            options["parallel"] = True
        if inline:
            options["inline"] = "always"
        return cast(F, numba.njit(**options)(function))

    return decorate


prange = numba.prange
