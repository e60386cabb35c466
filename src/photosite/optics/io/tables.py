"""Tables of OTFs (CSV), of PSFs (npz, HDF5, TIFF stacks, matrices of text), and of pupils (npz).

What a file does not state, such as the sample spacing or the wavelength of a page, must be passed; it is never guessed.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError, InputError, in_file
from photosite.files.hdf5 import check_own_data, check_stored
from photosite.files.small_files import check_stored_file, read_small
from photosite.files.tiff_pages import decoded, pages_of
from photosite.optics.checks import number_array
from photosite.optics.lens_design import LensDesign
from photosite.optics.tables import OtfTable, PsfTable

_LARGEST_TEXT = 64 << 20
_ALWAYS_READ_VALUES = 1 << 24
"""Numbers that a file however small may hold: a compressed pupil of 4096 x 4096 samples."""
_MOST_VALUES_PER_BYTE = 8

_DESIGN_FIELDS = ("wavelength_nm", "psf", "spacing_um", "field_y", "field_x", "unit")
"""Fields of a `LensDesign` in an archive; the options of the low-rank sum are in the optics file."""


def read_amplitude(path: Path) -> NDArray[np.float64]:
    """Return the amplitude transmission of a pupil, see `Pupil`; raise `FileError` if it is missing."""
    return real_numbers(path, "amplitude", read_arrays(path, ("amplitude",))["amplitude"])


def write_amplitude(amplitude: NDArray[np.float64], path: Path) -> None:
    """Write the amplitude transmission of a pupil."""
    np.savez(path, amplitude=amplitude)


def read_design(path: Path, **options: Any) -> LensDesign:
    """Read PSFs over the field, as `write_design` writes them; the options are those of `LensDesign`.

    Raises `FileError` if the file is missing or damaged, or its content is invalid.
    """
    found = read_arrays(path, _DESIGN_FIELDS)
    fields: dict[str, Any] = {name: real_numbers(path, name, found[name]) for name in _DESIGN_FIELDS[:-1]}
    if fields["spacing_um"].size != 1:
        raise FileError(path, "spacing_um", value=fields["spacing_um"].size, expected="one number")
    fields |= {"spacing_um": fields["spacing_um"].item(), "unit": str(found["unit"]), **options}
    try:
        return LensDesign(**fields)
    except InputError as error:
        raise error.in_file(path) from None
    except (TypeError, ValueError) as error:
        raise FileError(path, str(error)) from None


def write_design(design: LensDesign, path: Path) -> None:
    """Write the PSFs and field points of a lens design."""
    arrays: dict[str, Any] = {name: np.asarray(getattr(design, name)) for name in _DESIGN_FIELDS}
    np.savez(path, **arrays)


def read_arrays(path: Path, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, NDArray[Any]]:
    """Return required and optional arrays of an .npz archive; raise `FileError` if it lacks one, or is damaged."""
    if not os.path.isfile(path):  # False for an invalid name, for which pathlib raises
        raise FileError(path, "no such file")
    check_stored_file(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            # Stated sizes are checked before any is inflated: zipfile reads no more than these.
            _check_values(path, sum(entry.file_size for entry in archive.zip.infolist()) // 8)
            missing = [name for name in names if name not in archive]
            if missing:
                raise FileError(path, f"holds no array '{missing[0]}', but {', '.join(archive.files) or 'nothing'}")
            return {name: archive[name] for name in (*names, *(name for name in optional if name in archive))}
    except FileError:
        raise
    except MemoryError:
        raise FileError(path, "cannot be read: it declares more data than fits in memory") from None
    except Exception:  # NumPy and zipfile raise many types for a damaged file, and NumPy recommends unsafe loading
        raise FileError(path, "cannot be read: it is not an .npz archive of numbers, or is damaged") from None


def _check_values(path: Path, count: int) -> None:
    """Check that a file does not hold far more numbers than its size lets expect."""
    size = os.path.getsize(path)
    if count > max(_ALWAYS_READ_VALUES, _MOST_VALUES_PER_BYTE * size):
        expected = f"at most {_ALWAYS_READ_VALUES} in a file of {size} bytes"
        raise FileError(path, "numbers", value=count, expected=expected, hint="Save them at lower resolution")


def real_numbers(path: Path, name: str, values: object) -> NDArray[np.float64]:
    """Return an array of a file as floats; raise `FileError` if it is empty or does not hold real numbers."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu" or not values.size:
        kind = f"{values.dtype}, shape {values.shape}" if isinstance(values, np.ndarray) else type(values).__name__
        raise FileError(path, name, value=kind, expected="an array of real numbers")
    return values.astype(np.float64)


Array = NDArray[np.float64]

