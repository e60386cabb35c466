"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import sys
from pathlib import Path

import pytest
from killed_writers import kill_while_writing, temporaries
from raising import raises

from photosite.errors import FileError
from photosite.files.writing import TemporaryFolder, atomic_folder, atomic_path, remove_abandoned

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="processes are looked up on Linux only")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_nothing_has_the_name_before_the_end(tmp_path):
    path = tmp_path / "a.tar.txt"
    with atomic_path(path) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".txt"
        assert temporary.name.startswith(".")
        temporary.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert names(tmp_path) == ["a.tar.txt"]


@pytest.mark.parametrize("failure", [ValueError, OSError, KeyboardInterrupt])
def test_a_failure_leaves_what_was_there(tmp_path, failure):
    path = tmp_path / "a.txt"
    path.write_text("before")

    def write_half() -> None:
        with atomic_path(path) as temporary:
            temporary.write_text("half")
            raise failure

    with pytest.raises(FileError if failure is OSError else failure):
        write_half()
    assert path.read_text() == "before"
    assert names(tmp_path) == ["a.txt"]


def test_permissions_are_those_of_a_plain_file(tmp_path):
    (tmp_path / "plain").touch()
    with atomic_path(tmp_path / "a.txt"):
        pass
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "there.txt").write_text("before")
    (tmp_path / "link.txt").symlink_to("there.txt")
    with atomic_path(tmp_path / "link.txt") as temporary:
        temporary.write_text("after")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "there.txt").read_text() == "after"


@pytest.mark.parametrize("place", [".", os.devnull])
def test_folders_and_devices_are_not_replaced(tmp_path, monkeypatch, place):
    monkeypatch.chdir(tmp_path)
    with raises(FileError, "cannot be written"), atomic_path(place):
        pytest.fail("nothing may be written")
    assert Path(os.devnull).is_char_device()


def test_a_missing_folder(tmp_path):
    with (
        raises(FileError, "cannot be written", path=str(tmp_path / "nowhere" / "a.txt")),
        atomic_path(tmp_path / "nowhere" / "a.txt"),
    ):
        pytest.fail("nothing may be written")


def test_appears_at_the_end(tmp_path: Path) -> None:
    with atomic_folder(tmp_path / "stack") as place:
        (place / "a").write_text("a")
        assert not (tmp_path / "stack").exists()
    assert [file.name for file in tmp_path.rglob("*")] == ["stack", "a"]


def test_empty_folder_is_taken(tmp_path: Path) -> None:
    (tmp_path / "stack").mkdir()
    with atomic_folder(tmp_path / "stack") as place:
        (place / "a").write_text("a")
    assert (tmp_path / "stack" / "a").read_text() == "a"


def _write(folder: Path, failure: type[BaseException] | None = None, meanwhile: Path | None = None) -> None:
    with atomic_folder(folder) as place:
        (place / "a").write_text("mine")
        if meanwhile is not None:
            folder.mkdir()
            meanwhile.write_text("theirs")
        if failure is not None:
            raise failure


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_nothing(tmp_path: Path, failure: type[BaseException]) -> None:
    with pytest.raises(failure):
        _write(tmp_path / "stack", failure)
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_stays(tmp_path: Path) -> None:
    (tmp_path / "stack").mkdir()
    (tmp_path / "stack" / "mine").write_text("mine")
    with raises(FileError, "exists already"), atomic_folder(tmp_path / "stack"):
        pytest.fail("the block must not run")
    (tmp_path / "file").write_text("mine")
    with raises(FileError, "exists already"), atomic_folder(tmp_path / "file"):
        pytest.fail("the block must not run")
    assert (tmp_path / "stack" / "mine").read_text() == (tmp_path / "file").read_text() == "mine"


def test_filled_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    """Somebody else made the folder while this one was written: theirs stays."""
    with raises(FileError, "cannot be written"):
        _write(tmp_path / "stack", meanwhile=tmp_path / "stack" / "b")
    assert [file.name for file in tmp_path.rglob("*")] == ["stack", "b"]


def test_no_folder_above(tmp_path: Path) -> None:
    with raises(FileError, "cannot be written"), atomic_folder(tmp_path / "nowhere" / "stack"):
        pytest.fail("the block must not run")


def test_usual_permissions(tmp_path: Path) -> None:
    with atomic_folder(tmp_path / "stack"):
        pass
    (tmp_path / "plain").mkdir()
    assert (tmp_path / "stack").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_errors_name_the_folder_asked_for(tmp_path: Path) -> None:
    def fails(path: Path) -> None:
        with atomic_folder(tmp_path / "stack") as place:
            (place / "dark").mkdir()
            raise FileError(place / "dark" / path, "is truncated", 3)

    with pytest.raises(FileError) as caught:
        fails(Path("1.tif"))
    assert str(caught.value) == f"{tmp_path / 'stack' / 'dark' / '1.tif'}:3: is truncated"
    with pytest.raises(FileError) as caught:
        fails(tmp_path / "elsewhere.tif")
    assert caught.value.path == str(tmp_path / "elsewhere.tif")


@pytest.mark.parametrize(
    ("free", "said"), [(0, os.strerror(errno.ENOSPC)), (1 << 30, "26000 requested and 3680 written")]
)
def test_a_full_disk_is_called_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, said: str) -> None:
    """NumPy's tofile raises without an error number."""

    def writes(file: Path) -> None:
        with atomic_folder(tmp_path / "stack") as place, atomic_path(place / file):
            raise OSError("26000 requested and 3680 written")

    usage = shutil.disk_usage(tmp_path)._replace(free=free)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    with pytest.raises(FileError) as caught:
        writes(Path("1.tif"))
    assert str(caught.value) == f"{tmp_path / 'stack' / '1.tif'}: cannot be written: {said}"
    assert list(tmp_path.iterdir()) == []


