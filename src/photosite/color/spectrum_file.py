"""Spectra in CSV files: a column of wavelengths, a column of values, and optionally their standard uncertainties."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError
from photosite.files.small import read_small

_LARGEST_BYTES = 1 << 22
_MOST_COLUMNS = 3


@dataclass(frozen=True, eq=False)
class SpectrumFile:
    """The content of a spectrum file.

    - `spectrum`, `standard_uncertainty`: Wavelengths and values; (wavelengths,), 0 where the file has no third column.
    - `columns`: Names of the columns in lower case; empty if the file has no heading.
    """

    spectrum: Spectrum
    standard_uncertainty: NDArray[np.float64]
    columns: tuple[str, ...]


def read_spectrum(path: str | PathLike[str]) -> SpectrumFile:
    """Read a spectrum from a CSV file.

    Parameters
    ----------
    path
        UTF-8 text, comma-separated: wavelength in nm, increasing from line to line, value, and optionally the value's
        standard uncertainty. A first line without numbers names the columns. Text after # is a comment.

    Raises
    ------
    FileError
        If the file cannot be read or has another content; with the line.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "diode.csv")
    ...     _ = file.write_text("wavelength_nm,responsivity_a_per_w\\n400, 0.12\\n500, 0.2\\n")
    ...     content = read_spectrum(file)
    >>> content.spectrum.values.tolist(), content.columns
    ([0.12, 0.2], ('wavelength_nm', 'responsivity_a_per_w'))
    """
    file = Path(path)
    rows: list[list[float]] = []
    columns: tuple[str, ...] = ()
    for number, line in enumerate(_text(file).splitlines(), start=1):
        cells = [cell.strip() for cell in line.split("#", 1)[0].split(",")]
        if cells == [""]:
            continue
        values = _numbers(cells)
        if values is None and not rows and not columns:
            columns = tuple(cell.lower() for cell in cells)
            continue
        if values is None or not 2 <= len(values) <= _MOST_COLUMNS or (rows and len(values) != len(rows[0])):
            count = f"{len(rows[0])}" if rows else "two or three"
            raise FileError(file, "line", number, value=line, expected=f"{count} finite numbers separated by commas")
        if rows and values[0] <= rows[-1][0]:
            expected = f"above {rows[-1][0]:g}, the line before"
            raise FileError(file, "wavelength", number, value=values[0], expected=expected)
        if len(values) > 2 and values[2] < 0:
            raise FileError(file, "standard_uncertainty", number, value=values[2], expected="0 or above")
        rows.append(values)
    if not rows:
        raise FileError(file, "the file holds no spectrum", hint="Write lines of wavelength in nm and value: 550, 0.31")
    table = np.array(rows)
    try:
        spectrum = Spectrum(table[:, 0], table[:, 1])
    except InputError as error:
        raise error.in_file(file) from None
    return SpectrumFile(spectrum, table[:, 2] if table.shape[1] > 2 else np.zeros(len(table)), columns)


def _text(file: Path) -> str:
    try:
        return read_small(file, "a spectrum", _LARGEST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileError(file, "the file is not UTF-8 text") from None


def _numbers(cells: list[str]) -> list[float] | None:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return None
    return values if all(map(math.isfinite, values)) else None