_RADIAL = "frequency_per_mm"
_PLANE = ("wavelength_nm", "fy_per_mm", "fx_per_mm", "real", "imag")
"""First column of a radial OTF table, and columns of a 2-D one."""


def load_otf_table(path: str | PathLike[str], beyond: Literal["zero", "diffraction"] = "zero") -> OtfTable:
    """Read a table of OTFs from a CSV file.

    Parameters
    ----------
    path
        Radial tables: a header `frequency_per_mm, 450, 550, 650` (wavelengths in nm), then lines of a frequency and its
        MTF at each. 2-D tables: columns `wavelength_nm, fy_per_mm, fx_per_mm, real, imag` in any order, one line for
        each point of a full grid. Lines that begin with # are comments. Semicolons may replace the commas, and then
        commas the decimal points.
    beyond
        See `OtfTable`.

    Raises
    ------
    FileError
        If the file is missing or damaged, or its content is invalid; with the line if known.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = Path(folder.name) / "mtf.csv"
    >>> _ = path.write_text("frequency_per_mm, 450, 650\\n0, 1, 1\\n40, 0.7, 0.6\\n200, 0, 0\\n")
    >>> load_otf_table(path).values
    array([[1. , 0.7, 0. ],
           [1. , 0.6, 0. ]])
    """
    lines = _lines(path)
    number, header = lines[0]
    names = [name.strip() for name in header]
    if names[0] != _RADIAL and sorted(names) != sorted(_PLANE):
        expected = f"'{_RADIAL}' and wavelengths in nm, or '{', '.join(_PLANE)}'"
        raise FileError(path, "the header", number, value=", ".join(names), expected=expected)
    wavelengths = [_wavelength(path, number, name) for name in names[1:]] if names[0] == _RADIAL else []
    rows = np.array([_numbers(path, line, row, len(names)) for line, row in lines[1:]]).reshape(-1, len(names))
    with in_file(path):
        if names[0] == _RADIAL:
            return OtfTable(np.array(wavelengths), rows[:, 0], rows[:, 1:].T, beyond=beyond)
        return _plane_table(path, {name: rows[:, k] for k, name in enumerate(names)}, beyond)


def write_otf(table: OtfTable, path: Path) -> None:
    """Write a table of OTFs that `load_otf_table` reads."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        write = csv.writer(stream).writerow
        waves, down = table.wavelength_nm.tolist(), table.frequency_per_mm.tolist()
        if table.fx_per_mm is None:
            write([_RADIAL, *waves])
            for frequency, row in zip(down, np.real(table.values).T.tolist(), strict=True):
                write([frequency, *row])
            return
        write(_PLANE)
        for k, i, j in np.ndindex(table.values.shape):
            value = complex(table.values[k, i, j])
            write([waves[k], down[i], float(table.fx_per_mm[j]), value.real, value.imag])


def read_psf(
    path: Path,
    load: Callable[[Path], Mapping[str, Any]],
    *,
    spacing_um: float | None = None,
    wavelength_nm: ArrayLike | None = None,
    normalize: bool = False,
) -> PsfTable:
    """Read a table of PSFs.

    Parameters
    ----------
    path
        The file.
    load
        Reader of the format: path -> arrays by name, with "psf" and, if the file states them, "spacing_um" and
        "wavelength_nm".
    spacing_um, wavelength_nm
        What the file does not state; an error if the file states another value.
    normalize
        See `PsfTable`.

    Raises
    ------
    FileError
        If the file is missing or damaged, lacks its spacing or wavelengths, or its content is invalid.
    """
    check_stored_file(path)
    try:
        found = load(path)
    except (FileError, InputError):
        raise
    except MemoryError:
        raise FileError(path, "cannot be read: it declares more data than fits in memory") from None
    except Exception as error:  # libraries raise many types for a damaged file
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(path, f"cannot be read: {reason[:200]}") from None
    spacing = _stated(path, "spacing_um", found, spacing_um)
    grid = _stated(path, "wavelength_nm", found, wavelength_nm)
    samples = real_numbers(path, "psf", np.asarray(found["psf"]))
    if spacing.size != 1:
        raise FileError(path, "spacing_um", value=spacing.tolist(), expected="one number")
    with in_file(path):
        return PsfTable(grid, samples[None] if samples.ndim == 2 else samples, float(spacing[0]), normalize)


def write_psf(table: PsfTable, path: Path) -> None:
    """Write a table of PSFs as an .npz archive."""
    np.savez(path, psf=table.samples, spacing_um=float(table.spacing_um), wavelength_nm=table.wavelength_nm)


def _stated(path: Path, name: str, found: Mapping[str, Any], given: ArrayLike | None) -> Array:
    """Return a quantity that the file or the caller states; both may state the same value."""
    if found.get(name) is None and given is None:
        example = {name: 0.5 if name == "spacing_um" else 550}
        raise FileError(path, f"does not state its {name}", hint=f"Pass {{{name}}}", arguments=example)
    own = None if found.get(name) is None else np.atleast_1d(real_numbers(path, name, np.asarray(found[name])))
    if given is None:
        assert own is not None
        return own
    with in_file(path):
        passed = number_array(name, given)
    if own is not None and not (passed.shape == own.shape and np.allclose(passed, own, rtol=1e-6)):
        raise FileError(path, name, value=passed.tolist(), expected=f"{own.tolist()}, as the file states, or omitted")
    return passed


def load_npz(path: Path) -> dict[str, Any]:
    """Return the arrays of an .npz archive."""
    return dict(read_arrays(path, ("psf",), ("spacing_um", "wavelength_nm")))


def load_hdf5(path: Path) -> dict[str, Any]:
    """Return the data sets of an HDF5 file; spacing and wavelengths may be attributes of the file or of `psf`."""
    import h5py

    with h5py.File(path, "r") as file:
        check_own_data(path, file)
        psf = file.get("psf")
        if not isinstance(psf, h5py.Dataset):
            raise FileError(path, f"holds no data set 'psf', but {', '.join(file) or 'nothing'}")
        check_stored(path, psf)
        _check_values(path, psf.size)
        found: dict[str, Any] = {"psf": psf[()]}
        for name in ("spacing_um", "wavelength_nm"):
            for place in (file, file.attrs, psf.attrs):
                if name in place:
                    value = place[name]
                    found[name] = value[()] if isinstance(value, h5py.Dataset) else value
                    break
        return found


def load_tiff(path: Path) -> dict[str, Any]:
    """Return the pages of a TIFF stack, one wavelength each."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        found = pages_of(path, file)
        _check_values(path, sum(page.size for page in found))
        pages = [decoded(path, page) for page in found]
    if not pages or any(page.ndim != 2 or page.shape != pages[0].shape for page in pages):
        raise FileError(path, "pages", expected="gray and of equal size, one page for each wavelength")
    return {"psf": np.stack(pages)}


