"""Threads of a process, and loops of compiled functions on them."""

from __future__ import annotations

import multiprocessing
import os
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.engine import threads
from photosite.engine.threads import ITEMS_PER_THREAD, cores, parallel_for, thread_count, threads_for


@pytest.fixture
def four(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four threads, whatever the machine."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", "4")
    threads._forget()
    yield  # type: ignore[misc]
    monkeypatch.undo()
    threads._forget()


def add_one(start: int, stop: int, values: NDArray[np.int64]) -> None:
    values[start:stop] += 1


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 1000])
@pytest.mark.usefixtures("four")
def test_each_iteration_runs_once(count: int) -> None:
    values = np.zeros(count, np.int64)
    parallel_for(add_one, count, values)
    assert (values == 1).all()


@pytest.mark.usefixtures("four")
def test_an_error_waits_for_the_other_parts() -> None:
    done = []

    def fail_first(start: int, stop: int) -> None:
        if start == 0:
            raise ArithmeticError
        threading.Event().wait(0.05)
        done.append((start, stop))

    with pytest.raises(ArithmeticError):
        parallel_for(fail_first, 8)
    assert sorted(done) == [(k, k + 1) for k in range(1, 8)]


@pytest.mark.usefixtures("four")
def test_few_items_use_few_threads() -> None:
    assert thread_count() == 4
    with threads_for(2 * ITEMS_PER_THREAD):
        assert thread_count() == 2
        with threads_for(1):
            assert thread_count() == 1
        assert thread_count() == 2
        with threads_for(100 * ITEMS_PER_THREAD):
            assert thread_count() == 2
    assert thread_count() == 4


@pytest.mark.parametrize(("workers", "expected"), [(1, cores()), (2, max(1, cores() // 2)), (1000, 1)])
def test_a_worker_of_a_data_loader_has_its_part_of_the_cores(
    workers: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    loader = SimpleNamespace(get_worker_info=lambda: SimpleNamespace(num_workers=workers))
    monkeypatch.setitem(sys.modules, "torch.utils.data", loader)  # type: ignore[arg-type]
    threads._forget()
    try:
        assert thread_count() == expected
    finally:
        monkeypatch.undo()
        threads._forget()


def report_threads(pipe: multiprocessing.connection.Connection) -> None:
    values = np.zeros(100, np.int64)
    parallel_for(add_one, 100, values)
    pipe.send((thread_count(), int(values.sum())))


@pytest.mark.parametrize("method", multiprocessing.get_all_start_methods())
def test_a_process_beside_others_has_one_thread(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    parallel_for(add_one, 100, np.zeros(100, np.int64))  # a forked process does not have these threads
    context = multiprocessing.get_context(method)
    here, there = context.Pipe()
    process = context.Process(target=report_threads, args=(there,))
    process.start()
    assert here.poll(60)
    assert here.recv() == (1, 100)
    process.join(10)
    assert process.exitcode == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.usefixtures("four")
def test_a_forked_process_starts_threads_of_its_own() -> None:
    parallel_for(add_one, 100, np.zeros(100, np.int64))
    child = os.fork()
    if child == 0:
        values = np.zeros(100, np.int64)
        parallel_for(add_one, 100, values)
        os._exit(int(values.sum()) - 100)
    assert os.waitpid(child, 0)[1] == 0
