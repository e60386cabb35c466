"""`photosite worker` with a Dask scheduler on this machine."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from photosite.engine.workers import run_tasks


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"
    call = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen([sys.executable, "-m", "distributed.cli.dask_scheduler", *call], **quiet)
    try:
        while not file.exists():
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"]
    finally:
        process.kill()
        process.wait()


@pytest.mark.smoke("worker")
@pytest.mark.filterwarnings("ignore:the scheduler has no workers")
def test_workers_have_a_core_each_and_keep_what_is_set(scheduler: str, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "photosite", "worker", scheduler, "--processes", "2", "--", "--name", "named"]
    given = {name: value for name, value in os.environ.items() if name != "NUMBA_NUM_THREADS"}
    with (tmp_path / "log").open("w") as log:
        worker = subprocess.Popen(call, env=given | {"MALLOC_ARENA_MAX": "3"}, stderr=log)
    try:
        found = run_tasks(os.getenv, ["NUMBA_NUM_THREADS", "MALLOC_ARENA_MAX"], scheduler=scheduler)
        assert dict(found) == {0: "1", 1: "3"}
        until = time.monotonic() + 60
        while (tmp_path / "log").read_text().count("named-") < 2:  # the second worker may still start
            assert time.monotonic() < until
            time.sleep(0.1)
        worker.send_signal(signal.SIGINT)
        assert worker.wait(timeout=60) == 0
    finally:
        worker.kill()
        worker.wait()


@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1:1"])
def test_an_address_without_a_scheduler_is_one_line(photosite: Any, address: str) -> None:
    pytest.importorskip("distributed")
    done = photosite("worker", address)
    assert (done.status, done.out, done.err.count("\n")) == (2, "", 1)
    assert address in done.err