def test_added_to_what_is_there(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "a").write_text("of last time")

    def adds(*, failing: bool) -> None:
        with atomic_folder(tmp_path, add=True) as place:
            (place / "a").write_text("a")
            (place / "sub").mkdir()
            assert (tmp_path / "a").read_text() == "of last time"
            if failing:
                raise KeyError("b")

    with pytest.raises(KeyError):
        adds(failing=True)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"mine": "mine", "a": "of last time"}
    adds(failing=False)
    assert {file.name for file in tmp_path.iterdir()} == {"mine", "a", "sub"}
    assert (tmp_path / "a").read_text() == "a"
    with atomic_folder(tmp_path / "new", add=True):
        pass
    assert (tmp_path / "new").is_dir()


@on_linux
@pytest.mark.parametrize("folder", [False, True])
def test_the_next_writer_removes_what_a_killed_one_left(tmp_path: Path, folder: bool) -> None:
    left = kill_while_writing(tmp_path / "a.txt", folder=folder)
    with atomic_path(tmp_path / "b.txt"):
        assert not left.exists()
        assert len(temporaries(tmp_path)) == 1
    assert names(tmp_path) == ["b.txt"]


@on_linux
def test_what_somebody_may_still_write_stays(tmp_path: Path) -> None:
    """Of a running process; of another machine, or one that was restarted, until a day has passed."""
    left = kill_while_writing(tmp_path / "a.txt")
    system = left.name.split("-")[1]
    elsewhere = left.rename(tmp_path / left.name.replace(system, "0123abcd"))
    folder = tmp_path / left.name.replace(system, "0123abce").removesuffix(".txt")
    (folder / "below").mkdir(parents=True)
    (folder / "below" / "a").touch()
    unrelated = tmp_path / ".photosite-notes"
    unrelated.touch()
    with atomic_path(tmp_path / "b.txt") as temporary:
        remove_abandoned(tmp_path)
        assert {temporary, elsewhere, folder, unrelated} == set(tmp_path.iterdir())
    days_ago = elsewhere.stat().st_mtime - 2 * 86400
    for path in (elsewhere, folder, folder / "below"):
        os.utime(path, (days_ago, days_ago))
    remove_abandoned(tmp_path)
    assert {folder, unrelated, tmp_path / "b.txt"} == set(tmp_path.iterdir())  # a file in the folder has just changed
    os.utime(folder / "below" / "a", (days_ago, days_ago))
    remove_abandoned(tmp_path)
    assert {unrelated, tmp_path / "b.txt"} == set(tmp_path.iterdir())


@on_linux
def test_the_number_of_a_process_may_be_in_use_again(tmp_path: Path) -> None:
    left = kill_while_writing(tmp_path / "a.txt")
    process = left.name.split("-")[2]
    left = left.rename(tmp_path / left.name.replace(f"-{process}-", f"-{os.getpid()}-"))
    remove_abandoned(tmp_path)
    assert not left.exists()


@on_linux
def test_temporary_folders_of_killed_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left = kill_while_writing(tmp_path / "a", folder=True).rename(tmp_path / "x")
    own = TemporaryFolder()
    left.rename(tmp_path / own.path.name.replace(f"-{os.getpid()}-", f"-{2**22 + 1}-"))
    remove_abandoned(tmp_path)
    assert list(tmp_path.iterdir()) == [own.path]
    own.close()
    assert not list(tmp_path.iterdir())


class _Calls:
    """Records renames and syncs, by the name that the file had or gets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[str] = []
        replace, fsync = os.replace, os.fsync

        def note_replace(source: Path, target: Path) -> None:
            self.made.append(f"rename {Path(target).name}")
            replace(source, target)

        def note_sync(handle: int) -> None:
            self.made.append(f"sync {Path(os.readlink(f'/proc/self/fd/{handle}')).suffix or 'folder'}")
            fsync(handle)

        monkeypatch.setattr(os, "replace", note_replace)
        monkeypatch.setattr(os, "fsync", note_sync)


@on_linux
def test_the_disk_holds_a_file_before_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = _Calls(monkeypatch)
    with atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("whole")
    assert calls.made == ["sync .txt", "rename a.txt", "sync folder"]
    calls.made.clear()
    with atomic_folder(tmp_path / "stack") as place:
        (place / "b").mkdir()
        for number in range(3):
            with atomic_path(place / "b" / f"{number}.txt"):
                pass
        assert calls.made == [f"rename {number}.txt" for number in range(3)]
        calls.made.clear()
    assert calls.made == [*["sync .txt"] * 3, "sync folder", "sync folder", "rename stack", "sync folder"]
    calls.made.clear()
    with atomic_path(tmp_path / "a.txt", durable=False):
        pass
    assert calls.made == ["rename a.txt"]


def test_a_sync_that_fails_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(handle: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    (tmp_path / "a.txt").write_text("before")
    monkeypatch.setattr(os, "fsync", fails)
    with (
        raises(FileError, f"cannot be written: {os.strerror(errno.EIO)}"),
        atomic_path(tmp_path / "a.txt") as temporary,
    ):
        temporary.write_text("after")
    assert (tmp_path / "a.txt").read_text() == "before"
    assert names(tmp_path) == ["a.txt"]
