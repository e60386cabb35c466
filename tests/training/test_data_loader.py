"""Pairs in the workers of torch's DataLoader: the same items, shared cores, and nothing printed at their end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.engine.threads import cores
from photosite.training import Electrons, PairDataset

pytest.importorskip("torch", reason="torch (extra ml) is not installed; make test-torch installs it")

SCRIPT = Path(__file__).parents[1] / "helpers/data_loader.py"
METHODS = ["fork", "spawn", "forkserver"]


_OF_TORCH = re.compile(r"(.*resource_tracker: .*\n  warnings\.warn\('resource_tracker: .*\n)+")
"""Warnings of Python's resource tracker. At the end of a program, queues of the DataLoader that no thread waits for
release their semaphores while the interpreter stops, so that on a busy machine the tracker sometimes misses one. A
dataset of plain numbers does the same; photosite makes no semaphores in a DataLoader's processes."""


def run(method: str, way: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_NUM_THREADS"}
    command = [sys.executable, str(SCRIPT), method, way]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, env=environment, check=False)
    done.stderr = _OF_TORCH.sub("", done.stderr)
    return done


@pytest.fixture(scope="module")
def expected() -> list[str]:
    """Return the lines of one epoch."""
    electrons = np.random.default_rng(1).uniform(0.0, 500.0, (256, 256)).astype(np.float32)
    pairs = PairDataset(Electrons([electrons]), ps.load_sensor("nikon-d200"), draws=12)
    share = max(1, cores() // 2)
    return [f"{np.asarray(pairs[index].noisy, np.int64).sum()} {share}" for index in range(12)]


@pytest.mark.parametrize("way", ["plain", "unused", "persistent", "break"])
@pytest.mark.parametrize("method", METHODS)
def test_workers_give_the_same_items_on_their_part_of_the_cores(method: str, way: str, expected: list[str]) -> None:
    done = run(method, way)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == 2 * (expected[:4] if way == "break" else expected)


@pytest.mark.parametrize("method", METHODS)
def test_an_error_in_a_worker_ends_the_program_with_that_error(method: str) -> None:
    done = run(method, "error")
    assert done.returncode == 1
    assert "ArithmeticError: five" in done.stderr
    assert "terminate called" not in done.stderr
    assert "Aborted" not in done.stderr


@pytest.mark.parametrize("method", METHODS)
def test_an_interrupt_ends_the_program_and_its_workers(method: str) -> None:
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), method, "plain"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline()
    os.killpg(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert "terminate called" not in err
    assert "Aborted" not in err
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:  # the workers belong to the process group, which ends with them
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    pytest.fail("workers are left")


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_hundred_programs_end_without_a_word(method: str, expected: list[str]) -> None:
    for number in range(100):
        way = ("plain", "unused", "persistent", "break")[number % 4]
        done = run(method, way)
        assert (done.returncode, done.stderr) == (0, "")
