"""The table of optics formats, and the choice of a format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from raising import raises

from photosite.errors import FileError, InputError
from photosite.optics.io.formats import FORMATS, load_lens_design, read
from photosite.optics.tables import PsfTable

AXIS = np.arange(-8, 9) * 0.5
GAUSS = np.exp(-(AXIS[:, None] ** 2 + AXIS**2) / 2)
TABLE = PsfTable(np.array([550.0]), GAUSS[None] / GAUSS.sum(), 0.5)


def test_each_kind_of_value_has_one_format_of_a_name() -> None:
    names = [(entry.holds, entry.name) for entry in FORMATS]
    assert len(set(names)) == len(names)


def test_a_written_table_is_read_by_the_same_format(tmp_path: Path) -> None:
    entry = next(entry for entry in FORMATS if (entry.holds, entry.name) == ("PSFs", "npz"))
    assert entry.write is not None
    entry.write(TABLE, tmp_path / "a.npz")
    found = read("PSFs", "a.npz", folder=tmp_path)
    np.testing.assert_array_equal(found.samples, TABLE.samples)


def test_options_that_a_format_does_not_have(tmp_path: Path) -> None:
    with raises(InputError, "unknown option 'ranks'"):
        load_lens_design(tmp_path, ranks=3)
    with raises(FileError, "first_row"):
        load_lens_design(tmp_path / "a.npz", first_row="top")


def test_unknown_suffix(tmp_path: Path) -> None:
    with raises(FileError, "suffix", value=".mat"):
        read("PSFs", tmp_path / "a.mat")
