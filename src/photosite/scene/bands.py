"""The wavelengths of a spectral file's bands: their unit, their order, and what is refused of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError

Array = NDArray[np.float64]

_LOWEST_NM, _HIGHEST_NM = 100.0, 30_000.0
_NANOMETRES_PER = {"nm": 1.0, "um": 1e3, "m": 1e9, "angstrom": 0.1, "mm": 1e6}
_UNIT_NAMES = {
    **dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre", "nanometres"), "nm"),
    **dict.fromkeys(("um", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"), "um"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("angstrom", "angstroms", "a"), "angstrom"),
    **dict.fromkeys(("mm", "millimeter", "millimeters"), "mm"),
}


def wavelengths_in_nm(path: Path, values: ArrayLike | None, unit: str | None, wanted: ArrayLike | None) -> Array:
    """The wavelengths of a file's bands, in nm and in the bands' order.

    Parameters
    ----------
    path
        The file, for messages.
    values
        (bands,) as the file has them; None where it says nothing.
    unit
        As the file has it; None where it says nothing. Then numbers from 200 to 2600 are nanometres: no other unit
        puts those into a camera's range.
    wanted
        (bands,) nm, as the caller says them for a file that does not.

    Raises
    ------
    FileError
        If neither says them, both do and differ, the unit is missing or unknown, or they lie beyond any camera.
    """
    if values is None:
        if wanted is None:
            raise FileError(path, "does not say the wavelengths of its bands; give them in nm (wavelength_nm=[...])")
        return _checked_nm(path, np.asarray(wanted, np.float64).ravel(), "given")
    try:
        grid = np.asarray(values, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise FileError(path, "has wavelengths that are no numbers; give them in nm (wavelength_nm=[...])") from None
    if wanted is not None:
        given = _checked_nm(path, np.asarray(wanted, np.float64).ravel(), "given")
        if unit is not None and not (
            given.shape == grid.shape and np.allclose(given, grid * _factor(path, unit), rtol=1e-6)
        ):
            raise FileError(path, "says its wavelengths itself, and others than wavelength_nm; leave that out")
        return given
    if unit is None:
        if not (np.isfinite(grid).all() and grid.size and grid.min() >= 200 and grid.max() <= 2600):
            raise FileError(
                path,
                f"does not say the unit of its wavelengths, {_ends(grid)}; give them in nm (wavelength_nm=[...])",
            )
        return grid
    return _checked_nm(path, grid * _factor(path, unit), f"in {unit}")


def _factor(path: Path, unit: str) -> float:
    name = _UNIT_NAMES.get(unit.strip().lower().replace("µ", "u").replace("μ", "u"))
    if name is None:
        raise FileError(
            path, f"has wavelengths in '{unit[:40]}', an unknown unit; give them in nm (wavelength_nm=[...])"
        )
    return _NANOMETRES_PER[name]


def _checked_nm(path: Path, grid: Array, what: str) -> Array:
    if grid.size and np.isfinite(grid).all() and grid.min() >= _LOWEST_NM and grid.max() <= _HIGHEST_NM:
        return grid
    mend = "are they in another unit? Correct the file's unit, or give them in nm (wavelength_nm=[...])"
    raise FileError(path, f"has wavelengths of {_ends(grid)} {what}, which no camera sees; {mend}")


def _ends(grid: Array) -> str:
    return f"{grid.min():g} to {grid.max():g}" if grid.size and np.isfinite(grid).all() else "some no numbers"


def within_range(wavelength_nm: Array, band_range_nm: ArrayLike | None) -> NDArray[np.bool_]:
    """(bands,) whether each lies in a range, its ends included; all do where none is said.

    Examples
    --------
    >>> within_range(np.array([390.0, 400, 780, 790]), (400, 780)).tolist()
    [False, True, True, False]
    """
    first, last = (-np.inf, np.inf) if band_range_nm is None else np.asarray(band_range_nm, np.float64)
    return (wavelength_nm >= first) & (wavelength_nm <= last)


def band_order(name: str, wavelength_nm: Array, *, sort: bool) -> NDArray[np.intp]:
    """(bands,) indices that put bands in order of wavelength.

    Raises
    ------
    FileError
        If they are not in order and `sort` is false, or a wavelength stands twice.
    """
    order = np.argsort(wavelength_nm, kind="stable")
    if (np.diff(wavelength_nm[order]) == 0).any():
        at = int(order[int(np.argmax(np.diff(wavelength_nm[order]) == 0))])
        raise FileError(name, f"two bands have {wavelength_nm[at]:g} nm; leave one of them out")
    steps = np.diff(wavelength_nm)
    if (steps <= 0).any() and not sort:
        at = int(np.argmax(steps <= 0)) + 1
        raise FileError(
            name,
            f"its wavelengths are not sorted: band {at + 1} has {wavelength_nm[at]:g} nm after "
            f"{wavelength_nm[at - 1]:g} nm; sort the file's bands, or say that they be sorted (sort_bands=True)",
        )
    return order
