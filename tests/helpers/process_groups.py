"""Processes that a killed one may leave behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

HELPERS = Path(__file__).parent


def left_by(script: Path, number: signal.Signals, processes: int, within_s: float = 20.0) -> list[int]:
    """Start a script, end it by a signal when it has `processes`, and return those that run `within_s` later."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path])}
    process = subprocess.Popen(
        [sys.executable, str(script)], start_new_session=True, env=environment, stderr=subprocess.DEVNULL
    )
    _until(lambda: len(members(process.pid)) >= processes, 60)
    time.sleep(0.5)
    process.send_signal(number)
    assert process.wait(20) != 0
    _until(lambda: not members(process.pid), within_s)
    return members(process.pid)


def _until(condition: Callable[[], bool], longest_s: float) -> None:
    deadline = time.monotonic() + longest_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)


def members(group: int) -> list[int]:
    """Return the processes of a group that still run."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[2]) == group and fields[0] != "Z":
                found.append(int(entry.name))
    return found
