"""Spectra from CSV files."""

from __future__ import annotations

from pathlib import Path

import pytest

from photosite.color.spectrum_file import read_spectrum
from photosite.errors import FileError


def test_read_spectrum(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("# a lamp\nnm, Power, u\n400, 1.5, 0.1  # first line\n\n410,2,0.2\n")
    content = read_spectrum(file)
    assert content.spectrum.wavelength_nm.tolist() == [400.0, 410.0]
    assert content.spectrum.values.tolist() == [1.5, 2.0]
    assert content.standard_uncertainty.tolist() == [0.1, 0.2]
    assert content.columns == ("nm", "power", "u")
    file.write_text("400,1\n")
    assert read_spectrum(file).columns == ()


@pytest.mark.parametrize(
    ("text", "what", "line"),
    [
        ("", "the file holds no spectrum", None),
        ("nm,v\n", "the file holds no spectrum", None),
        ("nm,v\nnm,v\n", "line", 2),
        ("400,1\n390,2\n", "wavelength", 2),
        ("400,1\n410,nan\n", "line", 2),
        ("400,1\n410,2,3\n", "line", 2),
        ("400,1,-1\n", "standard_uncertainty", 1),
        ("-400,1\n", "wavelength_nm", None),
    ],
)
def test_invalid_spectrum_files(tmp_path: Path, text: str, what: str, line: int | None) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(FileError) as caught:
        read_spectrum(file)
    assert (caught.value.what, caught.value.line) == (what, line)


def test_missing_spectrum_file(tmp_path: Path) -> None:
    with pytest.raises(FileError):
        read_spectrum(tmp_path / "none.csv")
