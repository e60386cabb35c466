"""Timing beside a baseline in the same process, and peak memory in a fresh process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from photosite.errors import PhotositeError


@dataclass(frozen=True)
class Case:
    """Result of a benchmark case.

    Parameters
    ----------
    seconds, baseline_seconds
        Best of several runs each, taken in turn in one process.
    peak_mb
        Peak resident memory of a fresh process that does the work once, without the baseline.
    megapixels
        Size of the work.
    """

    seconds: float
    baseline_seconds: float
    peak_mb: float
    megapixels: float

    @property
    def ratio(self) -> float:
        """Baseline time over time."""
        return self.baseline_seconds / self.seconds

    def to_dict(self) -> dict[str, float]:
        """Return the figures for JSON."""
        return {**asdict(self), "ratio": self.ratio}


def best_seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Return the shortest time of several runs, the one least disturbed by other processes."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def in_turn(work: Callable[[], object], baseline: Callable[[], object], repeats: int = 3) -> tuple[float, float]:
    """Return the shortest time of each, run in turn, so that a busy machine affects both equally."""
    pairs = [(best_seconds(work, 1), best_seconds(baseline, 1)) for _ in range(repeats)]
    return min(ours for ours, _ in pairs), min(theirs for _, theirs in pairs)


# A process's ru_maxrss includes its parent's size; VmHWM does not.
_CHILD = """
import sys
try:
    exec(sys.argv[1])
except SystemExit as end:
    if end.code:
        raise
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print("\\n", int(status["VmHWM"].split()[0]) * 1024)
"""


def peak_mb(function: Callable[..., object], **arguments: Any) -> float:
    """Return the peak resident memory, in 10^6 bytes, of a fresh process that calls a module's function once."""
    given = ", ".join(f"{name}={value!r}" for name, value in arguments.items())
    return peak_mb_of(f"from {function.__module__} import {function.__name__} as f; f({given})")


def peak_mb_of(code: str) -> float:
    """Return the peak resident memory, in 10^6 bytes, of a fresh process that runs a line of Python.

    Raises
    ------
    PhotositeError
        If the process fails.
    """
    done = subprocess.run([sys.executable, "-c", _CHILD, code], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise PhotositeError(f"the benchmark process failed: {done.stderr.strip().splitlines()[-1]}")
    return float(done.stdout.splitlines()[-1]) / 1e6
