"""Commands that write, run while the system fails them: at each of their operations on files, killed, and in races.

Each run is a forked process in a folder that `shim.c` watches. Before it, the folder holds the outputs of another run
of the command ("old"); a run without faults gives the outputs that are expected ("new").
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path

from photosite.cli.main import run
from photosite.files import writing
from photosite.files.writing import is_temporary

COUNT, FAIL_ONCE, FAIL_FROM, KILL, FULL, NO_MEMORY = range(6)
"""Actions of the shim."""

LONGEST_S = 120.0
"""Time after which a run counts as hanging."""

Contents = dict[str, bytes]
"""Files by their names below a folder."""


def build_shim(folder: Path) -> Path:
    """Compile the library to preload and return its path."""
    library = folder / "shim.so"
    source = Path(__file__).with_name("shim.c")
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


def shim_environment(library: Path) -> dict[str, str]:
    """Return the environment of a process that runs cases."""
    threads = dict.fromkeys(("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return os.environ | threads | {"LD_PRELOAD": str(library), "SOURCE_DATE_EPOCH": "1700000000"}


def arm(folder: Path, action: int, at: int = 0, number: int = 0, log: str = "") -> None:
    """Let the shim act on operations below a folder, from now on."""
    ctypes.CDLL(None).shim_arm(str(folder).encode(), action, ctypes.c_long(at), number, log.encode())


def count() -> int:
    """Return the number of operations since `arm`."""
    function = ctypes.CDLL(None).shim_count
    function.restype = ctypes.c_long
    return int(function())


@dataclass
class Case:
    """A command that writes below the current folder."""

    name: str
    arguments: str
    """With {value}, which makes the outputs of the old and the new run differ."""
    values: tuple[str, str] = ("", "")
    overwrites: bool = True
    """Whether the old outputs are there when the new run begins; else the folder is empty."""
    pairs: tuple[tuple[str, str], ...] = ()
    """Names of two files that must be of the same run; the second may have the suffix .new."""
    folder: str = ""
    """Folder that appears as a whole."""
    checkpoint: str = ""
    """Folder from which an interrupted run goes on, and which it removes at its end."""
    within: Callable[[], AbstractContextManager[None]] = contextlib.nullcontext
    """Context of each run, which makes the command short or its outputs the same each time."""
    old: Contents = field(default_factory=dict)
    new: Contents = field(default_factory=dict)
    operations: int = 0
    allocations: int = 0

    def command(self, which: int) -> list[str]:
        """Return the arguments of the old (0) or new (1) run."""
        return self.arguments.format(value=self.values[which]).split()


@dataclass
class Ended:
    """How a run ended: exit status, or the negative number of a signal; None if it hung."""

    status: int | None
    err: str
    operations: int


def contents(folder: Path) -> Contents:
    """Return all files below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def is_left_over(case: Case, name: str) -> bool:
    """Return whether a file is one that the next run uses or removes: temporary, a lock's, or of the checkpoint."""
    path = Path(name)
    known = path.name.endswith((".lock", "-journal", ".h5.new")) or path.parts[0] == case.checkpoint
    return known or any(is_temporary(part) for part in path.parts)


