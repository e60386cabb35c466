"""The cache of computed arrays: nothing is computed twice, and no file or folder can spoil a result."""

from __future__ import annotations

import multiprocessing
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from photosite.files import cache
from photosite.files.cache import Arrays, cached_arrays, content_digest
from photosite.values.read_only import ReadOnly


class Squares:
    """Computes squares, and counts how often."""

    def __init__(self, count: int = 100) -> None:
        self.count, self.calls = count, 0

    def __call__(self) -> Arrays:
        self.calls += 1
        return {"squares": np.arange(self.count) ** 2, "whole": np.array(2.5)}

    def cached(self, **options: Any) -> Arrays:
        return cached_arrays("squares", (self.count,), self, **options)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def only_file(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_second_call_reads_the_same_bits(folder: Path) -> None:
    squares = Squares()
    first, second = squares.cached(), squares.cached()
    assert squares.calls == 1
    assert first.keys() == second.keys()
    for name, values in first.items():
        assert values.dtype == second[name].dtype
        assert values.shape == second[name].shape
        assert values.tobytes() == second[name].tobytes()


def test_other_inputs_or_name_are_another_entry(folder: Path) -> None:
    squares = Squares()
    for name, inputs in (("squares", (1,)), ("squares", (1.0,)), ("squares", ("1",)), ("roots", (1,))):
        cached_arrays(name, inputs, squares)
    assert squares.calls == len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("content", [b"", b"not an entry", b"PK\x03\x04" + bytes(500)])
def test_foreign_file_is_replaced(folder: Path, content: bytes) -> None:
    squares = Squares()
    squares.cached()
    path = only_file(folder)
    whole = path.read_bytes()
    path.write_bytes(content)
    assert (squares.cached()["squares"] == np.arange(100) ** 2).all()
    assert squares.calls == 2
    assert path.read_bytes() == whole


def test_every_damage_is_found(folder: Path) -> None:
    squares = Squares()
    squares.cached()
    path = only_file(folder)
    whole = path.read_bytes()
    cut = [whole[:size] for size in range(0, len(whole), 97)]
    changed = [whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :] for at in range(0, len(whole), 97)]
    for calls, damaged in enumerate(cut + changed, 2):
        path.write_bytes(damaged)
        assert (squares.cached()["squares"] == np.arange(100) ** 2).all()
        assert squares.calls == calls


def test_entry_of_another_key_is_not_used(folder: Path) -> None:
    few, many = Squares(10), Squares(20)
    few.cached()
    other = only_file(folder)
    many.cached()
    (own,) = set(folder.iterdir()) - {other}
    shutil.copy(other, own)
    assert many.cached()["squares"].size == 20
    assert many.calls == 2


def test_off_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.CACHE_VARIABLE, "off")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    squares = Squares()
    squares.cached()
    squares.cached()
    assert squares.calls == 2
    assert not list(tmp_path.iterdir())


def test_default_folder_follows_the_platform(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(cache.CACHE_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    Squares().cached()
    assert only_file(tmp_path / "photosite" / "arrays").is_file()


def test_folder_that_cannot_be_written_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path / "file" / "cache"))
    squares = Squares()
    assert squares.cached()["squares"].size == squares.cached()["squares"].size == 100
    assert squares.calls == 2


def _write_where_files_may_not_grow() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))  # writing fails as on a full disk
    squares = Squares()
    assert squares.cached()["squares"].size == squares.cached()["squares"].size == 100
    assert squares.calls == 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs limits of a process")
def test_failed_write_is_no_error_and_leaves_nothing(folder: Path) -> None:
    worker = multiprocessing.get_context("fork").Process(target=_write_where_files_may_not_grow)
    worker.start()
    worker.join(30)
    assert worker.exitcode == 0
    assert not list(folder.iterdir())


def test_device_in_place_of_an_entry_is_not_read(folder: Path) -> None:
    squares = Squares()
    squares.cached()
    path = only_file(folder)
    path.unlink()
    path.symlink_to("/dev/zero")
    squares.cached()
    assert squares.cached()["squares"].size == 100
    assert squares.calls == 2


def test_least_recently_used_entries_go_first(folder: Path) -> None:
    parts = [Squares(1000 + n) for n in range(4)]
    for age, part in enumerate(parts[:3]):
        before = set(folder.iterdir()) if folder.exists() else set()
        part.cached()
        (path,) = set(folder.iterdir()) - before
        os.utime(path, (1e9 + age, 1e9 + age))
    parts[0].cached()  # used again
    size = path.stat().st_size
    parts[3].cached(largest_bytes=3 * size + 100)
    for part in parts:
        part.cached()
    assert [part.calls for part in parts] == [1, 2, 1, 1]


def test_entry_larger_than_the_cache_is_not_written(folder: Path) -> None:
    Squares(1000).cached(largest_bytes=4000)
    assert not folder.exists() or not list(folder.iterdir())


def test_files_left_behind_are_removed(folder: Path) -> None:
    Squares(1).cached()
    old, new = folder / ".squares-old.arrays", folder / ".squares-new.arrays"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (1e9, 1e9))
    Squares(2).cached()
    assert new.exists()
    assert not old.exists()


def _write_often(folder: str, rounds: int) -> None:
    os.environ[cache.CACHE_VARIABLE] = folder
    for number in range(rounds):
        squares = Squares(2000 + number % 5)
        assert (squares.cached(largest_bytes=60_000)["squares"] == np.arange(squares.count) ** 2).all()


def test_writers_at_the_same_time(folder: Path) -> None:
    """Four processes write and remove the same entries; none reads a half-written one."""
    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=_write_often, args=(str(folder), 60)) for _ in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
    assert [worker.exitcode for worker in workers] == [0] * 4
    assert sum(path.stat().st_size for path in folder.iterdir()) <= 60_000


# Keys: equal for equal content, different for any difference, and none where content cannot be known.


def test_content_of_arrays() -> None:
    values = np.arange(6.0).reshape(2, 3)
    assert content_digest(values) == content_digest(np.asfortranarray(values))
    others = [values.ravel(), values.astype(np.float32), values.T, values + 1e-16 * (values == 0), -values]
    assert len({content_digest(values), *map(content_digest, others)}) == 1 + len(others)


def test_content_of_nested_values() -> None:
    values: list[object] = [
        (1, 2),
        (1, (2,)),
        ((1,), 2),
        [1, 2],
        "12",
        12,
        12.0,
        {"1": 2},
        ReadOnly({"1": 2, "2": 1}),
        None,
        (),
        ReadOnly,
    ]
    known = [content_digest(value) for value in values]
    assert None not in known
    assert len(set(known)) == len(known)


@dataclass
class _Foreign:
    value: float


def test_content_that_is_not_known(folder: Path) -> None:
    unknown: list[Any] = [lambda: 1, _Foreign(1.0), object(), np.array([object()]), Squares, (1, {2: {3}})]
    assert [content_digest(value) for value in unknown] == [None] * len(unknown)
    squares = Squares()
    for value in unknown:
        cached_arrays("squares", (value,), squares)
    assert squares.calls == len(unknown)
    assert not folder.exists()
