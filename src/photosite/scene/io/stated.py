"""What a file states about its values: numbers, lists of numbers and units, each checked as it is read."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.scene.cube import Array
from photosite.scene.options import ReadOptions
from photosite.scene.units import Units, parse_units

_LONGEST = 80


class Stated:
    """Values that a file states by name: attributes, fields of a header, or JSON. Each is None where it is missing.

    Every method raises `FileError` for a value that is not of its kind; numbers can be text.
    """

    def __init__(self, path: Path, values: Mapping[str, Any]) -> None:
        self._path, self._values = path, values

    def numbers(self, name: str, count: int | None = None) -> Array | None:
        """Return a list of numbers; where a count is given, of so many finite ones."""
        value = self._values.get(name)
        if value is None:
            return None
        try:
            numbers = np.empty(0) if isinstance(value, bool) else np.asarray(value, np.float64).ravel()
        except (TypeError, ValueError, OverflowError):
            numbers = np.empty(0)
        if numbers.size == 0 or (count is not None and not (numbers.size == count and np.isfinite(numbers).all())):
            several = "a list of numbers" if count is None else f"{count} finite numbers, one for each band"
            raise FileError(self._path, name, value=value, expected="a finite number" if count == 1 else several)
        return numbers

    def number(self, name: str, *, above_0: bool = False) -> float | None:
        """Return a finite number."""
        values = self.numbers(name, 1)
        if above_0 and values is not None and values[0] <= 0:
            raise FileError(self._path, name, value=float(values[0]), expected="above 0")
        return None if values is None else float(values[0])

    def head(self, bands: int, no_data: str = "no_data") -> dict[str, Any]:
        """Return the fields of a cube: light (bands,), distance, width, and the mark of missing values."""
        mark = self.numbers(no_data)
        return {
            "light": self.numbers("light", bands),
            "distance_m": self.number("distance_m", above_0=True),
            "width_m": self.number("width_m", above_0=True),
            # NaN is missing in any case.
            "no_data": None if mark is None or not np.isfinite(mark).all() else self.number(no_data),
        }


def file_units(path: Path, options: ReadOptions, stated: Any) -> Units:
    """Return the units of a file's values; the caller's override those that the file states, if any."""
    if options.units is not None:
        return override_units(path, options.units, stated)
    if stated is None:
        or_else = ", 'photons/s/sr/m2/nm', 'reflectance' or 'relative'"
        options.require(path, "does not state the units of its values", or_else, units="W/sr/m2/nm")
    try:
        return parse_units(str(stated)[:_LONGEST])
    except InputError as error:
        raise error.in_file(path) from None


def override_units(path: Path, given: str, stated: Any, own: Units | None = None) -> Units:
    """Return the caller's units; warn where the file states others: `own`, or else those of the text `stated`."""
    units = parse_units(given)
    if own is None:
        try:
            own = None if stated is None else parse_units(str(stated)[:_LONGEST])
        except InputError:  # unknown units cannot contradict
            own = None
    if own is not None and (own.quantity != units.quantity or not math.isclose(own.scale, units.scale, rel_tol=1e-9)):
        what = f"the file states the units '{stated!s:.40}'; units='{given}' overrides them"
        warnings.warn(PhotositeWarning(what, where=str(path)), stacklevel=2)
    return units
