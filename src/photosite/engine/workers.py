"""Tasks on processes of this machine, or on the workers of a Dask scheduler."""

from __future__ import annotations

import importlib
import logging
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
import warnings
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, chdir, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from multiprocessing import connection
from typing import Any, TypeVar
from uuid import uuid4

from photosite.engine.memory import how_it_ended
from photosite.engine.process import prepare_process
from photosite.engine.threads import cores, threads_for
from photosite.errors import InputError, PhotositeError, PhotositeWarning, WorkerError, message_of

Task = TypeVar("Task")
Result = TypeVar("Result")

MOST_DEATHS = 3
"""Workers that a task may end before it is given up; Dask's `distributed.scheduler.allowed-failures` is the same."""

_CONNECT_S, _END_S = 10.0, 5.0

THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit the threads of libraries."""

_environment = threading.Lock()


def run_tasks(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    processes: int | None = 1,
    scheduler: str | None = None,
    name: Callable[[Task], str] = str,
    ahead: int = 10_000,
) -> Generator[tuple[int, Result], None, None]:
    """Apply a function to tasks; yield the index and the result of each as it completes.

    The task of a worker that dies goes to another one. Closing the iterator, Ctrl-C and an error end local workers at
    once; on a scheduler, workers complete the task that they are at. Workers end when this process is killed.

    Parameters
    ----------
    function
        Function of a module, or an object that pickles. Each worker gets it once.
    tasks
        Arguments of the calls; short, because each passes the scheduler.
    processes
        Number of local processes; None: one for each core. 1 runs the tasks in this process. Each process has its
        fraction of the cores for threads, unless variables such as NUMBA_NUM_THREADS are set.
    scheduler
        Address of a Dask scheduler, such as "tcp://10.0.0.1:8786", on whose workers the tasks run instead, with one
        thread each, and in the working folder of this process where they have it.
    name
        Returns the name of a task in errors.
    ahead
        Tasks that a scheduler gets before their results are taken; fewer need less memory for large results.

    Raises
    ------
    InputError
        If `processes` is below 1, or there is no scheduler at the address.
    WorkerError
        If a task ended three workers, or the scheduler is lost.
    Exception
        What the function raises.

    Examples
    --------
    >>> list(run_tasks(abs, [-3, 2]))
    [(0, 3), (1, 2)]
    """
    if processes is not None and (isinstance(processes, bool) or not isinstance(processes, int) or processes < 1):
        raise InputError("processes", value=processes, expected="1 or more, or None for the number of cores")
    if scheduler is not None:
        return _on_scheduler(function, tasks, scheduler, name, ahead)
    count = min(cores() if processes is None else processes, len(tasks))
    return (
        ((index, function(task)) for index, task in enumerate(tasks))
        if count <= 1
        else _on_processes(function, tasks, count, name)
    )


def in_order(completed: Iterable[tuple[int, Result]]) -> Iterator[Result]:
    """Yield results in the order of the tasks.

    Examples
    --------
    >>> list(in_order([(1, "b"), (0, "a"), (2, "c")]))
    ['a', 'b', 'c']
    """
    early: dict[int, Result] = {}
    following = 0
    for index, result in completed:
        early[index] = result
        while following in early:
            yield early.pop(following)
            following += 1


# Local processes


class _Process:
    """A worker process, and the index of the task that it is at; it says "ready" before its first task."""

    def __init__(self, function: Callable[[Any], Any], threads: int) -> None:
        # Spawned, because the threads of compiled kernels do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.task: int | None = None
        self.ready = False
        self._process = context.Process(target=_serve, args=(other, function), daemon=True)
        with _threads_of_children(threads):
            self._process.start()
        other.close()

    def give(self, index: int, task: object) -> None:
        self.task = index
        with suppress(OSError):  # that it has died shows when its answer is read
            self.pipe.send(task)

    def stop(self, *, at_once: bool) -> None:
        """End the process, or let it end by itself when it is idle."""
        self.pipe.close()
        if at_once:
            self._process.kill()

    def joined(self) -> str:
        """Wait until the process has ended, by force after some seconds; return how it ended."""
        self._process.join(_END_S)
        code = self._process.exitcode
        self._process.kill()
        self._process.join()
        return "no answer" if code is None else how_it_ended(code)


def _on_processes(
    function: Callable[[Task], Result], tasks: Sequence[Task], count: int, name: Callable[[Task], str]
) -> Generator[tuple[int, Result], None, None]:
    threads = max(1, cores() // count)
    waiting = deque(range(len(tasks)))
    deaths: Counter[int | None] = Counter()
    pool: dict[Any, _Process] = {}

    def start() -> None:
        worker = _Process(function, threads)
        pool[worker.pipe] = worker

    def give(worker: _Process) -> None:
        worker.task = None
        if waiting:
            index = waiting.popleft()
            worker.give(index, tasks[index])

    complete = False
    try:
        for _ in range(count):
            start()
        left = len(tasks)
        while left:
            for pipe in connection.wait(list(pool)):
                worker = pool[pipe]
                try:
                    succeeded, answer = worker.pipe.recv()
                except (EOFError, OSError):
                    del pool[pipe]
                    _note_death(worker, deaths, lambda index: name(tasks[index]))
                    if worker.task is not None:
                        waiting.appendleft(worker.task)
                    start()
                    continue
                if not worker.ready:
                    worker.ready = True
                    give(worker)
                    continue
                if not succeeded:
                    raise _error_of(answer)
                index = worker.task
                assert index is not None
                give(worker)
                left -= 1
                yield index, answer
        complete = True
    finally:
        for worker in pool.values():
            worker.stop(at_once=not complete)
        for worker in pool.values():
            worker.joined()


def _note_death(worker: _Process, deaths: Counter[int | None], name: Callable[[int], str]) -> None:
    """Count a worker that died for its task, or for its start; raise an error if there were too many."""
    worker.stop(at_once=False)
    end = worker.joined()
    deaths[worker.task] += 1
    if deaths[worker.task] < MOST_DEATHS:
        return
    if worker.task is None:
        hint = "A script needs 'if __name__ == \"__main__\":' around what it does"
        raise WorkerError(f"{MOST_DEATHS} worker processes died before their first task ({end})", hint=hint)
    what = f"the task ended {MOST_DEATHS} worker processes ({end})"
    raise WorkerError(what, where=name(worker.task), hint=_HINT, arguments=_FEWER)


_HINT, _FEWER = "If memory is short, use fewer: {processes}", {"processes": 1}


def _error_of(answer: tuple[bytes, str]) -> Exception:
    """Return the exception that a worker sent, with the worker's traceback as a note."""
    pickled, trace = answer
    try:
        error = pickle.loads(pickled)
    except Exception:
        return RuntimeError(trace)
    if not isinstance(error, PhotositeError):
        error.add_note(f"In a worker process:\n{trace}")
    return error if isinstance(error, Exception) else RuntimeError(trace)


