"""The child process that reads untrusted files: results, errors, limits, and how often it is started."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from process_groups import left_by

from photosite.errors import FileError
from photosite.files import child
from photosite.files.child import KILLED, ChildError, call_in_child
from photosite.files.hdf5 import open_hdf5, read_texts

LIMITS = {"time_s": 20.0, "memory_bytes": 2 << 30}


def process_of_the_child() -> int:
    return int(call_in_child(os.getpid, **LIMITS))


def test_calls_fraction_one_child() -> None:
    first = process_of_the_child()
    assert first != os.getpid()
    begun = time.monotonic()
    assert {process_of_the_child() for _ in range(20)} == {first}
    assert time.monotonic() - begun < 2.0


def test_errors_of_the_function_keep_their_fields(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs.create("a", np.array([np.arange(3), None], object)[:1], dtype=h5py.vlen_dtype(np.int64))
    with pytest.raises(FileError) as caught:
        call_in_child(read_texts, str(tmp_path / "a.h5"), **LIMITS)
    assert (caught.value.path, caught.value.where) == (str(tmp_path / "a.h5"), "/: a")
    with pytest.raises(ChildError, match="No such file"):
        call_in_child(os.listdir, str(tmp_path / "missing"), **LIMITS)


def test_a_crash_is_an_error_and_the_next_call_works() -> None:
    first = process_of_the_child()
    with pytest.raises(ChildError, match="crashed"):
        call_in_child(os.abort, **LIMITS)
    assert process_of_the_child() != first


def test_a_killed_child_is_reported_as_that() -> None:
    call_in_child(os.getpid, **LIMITS)
    with pytest.raises(ChildError) as caught:
        call_in_child(os.kill, process_of_the_child(), signal.SIGKILL, **LIMITS)
    assert str(caught.value) == KILLED


def test_a_call_that_takes_too_long_is_ended() -> None:
    begun = time.monotonic()
    with pytest.raises(ChildError, match=r"longer than 0\.3 s"):
        call_in_child(time.sleep, 60.0, time_s=0.3, memory_bytes=2 << 30)
    assert time.monotonic() - begun < 20.0


@pytest.mark.skipif(sys.platform == "win32", reason="no timer of processor time")
def test_processor_time_is_limited_and_waiting_is_not() -> None:
    begun = time.monotonic()
    with pytest.raises(ChildError, match=r"0\.3 s of the processor's time"):
        call_in_child(sum, range(10**12), time_s=60.0, memory_bytes=2 << 30, processor_s=0.3)
    assert time.monotonic() - begun < 30.0
    assert call_in_child(time.sleep, 1.0, time_s=60.0, memory_bytes=2 << 30, processor_s=0.3) is None
    assert call_in_child(sum, range(10), time_s=60.0, memory_bytes=2 << 30) == 45


@pytest.mark.skipif(sys.platform == "win32", reason="no address space limit")
def test_memory_is_limited_for_each_call() -> None:
    with pytest.raises(ChildError, match="MemoryError"):
        call_in_child(bytearray, 1 << 30, time_s=20.0, memory_bytes=1 << 29)
    assert len(call_in_child(bytes, 1 << 20, **LIMITS)) == 1 << 20


@pytest.mark.skipif(sys.platform == "win32", reason="no fork")
def test_a_forked_process_starts_its_own_child() -> None:
    ours = process_of_the_child()
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    process = context.Process(target=lambda: queue.put(process_of_the_child()))
    process.start()
    theirs = queue.get()
    process.join()
    assert theirs != ours
    assert process_of_the_child() == ours


def test_a_child_that_died_meanwhile_is_replaced() -> None:
    first = process_of_the_child()
    os.kill(first, signal.SIGTERM)
    assert child._child is not None
    child._child.process.wait()
    assert process_of_the_child() != first


def test_files_without_variable_length_text_need_no_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photosite.files.hdf5.call_in_child", lambda *a, **k: pytest.fail("a child was started"))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["name"] = np.bytes_(b"fixed")
        file["x"] = np.arange(3)
    with open_hdf5(tmp_path / "a.h5") as opened:
        assert opened.attributes(opened.file) == {"name": "fixed"}


def test_text_of_variable_length_comes_from_the_child(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["name"] = "above"
        data = file.create_dataset("group/x", data=np.arange(3))
        data.attrs["lines"] = ["a", "b"]
        data.attrs["name"] = "Ångström"
    with open_hdf5(tmp_path / "a.h5") as opened:
        found = opened.attributes(opened.datasets["group/x"], inherited=True)
        assert found["name"] == "Ångström"
        assert list(found["lines"]) == ["a", "b"]
        assert opened.attributes(opened.file["group"], inherited=True) == {"name": "above"}


def test_relative_paths_follow_the_parent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The child starts in one folder; the parent then moves to another."""
    call_in_child(os.path.exists, "here", time_s=60, memory_bytes=1 << 30)
    (tmp_path / "here").touch()
    monkeypatch.chdir(tmp_path)
    assert call_in_child(os.path.exists, "here", time_s=60, memory_bytes=1 << 30)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs the list of processes of Linux")
def test_a_child_that_hangs_ends_after_its_parent(tmp_path: Path) -> None:
    call = "from photosite.files.child import call_in_child\ncall_in_child(time.sleep, 60, time_s=1, memory_bytes=0)"
    (tmp_path / "run.py").write_text(f"import time\n{call}\n")
    assert not left_by(tmp_path / "run.py", signal.SIGKILL, processes=2)
