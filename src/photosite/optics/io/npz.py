"""Arrays of a lens that lie beside its optics file: a pupil's amplitude, point spreads over the field."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.optics.lens_design import LensDesign

DESIGN = ("wavelength_nm", "psf", "spacing_um", "field_y", "field_x", "unit")
"""Fields of a `LensDesign` that an array file holds; what is said of the sum stands in the optics file."""


def read_amplitude(path: Path) -> NDArray[np.float64]:
    """A pupil's amplitude transmission, see `photosite.optics.pupil.Pupil`.

    Raises
    ------
    FileError
        If the file is missing, damaged, or holds no such array.
    """
    return real_numbers(path, "amplitude", read_arrays(path, ("amplitude",))["amplitude"])


def read_design(path: Path, **options: Any) -> LensDesign:
    """Point spreads over the field, as `write_design` lays them down.

    Parameters
    ----------
    path
        The file.
    **options
        `symmetric`, `tolerance`, `rank`, `detail_um` and `nodes` of `LensDesign`.

    Raises
    ------
    FileError
        If the file is missing, damaged, or holds what cannot be.
    """
    found = read_arrays(path, DESIGN)
    if "first_row" in options:
        raise FileError(path, "has its first row on top; first_row is for the listings of a lens-design program")
    fields: dict[str, Any] = {name: real_numbers(path, name, found[name]) for name in DESIGN[:-1]}
    if fields["spacing_um"].size != 1:
        raise FileError(path, f"spacing_um is one number, not {fields['spacing_um'].size}")
    if (unit := str(found["unit"])) not in ("mm", "deg"):
        raise FileError(path, f"unit is 'mm' or 'deg', not '{unit:.20}'")
    fields |= {"spacing_um": fields["spacing_um"].item(), "unit": unit, **options}
    try:
        return LensDesign(**fields)
    except (InputError, TypeError, ValueError) as error:
        raise FileError(path, str(error)) from None


def write_design(design: LensDesign, path: Path) -> None:
    """The fields `DESIGN` of a lens design."""
    arrays: dict[str, Any] = {name: np.asarray(getattr(design, name)) for name in DESIGN}
    np.savez(path, **arrays)


def write_amplitude(amplitude: NDArray[np.float64], path: Path) -> None:
    """A pupil's array."""
    np.savez(path, amplitude=amplitude)


def read_arrays(path: Path, names: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, NDArray[Any]]:
    """Arrays of an .npz archive by name.

    Parameters
    ----------
    path
        The file.
    names, optional
        Those that must be in it, and those that may be.

    Raises
    ------
    FileError
        If it is missing, damaged, or lacks one.
    """
    if not os.path.isfile(path):  # False for a name that no file can have, where pathlib raises
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
        raise FileError(path, "cannot be read: it says it is larger than memory") from None
    except Exception:  # NumPy and zipfile raise many kinds at a damaged file, and advise to load it unsafely
        raise FileError(path, "cannot be read: it is no .npz archive of numbers, or damaged") from None


def real_numbers(path: Path, name: str, values: object) -> NDArray[np.float64]:
    """An array of a file as floats.

    Raises
    ------
    FileError
        If it holds none, or what is no real number.
    """
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
        raise FileError(path, f"'{name}' holds no real numbers")
    if not values.size:
        raise FileError(path, f"'{name}' is empty")
    return values.astype(np.float64)
