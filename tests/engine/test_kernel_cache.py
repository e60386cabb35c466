"""Compiled kernels on disk: used again, and compiled anew where a file is damaged or cannot be written."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photosite.engine import jit, kernel_folder
from photosite.engine.random_numbers import poisson


def double(values: Any) -> Any:
    return 2 * values


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[], Any]:
    """Return a function that decorates `double` as a new process does."""
    monkeypatch.setattr(jit, "kernel_folder", lambda: tmp_path / "kernels")
    return lambda: jit.compiled()(double)


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.nbc"))


def test_a_kernel_is_compiled_once_for_each_type(kernel: Callable[[], Any], tmp_path: Path) -> None:
    first = kernel()
    assert (first(2.0), first(3)) == (4.0, 6)
    assert len(files(tmp_path)) == 2
    again = kernel()
    assert (again(2.0), again(3)) == (4.0, 6)
    assert sum(again.stats.cache_hits.values()) == 2
    assert (again(np.arange(3.0)) == [0, 2, 4]).all()
    assert len(files(tmp_path)) == 3


def test_a_kernel_pickles_by_its_name() -> None:
    assert pickle.loads(pickle.dumps(poisson)) is poisson


_LOADING = """
import sys
from photosite.engine.random_numbers import poisson
assert "numba" not in sys.modules
poisson(20.0, 1, 2, 3, 4, 5)
sys.exit("numba.np.arrayobj" in sys.modules)
"""


def test_numba_loads_what_compiles_only_to_compile() -> None:
    """What numba can compile takes 0.3 s to load."""
    poisson(20.0, 1, 2, 3, 4, 5)
    assert subprocess.run([sys.executable, "-c", _LOADING], check=False).returncode == 0


@pytest.mark.parametrize("damage", ["empty", "truncated", "garbage", "one byte"])
def test_a_damaged_file_is_compiled_anew(kernel: Callable[[], Any], tmp_path: Path, damage: str) -> None:
    kernel()(2.0)
    (path,) = files(tmp_path)
    good = path.read_bytes()
    content = bytearray(good)
    content[len(content) // 2] ^= 1
    path.write_bytes({"empty": b"", "truncated": good[:-9], "garbage": b"x" * 500, "one byte": bytes(content)}[damage])
    damaged = kernel()
    assert damaged(2.0) == 4.0
    assert sum(damaged.stats.cache_hits.values()) == 0
    again = kernel()
    assert again(2.0) == 4.0
    assert sum(again.stats.cache_hits.values()) == 1


def test_a_kernel_is_kept_while_another_process_writes(
    kernel: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A temporary file of another process takes its name after it was listed, and before it is looked at."""
    monkeypatch.setattr(Path, "glob", lambda folder, _: [folder / "renamed by now.tmp"])
    kernel()(2.0)
    monkeypatch.undo()
    assert len(files(tmp_path)) == 1


def test_a_folder_that_cannot_be_written_is_no_error(kernel: Callable[[], Any], tmp_path: Path) -> None:
    (tmp_path / "kernels").write_text("a file in the place of the folder")
    assert kernel()(2.0) == 4.0


_COMPILING = """
import sys
from pathlib import Path
from photosite.engine import jit
jit.kernel_folder = lambda: Path(sys.argv[1])
from photosite.engine.random_numbers import poisson
print("ready", flush=True)
sys.stdin.readline()
print(poisson(20.0, 1, 2, 3, 4, 5), sum(poisson.stats.cache_hits.values()))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="files are not locked on Windows")
def test_of_two_processes_that_need_a_kernel_one_compiles_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", _COMPILING, str(tmp_path)]
    processes = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    (one, hits), (other, more) = (process.communicate(timeout=120)[0].split() for process in processes)
    assert one == other
    assert int(hits) + int(more) == 1
    assert not list(tmp_path.rglob("*.lock"))


def test_a_kernel_that_a_killed_process_was_compiling_is_compiled(kernel: Callable[[], Any], tmp_path: Path) -> None:
    assert kernel()(2.0) == 4.0
    (path,) = files(tmp_path)
    path.unlink()
    path.with_suffix(".lock").touch()
    assert kernel()(2.0) == 4.0
    assert files(tmp_path) == [path]


@pytest.fixture
def no_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Put a file where the user's cache would be, and return the folder of temporary files."""
    (tmp_path / "home").touch()
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    kernel_folder.kernel_folder.cache_clear()
    yield tmp_path / "tmp"  # type: ignore[misc]
    kernel_folder.kernel_folder.cache_clear()


@pytest.mark.skipif(sys.platform != "linux", reason="the folder is that of XDG_CACHE_HOME on Linux")
def test_kernels_are_kept_in_a_temporary_folder_of_the_user(no_cache: Path) -> None:
    folder = kernel_folder.kernel_folder()
    own = no_cache / f"photosite-{os.getuid()}"
    assert folder.parent == own
    assert own.stat().st_mode & 0o777 == 0o700
    kernel_folder.kernel_folder.cache_clear()
    assert kernel_folder.kernel_folder() == folder


@pytest.mark.skipif(sys.platform != "linux", reason="the folder is that of XDG_CACHE_HOME on Linux")
@pytest.mark.parametrize("planted", ["a link", "open to others", "a file"])
def test_a_temporary_folder_that_others_can_write_is_not_used(no_cache: Path, planted: str) -> None:
    own = no_cache / f"photosite-{os.getuid()}"
    if planted == "a link":
        (no_cache / "elsewhere").mkdir()
        own.symlink_to(no_cache / "elsewhere")
    elif planted == "a file":
        own.touch()
    else:
        own.mkdir()
        own.chmod(0o777)
    folder = kernel_folder.kernel_folder()
    assert own not in folder.parents
    assert folder.is_dir()


def test_threads_that_make_kernels_at_once_keep_their_folders(kernel: Callable[[], Any]) -> None:
    kernel()(2.0)  # numba is imported before
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as threads:
            folders = list(threads.map(lambda _: Path(kernel()._cache.cache_path), range(200)))
    finally:
        sys.setswitchinterval(interval)
    assert len(set(folders)) == 1