def fill(folder: Path, content: Contents) -> None:
    """Make a folder hold these files and nothing else."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, data in content.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)


class Run:
    """The old (0) or new (1) run of a case in a forked process, in a folder."""

    def __init__(
        self, folder: Path, case: Case, which: int = 1, action: int = COUNT, at: int = 0, number: int = 0, log: str = ""
    ) -> None:
        Run._made += 1
        self._err, self._note = (folder.with_name(f"{folder.name}.{Run._made}.{kind}") for kind in ("err", "count"))
        self.process = os.fork()
        if self.process == 0:
            self._run(folder, case, which, action, at, number, log)

    _made = 0

    def _run(self, folder: Path, case: Case, which: int, action: int, at: int, number: int, log: str) -> None:
        status = 1
        try:
            os.chdir(folder)
            writing._looked_at.clear()  # as in a process of its own
            with self._err.open("w", buffering=1) as stream, contextlib.redirect_stderr(stream):
                os.dup2(stream.fileno(), 2)
                for kind in (signal.SIGTERM, signal.SIGHUP):  # as `photosite.cli.main.main`
                    signal.signal(kind, lambda number, _: sys.exit(128 + number))
                try:
                    with contextlib.redirect_stdout(io.StringIO()), case.within():
                        arm(folder, action, at, number, log)
                        status = run(case.command(which))
                except SystemExit as stop:
                    status = int(stop.code or 0)
                except BaseException:
                    traceback.print_exc()
            self._note.write_text(str(count()))
        finally:
            os._exit(status)

    def wait(self) -> Ended:
        """Wait for the end."""
        deadline = time.monotonic() + LONGEST_S
        while True:
            done, code = os.waitpid(self.process, os.WNOHANG)
            if done:
                break
            if time.monotonic() > deadline:
                os.kill(self.process, signal.SIGKILL)
                os.waitpid(self.process, 0)
                return Ended(None, "", 0)
            time.sleep(0.002)
        operations = int(self._note.read_text()) if self._note.exists() else 0
        err = self._err.read_text(errors="replace") if self._err.exists() else ""
        for path in (self._err, self._note):
            path.unlink(missing_ok=True)
        return Ended(os.waitstatus_to_exitcode(code), err, operations)


def _warm(case: Case, folder: Path) -> None:
    """Run a case in this process, so that forked ones have its modules and kernels."""
    fill(folder, {})
    silent = io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(silent),
        contextlib.redirect_stderr(silent),
        case.within(),
    ):
        run(case.command(0))


def prepare(case: Case, folder: Path) -> list[str]:
    """Run a case without faults, twice; return what is wrong with it already."""
    _warm(case, folder)
    for which in (0, 1, 1):
        fill(folder, {})
        ended = Run(folder, case, which).wait()
        if ended.status != 0:
            return [f"{case.name}: exit status {ended.status} without a fault: {ended.err}"]
        found = contents(folder)
        if which == 1 and case.new and found != case.new:
            names = [name for name in found.keys() | case.new if found.get(name) != case.new.get(name)]
            return [f"{case.name}: two runs differ in {names}"]
        case.old, case.new = (found, {}) if which == 0 else (case.old, found)
    if not case.overwrites:
        case.old = {}
    fill(folder, case.old)
    case.operations = Run(folder, case, log=f"{folder}.log").wait().operations
    if contents(folder) != case.new:
        return [f"{case.name}: a run over older outputs gives others"]
    fill(folder, case.old)
    case.allocations = Run(folder, case, action=NO_MEMORY, at=-1).wait().operations
    return []


def state(case: Case, found: Contents) -> list[str]:
    """Return what is wrong with the outputs after a fault: neither old nor new, or of different runs."""
    wrong = []
    for name in sorted({*case.old, *case.new, *found}):
        if name not in case.old.keys() | case.new:
            if not is_left_over(case, name):
                wrong.append(f"{name} is left")
        elif found.get(name) not in (case.old.get(name), case.new.get(name)):
            wrong.append(f"{name} is neither old nor new")
    inside = [name for name in case.new if case.folder and name.startswith(f"{case.folder}/")]
    if 0 < sum(name in found for name in inside) < len(inside):
        wrong.append(f"{case.folder} is not whole")
    for first, second in case.pairs:
        kinds = (case.old, case.new)
        of_first = {number for number, kind in enumerate(kinds) if found.get(first) == kind.get(first)}
        of_second = {
            number
            for number, kind in enumerate(kinds)
            for name in (second, f"{second}.new")
            if found.get(name) == kind.get(second)
        }
        if not of_first & of_second:
            wrong.append(f"{first} and {second} do not belong together")
    return wrong


def findings(case: Case, folder: Path, ended: Ended, *, killed: bool = False, again: bool = True) -> list[str]:
    """Return what is wrong after a run with a fault, and after the run that follows it."""
    found = contents(folder)
    wrong = state(case, found)
    if killed:
        if ended.status not in (0, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGHUP, 129, 143):
            wrong.append(f"exit status {ended.status}: {ended.err[-500:]}")
    elif ended.status == 0:
        if {name: data for name, data in found.items() if not is_left_over(case, name)} != case.new:
            wrong.append("exit status 0 without the new outputs")
    elif ended.status != 2:
        wrong.append(f"exit status {ended.status}: {ended.err[-1500:]}")
    lines = [line for line in ended.err.splitlines() if line.startswith("photosite: ") and "warning" not in line[:20]]
    if ended.status == 2 and len(lines) != 1:
        wrong.append(f"{len(lines)} lines of error: {ended.err[-500:]}")
    if "Traceback" in ended.err or "libhdf5" in ended.err or "HDF5-DIAG" in ended.err:
        wrong.append(f"raw messages: {ended.err[-1500:]}")
    if again and not (not case.overwrites and found == case.new):
        repeated = Run(folder, case).wait()
        found = contents(folder)
        if not case.overwrites:  # what is finished is not written again, and the lock's file beside it stays
            found = {name: data for name, data in found.items() if data or not name.endswith(".lock")}
        if repeated.status != 0 or found != case.new:
            names = [name for name in found.keys() | case.new if found.get(name) != case.new.get(name)]
            wrong.append(f"the next run: exit status {repeated.status}, {names}: {repeated.err[-500:]}")
    return wrong
