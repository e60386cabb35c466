"""Threads of this process: how many it may use, loops of compiled functions and computations on several of them."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from functools import lru_cache
from itertools import pairwise
from typing import Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

ITEMS_PER_THREAD = 100_000
"""Pixels that take a thread about a millisecond."""

VARIABLE = "NUMBA_NUM_THREADS"
"""Environment variable with the number of threads, in place of the number of cores."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_most: ContextVar[int | None] = ContextVar("_most", default=None)
"""Most threads in a `with threads_for(...)` block."""


def thread_count() -> int:
    """Return how many threads to use: those of this process, or fewer in a `with threads_for(...)` block."""
    available = _available()
    return min(_most.get() or available, available)


def _available() -> int:
    """Return how many threads this process may use: its cores, or the variable NUMBA_NUM_THREADS.

    A worker of a `torch.utils.data.DataLoader` has its part of the cores, and any other process that `multiprocessing`
    started (those of Dask's workers and of process pools, too) has one, because others of its kind run beside it.
    """
    stated = os.environ.get(VARIABLE, "")
    if stated.isdecimal() and int(stated) > 0:
        return int(stated)
    data = sys.modules.get("torch.utils.data")
    if data is not None and (worker := data.get_worker_info()) is not None:
        return max(1, cores() // int(worker.num_workers))
    return 1 if multiprocessing.parent_process() is not None else cores()


_NO_LIMIT = nullcontext()


def threads_for(items: int) -> AbstractContextManager[None]:
    """Limit the threads of `parallel_for` in a `with` block to what a number of items can keep busy.

    Handing work to a thread takes longer than a small frame, and much longer if other processes use the cores.
    """
    threads = max(1, items // ITEMS_PER_THREAD)
    return _NO_LIMIT if threads >= thread_count() else _at_most(threads)


@contextmanager
def _at_most(threads: int) -> Iterator[None]:
    before = _most.set(threads)
    try:
        yield
    finally:
        _most.reset(before)


def parallel_for(
    kernel: Callable[Concatenate[int, int, P], None], count: int, *arguments: P.args, **options: P.kwargs
) -> None:
    """Call a compiled function for parts of `range(count)`, on the threads of this process.

    The parts are `kernel(first, last, ...)`, of about equal size, one for each thread. The function releases the
    interpreter's lock, and its iterations do not depend on each other.

    Examples
    --------
    >>> found = []
    >>> with threads_for(1):
    ...     parallel_for(lambda first, last, out: out.append((first, last)), 10, found)
    >>> found
    [(0, 10)]
    """
    threads = min(thread_count(), count)
    if threads <= 1:
        kernel(0, count, *arguments, **options)
        return
    ends = [part * count // threads for part in range(threads + 1)]
    others = [_pool().submit(kernel, first, last, *arguments, **options) for first, last in pairwise(ends[1:])]
    try:
        kernel(0, ends[1], *arguments, **options)
    finally:  # they write into the same arrays
        wait(others)
    for other in others:
        other.result()


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_available(), "photosite")


def _forget() -> None:
    """Forget the threads of the process that this one was forked from, which do not exist here."""
    _pool.cache_clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


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
    if thread_count() > 1:
        return pool.submit(function, *arguments, **options)
    future: Future[T] = Future()
    try:
        future.set_result(function(*arguments, **options))
    except Exception as error:
        future.set_exception(error)
    return future