@contextmanager
def _threads_of_children(threads: int) -> Iterator[None]:
    """Limit the threads of processes that start in a `with` block: libraries read these variables when they load."""
    with _environment:
        missing = [variable for variable in THREAD_VARIABLES if variable not in os.environ]
        os.environ.update(dict.fromkeys(missing, str(threads)))
        try:
            yield
        finally:
            for variable in missing:
                del os.environ[variable]


def _serve(pipe: connection.Connection, function: Callable[[Any], Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all processes; the parent ends this one
    prepare_process()
    end_with_parent()
    with suppress(EOFError, OSError):  # the parent has closed the pipe
        pipe.send((True, None))
        while True:
            pipe.send_bytes(_answer(function, pipe.recv()))


def _answer(function: Callable[[Any], Any], task: object) -> bytes:
    try:
        return pickle.dumps((True, function(task)))
    except Exception as error:
        trace = traceback.format_exc()
        try:
            pickled = pickle.dumps(error)
        except Exception:
            pickled = b""
        return pickle.dumps((False, (pickled, trace)))


def end_with_parent() -> None:
    """End this process, from now on, when its parent was killed, which cannot tell it so."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


# Dask


def _on_scheduler(
    function: Callable[[Task], Result], tasks: Sequence[Task], scheduler: str, name: Callable[[Task], str], ahead: int
) -> Generator[tuple[int, Result], None, None]:
    dask = _distributed()
    with ExitStack() as stack:
        # Errors reach the caller as exceptions; what Dask logs about a lost connection repeats them.
        stack.enter_context(importlib.import_module("distributed.utils").silence_logging_cmgr(logging.CRITICAL))
        check_scheduler(scheduler)
        try:
            client = dask.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
        except OSError as error:
            raise _no_scheduler(scheduler, error) from None
        stack.callback(client.close)  # cancels what is left
        if not client.scheduler_info()["workers"]:
            hint = f"Start some: photosite worker {scheduler}"
            warnings.warn(PhotositeWarning("the scheduler has no workers", hint=hint), stacklevel=3)
        run, folder = uuid4().hex[:12], os.getcwd()
        # A separate task, so that its result is computed again when the workers that hold it die.
        kept = client.submit(_same, function, key=f"photosite-function-{run}", pure=False)
        left = iter(range(len(tasks)))
        places: dict[str, int] = {}

        def submit(index: int) -> Any:
            key = f"photosite-task-{run}-{index}"
            places[key] = index
            return client.submit(_applied, kept, tasks[index], folder, key=key, pure=False)

        first = [submit(index) for _, index in zip(range(ahead), left, strict=False)]
        completed = dask.as_completed(first, loop=client.loop, with_results=True, raise_errors=False)
        del first  # the scheduler forgets a task when its future is deleted
        for future, result in completed:
            index = places.pop(future.key)
            if not isinstance(result, _Done):
                failure = result[1] if isinstance(result, tuple) else result
                if isinstance(failure, dask.KilledWorker):
                    # A task that waited at the same workers counts as well for Dask.
                    beside = (
                        place
                        for key, place in places.items()
                        if isinstance(client.futures[key].exception, dask.KilledWorker)
                    )
                    raise _ended_workers(failure, [name(tasks[place]) for place in sorted([index, *beside])])
                if isinstance(failure, Exception) and not isinstance(failure, CancelledError):
                    raise failure
                raise _lost(scheduler)
            if (following := next(left, None)) is not None:
                if client.status == "closed":  # while the caller was at work
                    raise _lost(scheduler)
                completed.add(submit(following))
            yield index, result.result


def _distributed() -> Any:
    """Return the package distributed."""
    try:
        return importlib.import_module("distributed")
    except ImportError:
        hint = "Run pip install '.[distributed]' in the clone"
        raise InputError("a scheduler needs the package distributed", hint=hint) from None


def check_scheduler(address: str) -> None:
    """Raise `InputError` if no scheduler answers at an address; a Dask client hangs there for half a minute."""
    import asyncio  # takes 0.05 s to import, only for Dask

    _distributed()
    with ThreadPoolExecutor(1) as pool:  # a thread without an event loop, which that of a notebook has
        try:
            kind = pool.submit(asyncio.run, _kind_of_server(address)).result()
        except (TimeoutError, MemoryError):  # what another protocol sends can be taken for the length of a message
            raise _no_scheduler(address, ValueError("No Dask scheduler answers there")) from None
        except Exception as error:  # the packages of each protocol have their own
            raise _no_scheduler(address, error) from None
    if kind != "Scheduler":
        raise _no_scheduler(address, ValueError(f"A Dask {kind} answers there"))


async def _kind_of_server(address: str) -> str:
    import asyncio

    connect: Any = importlib.import_module("distributed.comm").connect
    security = importlib.import_module("distributed.security").Security()  # of Dask's configuration
    async with asyncio.timeout(_CONNECT_S + 1.0):  # for the answer; the connection has its own limit and message
        connection = await connect(address, timeout=_CONNECT_S, **security.get_connection_args("client"))
        try:
            await connection.write({"op": "identity", "reply": True})
            return str((await connection.read())["type"])
        finally:
            connection.abort()


def _no_scheduler(address: str, error: Exception) -> InputError:
    expected = "the address of a Dask scheduler that runs, such as tcp://10.0.0.1:8786"
    return InputError("scheduler", value=address, expected=expected, hint=message_of(error))


def _lost(address: str) -> WorkerError:
    return WorkerError(
        "the scheduler was lost, or lost a task", where=address, hint="Start the scheduler, and run this again"
    )


def _ended_workers(failure: Any, names: Sequence[str]) -> WorkerError:
    workers = f"{failure.allowed_failures + 1} workers ({failure.last_worker.address})"
    what = f"the task ended {workers}" if len(names) == 1 else f"one of these tasks ended {workers}"
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return WorkerError(what, where=", ".join(names[:_NAMED]) + more, hint="Their logs may have the reason")


_NAMED = 5


def _same(function: Result) -> Result:
    return function


@dataclass(frozen=True)
class _Done:
    """A result, which for Dask could otherwise be a description of an error."""

    result: Any


def _applied(function: Callable[[Any], Any], task: object, folder: str) -> _Done:
    with threads_for(1), chdir(folder) if os.path.isdir(folder) else nullcontext():
        return _Done(function(task))
