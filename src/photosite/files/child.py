"""A child process that reads untrusted files, with limits on time and memory.

Some C libraries crash, hang or allocate gigabytes on damaged files. Here that is an error in the parent. The child is
started by the first call (about 0.5 s) and serves later ones (about 0.15 ms each), so that thousands of files need one
child. It is replaced when it dies, and it ends with its parent.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any, BinaryIO

from photosite.errors import PhotositeError, message_of

_START_S = 120.0
"""Time limit for starting the child and importing a module, on a busy machine."""
_END_S = 5.0
"""Time in which a child that has closed its streams ends."""
_LEFT_ALONE_S = 5.0
"""Time after a call's limit at which the child ends by itself."""

_SIGKILL = 9
"""`signal.SIGKILL`, which Windows lacks."""

KILLED = "the reader was killed by the system, usually for lack of memory"
"""How a child ended that received SIGKILL within its time."""


class ChildError(Exception):
    """The call did not return: the child crashed, ran out of time or memory, or raised an exception."""


def call_in_child(
    function: Callable[..., Any], *arguments: Any, time_s: float, memory_bytes: int, processor_s: float = 0.0
) -> Any:
    """Call a function in the child process and return its result.

    Parameters
    ----------
    function
        A function of a module. The child imports that module, so keep the module's imports few.
    *arguments
        Arguments and result must be picklable.
    time_s
        Time limit of the call, in seconds; starting the child is not included.
    memory_bytes
        Limit of the child's address space. Not enforced on Windows.
    processor_s
        Limit of the child's processor time for the call, which a busy machine does not use up; 0 for none. Not enforced
        on Windows.

    Raises
    ------
    PhotositeError
        If the function raised it.
    ChildError
        If the call failed in any other way.

    Examples
    --------
    >>> import math
    >>> call_in_child(math.hypot, 3, 4, time_s=10, memory_bytes=1 << 30)
    5.0
    """
    global _child
    with _lock:
        if _child is None or _child.process.poll() is not None:
            _child = _Child()
        try:
            if function.__module__ not in _child.modules:
                _child.call((importlib.import_module, (function.__module__,), 0, os.getcwd(), 0.0), _START_S)
                _child.modules.add(function.__module__)
            failed, result = _child.call((function, arguments, memory_bytes, os.getcwd(), processor_s), time_s)
        except ChildError:
            _child.end()
            _child = None
            raise
    if not failed:
        return result
    raise result if isinstance(result, PhotositeError) else ChildError(result)


class _Child:
    def __init__(self) -> None:
        self.modules: set[str] = set()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "photosite.files.child"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )

    def call(
        self, request: tuple[Callable[..., Any], tuple[Any, ...], int, str, float], time_s: float
    ) -> tuple[bool, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        timer = threading.Timer(time_s, self.process.kill)
        timer.start()
        try:
            pickle.dump((*request, time_s), self.process.stdin)
            self.process.stdin.flush()
            answer: tuple[bool, Any] = pickle.load(self.process.stdout)
            return answer
        except (EOFError, OSError, pickle.UnpicklingError):
            if not timer.is_alive():
                raise ChildError(f"reading took longer than {time_s:g} s") from None
            ended = self._ended_by()
            if ended == getattr(signal, "SIGPROF", None):
                raise ChildError(f"reading took longer than {request[-1]:g} s of the processor's time") from None
            raise ChildError(KILLED if ended == _SIGKILL else "the reader crashed") from None
        finally:
            timer.cancel()

    def _ended_by(self) -> int:
        """Return the signal that ended the process, which has closed its streams; 0 for none."""
        try:
            return max(-self.process.wait(_END_S), 0)
        except subprocess.TimeoutExpired:
            return 0

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):
                stream.close()  # type: ignore[union-attr]


_lock = threading.Lock()
_child: _Child | None = None


def _end() -> None:
    if _child is not None:
        _child.end()


def _forget() -> None:
    """Leave the child to the process that was forked from."""
    global _child, _lock
    _child, _lock = None, threading.Lock()


atexit.register(_end)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _limit_memory(size: int) -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = size or hard
    resource.setrlimit(resource.RLIMIT_AS, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _serve(requests: BinaryIO, answers: BinaryIO) -> None:
    while True:
        try:
            function, arguments, memory_bytes, folder, processor_s, time_s = pickle.load(requests)
        except EOFError:
            return
        _limit_memory(memory_bytes)
        if hasattr(signal, "alarm"):  # a parent that was killed cannot end this process while a library hangs
            signal.alarm(math.ceil(time_s + _LEFT_ALONE_S))
            signal.setitimer(signal.ITIMER_PROF, processor_s)
        try:
            os.chdir(folder)  # arguments may be relative paths, and the parent may have moved
            result = function(*arguments)
            answer = pickle.dumps((False, None if function is importlib.import_module else result))
        except PhotositeError as error:
            answer = pickle.dumps((True, error))
        except Exception as error:
            answer = pickle.dumps((True, message_of(error)))
        if hasattr(signal, "alarm"):
            signal.alarm(0)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        answers.write(answer)
        answers.flush()


if __name__ == "__main__":
    _requests, _answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not mix with the answers
    _serve(_requests, _answers)
