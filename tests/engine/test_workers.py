"""Work on local processes and on a Dask cluster of this machine: dead workers, errors, interruptions, threads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import worker_tasks as tasks

import photosite as ps
from photosite.data import Electrons, PairDataset, write_shards
from photosite.engine.workers import in_order, run_tasks
from photosite.errors import InputError, WorkerError

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
    assert caught.value.where == "number 1"


def test_errors_of_tasks_are_those_of_the_call(where: dict[str, Any]) -> None:
    with pytest.raises(ArithmeticError, match="three"):
        everything(tasks.failing, 5, **where)


def test_a_worker_takes_no_more_threads_than_its_share(where: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr("photosite.engine.workers._cores", lambda: 2)
    assert everything(tasks.limits, 2, **where) == [(1, "1"), (1, "1")]
    assert "NUMBA_NUM_THREADS" not in os.environ


@pytest.mark.slow
def test_sweeps_and_shards_are_the_same(scheduler: str, tmp_path: Path) -> None:
    alone = ps.sweep(CAMERA, VALUES, progress=False)
    shared = within(60, lambda: ps.sweep(CAMERA, VALUES, scheduler=scheduler, progress=False))
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
    ):
        with pytest.raises(InputError) as caught:
            everything(tasks.double, 2, **call)
        assert caught.value.what == what


SCRIPT = """
import sys
import worker_tasks
from photosite.engine.workers import run_tasks
if __name__ == "__main__":
    found = run_tasks(worker_tasks.sleeping, range(4), processes=2)
    print("begun", flush=True)
    list(found)
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs the list of processes of Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_their_parent(number: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(SCRIPT)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(HELPERS), *sys.path])}
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "run.py")], start_new_session=True, env=environment, stderr=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 60
    while len(members(process.pid)) < 3 and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(number)
    assert process.wait(20) != 0
    deadline = time.monotonic() + 20
    while members(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not members(process.pid), "workers outlive their parent"


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
