"""Computations beside others, on the threads that a process may use."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

from photosite.engine.jit import THREADS

P = ParamSpec("P")
T = TypeVar("T")


def computed_beside(pool: Executor, function: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> Future[T]:
    """Compute something in a pool's threads, or at once if this process may use one thread.

    Workers that share a machine have a core each, so that two computations at a time would take that of another worker.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(1) as pool:
    ...     future = computed_beside(pool, max, 2, 5)
    >>> future.result()
    5
    """
    if THREADS > 1:
        return pool.submit(function, *arguments, **options)
    future: Future[T] = Future()
    try:
        future.set_result(function(*arguments, **options))
    except Exception as error:
        future.set_exception(error)
    return future
