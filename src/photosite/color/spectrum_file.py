"""Spectra in CSV files: a column of wavelengths, a column of values, and perhaps one of their uncertainties."""

from __future__ import annotations

import math
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError
from photosite.files.small import read_small

_LARGEST_BYTES = 1 << 22
_MOST_COLUMNS = 3


def read_spectrum(path: str | PathLike[str]) -> tuple[Spectrum, NDArray[np.float64]]:
    """A spectrum from a CSV file.

    Parameters
    ----------
    path
        Text in UTF-8: wavelength in nm, rising from line to line, value, and perhaps its standard uncertainty, with
        commas between. A first line without numbers names the columns; what follows a # is a note.

    Returns
    -------
    tuple
        The spectrum, and its standard uncertainties, (wavelengths,), 0 where the file has none.

    Raises
    ------
    FileError
        If the file cannot be read or holds something else; with the line.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "diode.csv")
    ...     _ = file.write_text("wavelength_nm,responsivity_a_per_w\\n400, 0.12\\n500, 0.2\\n")
    ...     spectrum, uncertainty = read_spectrum(file)
    >>> spectrum.values.tolist(), uncertainty.tolist()
    ([0.12, 0.2], [0.0, 0.0])
    """
    file = Path(path)
    rows: list[list[float]] = []
    first = 0
    for number, line in enumerate(_text(file).splitlines(), start=1):
        cells = [cell.strip() for cell in line.split("#", 1)[0].split(",")]
        if cells == [""]:
            continue
        values = _numbers(cells)
        if values is None and not rows and not first:
            first = number  # the heading
            continue
        if values is None or not 2 <= len(values) <= _MOST_COLUMNS or (rows and len(values) != len(rows[0])):
            columns = f"{len(rows[0])}" if rows else "two or three"
            raise FileError(file, f"expected {columns} finite numbers with commas between, got {line!r:.60}", number)
        if rows and values[0] <= rows[-1][0]:
            raise FileError(file, f"wavelengths rise from line to line; {values[0]:g} follows {rows[-1][0]:g}", number)
        if len(values) > 2 and values[2] < 0:
            raise FileError(file, f"a standard uncertainty is 0 or above, not {values[2]:g}", number)
        rows.append(values)
    if not rows:
        raise FileError(file, "holds no spectrum: expected lines of wavelength in nm and value, as in '550, 0.31'")
    table = np.array(rows)
    try:
        spectrum = Spectrum(table[:, 0], table[:, 1])
    except InputError as error:
        raise FileError(file, str(error)) from None
    return spectrum, table[:, 2] if table.shape[1] > 2 else np.zeros(len(table))


def read_heading(path: str | PathLike[str]) -> tuple[str, ...]:
    """The names of the columns of a CSV file with a spectrum, in lower case; none where it has no heading.

    Parameters
    ----------
    path
        As for `read_spectrum`.

    Raises
    ------
    FileError
        If the file cannot be read.
    """
    for line in _text(Path(path)).splitlines():
        cells = [cell.strip() for cell in line.split("#", 1)[0].split(",")]
        if cells != [""]:
            return () if _numbers(cells) is not None else tuple(cell.lower() for cell in cells)
    return ()


def _text(file: Path) -> str:
    try:
        return read_small(file, "a spectrum", _LARGEST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileError(file, "is no spectrum: it is not text in UTF-8") from None


def _numbers(cells: list[str]) -> list[float] | None:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        return None
    return values if all(map(math.isfinite, values)) else None
