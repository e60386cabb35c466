"""Work on local processes and on a Dask cluster of this machine: dead workers, errors, interruptions, threads."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import worker_tasks as tasks
from process_groups import left_by

import photosite as ps
from photosite.engine.memory import KILLED
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import InputError, PhotositeWarning, WorkerError
from photosite.training import Electrons, PairDataset, write_shards

# Right after a test that ends all workers of the shared scheduler
pytestmark = pytest.mark.filterwarnings("ignore:the scheduler has no workers")

CAMERA = ps.Camera(ps.DiffractionLimited(2.8, 4), ps.load_sensor("vendor-2.2um").with_(rows=16, cols=16))
VALUES = {"pixel_width_um": [1.1, 2.2], "f_number": [2, 4]}
HELPERS = Path(__file__).parents[1] / "helpers"


def within(seconds: float, call: Callable[[], Any]) -> Any:
    """Return the result of a call, or fail when it takes too long."""
    pool = ThreadPoolExecutor(1)
    try:
        return pool.submit(call).result(seconds)
    finally:
        pool.shutdown(wait=False)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler in this process, with two worker processes of one thread."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address


def everything(function: Callable[[Any], Any], count: int, **where: Any) -> list[Any]:
    completed = run_tasks(function, range(count), name="number {}".format, **where)
    return within(60, lambda: list(in_order(completed)))


@pytest.fixture(params=["processes", "scheduler"])
def where(request: pytest.FixtureRequest) -> dict[str, Any]:
    return {"processes": 2} if request.param == "processes" else {"scheduler": request.getfixturevalue("scheduler")}


def test_a_killed_worker_changes_nothing(where: dict[str, Any], tmp_path: Path) -> None:
    assert everything(partial(tasks.double_after_death, str(tmp_path)), 6, **where) == [0, 2, 4, 6, 8, 10]
    assert (tmp_path / "died").exists()


@pytest.mark.parametrize("where", ["processes", pytest.param("scheduler", marks=pytest.mark.slow)], indirect=True)
def test_a_task_that_ends_every_worker_is_named(where: dict[str, Any]) -> None:
    with pytest.raises(WorkerError) as caught:
        everything(tasks.deadly, 2, **where)
    # Dask counts a task that waits at the same worker, too.
    assert caught.value.where in ("number 1", *(["number 0, number 1"] if "scheduler" in where else []))
    assert "scheduler" in where or KILLED in caught.value.what


def test_errors_of_tasks_are_those_of_the_call(where: dict[str, Any]) -> None:
    with pytest.raises(ArithmeticError, match="three"):
        everything(tasks.failing, 5, **where)


def test_a_worker_takes_no_more_threads_than_its_fraction(
    where: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for variable in ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr("photosite.engine.workers.cores", lambda: 2)
    assert everything(tasks.limits, 2, **where) == [(1, "1"), (1, "1")]
    assert "NUMBA_NUM_THREADS" not in os.environ


@pytest.mark.slow
def test_sweeps_and_shards_are_the_same(scheduler: str, tmp_path: Path) -> None:
    alone = ps.studies.sweep(CAMERA, VALUES, progress=False)
    shared = within(60, lambda: ps.studies.sweep(CAMERA, VALUES, scheduler=scheduler, progress=False))
    assert shared.rows == alone.rows
    pairs = PairDataset(Electrons([np.full((16, 16), 500.0)]), CAMERA.sensor, draws=4)
    write_shards(pairs, tmp_path / "a", pairs_per_shard=2)
    within(60, lambda: write_shards(pairs, tmp_path / "b", pairs_per_shard=2, scheduler=scheduler))
    one, other = ({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in "ab")
    assert one == other


def test_calls_that_cannot_work() -> None:
    pytest.importorskip("distributed")
    for call, what in (
        ({"processes": 0}, "processes"),
        ({"processes": True}, "processes"),
        ({"scheduler": "nowhere"}, "scheduler"),
        ({"scheduler": "tls://127.0.0.1:9"}, "scheduler"),  # TLS without certificates
        ({"scheduler": "inproc://here"}, "scheduler"),
    ):
        with pytest.raises(InputError) as caught:
            everything(tasks.double, 2, **call)
        assert caught.value.what == what


@pytest.mark.slow
def test_an_address_that_does_not_answer_is_an_error_within_seconds() -> None:
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as silent:
        for port in (silent.getsockname()[1], 9):
            begun = time.monotonic()
            with pytest.raises(InputError) as caught:
                everything(tasks.double, 2, scheduler=f"tcp://127.0.0.1:{port}")
            assert caught.value.what == "scheduler"
            assert time.monotonic() - begun < 20


def test_an_address_of_a_worker_is_an_error(scheduler: str) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.Client(scheduler, set_as_default=False) as client:
        worker = next(iter(client.scheduler_info()["workers"]))
    with pytest.raises(InputError) as caught:
        everything(tasks.double, 2, scheduler=worker)
    assert "Worker" in (caught.value.hint or "")


LOST = """
import os, sys, time
import worker_tasks
from photosite.engine.memory import KILLED
from photosite.engine.workers import run_tasks
address, number, process = sys.argv[1], *map(int, sys.argv[2:])
try:
    for index, _ in run_tasks(worker_tasks.double, range(6), scheduler=address, ahead=2):
        if index == 0:
            os.kill(process, number)
            time.sleep(12)  # longer than Dask's client tries to connect again
