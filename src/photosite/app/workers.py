"""Worker processes: calls with limits on time and memory, and jobs that wait in a queue and can be cancelled.

Pictures and jobs have processes of their own, so that a long job delays no picture. Job processes run at a lower
priority. A process that dies, hangs or is cancelled is replaced. A new process first imports and compiles what its
calls need; until then jobs wait in the queue, and cancelling one leaves the process alone.
"""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import secrets
import signal
import threading
import time
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Literal

from photosite.engine.workers import end_with_parent
from photosite.errors import PhotositeError, message_of

Progress = Callable[[int, int, str], object]
Status = Literal["queued", "running", "done", "failed", "cancelled"]

_SPAWN = multiprocessing.get_context("spawn")
_GRACE_S = 1.5
"""Time in which a cancelled call can stop by itself, at its next report of progress. A new process needs several times
as long before it computes."""
_PREPARE_S = 1800.0
"""Time in which a new process must be prepared. A busy machine compiles for minutes; a process that is ended compiles
again."""
_JOB_NICENESS = 5
"""A job gets a third of the time of a picture that is computed meanwhile; at 10, it stands still on a busy machine."""
_POLL_S = 0.05
_MOST_KEPT = 64


def steps(progress: Progress | None) -> Callable[[str], None]:
    """Return a function that reports each part of a computation of unknown length by its name."""
    done = itertools.count(1)

    def report(what: str) -> None:
        if progress is not None:
            progress(number := next(done), number + 1, what)

    return report


class WorkerError(Exception):
    """A call did not return: its process died, or it took too long."""


class BusyError(Exception):
    """Too many calls wait already."""


class CancelledError(Exception):
    """The call was cancelled."""


class Worker:
    """A process that runs one call at a time.

    Parameters
    ----------
    niceness
        Added to the priority value of the process; 0 keeps it.
    memory_bytes
        Limit of its address space; 0 is no limit. Not enforced on Windows.
    prepare
        A function of a module without arguments that a new process runs before its first call. Its errors are ignored.
    """

    def __init__(self, niceness: int = 0, memory_bytes: int = 0, prepare: Callable[[], object] | None = None) -> None:
        self._settings = niceness, memory_bytes, prepare
        self._lock = threading.Lock()
        self._closed = False
        self._start()

    def _start(self) -> None:
        self._cancelled = _SPAWN.Event()
        self._connection, theirs = _SPAWN.Pipe()
        self._prepared, self._started = False, time.monotonic()
        arguments = (theirs, self._cancelled, *self._settings)
        self.process = _SPAWN.Process(target=_serve, args=arguments, daemon=True, name="photosite worker")
        self.process.start()
        theirs.close()

    def call(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        time_s: float,
        progress: Progress | None = None,
        cancelled: threading.Event | None = None,
    ) -> Any:
        """Call a function in the process and return its result.

        Parameters
        ----------
        function
            A function of a module. With `progress` it gets the keyword argument `progress`, a function too.
        *arguments
            They and the result must be picklable.
        time_s
            Time limit in seconds, after which the process is ended. It begins once the process is prepared.
        progress
            Called in this process with what the function reports.
        cancelled
            Ends the call when it is set.

        Raises
        ------
        PhotositeError
            If the function raised it.
        WorkerError
            If the process died or took too long, or the function raised another exception.
        CancelledError
            If `cancelled` was set.
        """
        with self._lock:
            if self._closed:
                raise WorkerError("the server stops")
            if not self.process.is_alive():
                self._replace()
            try:
                return self._answer(function, arguments, time_s, progress, cancelled)
            except (EOFError, OSError) as error:
                self._replace()
                text = "its process ended (out of memory, or stopped from outside); a new one was started"
                raise WorkerError(f"the computation failed: {text}") from error

    def _answer(
        self,
        function: Callable[..., Any],
        arguments: tuple[Any, ...],
        time_s: float,
        progress: Progress | None,
        cancelled: threading.Event | None,
    ) -> Any:
        while not self._is_prepared():
            if cancelled is not None and cancelled.is_set():
                raise CancelledError
            if time.monotonic() - self._started > _PREPARE_S:
                self._replace()
                raise WorkerError(f"the process did not start within {_PREPARE_S:g} s")
        deadline, stop_at = time.monotonic() + time_s, float("inf")
        self._cancelled.clear()
        self._connection.send((function, arguments, progress is not None))
        while True:
            if self._connection.poll(_POLL_S):
                kind, content = self._connection.recv()
                if kind == "progress":
                    if progress is not None:
                        progress(*content)
                    continue
                if kind == "cancelled":
                    raise CancelledError
                if kind == "done":
                    return content
                raise content if isinstance(content, PhotositeError) else WorkerError(str(content))
            now = time.monotonic()
            if cancelled is not None and cancelled.is_set() and stop_at == float("inf"):
                self._cancelled.set()
                stop_at = now + _GRACE_S
            if now > stop_at:
                self._replace()
                raise CancelledError
            if now > deadline:
                self._replace()
                raise WorkerError(f"the computation took longer than {time_s:g} s and was ended")

    def wait_until_prepared(self) -> None:
        """Wait until the process can compute, at most as long as it lives."""
        with self._lock, contextlib.suppress(EOFError, OSError):
            while not self._closed and self.process.is_alive() and not self._is_prepared():
                pass

    def _is_prepared(self) -> bool:
        """Wait up to `_POLL_S` for the process to be prepared."""
        if not self._prepared and self._connection.poll(_POLL_S):
            self._connection.recv()
            self._prepared = True
        return self._prepared

    def _replace(self) -> None:
        self._end()
        self._start()

    def _end(self) -> None:
        self.process.kill()
        self.process.join(5.0)
        with contextlib.suppress(OSError):
            self._connection.close()

    def close(self) -> None:
        """End the process."""
        self._closed = True
        self._end()