def load_text(path: Path) -> dict[str, Any]:
    """Return a matrix of numbers."""
    rows: list[list[float]] = []
    for number, row in _lines(path):
        entries = row if len(row) > 1 else row[0].split()
        rows.append(_numbers(path, number, entries, len(rows[0]) if rows else None))
    return {"psf": np.array(rows)}


def _lines(path: str | PathLike[str]) -> list[tuple[int, list[str]]]:
    """Return line numbers and entries of the lines that are neither empty nor comments."""
    try:
        text = read_small(path, "a table of numbers", _LARGEST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FileError(path, "is not text in UTF-8") from None
    numbered = enumerate(text.splitlines(), start=1)
    lines = [(number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise FileError(path, "is empty")
    separator = ";" if ";" in lines[0][1] else ","
    if separator == ";" and not any("." in line for _, line in lines):  # with points, commas would be ambiguous
        lines = [(number, line.replace(",", ".")) for number, line in lines]
    return [(number, next(csv.reader([line], delimiter=separator, skipinitialspace=True))) for number, line in lines]


def _numbers(path: str | PathLike[str], line: int, row: list[str], count: int | None) -> list[float]:
    if count is not None and len(row) != count:
        raise FileError(path, "entries in this line", line, value=len(row), expected=str(count))
    values = []
    for entry in row:
        try:
            values.append(float(entry))
        except ValueError:
            raise FileError(path, "entry", line, value=entry.strip(), expected="a number") from None
        if not math.isfinite(values[-1]):
            raise FileError(path, "entry", line, value=entry.strip(), expected="a finite number")
    return values


def _wavelength(path: str | PathLike[str], line: int, name: str) -> float:
    try:
        return float(name.removesuffix("nm"))
    except ValueError:
        raise FileError(path, "column name", line, value=name, expected="a wavelength in nm") from None


def _plane_table(
    path: str | PathLike[str], columns: Mapping[str, Array], beyond: Literal["zero", "diffraction"]
) -> OtfTable:
    axes, indices = zip(*(np.unique(columns[name], return_inverse=True) for name in _PLANE[:3]), strict=True)
    shape = tuple(axis.size for axis in axes)
    values = np.full(shape, np.nan, np.complex128)
    if columns["real"].size == math.prod(shape):
        values[indices] = columns["real"] + 1j * columns["imag"]
    if np.isnan(values).any():
        expected = f"one for each point of the grid of {' x '.join(map(str, shape))}"
        raise FileError(path, "entries", value=columns["real"].size, expected=expected)
    return OtfTable(axes[0], axes[1], values, fx_per_mm=axes[2], beyond=beyond)