except Exception as error:
    print(type(error).__name__, error.where)
"""


def test_a_scheduler_without_workers_is_a_warning() -> None:
    distributed = pytest.importorskip("distributed")
    options: dict[str, Any] = {"host": "127.0.0.1", "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(n_workers=0, threads_per_worker=1, **options) as cluster:

        def start_later() -> None:
            time.sleep(1)
            cluster.scale(1)

        threading.Thread(target=start_later).start()
        with pytest.warns(PhotositeWarning):
            assert everything(tasks.double, 2, scheduler=cluster.scheduler_address) == [0, 2]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("workers", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_lost_scheduler_is_an_error_without_log_lines(workers: int, number: signal.Signals, tmp_path: Path) -> None:
    """In a process of its own, because Dask's log goes to the standard error of the time of its import."""
    pytest.importorskip("distributed")
    file, log = tmp_path / "scheduler.json", tmp_path / "log"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path])}
    started: list[subprocess.Popen[str]] = []

    def start(*call: str, **pipes: Any) -> None:
        started.append(subprocess.Popen([sys.executable, *call], env=environment, text=True, **pipes))

    def start_dask(what: str, *call: str) -> None:
        with log.open("a") as stream:
            program = ["-m", f"distributed.cli.dask_{what}", "--no-dashboard", "--scheduler-file", str(file)]
            start(*program, *call, stdout=stream, stderr=stream)

    try:
        start_dask("scheduler", "--host", "127.0.0.1", "--port", "0")
        wait_until(file.exists)
        for _ in range(workers):
            start_dask("worker", "--nthreads", "1", "--no-nanny")
        address = json.loads(file.read_text())["address"]
        given = address, str(int(number)), str(started[0].pid)
        start("-W", "ignore::UserWarning", "-c", LOST, *given, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        if not workers:  # the tasks wait
            wait_until(lambda: "Receive client connection" in log.read_text())
            time.sleep(0.5)
            started[0].send_signal(number)
        assert started[-1].communicate(timeout=60) == (f"WorkerError {address}\n", "")
    finally:
        for process in started:
            process.kill()
            process.wait()


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.05)


SCRIPT = """
import signal
import worker_tasks
from photosite.engine.memory import KILLED
from photosite.engine.workers import run_tasks
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell ignores for what it runs in the background
if __name__ == "__main__":
    found = run_tasks(worker_tasks.sleeping, range(4), processes=2)
    print("begun", flush=True)
    list(found)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs the list of processes of Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_their_parent(number: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(SCRIPT)
    assert not left_by(tmp_path / "run.py", number, processes=4)  # with the tracker of multiprocessing
