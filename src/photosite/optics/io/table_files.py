"""Tables of transfer functions and point spreads from files: CSV, npz, HDF5, TIFF stacks and matrices of text.

What a file does not say, the spacing of samples or a page's wavelength, is asked for, never guessed.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError, InputError
from photosite.optics.io.npz import read_arrays, real_numbers
from photosite.optics.radial_table import numbers
from photosite.optics.tables import OtfTable, PsfTable

Array = NDArray[np.float64]

RADIAL = "frequency_per_mm"
PLANE = ("wavelength_nm", "fy_per_mm", "fx_per_mm", "real", "imag")
"""First column of a radial table, and columns of a 2-D one."""
_HDF5 = (".h5", ".hdf5")
_TIFF = (".tif", ".tiff")
_TEXT = (".txt", ".csv", ".dat")


def read_otf_table(path: str | PathLike[str], beyond: Literal["zero", "diffraction"] = "zero") -> OtfTable:
    """A table of transfer functions from a CSV file.

    Parameters
    ----------
    path
        Either a first line `frequency_per_mm, 450, 550, 650` (wavelengths in nm) and lines of a frequency and its MTF
        at each; or columns `wavelength_nm, fy_per_mm, fx_per_mm, real, imag` in any order, one line for each entry of
        a full grid. Lines that begin with # are comments.
        Semicolons may stand for the commas, and then commas for the decimal points.
    beyond
        See `OtfTable`.

    Raises
    ------
    FileError
        If the file is missing, damaged or says what cannot be, with the line where there is one.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = Path(folder.name) / "mtf.csv"
    >>> _ = path.write_text("frequency_per_mm, 450, 650\\n0, 1, 1\\n40, 0.7, 0.6\\n200, 0, 0\\n")
    >>> read_otf_table(path).values
    array([[1. , 0.7, 0. ],
           [1. , 0.6, 0. ]])
    """
    lines = _lines(path)
    number, header = lines[0]
    names = [name.strip() for name in header]
    try:
        if names[0] == RADIAL:
            wavelengths = np.array([_wavelength(path, number, name) for name in names[1:]])
            rows = np.array([_numbers(path, line, row, names) for line, row in lines[1:]]).reshape(-1, len(names))
            return OtfTable(wavelengths, rows[:, 0], rows[:, 1:].T, beyond=beyond)
        if sorted(names) == sorted(PLANE):
            rows = np.array([_numbers(path, line, row, names) for line, row in lines[1:]]).reshape(-1, len(names))
            return _plane_table(path, {name: rows[:, k] for k, name in enumerate(names)}, beyond)
    except InputError as error:
        raise FileError(path, str(error)) from None
    raise FileError(
        path,
        f"the first line names the columns: '{RADIAL}' and wavelengths in nm, or '{', '.join(PLANE)}'; "
        f"here it is '{', '.join(names)[:80]}'",
        number,
    )


def read_psf_table(
    path: str | PathLike[str],
    *,
    spacing_um: float | None = None,
    wavelength_nm: ArrayLike | None = None,
    normalise: bool = False,
) -> PsfTable:
    """A table of point spreads from a file.

    Parameters
    ----------
    path
        .npz or HDF5 with `psf` (L, n, n) or (n, n), `spacing_um` and `wavelength_nm` (in HDF5, the two may be
        attributes of the file or of `psf`); a TIFF stack, a page for each wavelength; a matrix of numbers as text
        (.txt, .csv, .dat), one wavelength.
    spacing_um, wavelength_nm
        What the file does not say. Where it does and another value is given, that is an error.
    normalise
        See `PsfTable`.

    Raises
    ------
    FileError
        If the file is missing, damaged, does not say its spacing or wavelengths, or says what cannot be.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = Path(folder.name) / "psf.npz"
    >>> x = np.arange(-8, 9) * 0.5
    >>> gauss = np.exp(-(x[:, None] ** 2 + x**2) / 2) / (8 * np.pi)
    >>> np.savez(path, psf=gauss, spacing_um=0.5, wavelength_nm=550.0)
    >>> read_psf_table(path, normalise=True).samples.shape
    (1, 17, 17)
    """
    suffix = Path(path).suffix.lower()
    readers = {**dict.fromkeys(_HDF5, _hdf5), **dict.fromkeys(_TIFF, _tiff), **dict.fromkeys(_TEXT, _text)}
    readers[".npz"] = _npz
    if suffix not in readers:
        raise FileError(path, f"point spreads are read from {', '.join(sorted(readers))}, not from '{suffix}'")
    if not os.path.isfile(path):
        raise FileError(path, "no such file")
    try:
        found = readers[suffix](path)
    except (FileError, InputError):
        raise
    except MemoryError:
        raise FileError(path, "cannot be read: it says it is larger than memory") from None
    except Exception as error:  # libraries raise many kinds at a damaged file
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read: {reason[:200]}") from None
    spacing = _said(path, "spacing_um", found, spacing_um)
    grid = _said(path, "wavelength_nm", found, wavelength_nm)
    try:
        samples = real_numbers(Path(path), "psf", np.asarray(found["psf"]))
        if spacing.size != 1:
            raise InputError(f"spacing_um is one number, not {spacing.size}")
        return PsfTable(grid, samples[None] if samples.ndim == 2 else samples, float(spacing[0]), normalise)
    except (InputError, TypeError, ValueError) as error:
        raise FileError(path, str(error)) from None


def _said(path: str | PathLike[str], name: str, found: Mapping[str, Any], given: ArrayLike | None) -> Array:
    """A quantity by the file or by the caller; both may say it if they say the same."""
    inside = found.get(name)
    if inside is None and given is None:
        raise FileError(path, f"the file does not say its {name}; give {name}=...")
    try:
        ours = None if given is None else numbers(name, given)
        own = None if inside is None else np.atleast_1d(real_numbers(Path(path), name, np.asarray(inside)))
    except InputError as error:
        raise FileError(path, str(error)) from None
    if ours is not None and own is not None and not (ours.shape == own.shape and np.allclose(ours, own, rtol=1e-6)):
        raise FileError(path, f"the file says {name} {own.tolist()}, the call {ours.tolist()}: leave out the latter")
    result = ours if own is None else own
    assert result is not None
    return result


def _npz(path: str | PathLike[str]) -> dict[str, Any]:
    return dict(read_arrays(Path(path), ("psf",), ("spacing_um", "wavelength_nm")))


def _hdf5(path: str | PathLike[str]) -> dict[str, Any]:
    import h5py

    with h5py.File(path, "r") as file:
        psf = file.get("psf")
        if not isinstance(psf, h5py.Dataset):
            raise FileError(path, f"holds no data set 'psf', but {', '.join(file) or 'nothing'}")
        found: dict[str, Any] = {"psf": psf[()]}
        for name in ("spacing_um", "wavelength_nm"):
            for place in (file, file.attrs, psf.attrs):
                if name in place:
                    value = place[name]
                    found[name] = value[()] if isinstance(value, h5py.Dataset) else value
                    break
        return found


def _tiff(path: str | PathLike[str]) -> dict[str, Any]:
    import tifffile

    with tifffile.TiffFile(path) as file:
        pages = [page.asarray() for page in file.pages]
    if not pages or any(page.ndim != 2 or page.shape != pages[0].shape for page in pages):
        raise FileError(path, "pages of a stack of point spreads are grey and of one size, a page for each wavelength")
    return {"psf": np.stack(pages)}


def _text(path: str | PathLike[str]) -> dict[str, Any]:
    rows: list[list[float]] = []
    for number, row in _lines(path):
        entries = row if len(row) > 1 else row[0].split()
        rows.append(_numbers(path, number, entries, None if not rows else ["sample"] * len(rows[0])))
    return {"psf": np.array(rows)}


def _lines(path: str | PathLike[str]) -> list[tuple[int, list[str]]]:
    """Line numbers and entries of a text file's lines that say something."""
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise FileError(path, "is not text in UTF-8: a table is a plain CSV file") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if _says_something(line)]
    if not lines:
        raise FileError(path, "is empty")
    separator = ";" if ";" in lines[0][1] else ","
    if separator == ";" and not any("." in line for _, line in lines):  # with points too, commas would be ambiguous
        lines = [(number, line.replace(",", ".")) for number, line in lines]
    return [(number, next(csv.reader([line], delimiter=separator, skipinitialspace=True))) for number, line in lines]


