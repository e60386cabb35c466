"""Folders that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pytest

from photosite.errors import FileError
from photosite.files.atomic import atomic_folder, atomic_path


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
    with pytest.raises(FileError, match="not an empty folder"), atomic_folder(tmp_path / "stack"):
        pytest.fail("the block must not run")
    (tmp_path / "file").write_text("mine")
    with pytest.raises(FileError, match="not an empty folder"), atomic_folder(tmp_path / "file"):
        pytest.fail("the block must not run")
    assert (tmp_path / "stack" / "mine").read_text() == (tmp_path / "file").read_text() == "mine"


def test_filled_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    """Somebody else made the folder while this one was written: theirs stays."""
    with pytest.raises(FileError, match="cannot be written"):
        _write(tmp_path / "stack", meanwhile=tmp_path / "stack" / "b")
    assert [file.name for file in tmp_path.rglob("*")] == ["stack", "b"]


def test_no_folder_above(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"), atomic_folder(tmp_path / "nowhere" / "stack"):
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

    with pytest.raises(KeyError, match="b"):
        adds(failing=True)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"mine": "mine", "a": "of last time"}
    adds(failing=False)
    assert {file.name for file in tmp_path.iterdir()} == {"mine", "a", "sub"}
    assert (tmp_path / "a").read_text() == "a"
    with atomic_folder(tmp_path / "new", add=True):
        pass
    assert (tmp_path / "new").is_dir()
