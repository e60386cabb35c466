"""Spectra: wavelength grids, integration over wavelength, conversion between photons and energy, CSV files."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError, InputError
from photosite.files.small_files import read_small
from photosite.values.shown import ResultTable, Shown, Tabular, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rule = Literal["trapezoid", "rectangle"]

PLANCK_J_S = 6.62607015e-34
LIGHT_SPEED_M_S = 299_792_458.0

DEFAULT_WAVELENGTH_NM: NDArray[np.float64] = np.arange(380.0, 781.0, 10.0)
DEFAULT_WAVELENGTH_NM.flags.writeable = False

_LARGEST_BYTES = 1 << 22
_MOST_COLUMNS = 3


_SHORTEST_NM, _LONGEST_NM = 1e-3, 1e6


def wavelength_grid(wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Return wavelengths as a float array.

    Raises `InputError` if they are not one-dimensional, increasing, and from 0.001 nm to 1 mm.
    """
    grid = np.asarray(wavelength_nm, dtype=np.float64)
    if grid.ndim != 1 or grid.size == 0 or not np.isfinite(grid).all() or grid[0] <= 0:
        raise InputError("wavelength_nm", value=wavelength_nm, expected="a non-empty list of finite numbers above 0")
    if (np.diff(grid) <= 0).any():
        raise InputError("wavelength_nm", value=wavelength_nm, expected="increasing", hint="Sort it with its values")
    if not (grid[0] >= _SHORTEST_NM and grid[-1] <= _LONGEST_NM):
        beyond = float(grid[0] if grid[0] < _SHORTEST_NM else grid[-1])
        raise InputError("wavelength_nm", value=beyond, expected=f"from {_SHORTEST_NM:g} to {_LONGEST_NM:g} nm")
    return grid


@dataclass(frozen=True, eq=False)
class Spectrum(Tabular):
    """A quantity as a function of wavelength.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing.
    values
        (wavelengths,), finite; the unit depends on the use.

    Examples
    --------
    >>> Spectrum([400, 500], [0.0, 1.0]).at([400, 450, 600])
    array([0. , 0.5, 0. ])
    """

    wavelength_nm: NDArray[np.float64]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        grid = wavelength_grid(self.wavelength_nm)
        values = np.asarray(self.values, dtype=np.float64)
        if values.shape != grid.shape or not np.isfinite(values).all():
            expected = f"one finite number for each of {grid.size} wavelengths"
            raise InputError("values", value=self.values, expected=expected)
        object.__setattr__(self, "wavelength_nm", grid)
        object.__setattr__(self, "values", values)

    def at(self, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
        """Return the values at other wavelengths: linear between entries, 0 outside the table."""
        wanted = np.asarray(wavelength_nm, dtype=np.float64)
        return np.interp(wanted, self.wavelength_nm, self.values, left=0.0, right=0.0)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the spectrum on Matplotlib axes, new ones by default, and return them."""
        return drawn(self, ax)

    def to_dict(self) -> dict[str, list[float]]:
        """Return the wavelengths and values as lists."""
        return {"wavelength_nm": self.wavelength_nm.tolist(), "value": self.values.tolist()}

    def _table(self) -> ResultTable:
        first, last = self.wavelength_nm[0], self.wavelength_nm[-1]
        title = f"Spectrum: {self.wavelength_nm.size} wavelengths, {first:g} to {last:g} nm"
        pairs = zip(self.wavelength_nm.tolist(), self.values.tolist(), strict=True)
        return ResultTable(title, ("wavelength_nm", "value"), list(pairs))


def integration_weights(wavelength_nm: ArrayLike, rule: Rule = "trapezoid") -> NDArray[np.float64]:
    """Return (wavelengths,) weights in nm; `values @ weights` is the integral over wavelength.

    Parameters
    ----------
    wavelength_nm
        (wavelengths,), increasing. A single wavelength gets the weight 1 nm.
    rule
        "trapezoid", or "rectangle" (sum times step) for comparison with tools that use it; it needs equal steps.

    Raises
    ------
    InputError
        If the rule is unknown, or the rectangle rule is used with unequal steps.

    Examples
    --------
    >>> integration_weights([400, 410, 420]), integration_weights([400, 410, 420], "rectangle")
    (array([ 5., 10.,  5.]), array([10., 10., 10.]))
    """
    grid = wavelength_grid(wavelength_nm)
    if rule not in ("trapezoid", "rectangle"):
        raise InputError("rule", value=rule, expected="'trapezoid' or 'rectangle'")
    if grid.size == 1:
        return np.ones(1)
    step = np.diff(grid)
    if rule == "rectangle":
        if not np.allclose(step, step[0], rtol=1e-9):
            raise InputError("the rectangle rule needs equal wavelength steps", hint="Use the trapezoidal rule")
        return np.full(grid.size, step[0])
    weights = np.zeros(grid.size)
    weights[:-1] += step / 2
    weights[1:] += step / 2
    return weights


def photons_from_energy(energy: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Convert (..., wavelengths) joules to photons: divide by h c / lambda.

    Examples
    --------
    >>> float(photons_from_energy(1.0, 555.0)) / 1e18
    2.79...
    """
    wavelength_m = np.asarray(wavelength_nm, dtype=np.float64) * 1e-9
    return np.asarray(energy, dtype=np.float64) * wavelength_m / (PLANCK_J_S * LIGHT_SPEED_M_S)


def energy_from_photons(photons: ArrayLike, wavelength_nm: ArrayLike) -> NDArray[np.float64]:
    """Convert (..., wavelengths) photons to joules: multiply by h c / lambda.

    Examples
    --------
    >>> float(energy_from_photons(photons_from_energy(2.0, 500.0), 500.0))
    2.0
    """
    wavelength_m = np.asarray(wavelength_nm, dtype=np.float64) * 1e-9
    return np.asarray(photons, dtype=np.float64) * (PLANCK_J_S * LIGHT_SPEED_M_S) / wavelength_m


@dataclass(frozen=True, eq=False)
class SpectrumFile(Shown):
    """The content of a spectrum file: wavelengths, values, and optionally their standard uncertainties.

    - `spectrum`, `standard_uncertainty`: Wavelengths and values; (wavelengths,), 0 where the file has no third column.
    - `columns`: Names of the columns in lower case; empty if the file has no heading.
    """

    spectrum: Spectrum
    standard_uncertainty: NDArray[np.float64]
    columns: tuple[str, ...]


def load_spectrum(path: str | PathLike[str]) -> SpectrumFile:
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
    ...     content = load_spectrum(file)
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