def _says_something(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _numbers(path: str | PathLike[str], line: int, row: list[str], names: list[str] | None) -> list[float]:
    if names is not None and len(row) != len(names):
        raise FileError(path, f"has {len(row)} entries where {len(names)} are expected", line)
    values = []
    for entry in row:
        try:
            values.append(float(entry))
        except ValueError:
            raise FileError(path, f"'{entry.strip()[:40]}' is not a number", line) from None
        if not math.isfinite(values[-1]):
            raise FileError(path, f"'{entry.strip()[:40]}' is not a finite number", line)
    return values


def _wavelength(path: str | PathLike[str], line: int, name: str) -> float:
    try:
        return float(name.removesuffix("nm"))
    except ValueError:
        raise FileError(
            path, f"'{name[:40]}' is not a wavelength in nm, as every column's name but the first", line
        ) from None


def _plane_table(
    path: str | PathLike[str], columns: Mapping[str, Array], beyond: Literal["zero", "diffraction"]
) -> OtfTable:
    axes, places = zip(*(np.unique(columns[name], return_inverse=True) for name in PLANE[:3]), strict=True)
    shape = tuple(axis.size for axis in axes)
    values = np.full(shape, np.nan, np.complex128)
    if columns["real"].size != math.prod(shape):
        raise FileError(path, f"{columns['real'].size} entries are no full grid of {' x '.join(map(str, shape))}")
    values[places] = columns["real"] + 1j * columns["imag"]
    if np.isnan(values).any():
        raise FileError(path, "an entry of the grid comes twice, another is missing")
    return OtfTable(axes[0], axes[1], values, fx_per_mm=axes[2], beyond=beyond)
