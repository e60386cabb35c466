"""Worker processes: limits, cancelling, and what happens when one dies."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from process_groups import left_by

from photosite.app.workers import BusyError, CancelledError, Queue, Worker, WorkerError
from photosite.errors import InputError


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    made = Worker()
    yield made
    made.close()


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_results_and_errors_come_back(worker: Worker) -> None:
    assert worker.call(os.path.join, "a", "b", time_s=30) == os.path.join("a", "b")
    with pytest.raises(InputError) as caught:
        worker.call(_raise, time_s=30)
    assert (caught.value.what, caught.value.value) == ("x", 3)
    with pytest.raises(WorkerError):
        worker.call(int, "x", time_s=30)


def _raise() -> None:
    raise InputError("x", value=3, expected="4")


def test_a_call_that_takes_too_long_is_ended(worker: Worker) -> None:
    worker.call(os.getpid, time_s=60)
    begun, pid = time.monotonic(), worker.process.pid
    with pytest.raises(WorkerError):
        worker.call(time.sleep, 60, time_s=0.2)
    assert time.monotonic() - begun < 5
    assert not is_running(pid)
    assert worker.call(os.getpid, time_s=60) != pid


def test_cancelling_ends_a_process_that_does_not_listen(worker: Worker) -> None:
    worker.call(os.getpid, time_s=60)
    pid, cancelled = worker.process.pid, threading.Event()
    threading.Timer(0.1, cancelled.set).start()
    begun = time.monotonic()
    with pytest.raises(CancelledError):
        worker.call(time.sleep, 60, time_s=60, cancelled=cancelled)
    assert time.monotonic() - begun < 5
    assert not is_running(pid)


def test_cancelling_before_the_process_is_prepared_leaves_it_alone() -> None:
    made, cancelled = Worker(prepare=_slow), threading.Event()
    cancelled.set()
    try:
        pid = made.process.pid
        with pytest.raises(CancelledError):
            made.call(os.getpid, time_s=60, cancelled=cancelled)
        assert made.call(os.getpid, time_s=60) == pid
    finally:
        made.close()


def test_the_time_limit_of_a_call_begins_once_the_process_is_prepared() -> None:
    made = Worker(prepare=_slow)
    try:
        pid = made.process.pid
        assert made.call(os.getpid, time_s=0.5) == pid
    finally:
        made.close()


def _slow() -> None:
    time.sleep(1)


def test_a_process_that_cannot_be_prepared_computes() -> None:
    made = Worker(prepare=_raise)
    try:
        assert made.call(abs, -1, time_s=60) == 1
    finally:
        made.close()


def test_a_process_that_dies_is_replaced(worker: Worker) -> None:
    pid = worker.call(os.getpid, time_s=60)
    threading.Timer(0.1, os.kill, (pid, signal.SIGKILL)).start()
    with pytest.raises(WorkerError):
        worker.call(time.sleep, 60, time_s=60)
    assert worker.call(os.getpid, time_s=60) != pid


def test_jobs_wait_are_replaced_and_cancelled() -> None:
    queue = Queue(1, time_s=30, most_waiting=2)
    try:
        first = queue.add("frame", "one", _busy)
        while first.status == "queued":
            time.sleep(0.01)
        waiting = queue.add("frame", "two", _busy)
        replaced = queue.add("frame", "two", _busy, replaces=True)
        assert (waiting.status, replaced.status) == ("cancelled", "queued")
        queue.add("plan", "two", _busy)
        with pytest.raises(BusyError):
            queue.add("plan", "three", _busy)
        begun = time.monotonic()
        queue.cancel(first)
        while first.status == "running":
            time.sleep(0.01)
        assert first.status == "cancelled"
        assert time.monotonic() - begun < 3
    finally:
        queue.close()


def _busy(progress=None) -> None:
    """Compute until cancelled, as a computation that reports its progress."""
    while True:
        time.sleep(0.05)
        progress(1, 2, "parts")


def test_a_frame_that_does_not_fit_on_the_disk_fails_with_the_reason(client, workbench, monkeypatch) -> None:
    kept, missing = workbench.kept, workbench.folder / "missing"
    monkeypatch.setattr(type(workbench), "kept", property(lambda _: missing))
    state = {"sensor": {"changes": {"rows": 64, "cols": 64}}}
    job = client.post("/api/frames", json={"state": state}).json()
    while job["status"] in ("queued", "running"):
        time.sleep(0.05)
        job = client.get(f"/api/jobs/{job['id']}").json()
    assert job["status"] == "failed"
    assert "No such file" in job["error"]
    assert client.post("/api/view", json={"state": state}).status_code == 200  # previews need no disk
    assert kept.exists()


def test_the_server_survives_the_death_of_its_worker(client, workbench) -> None:
    view = {"state": {}, "view": {"height": 40, "width": 60}}
    assert client.post("/api/view", json=view).status_code == 200
    os.kill(workbench.pool.workers[0].process.pid, signal.SIGKILL)
    statuses = {client.post("/api/view", json=view).status_code for _ in range(2)}
    assert statuses <= {200, 503}
    assert client.post("/api/view", json=view).status_code == 200


def test_files_used_least_recently_are_deleted_beyond_the_limit(workbench, monkeypatch) -> None:
    import photosite.app.server as server

    for number in range(4):
        path = Path(workbench.kept, f"frame-{number}.npy")
        path.write_bytes(b"x" * 100)
        os.utime(path, (number + 4e9, number + 4e9))
    monkeypatch.setattr(server, "_KEPT_BYTES", 250)
    workbench.tidy()
    assert sorted(path.name for path in workbench.kept.glob("frame-?.npy")) == ["frame-2.npy", "frame-3.npy"]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs the list of processes of Linux")
def test_a_worker_ends_with_the_server(tmp_path: Path) -> None:
    call = "    Worker().call(time.sleep, 60, time_s=60)"
    lines = ["import time", "from photosite.app.workers import Worker", "if __name__ == '__main__':", call]
    (tmp_path / "run.py").write_text("\n".join(lines))
    assert not left_by(tmp_path / "run.py", signal.SIGKILL, processes=3)
