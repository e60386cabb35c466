"""NumPy archives: arrays by name, pupil amplitudes, and PSFs over the field."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.optics.lens_design import LensDesign

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
    try:
        with np.load(path, allow_pickle=False) as archive:
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


def real_numbers(path: Path, name: str, values: object) -> NDArray[np.float64]:
    """Return an array of a file as floats; raise `FileError` if it is empty or does not hold real numbers."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu" or not values.size:
        kind = f"{values.dtype}, shape {values.shape}" if isinstance(values, np.ndarray) else type(values).__name__
        raise FileError(path, name, value=kind, expected="an array of real numbers")
    return values.astype(np.float64)
