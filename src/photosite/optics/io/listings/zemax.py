"""Text listings of Zemax OpticStudio: point spreads, relative illumination, distortion.

They are what an analysis window's text tab saves, in any of the encodings and decimal marks that versions and
countries have. Layouts: docs/optics.md says after which published examples they were written.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.illumination import IlluminationTable
from photosite.optics.io.listings.grid_distortion import is_grid_distortion, read_grid_distortion
from photosite.optics.io.listings.text import (
    NUMBER,
    PsfListing,
    TableRows,
    finite,
    grid_of_numbers,
    micrometers,
    read_text,
)
from photosite.optics.radial_table import FieldPoints

Array = NDArray[np.float64]

_N = f"({NUMBER})"
_WAVE_AND_FIELD = re.compile(
    rf"^\s*{_N}(?:\s+to\s+{_N})?\s*(\S*m\S*)\s+at\s+{_N}(?:,\s+{_N})?\s*\(?([A-Za-z]+)\)?\.?\s*$"
)
_SPACING = re.compile(rf"^\s*Data spacing is\s*:?\s*{_N}\s*(\S+)", re.IGNORECASE)
_AREA = re.compile(rf"^\s*Data area is\s*:?\s*{_N}(?:\s*by\s*{NUMBER})?\s*(\S+)", re.IGNORECASE)
_GRID = re.compile(r"^\s*Image grid size\s*:\s*(\d+)\s*by\s*(\d+)", re.IGNORECASE)
_CENTER_ROW = re.compile(r"^\s*Center point is\s*:\s*row\s*(\d+),\s*column\s*(\d+)", re.IGNORECASE)
_CENTER = re.compile(r"^\s*Center point is\s*:\s*(\d+),\s*(\d+)", re.IGNORECASE)
_CENTER_COORDINATES = re.compile(rf"^\s*Center coordinates\s*:\s*{_N},\s+{_N}\s*([A-Za-z]*)", re.IGNORECASE)
_VALUES = re.compile(r"^\s*Values are (.*)$", re.IGNORECASE)
_FIELD_UNITS = {"deg": "deg", "degrees": "deg", "degree": "deg", "mm": "mm", "millimeters": "mm", "millimeter": "mm"}
_WAVELENGTH = re.compile(rf"wavelength\s*:?\s*{_N}\s*(\S*m\S*)", re.IGNORECASE)
_SAME_NM = 0.05
_MOST_DIGITS = 9
_SAME_FOCAL = 2e-4
"""Below 1.4 degrees a tangent and an angle do not differ by more."""


def is_psf_listing(lines: list[str]) -> bool:
    """Whether these are a listing of an FFT or Huygens point spread."""
    return any(re.match(r"\s*listing of .*psf", line, re.IGNORECASE) for line in lines[:12])


def read_psf(path: str | PathLike[str]) -> PsfListing:
    """A listing of an FFT PSF or Huygens PSF.

    Raises
    ------
    FileError
        If it is not one, is of several wavelengths together, or lacks the distance of samples; with the line.
    """
    file = Path(path)
    lines = read_text(file, "a listing of a point spread")
    if not is_psf_listing(lines):
        raise FileError(file, "is not a listing of an FFT or Huygens PSF: its first lines name none")
    header = _Header(file)
    start = None
    for index, line in enumerate(lines):
        if (match := _VALUES.match(line)) is not None:
            if re.search("log|phase|real|imag", match[1], re.IGNORECASE):
                raise FileError(file, f"values are {match[1].strip()}: export linear intensity", index + 1)
            start = _first_row(lines, index + 1)
            break
        header.take(line, index + 1)
    if start is None:
        raise FileError(file, "has no line 'Values are ...' before its numbers; save the whole listing")
    if header.spacing_um is None:
        raise FileError(file, "does not say 'Data spacing is ... µm'; save the whole listing, its header too")
    samples = grid_of_numbers(lines, start, file, None if header.grid is None else header.grid[0])
    if header.grid is not None and samples.shape != header.grid:
        rows, cols = header.grid
        raise FileError(file, f"says {cols} by {rows} samples and holds {samples.shape[1]} by {samples.shape[0]}")
    origin = header.origin or (samples.shape[0] // 2, samples.shape[1] // 2)
    if not (0 <= origin[0] < samples.shape[0] and 0 <= origin[1] < samples.shape[1]):
        raise FileError(file, f"its center point, row {origin[0] + 1} column {origin[1] + 1}, is not in its grid")
    return PsfListing(
        file,
        samples,
        origin,
        header.finest_spacing_um(samples.shape[1]),
        header.wavelength_nm,
        header.field,
        header.unit,
        header.center_mm,
    )


def _first_row(lines: list[str], first: int) -> int:
    """Where numbers begin: versions differ in what stands between "Values are ..." and them."""
    for index in range(first, len(lines)):
        if sum(re.fullmatch(NUMBER, part) is not None for part in lines[index].split()) >= 3:
            return index
    return first


@dataclass
class _Header:
    """What the lines above the numbers say."""

    path: Path
    spacing_um: float | None = None
    rounding_um: float = 0.0
    area_um: float | None = None
    wavelength_nm: float | None = None
    field: tuple[float, float] | None = None
    unit: str | None = None
    grid: tuple[int, int] | None = None
    origin: tuple[int, int] | None = None
    center_mm: tuple[float, float] | None = None

    def take(self, line: str, at: int) -> None:
        if (match := _WAVE_AND_FIELD.match(line)) is not None:
            first, last, unit, x, y, field_unit = match.groups()
            self.wavelength_nm = micrometers(first, unit, self.path, at) * 1e3
            if last is not None and abs(micrometers(last, unit, self.path, at) * 1e3 - self.wavelength_nm) > _SAME_NM:
                raise FileError(self.path, "is of several wavelengths together; save one listing for each", at)
            if field_unit.lower() not in _FIELD_UNITS:
                raise FileError(self.path, f"its field is in '{field_unit}', neither deg nor mm", at)
            # One number is the field along y.
            along = [finite(part, self.path, at) for part in (x, y) if part is not None]
            self.field = (0.0, along[0]) if y is None else (along[0], along[1])
            self.unit = _FIELD_UNITS[field_unit.lower()]
        elif (match := _SPACING.match(line)) is not None:
            self.spacing_um = micrometers(match[1], match[2], self.path, at)
            digits = len(re.split("[.,]", match[1], maxsplit=1)[1]) if re.search("[.,]", match[1]) else 0
            self.rounding_um = micrometers("0.5", match[2], self.path, at) * 10.0**-digits
        elif (match := _AREA.match(line)) is not None:
            self.area_um = micrometers(match[1], match[2], self.path, at)
        elif (match := _GRID.match(line)) is not None:
            self.grid = self._count(match[2], at), self._count(match[1], at)
        elif (match := _CENTER_ROW.match(line)) is not None:
            self.origin = self._count(match[1], at) - 1, self._count(match[2], at) - 1
        elif (match := _CENTER.match(line)) is not None:
            self.origin = self._count(match[2], at) - 1, self._count(match[1], at) - 1
        elif (match := _CENTER_COORDINATES.match(line)) is not None:
            x_um, y_um = (micrometers(part, match[3] or "mm", self.path, at) for part in match.group(1, 2))
            self.center_mm = x_um * 1e-3, y_um * 1e-3

    def _count(self, digits: str, at: int) -> int:
        if len(digits) > _MOST_DIGITS:
            raise FileError(self.path, f"'{digits[:40]}' is too large a number of samples", at)
        return int(digits)

    def finest_spacing_um(self, samples: int) -> float | None:
        """The spacing, from the area where that has more digits and is the same within rounding."""
        if self.spacing_um is None or self.area_um is None:
            return self.spacing_um
        finer = self.area_um / samples
        return finer if abs(finer - self.spacing_um) <= self.rounding_um * (1 + 1e-9) else self.spacing_um


def read_relative_illumination(path: str | PathLike[str]) -> IlluminationTable:
    """A listing of relative illumination over field angle or image height.

    Raises
    ------
    FileError
        If it is none, does not say in which unit its field is, or that is neither an angle nor a length.
    """
    file = Path(path)
    lines = read_text(file, "a listing of relative illumination")
    if "relative illumination" not in " ".join(lines[:12]).lower():
        raise FileError(file, "is not a listing of relative illumination: its first lines do not name it")
    unit: tuple[str, float] | None = None
    listed = TableRows(file)
    in_table = False
    for index, line in enumerate(lines):
        said = re.match(r"^\s*Field (?:values are in|units are)\s*:?\s*([A-Za-z]+)", line, re.IGNORECASE)
        if said is not None:
            unit = _field_unit(said[1], file, index + 1)
        elif re.search(r"field.*rel\.?\s*ill", line, re.IGNORECASE):
            in_table = True
            inside = re.search(r"\((deg|mm|cm|m\b|in\b)", line, re.IGNORECASE)
            unit = unit or (None if inside is None else _field_unit(inside[1], file, index + 1))
        elif in_table:
            listed.take(line, index + 1)
    if not listed.rows:
        raise FileError(file, "has no table of field and relative illumination")
    if unit is None:
        raise FileError(file, "does not say whether its field is in degrees or in mm; give the table in the YAML file")
    table = np.array(listed.rows)
    kind, scale = unit
    with np.errstate(over="ignore"):
        place = table[:, 0] * scale
    if not np.isfinite(place).all():
        raise FileError(file, "its field, in mm, is too large a number")
    try:
        points = FieldPoints(angle_deg=place) if kind == "deg" else FieldPoints(height_mm=place)
        return IlluminationTable(points, table[:, 1])
    except ValueError as error:
        raise FileError(file, str(error)) from None


def _field_unit(name: str, file: Path, at: int) -> tuple[str, float]:
    """deg or mm, and how many of them the unit is."""
    if _FIELD_UNITS.get(name.lower()) == "deg":
        return "deg", 1.0
    try:
        return "mm", micrometers("1", name, file, at) * 1e-3
    except FileError:
        known = "neither degrees nor a length that is known here (mm, cm, m, inches)"
        raise FileError(file, f"its field is in '{name[:40]}', {known}; give the table in the YAML file", at) from None


@dataclass
class _Block:
    """The rows of one wavelength."""

    line: int
    wavelength_nm: float | None
    columns: list[str]
    table: TableRows

    def column(self, name: str) -> Array | None:
        if name not in self.columns:
            return None
        index = self.columns.index(name)
        return np.array([row[index] for row in self.table.rows])


_COLUMNS = {
    "angle": r"angle|field.*deg",
    "tan": r"tan(?:gential)? ?shift",
    "sag": r"sag(?:ittal)? ?shift",
    "real": r"real height",
    "reference": r"ref\.? height",
    "distortion": r"distortion",
}


def read_distortion(
    path: str | PathLike[str], *, wavelength_nm: float | None = None
) -> tuple[Distortion, LateralColor | None]:
    """A listing of field curvature and distortion over field angle, of one or more wavelengths, or of grid distortion.

    Parameters
    ----------
    path
        The file.
    wavelength_nm
        Whose distortion is the lens's; None: the first of the listing.

    Returns
    -------
    distortion
        Of that wavelength.
    lateral_color
        How far the others fall from it; None where there is one wavelength, or no real heights.

    Raises
    ------
    FileError
        If it is no such listing, its distortion is not against f tan(theta), or the wavelength is not in it.
    """
    file = Path(path)
    lines = read_text(file, "a listing of distortion")
    if is_grid_distortion(lines):
        return read_grid_distortion(lines, file, wavelength_nm), None
    head = " ".join(lines[:20]).lower()
    if "distortion" not in head:
        raise FileError(file, "is not a listing of distortion: its first lines do not name it")
    blocks = _blocks(lines, file)
    if not blocks:
        raise FileError(
            file, "has no table with field angle and distortion; save the text of Field Curvature/Distortion"
        )
    chosen = _chosen(file, blocks, wavelength_nm)
    angle = chosen.column("angle")
    assert angle is not None
    real, reference = chosen.column("real"), chosen.column("reference")
    if not re.search(r"f-tan\s*\(theta\)", head) and ("distortion type" in head or not _is_tangent(angle, reference)):
        raise FileError(file, "its distortion is not of the type F-Tan(Theta); set that in the analysis and save again")
    if (unit := re.search(r"(?:height|shift) units are\s*:?\s*([a-z]+)", head)) and "millimet" not in unit[1]:
        raise FileError(file, f"its heights are in {unit[1]}; set the lens to mm and save again")
    try:
        points = FieldPoints(angle_deg=np.abs(angle))
        if real is not None and reference is not None:
            ratio = np.ones(angle.size)
            np.divide(real, reference, out=ratio, where=reference != 0)
            return Distortion(points, ratio), _lateral(file, points, chosen, blocks)
        percent = chosen.column("distortion")
        assert percent is not None
        return Distortion.from_percent(points, percent), None
    except ValueError as error:
        raise FileError(file, str(error)) from None


def _is_tangent(angle_deg: Array, reference: Array | None) -> bool:
    """Whether reference heights are those of a tangent: listings that a program's interface saved name no type."""
    if reference is None or not (off_axis := angle_deg != 0).any():
        return False
    focal = reference[off_axis] / np.tan(np.radians(angle_deg[off_axis]))
    return bool(np.ptp(focal) <= _SAME_FOCAL * np.abs(focal).max())


