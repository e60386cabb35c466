"""Spectral cubes: images of many bands, their wavelengths, read a few rows at a time from memory or from a file.

A reader fills the header and converts the values to SI. `photosite.scene.scene_cube` makes scenes of cubes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.color.wavelength_units import NANOMETRES_PER, camera_unit, unit_name
from photosite.errors import FileError
from photosite.files.writing import TemporaryFolder
from photosite.scene.units import Quantity

Array = NDArray[np.float64]
Block = tuple[int, Array]
"""First row, and (n, cols, bands) values."""

Interleave = Literal["bsq", "bil", "bip"]

_LOWEST_NM, _HIGHEST_NM = 100.0, 30_000.0
_HINT: dict[str, Any] = {"hint": "Pass them in nm: {wavelength_nm}", "arguments": {"wavelength_nm": [400, 410, 420]}}


@dataclass(frozen=True, eq=False, kw_only=True)
class SpectralCube(ABC):
    """A cube: its shape, wavelengths and quantity, and its values block by block.

    Parameters
    ----------
    name
        The cube's name in messages: its file.
    shape
        (rows, cols, bands).
    wavelength_nm
        (bands,) in the order of the bands; the reduction checks that they increase.
    quantity
        What the values are: see `photosite.scene.units.Quantity`.
    light
        (bands,) photons/s/sr/m2/nm from a perfect white, where the file gives it.
    distance_m, width_m
        Of the scene, where the file gives them.
    title
        The scene's own name, where the file gives it.
    """

    name: str
    shape: tuple[int, int, int]
    wavelength_nm: Array
    quantity: Quantity
    light: Array | None = None
    distance_m: float | None = None
    width_m: float | None = None
    title: str | None = None

    def __post_init__(self) -> None:
        bands = self.shape[2]
        if len(self.wavelength_nm) != bands:
            raise FileError(
                self.name,
                f"has {bands} bands and {len(self.wavelength_nm)} wavelengths",
                hint="Pass one for each band: {wavelength_nm}",
                arguments={"wavelength_nm": [400, 410, 420]},
            )
        if self.light is not None and self.light.shape != (bands,):
            raise FileError(self.name, f"has a light of {self.light.size} values for {bands} bands")
        if 0 in self.shape:
            raise FileError(self.name, f"is empty: {self.shape} rows, columns and bands")

    @abstractmethod
    def blocks(self, rows: int) -> Iterator[Block]:
        """Yield all rows in order, at most `rows` at a time, in SI; NaN where the file has no data.

        The next block may overwrite the previous one.
        """

    def release(self) -> None:
        """Remove the cube's temporary folders; it cannot be read afterwards."""
        for part in vars(self).values():
            if isinstance(part, SpectralCube):
                part.release()
            elif isinstance(part, TemporaryFolder):
                part.close()


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayCube(SpectralCube):
    """A cube of values (rows, cols, bands) in memory, or in an object that is sliced like an array."""

    values: Any

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first in range(0, self.shape[0], rows):
            yield first, np.asarray(self.values[first : first + rows], dtype=np.float64)


