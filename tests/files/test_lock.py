"""Lock of a folder: one holder at a time, and none after its process has ended."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from photosite.errors import FileError
from photosite.files.writing import LOCK_NAME, FolderLock

HOLDER = """
import sys
from pathlib import Path
from photosite.files.writing import FolderLock
lock = FolderLock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def test_one_holder_in_a_process(tmp_path: Path) -> None:
    first = FolderLock(tmp_path)
    for _ in range(2):
        with pytest.raises(FileError) as caught:
            FolderLock(tmp_path)
        assert Path(caught.value.path) == tmp_path
    assert [entry.name for entry in tmp_path.iterdir()] == [LOCK_NAME]
    first.release()
    assert list(tmp_path.iterdir()) == []
    second = FolderLock(tmp_path)
    first.release()  # not the second's
    with pytest.raises(FileError):
        FolderLock(tmp_path)
    second.release()


def test_a_killed_process_leaves_no_lock(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(FileError):
            FolderLock(tmp_path)
        holder.kill()
        holder.wait()
    assert (tmp_path / LOCK_NAME).exists()
    FolderLock(tmp_path).release()
    assert not (tmp_path / LOCK_NAME).exists()


def test_a_folder_that_cannot_be_locked(tmp_path: Path) -> None:
    (tmp_path / LOCK_NAME).mkdir()
    with pytest.raises(FileError) as caught:
        FolderLock(tmp_path)
    assert Path(caught.value.path) == tmp_path
