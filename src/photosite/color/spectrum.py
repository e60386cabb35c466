"""Spectra: wavelength grids, integration over wavelength, conversion between photons and energy, CSV files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.wavelength_units import NANOMETRES_PER, camera_unit, heading_unit
from photosite.errors import FileError, InputError
from photosite.files.text_table import read_table, split_percent
from photosite.values.shown import ResultTable, Shown, Tabular, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rule = Literal["trapezoid", "rectangle"]

PLANCK_J_S = 6.62607015e-34
LIGHT_SPEED_M_S = 299_792_458.0

DEFAULT_WAVELENGTH_NM: NDArray[np.float64] = np.arange(380.0, 781.0, 10.0)
DEFAULT_WAVELENGTH_NM.flags.writeable = False

_LARGEST_BYTES = 1 << 22
_COLUMNS = (2, 3)


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
    """Read a spectrum from a table of text.

    Parameters
    ----------
    path
        UTF-8 text as people write tables (`photosite.files.text_table`): wavelength, increasing or decreasing from line
        to line, value, and optionally the value's standard uncertainty, separated by commas, semicolons, tabs or
        blanks. A first line without numbers names the columns; the first names the unit of the wavelengths, such as
        `wavelength_nm` or `Wavelength [um]`, or they are in nm. Columns such as `transmittance (%)` are in percent.

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
    table = read_table(file, "a spectrum", _LARGEST_BYTES)
    if not table.rows:
        raise FileError(file, "the file holds no spectrum", hint="Write lines of wavelength in nm and value: 550, 0.31")
    numbers = np.array(table.numbers(_COLUMNS))
    stated = [split_percent(cell) for cell in table.heading or ()]
    columns = tuple("_".join(re.findall(r"[^\W_]+", cell.lower())) for cell, _ in stated)
    in_percent = [percent for _, percent in stated[1:]]
    if in_percent[:2] == [False, True]:
        what, value = "the heading of the standard uncertainty", (table.heading or ())[2]
        raise FileError(file, what, table.heading_line, value=value, expected="in the unit of the values, not relative")
    for column, percent in enumerate(in_percent[: numbers.shape[1] - 1], start=1):
        numbers[:, column] /= 100.0 if percent else 1.0
    if table.heading is not None:
        is_wavelength, unit = heading_unit(table.heading[0])
        if is_wavelength:
            numbers[:, 0] *= NANOMETRES_PER[unit or camera_unit(numbers[:, 0]) or "nm"]
            columns = ("wavelength_nm", *columns[1:])
    lines = table.lines
    if len(numbers) > 1 and numbers[1, 0] < numbers[0, 0]:
        numbers, lines = numbers[::-1].copy(), lines[::-1]
    if (odd := np.flatnonzero(np.diff(numbers[:, 0]) <= 0)).size:
        at = int(odd[0])
        expected = f"above {numbers[at, 0]:g}, that of line {lines[at]}"
        raise FileError(file, "wavelength", lines[at + 1], value=float(numbers[at + 1, 0]), expected=expected)
    uncertainty = numbers[:, 2] if numbers.shape[1] > 2 else np.zeros(len(numbers))
    if (odd := np.flatnonzero(uncertainty < 0)).size:
        at = int(odd[0])
        raise FileError(file, "standard_uncertainty", lines[at], value=float(uncertainty[at]), expected="0 or above")
    try:
        spectrum = Spectrum(numbers[:, 0], numbers[:, 1])
    except InputError as error:
        raise error.in_file(file) from None
    return SpectrumFile(spectrum, uncertainty, columns)