@dataclass(frozen=True, eq=False, kw_only=True)
class RawCube(SpectralCube):
    """A cube of plain numbers in a file, read block by block without mapping it, so that memory stays bounded.

    Parameters
    ----------
    path
        The file.
    dtype
        Type of the numbers, byte order included.
    interleave
        "bsq" (band after band), "bil" (row after row, in it band after band), "bip" (spectrum after spectrum).
    offset
        Bytes before the first number.
    band_offsets
        First byte of each band, where bands are apart ("bsq" only); replaces `offset`.
    scale
        Factor from a number to SI; one for all or one per band.
    no_data
        The number that marks a missing value.
    keep
        The temporary folder that the file is in, kept as long as the cube.
    """

    path: Path
    dtype: np.dtype[Any]
    interleave: Interleave = "bsq"
    offset: int = 0
    band_offsets: tuple[int, ...] | None = None
    scale: float | Array = 1.0
    no_data: float | None = None
    keep: TemporaryFolder | None = None

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        total, cols, bands = self.shape
        rows = min(rows, total)
        by_band = self.interleave != "bip"
        values = np.empty((bands, rows, cols) if by_band else (rows, cols, bands))
        buffer = np.empty((cols * rows * bands,), self.dtype)
        scale = np.broadcast_to(np.asarray(self.scale, np.float64), (bands,))
        with self.path.open("rb", buffering=0) as file:
            for first in range(0, total, rows):
                count = min(rows, total - first)
                raw = self._read(file, buffer, first, count)
                block = values[:, :count] if by_band else values[:count]
                with np.errstate(over="ignore"):  # the reduction refuses infinite values
                    np.multiply(raw, scale[:, None, None] if by_band else scale, out=block)
                if self.no_data is not None:
                    block[raw == self.no_data] = np.nan
                yield first, (np.moveaxis(block, 0, 2) if by_band else block)

    def _read(self, file: Any, buffer: NDArray[Any], first: int, count: int) -> NDArray[Any]:
        """(bands, count, cols), or for "bip" (count, cols, bands), as stored."""
        total, cols, bands = self.shape
        size = self.dtype.itemsize
        if self.interleave == "bsq":
            raw = buffer[: bands * count * cols].reshape(bands, count, cols)
            for band in range(bands):
                own = self.offset + band * total * cols * size if self.band_offsets is None else self.band_offsets[band]
                self._fill(file, own + first * cols * size, raw[band])
            return raw
        flat = buffer[: bands * count * cols]
        self._fill(file, self.offset + first * cols * bands * size, flat)
        if self.interleave == "bil":
            return flat.reshape(count, bands, cols).transpose(1, 0, 2)
        return flat.reshape(count, cols, bands)

    def _fill(self, file: Any, begin: int, part: NDArray[Any]) -> None:
        view = memoryview(part.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        file.seek(begin)
        done = 0
        while done < len(view):
            more = file.readinto(view[done:])
            if not more:
                what = f"is truncated: it ends at byte {begin + done}, within a cube of {self.shape} values"
                raise FileError(self.name, what)
            done += more


@dataclass(frozen=True, eq=False, kw_only=True)
class SelectedBands(SpectralCube):
    """The bands (n,) of a cube, by their indices."""

    whole: SpectralCube
    bands: NDArray[np.intp]

    @property
    def path(self) -> Path:
        """The file that holds the values."""
        return Path(getattr(self.whole, "path", self.name))

    def blocks(self, rows: int) -> Iterator[Block]:
        """See `SpectralCube`."""
        for first, block in self.whole.blocks(rows):
            yield first, block[:, :, self.bands]


def select_bands(cube: SpectralCube, wanted: NDArray[np.bool_]) -> SpectralCube:
    """Return a cube of the wanted bands (bands,); the cube itself where all are wanted.

    Examples
    --------
    >>> whole = ArrayCube(name="pair", shape=(1, 1, 2), wavelength_nm=np.array([500.0, 900.0]),
    ...                   quantity="relative", values=np.array([[[1.0, 2.0]]]))
    >>> cube = select_bands(whole, whole.wavelength_nm < 800)
    >>> cube.wavelength_nm.tolist(), [block.tolist() for _, block in cube.blocks(8)]
    ([500.0], [[[[1.0]]]])
    """
    if wanted.all():
        return cube
    grid = np.asarray(cube.wavelength_nm, np.float64)
    if not wanted.any():
        what = f"no band is left of those from {grid.min():g} to {grid.max():g} nm"
        raise FileError(cube.name, what, hint="Choose another range")
    head = {field.name: getattr(cube, field.name) for field in fields(SpectralCube)} | {
        "shape": (*cube.shape[:2], int(wanted.sum())),
        "wavelength_nm": grid[wanted],
        "light": None if cube.light is None else np.asarray(cube.light, np.float64)[wanted],
    }
    return SelectedBands(whole=cube, bands=np.flatnonzero(wanted), **head)


# The wavelengths of a spectral file's bands: unit, order and validity.


def wavelengths_in_nm(path: Path, values: ArrayLike | None, unit: str | None, wanted: ArrayLike | None) -> Array:
    """Return the wavelengths of a file's bands, in nm and in the order of the bands.

    Parameters
    ----------
    path
        The file, for messages.
    values, unit
        (bands,) as in the file; None where it has none. Values from 200 to 2600 without a unit are nanometers, and from
        0.2 to 2.6 micrometers: no other unit puts them into a camera's range.
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
        if (only := camera_unit(grid)) is None:
            raise FileError(path, f"has no unit of its wavelengths, {_ends(grid)}", **_HINT)
        return grid * NANOMETRES_PER[only]
    return _checked_nm(path, grid * _factor(path, unit), f"in {unit}")


def _factor(path: Path, unit: str) -> float:
    if (name := unit_name(unit)) is None:
        raise FileError(path, f"has wavelengths in the unknown unit '{unit[:40]}'", **_HINT)
    return NANOMETRES_PER[name]


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


class Stated:
    """Values that a cube's file states by name: attributes, fields of a header, or JSON; None where one is missing.

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
