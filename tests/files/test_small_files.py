"""Files that are not what they seem: pipes, devices, holes."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from raising import raises

from photosite.errors import FileError
from photosite.files.small_files import check_stored_file, parse_json, read_small

GIGABYTE = 1 << 30


def _with_hole(path: Path, size: int) -> Path:
    with path.open("wb") as file:
        file.write(b"data")
        file.truncate(size)
    if size >= GIGABYTE and path.stat().st_blocks * 512 > size // 2:
        pytest.skip("the file system has no holes")
    return path


def test_folders_pipes_sockets_and_devices_are_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the name of a socket is short
    os.mkfifo("pipe")
    listener = socket.socket(socket.AF_UNIX)
    listener.bind("socket")
    Path("link").symlink_to("/dev/zero")
    for name, kind in (
        (".", "folder"),
        ("pipe", "pipe"),
        ("socket", "socket"),
        ("/dev/zero", "device"),
        ("link", "dev"),
    ):
        with pytest.raises(FileError) as caught:
            check_stored_file(name)
        assert kind in caught.value.what
    listener.close()


@pytest.mark.parametrize("name", ["gone", "a\0b", "n" * 5000])
def test_names_without_a_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError):
        check_stored_file(tmp_path / name)


def test_gigabytes_of_holes_are_no_file(tmp_path: Path) -> None:
    """A hole of less than a gigabyte is read: file systems that compress store long zeros in few blocks."""
    check_stored_file(_with_hole(tmp_path / "small", GIGABYTE))
    with pytest.raises(FileError) as caught:
        check_stored_file(_with_hole(tmp_path / "large", 100 * GIGABYTE))
    assert "holes" in caught.value.what


def test_a_small_file_is_not_read_beyond_its_limit(tmp_path: Path) -> None:
    assert read_small(_with_hole(tmp_path / "a", 100), "a text", 100)[:4] == b"data"
    with pytest.raises(FileError):
        read_small(_with_hole(tmp_path / "a", 101), "a text", 100)


@pytest.mark.parametrize(
    ("content", "line", "reason"),
    [
        (b'{\n"a": [1 2]}', 2, "expecting ',' delimiter"),
        (b"", 1, "expecting value"),
        (b'{"a": "\xff"}', None, "UTF-8"),
        (b"[" * 200_000, None, "nested"),
        (b"9" * 5000, None, "digits"),
    ],
)
def test_content_that_is_not_json(content: bytes, line: int | None, reason: str) -> None:
    with raises(FileError, "the file is not JSON: ", path="a.json", line=line) as caught:
        parse_json(content, "a.json")
    assert reason in caught.value.what