def _serve(
    requests: Connection, cancelled: Any, niceness: int, memory_bytes: int, prepare: Callable[[], object] | None
) -> None:
    """Run calls until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy is imported; its products here are small
    if niceness and hasattr(os, "nice"):
        os.nice(niceness)
    _limit_memory(memory_bytes)
    with contextlib.suppress(Exception):  # the first call raises the error again
        if prepare is not None:
            prepare()
    requests.send("prepared")

    def report(done: int, total: int, what: str = "") -> None:
        if cancelled.is_set():
            raise CancelledError
        requests.send(("progress", (done, total, what)))

    while True:
        try:
            function, arguments, with_progress = requests.recv()
        except (EOFError, OSError):
            return
        try:
            extra = {"progress": report} if with_progress else {}
            answer: tuple[str, Any] = ("done", function(*arguments, **extra))
        except CancelledError:
            answer = ("cancelled", None)
        except PhotositeError as error:
            answer = ("error", error)
        except MemoryError:
            answer = ("error", "the computation needs more memory than the server allows")
        except OSError as error:
            answer = ("error", f"{message_of(error)}: {error.filename or ''}".removesuffix(": "))
        except Exception as error:
            answer = ("error", f"{type(error).__name__}: {message_of(error)}")
        requests.send(answer)


def _limit_memory(size: int) -> None:
    if not size:
        return
    try:
        import resource
    except ImportError:  # Windows
        return
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (size if hard == resource.RLIM_INFINITY else min(size, hard), hard))


class Pool:
    """Some workers for short calls.

    The calls of one tab go to the same worker, which keeps its scene, unless that one is busy and another is not.

    Parameters
    ----------
    count, memory_bytes
        Number of workers, and the limit of each one's memory.
    prepare
        As for `Worker`.
    most_waiting
        Calls that wait for one worker; more raise `BusyError`.
    """

    def __init__(
        self,
        count: int,
        memory_bytes: int = 0,
        prepare: Callable[[], object] | None = None,
        most_waiting: int = 16,
    ) -> None:
        self.workers = [Worker(0, memory_bytes, prepare) for _ in range(count)]
        self._waiting = [0] * count
        self._most_waiting = most_waiting
        self._lock = threading.Lock()
        self._of_tab: dict[str, int] = {}

    def call(self, tab: str, function: Callable[..., Any], *arguments: Any, time_s: float) -> Any:
        """Call a function in the worker of a tab; as `Worker.call`."""
        with self._lock:
            if len(self._of_tab) > 1000:
                self._of_tab.clear()
            number = self._of_tab.setdefault(tab, len(self._of_tab) % len(self.workers))
            if self._waiting[number] and 0 in self._waiting:
                number = self._waiting.index(0)
            if self._waiting[number] >= self._most_waiting:
                raise BusyError("too many pictures wait to be computed")
            self._waiting[number] += 1
        try:
            return self.workers[number].call(function, *arguments, time_s=time_s)
        finally:
            with self._lock:
                self._waiting[number] -= 1

    def close(self) -> None:
        """End the processes."""
        for worker in self.workers:
            worker.close()


class Job:
    """A call in the queue, and what became of it."""

    def __init__(self, kind: str, tab: str, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.id, self.kind, self.tab = secrets.token_hex(8), kind, tab
        self.function, self.arguments = function, arguments
        self.status: Status = "queued"
        self.progress: tuple[int, int, str] = (0, 0, "")
        self.result: Any = None
        self.error = ""
        self.cancelled = threading.Event()
        self.started = 0.0
        self._ended: float | None = None

    @property
    def seconds(self) -> float:
        """Time that the call has taken so far, or took."""
        return 0.0 if not self.started else (self._ended or time.monotonic()) - self.started

    def end(self, status: Status) -> None:
        """Record how the call ended."""
        self._ended, self.status = time.monotonic(), status


class Queue:
    """Jobs, run one after the other by each of some workers.

    Parameters
    ----------
    count
        Number of workers.
    time_s, memory_bytes
        Limits of a job.
    prepare
        As for `Worker`. Jobs wait for a prepared worker.
    most_waiting
        Jobs that wait; more raise `BusyError`.
    finished
        Called after each job.
    """

    def __init__(
        self,
        count: int = 1,
        *,
        time_s: float = 1800.0,
        memory_bytes: int = 0,
        prepare: Callable[[], object] | None = None,
        most_waiting: int = 16,
        finished: Callable[[], object] = lambda: None,
    ) -> None:
        self._time_s, self._most_waiting, self._finished = time_s, most_waiting, finished
        self._jobs: dict[str, Job] = {}
        self._waiting: deque[Job] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self.workers = [Worker(_JOB_NICENESS, memory_bytes, prepare) for _ in range(count)]
        self._threads = [threading.Thread(target=self._run, args=(worker,), daemon=True) for worker in self.workers]
        for thread in self._threads:
            thread.start()

    def add(self, kind: str, tab: str, function: Callable[..., Any], *arguments: Any, replaces: bool = False) -> Job:
        """Add a job; with `replaces`, cancel the tab's other jobs of this kind."""
        job = Job(kind, tab, function, arguments)
        with self._changed:
            if replaces:
                for other in self._jobs.values():
                    if (other.kind, other.tab) == (kind, tab) and other.status in ("queued", "running"):
                        self._cancel(other)
            if len(self._waiting) >= self._most_waiting:
                raise BusyError("too many jobs wait already")
            self._jobs[job.id] = job
            old = [found for found in self._jobs.values() if found.status not in ("queued", "running")]
            for found in old[: max(len(old) - _MOST_KEPT, 0)]:
                del self._jobs[found.id]
            self._waiting.append(job)
            self._changed.notify()
        return job

    def get(self, job_id: str) -> Job | None:
        """Return a job by its id."""
        with self._changed:
            return self._jobs.get(job_id)

    def cancel(self, job: Job) -> None:
        """Cancel a job; a running one is stopped within `_GRACE_S`."""
        with self._changed:
            self._cancel(job)

    def _cancel(self, job: Job) -> None:
        job.cancelled.set()
        if job.status == "queued":
            job.status = "cancelled"
            with contextlib.suppress(ValueError):
                self._waiting.remove(job)

    def _run(self, worker: Worker) -> None:
        while True:
            worker.wait_until_prepared()  # another one can take the job meanwhile
            with self._changed:
                while not self._waiting and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return
                job = self._waiting.popleft()
                job.status = "running"
            self._compute(job, worker)
            with contextlib.suppress(OSError):
                self._finished()

    def _compute(self, job: Job, worker: Worker) -> None:
        def progress(done: int, total: int, what: str) -> None:
            job.progress = done, total, what

        job.started = time.monotonic()
        try:
            job.result = worker.call(
                job.function, *job.arguments, time_s=self._time_s, progress=progress, cancelled=job.cancelled
            )
            status: Status = "done"
        except CancelledError:
            status = "cancelled"
        except (PhotositeError, WorkerError) as error:
            job.error, status = str(error), "failed"
        except Exception as error:
            job.error, status = message_of(error), "failed"
        job.end(status)

    def close(self) -> None:
        """End the processes; running jobs fail."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for worker in self.workers:
            worker.close()
