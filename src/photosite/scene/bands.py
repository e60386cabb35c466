"""The wavelengths of a spectral file's bands: unit, order and validity."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
_HINT: dict[str, Any] = {"hint": "Pass them in nm: {wavelength_nm}", "arguments": {"wavelength_nm": [400, 410, 420]}}


def wavelengths_in_nm(path: Path, values: ArrayLike | None, unit: str | None, wanted: ArrayLike | None) -> Array:
    """Return the wavelengths of a file's bands, in nm and in the order of the bands.

    Parameters
    ----------
    path
        The file, for messages.
    values, unit
        (bands,) as in the file; None where it has none. Values from 200 to 2600 without a unit are nanometers: no other
        unit puts them into a camera's range.
    wanted
        (bands,) nm, given by the caller for a file without them.

    Raises
    ------
    FileError
        If neither gives them, both do and differ, or they are outside any camera's range.
    """
    if values is None:
        if wanted is None:
            raise FileError(path, "has no wavelengths of its bands", **_HINT)
        return _checked_nm(path, np.asarray(wanted, np.float64).ravel(), "given")
    try:
        grid = np.asarray(values, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        raise FileError(path, "has wavelengths that are not numbers", **_HINT) from None
    if wanted is not None:
        given = _checked_nm(path, np.asarray(wanted, np.float64).ravel(), "given")
        own = given if unit is None else grid * _factor(path, unit)
        if given.shape != own.shape or not np.allclose(given, own, rtol=1e-6):
            arguments = {"wavelength_nm": tuple(given.tolist())}
            raise FileError(path, "states other wavelengths", hint="Omit {wavelength_nm}", arguments=arguments)
        return given
    if unit is None:
        if not (np.isfinite(grid).all() and grid.size and grid.min() >= 200 and grid.max() <= 2600):
            raise FileError(path, f"has no unit of its wavelengths, {_ends(grid)}", **_HINT)
        return grid
    return _checked_nm(path, grid * _factor(path, unit), f"in {unit}")


def _factor(path: Path, unit: str) -> float:
    name = _UNIT_NAMES.get(unit.strip().lower().replace("µ", "u").replace("μ", "u"))
    if name is None:
        raise FileError(path, f"has wavelengths in the unknown unit '{unit[:40]}'", **_HINT)
    return _NANOMETRES_PER[name]


def _checked_nm(path: Path, grid: Array, what: str) -> Array:
    if grid.size and np.isfinite(grid).all() and grid.min() >= _LOWEST_NM and grid.max() <= _HIGHEST_NM:
        return grid
    raise FileError(path, f"has wavelengths of {_ends(grid)} {what}, outside any camera's range", **_HINT)


def _ends(grid: Array) -> str:
    return f"{grid.min():g} to {grid.max():g}" if grid.size and np.isfinite(grid).all() else "not all finite"


def within_range(wavelength_nm: Array, band_range_nm: ArrayLike | None) -> NDArray[np.bool_]:
    """Return whether each band (bands,) is in a range, its ends included; all are where the range is None.

    Examples
    --------
    >>> within_range(np.array([390.0, 400, 780, 790]), (400, 780)).tolist()
    [False, True, True, False]
    """
    first, last = (-np.inf, np.inf) if band_range_nm is None else np.asarray(band_range_nm, np.float64)
    return (wavelength_nm >= first) & (wavelength_nm <= last)


def band_order(name: str, wavelength_nm: Array, *, sort: bool) -> NDArray[np.intp]:
    """Return the indices (bands,) that sort bands by wavelength."""
    order = np.argsort(wavelength_nm, kind="stable")
    if (np.diff(wavelength_nm[order]) == 0).any():
        at = int(order[int(np.argmax(np.diff(wavelength_nm[order]) == 0))])
        raise FileError(name, f"two bands have {wavelength_nm[at]:g} nm", hint="Remove one of them")
    steps = np.diff(wavelength_nm)
    if (steps <= 0).any() and not sort:
        at = int(np.argmax(steps <= 0)) + 1
        after = f"band {at + 1} has {wavelength_nm[at]:g} nm after {wavelength_nm[at - 1]:g} nm"
        hint, arguments = "Sort the file's bands, or pass {sort_bands}", {"sort_bands": True}
        raise FileError(name, f"its wavelengths are not sorted: {after}", hint=hint, arguments=arguments)
    return order
