"""HDF5 files whose writing fails: libhdf5 would end the process."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from photosite.files.hdf5 import create_hdf5

VALUES = np.arange(1600.0).reshape(40, 40)


def write(path: Path) -> None:
    with create_hdf5(path) as file:
        for number in range(4):
            packed = {"chunks": (4, 40), "compression": "gzip"} if number % 2 else {}
            data = file.create_dataset(f"group{number}/a", data=VALUES, **packed)
            data.attrs["unit"] = "DN" * 100
            file.flush()
            assert data.shape == VALUES.shape


def test_the_content_is_that_of_h5py(tmp_path: Path) -> None:
    write(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert (file["group0/a"][()] == VALUES).all()
        assert (file["group3/a"][()] == VALUES).all()
        assert file["group3/a"].attrs["unit"] == "DN" * 100


@pytest.mark.parametrize(
    ("failure", "later"),
    [(OSError(errno.ENOSPC, "full"), True), (OSError(errno.EIO, "broken"), False), (KeyboardInterrupt(), False)],
)
def test_any_write_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException, later: bool) -> None:
    """The n-th write for every n, once or from then on: the error is raised, and the process goes on."""
    pwrite, made, allowed = os.pwrite, 0, 1 << 20

    def fails(handle: int, content: memoryview, place: int) -> int:
        nonlocal made
        made += 1
        if made == allowed + 1 or (later and made > allowed):
            raise failure
        return pwrite(handle, content, place)

    monkeypatch.setattr(os, "pwrite", fails)
    write(tmp_path / "a.h5")
    count = made
    assert count > 50
    for number in range(count):
        made, allowed = 0, number
        with pytest.raises(type(failure)) as caught:
            write(tmp_path / "a.h5")
        assert caught.value is failure
    made, allowed = 0, count
    write(tmp_path / "a.h5")


def test_a_short_write_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pwrite = os.pwrite
    monkeypatch.setattr(os, "pwrite", lambda handle, content, place: pwrite(handle, content[:100], place))
    write(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        assert (file["group0/a"][()] == VALUES).all()


def test_an_error_of_the_writer_is_raised(tmp_path: Path) -> None:
    def stops() -> None:
        with create_hdf5(tmp_path / "a.h5"):
            raise ValueError("mine")

    with pytest.raises(ValueError, match="mine"):
        stops()
