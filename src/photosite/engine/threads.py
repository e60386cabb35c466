"""Threads of this process: how many it may use, loops of compiled functions and computations on several of them."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from functools import lru_cache
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Concatenate, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

ITEMS_PER_THREAD = 100_000
"""Pixels that take a thread about a millisecond."""

COPIES_PER_THREAD = 2_000_000
"""Pixels that a thread copies or compares in 0.15 to 0.3 ms."""

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


def threads_for(items: int, per_thread: int = ITEMS_PER_THREAD) -> AbstractContextManager[None]:
    """Limit the threads of `parallel_for` in a `with` block to what a number of items can keep busy.

    Handing work to a thread takes longer than a small frame, and much longer if other processes use the cores.
    """
    threads = max(1, items // per_thread)
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

    The parts are `kernel(first, last, ...)`, the first ones larger than the last ones. The function releases the
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
    left = iter(_parts(count, threads))  # each part goes to the thread that is free: one that starts late takes fewer

    def run() -> None:
        for first, last in left:
            kernel(first, last, *arguments, **options)

    tasks, others = _tasks(_available()), [_Part(run) for _ in range(threads - 1)]
    for other in others:
        tasks.put(other)
    try:
        run()
    finally:  # they write into the same arrays
        errors = [other.wait() for other in others]
    for error in errors:
        if error is not None:
            raise error


@lru_cache
def _parts(count: int, threads: int) -> list[tuple[int, int]]:
    """Return the parts of a loop: large ones first, which cost fewer calls, and small ones that end at the same time.

    A part is three quarters of a thread's part of what is left, and at least a 16th of that of the whole loop.
    """
    parts, first = [], 0
    while first < count:
        last = min(first + max(3 * (count - first) // (4 * threads), count // (16 * threads), 1), count)
        parts.append((first, last))
        first = last
    return parts


class _Part:
    """What another thread does of a loop; a future of `concurrent.futures` takes several times as long."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call = call
        self._error: BaseException | None = None
        self._running = Lock()
        self._running.acquire()

    def run(self) -> None:
        try:
            self._call()
        except BaseException as error:
            self._error = error
        finally:
            self._running.release()

    def wait(self) -> BaseException | None:
        """Wait for the end; return the error."""
        self._running.acquire()
        return self._error


@lru_cache(maxsize=1)
def _tasks(threads: int) -> SimpleQueue[_Part]:
    """Start threads, and return the queue that they take parts from."""
    tasks: SimpleQueue[_Part] = SimpleQueue()
    for _ in range(threads):
        Thread(target=_run_parts, args=(tasks,), name="photosite", daemon=True).start()
    return tasks


def _run_parts(tasks: SimpleQueue[_Part]) -> None:
    while True:
        part = tasks.get()
        part.run()
        del part  # and the arrays with it


def _forget() -> None:
    """Forget the threads of the process that this one was forked from, which do not exist here."""
    _tasks.cache_clear()


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