def _blocks(lines: list[str], file: Path) -> list[_Block]:
    blocks: list[_Block] = []
    wavelength: float | None = None
    for index, line in enumerate(lines):
        if (said := _WAVELENGTH.search(line)) is not None and "data for" in line.lower():
            wavelength = micrometers(said[1], said[2], file, index + 1) * 1e3
            continue
        found = {name: match.start() for name, text in _COLUMNS.items() if (match := re.search(text, line.lower()))}
        if "angle" in found and "distortion" in found:
            columns = sorted(found, key=lambda name: found[name])
            blocks.append(_Block(index + 1, wavelength, columns, TableRows(file, len(columns))))
        elif blocks:
            blocks[-1].table.take(line, index + 1)
    full = [block for block in blocks if block.table.rows]
    for index, block in enumerate(full):
        if len(block.table.rows) < 2:
            raise FileError(file, "this table has one row, not two or more; save the whole listing", block.line)
        if any(block.wavelength_nm == before.wavelength_nm for before in full[:index]):
            which = "no wavelength" if block.wavelength_nm is None else f"{block.wavelength_nm:g} nm"
            raise FileError(file, f"this is the second table of {which}; save one of each wavelength", block.line)
    return full


def _chosen(file: Path, blocks: list[_Block], wavelength_nm: float | None) -> _Block:
    if wavelength_nm is None:
        return blocks[0]
    for block in blocks:
        if block.wavelength_nm is not None and abs(block.wavelength_nm - wavelength_nm) < 0.5:
            return block
    known = ", ".join("?" if b.wavelength_nm is None else f"{b.wavelength_nm:g}" for b in blocks)
    raise FileError(file, f"has no distortion at {wavelength_nm:g} nm; it has {known} nm")


def _lateral(file: Path, points: FieldPoints, chosen: _Block, blocks: list[_Block]) -> LateralColor | None:
    own, angle = chosen.column("real"), chosen.column("angle")
    known: dict[float, Array] = {}
    for block in blocks:
        heights = block.column("real")
        if block.wavelength_nm is None or heights is None:
            continue
        if not np.array_equal(block.column("angle"), angle):  # type: ignore[arg-type]
            raise FileError(file, "this table's angles are not those of the other wavelengths", block.line)
        known[block.wavelength_nm] = heights
    if own is None or len(known) < 2:
        return None
    shift = np.stack([(np.abs(known[w]) - np.abs(own)) * 1e3 for w in sorted(known)])
    return LateralColor(np.array(sorted(known)), points, shift)
