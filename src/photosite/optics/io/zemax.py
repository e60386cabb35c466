"""Text listings of Zemax OpticStudio: PSFs, relative illumination, distortion.

They are what the text tab of an analysis window saves, in any of its encodings and decimal marks. docs/howto/optics.md
names the published examples of each layout. A listing of grid distortion looks like this:

Units are Millimeters.
Wavelength: 0.55000 µm
Reference Coordinates: Xref = 0.00000E+000, Yref = 0.00000E+000

   i    j      X-Field       Y-Field      R-Field   Predicted X   Predicted Y        Real X        Real Y   Distortion
 -32  -32 -1.94201E+001 -1.48108E+001 2.37825E+001 -6.96011E-001 -5.22008E-001 -6.64084E-001 -4.98063E-001 -4.587114%
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, in_file
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.field_points import FieldPoints, even_curve
from photosite.optics.illumination import IlluminationTable
from photosite.optics.io.listing import (
    NUMBER,
    PsfListing,
    TableRows,
    finite,
    grid_of_numbers,
    micrometers,
    number,
    read_text,
)

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
_RELATIVE_UNITS = re.compile(r"^\s*Field (?:values are in|units are)\s*:?\s*([A-Za-z]+)", re.IGNORECASE)
_WAVELENGTH = re.compile(rf"wavelength\s*:?\s*{_N}\s*(\S*m\S*)", re.IGNORECASE)
_SAME_NM = 0.05
_MOST_DIGITS = 9
_SAME_FOCAL = 2e-4
"""Relative difference of focal lengths; a tangent and an angle differ by less below 1.4 degrees."""

_GRID_HEADING = re.compile(r"predicted\s+x\s+predicted\s+y\s+real\s+x\s+real\s+y", re.IGNORECASE)
_GRID_UNITS = re.compile(r"^\s*Units are\s*:?\s*([A-Za-z]+)", re.IGNORECASE)
_GRID_WAVELENGTH = re.compile(rf"^\s*Wavelength\s*:?\s*({NUMBER})\s*(\S*m\S*)", re.IGNORECASE)
_GRID_REFERENCE = re.compile(rf"Xref\s*=\s*({NUMBER}),?\s+Yref\s*=\s*({NUMBER})", re.IGNORECASE)
_GRID_COLUMNS = 10
_SYMMETRIC = 2e-3
"""Distance of a point from its rotationally symmetric position, relative to the largest height."""
_SAME_GRID_NM = 0.5


def is_psf_file(path: Path, suffixes: tuple[str, ...]) -> bool:
    """Return whether a file is a listing of an FFT or Huygens PSF."""
    return path.suffix.lower() in suffixes and _is_psf_listing(read_text(path, "a listing"))


def _is_psf_listing(lines: list[str]) -> bool:
    return any(re.match(r"\s*listing of .*psf", line, re.IGNORECASE) for line in lines[:12])


def read_psf(path: str | PathLike[str]) -> PsfListing:
    """Read a listing of an FFT PSF or Huygens PSF.

    Raises `FileError` with the line if it is not one, is of several wavelengths together, or lacks the sample spacing.
    """
    file = Path(path)
    lines = read_text(file, "a listing of a PSF")
    if not _is_psf_listing(lines):
        raise FileError(file, "is not a listing of an FFT or Huygens PSF")
    header = _Header(file)
    start = None
    for index, line in enumerate(lines):
        if (match := _VALUES.match(line)) is not None:
            if re.search("log|phase|real|imag", match[1], re.IGNORECASE):
                raise FileError(file, "values", index + 1, value=match[1].strip(), expected="linear intensity")
            start = _first_row(lines, index + 1)
            break
        header.take(line, index + 1)
    if start is None:
        raise FileError(file, "has no line 'Values are ...' before its numbers", hint="Save the whole listing")
    if header.spacing_um is None:
        raise FileError(file, "does not state 'Data spacing is ... µm'", hint="Save the whole listing with its header")
    samples = grid_of_numbers(lines, start, file, None if header.grid is None else header.grid[0])
    if header.grid is not None and samples.shape != header.grid:
        raise FileError(file, "samples", value=samples.shape, expected=f"{header.grid}, as the header states")
    origin = header.origin or (samples.shape[0] // 2, samples.shape[1] // 2)
    if not (0 <= origin[0] < samples.shape[0] and 0 <= origin[1] < samples.shape[1]):
        row_and_column = (origin[0] + 1, origin[1] + 1)
        raise FileError(file, "center point", value=row_and_column, expected=f"within the {samples.shape} samples")
    spacing = header.finest_spacing_um(samples.shape[1])
    stated = header.wavelength_nm, header.field, header.unit, header.center_mm
    return PsfListing(file, samples, origin, spacing, *stated)


def _first_row(lines: list[str], first: int) -> int:
    """Return the index of the first row of numbers; versions differ in what precedes it."""
    for index in range(first, len(lines)):
        if sum(re.fullmatch(NUMBER, part) is not None for part in lines[index].split()) >= 3:
            return index
    return first


@dataclass
class _Header:
    """Values from the lines above the numbers."""

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
                hint = "Save one listing for each wavelength"
                raise FileError(self.path, "is of several wavelengths together", at, hint=hint)
            if field_unit.lower() not in _FIELD_UNITS:
                raise FileError(self.path, "unit of the field", at, value=field_unit, expected="deg or mm")
            # A single number is the field along y.
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
            expected = f"of {_MOST_DIGITS} digits or less"
            raise FileError(self.path, "number of samples", at, value=digits, expected=expected)
        return int(digits)

    def finest_spacing_um(self, samples: int) -> float | None:
        """Return the spacing, from the area if that has more digits and agrees within rounding."""
        if self.spacing_um is None or self.area_um is None:
            return self.spacing_um
        finer = self.area_um / samples
        return finer if abs(finer - self.spacing_um) <= self.rounding_um * (1 + 1e-9) else self.spacing_um


def read_relative_illumination(path: str | PathLike[str]) -> IlluminationTable:
    """Read a listing of relative illumination over field angle or image height.

    Raises `FileError` if it is not one, or its field is neither an angle nor a length.
    """
    file = Path(path)
    lines = read_text(file, "a listing of relative illumination")
    if "relative illumination" not in " ".join(lines[:12]).lower():
        raise FileError(file, "is not a listing of relative illumination")
    unit: tuple[str, float] | None = None
    listed = TableRows(file)
    in_table = False
    for index, line in enumerate(lines):
        if (found := _RELATIVE_UNITS.match(line)) is not None:
            unit = _field_unit(found[1], file, index + 1)
        elif re.search(r"field.*rel\.?\s*ill", line, re.IGNORECASE):
            in_table = True
            inside = re.search(r"\((deg|mm|cm|m\b|in\b)", line, re.IGNORECASE)
            unit = unit or (None if inside is None else _field_unit(inside[1], file, index + 1))
        elif in_table:
            listed.take(line, index + 1)
    if not listed.rows:
        raise FileError(file, "has no table of field and relative illumination")
    if unit is None:
        hint = "Give the table in the optics file"
        raise FileError(file, "does not state whether its field is in degrees or in mm", hint=hint)
    table = np.array(listed.rows)
    kind, scale = unit
    with np.errstate(over="ignore"):
        place = table[:, 0] * scale
    if not np.isfinite(place).all():
        raise FileError(file, "field, in mm", expected="finite")
    with in_file(file):
        points = FieldPoints(angle_deg=place) if kind == "deg" else FieldPoints(height_mm=place)
        return IlluminationTable(points, table[:, 1])


def _field_unit(name: str, file: Path, line: int) -> tuple[str, float]:
    """Return deg or mm, and the factor to it."""
    if _FIELD_UNITS.get(name.lower()) == "deg":
        return "deg", 1.0
    try:
        return "mm", micrometers("1", name, file, line) * 1e-3
    except FileError:
        expected = "degrees, mm, cm, m or inches"
        hint = "Give the table in the optics file"
        raise FileError(file, "unit of the field", line, value=name, expected=expected, hint=hint) from None


@dataclass
class _Block:
    """The rows of one wavelength."""

    line: int
    wavelength_nm: float | None
    names: list[str]
    table: TableRows

    @cached_property
    def columns(self) -> dict[str, Array]:
        return dict(zip(self.names, np.array(self.table.rows).T, strict=True))


_COLUMNS = {
    "angle": r"angle|field.*deg",
    "tan": r"tan(?:gential)? ?shift",
    "sag": r"sag(?:ittal)? ?shift",
    "real": r"real height",
    "reference": r"ref\.? height",
    "distortion": r"distortion",
}


def read_distortion(
    path: str | PathLike[str], wavelength_nm: float | None = None
) -> tuple[Distortion, LateralColor | None]:
    """Read a listing of field curvature and distortion over field angle, or of grid distortion.

    Parameters
    ----------
    path
        The file.
    wavelength_nm
        Wavelength of the distortion; None: the first of the listing.

    Returns
    -------
    distortion, lateral_color
        Distortion at that wavelength, and displacements of the others; None if there is one wavelength, or no real
        heights.

    Raises
    ------
    FileError
        If it is not such a listing, its distortion is not of the type f tan(theta), or it lacks the wavelength.
    """
    file = Path(path)
    lines = read_text(file, "a listing of distortion")
    if "grid distortion" in " ".join(lines[:12]).lower():
        return _grid_distortion(lines, file, wavelength_nm), None
    head = " ".join(lines[:20]).lower()
    if "distortion" not in head:
        raise FileError(file, "is not a listing of distortion")
    blocks = _blocks(lines, file)
    if not blocks:
        hint = "Save the text of Field Curvature/Distortion"
        raise FileError(file, "has no table with field angle and distortion", hint=hint)
    chosen = _chosen(file, blocks, wavelength_nm)
    angle, real, reference = chosen.columns["angle"], chosen.columns.get("real"), chosen.columns.get("reference")
    if not re.search(r"f-tan\s*\(theta\)", head) and ("distortion type" in head or not _is_tangent(angle, reference)):
        hint = "Set that type in the analysis, and save again"
        raise FileError(file, "distortion", expected="of the type F-Tan(Theta)", hint=hint)
    if (unit := re.search(r"(?:height|shift) units are\s*:?\s*([a-z]+)", head)) and "millimet" not in unit[1]:
        hint = "Set the lens to mm, and save again"
        raise FileError(file, "unit of the heights", value=unit[1], expected="millimeters", hint=hint)
    with in_file(file):
        points = FieldPoints(angle_deg=np.abs(angle))
        if real is not None and reference is not None:
            ratio = np.ones(angle.size)
            np.divide(real, reference, out=ratio, where=reference != 0)
            return Distortion(points, ratio), _lateral_color(file, points, chosen, blocks)
        return Distortion.from_percent(points, chosen.columns["distortion"]), None


def _is_tangent(angle_deg: Array, reference: Array | None) -> bool:
    """Return whether reference heights go with the tangent: listings saved by a script do not name the type."""
    if reference is None or not (off_axis := angle_deg != 0).any():
        return False
    focal = reference[off_axis] / np.tan(np.radians(angle_deg[off_axis]))
    return bool(np.ptp(focal) <= _SAME_FOCAL * np.abs(focal).max())


def _blocks(lines: list[str], file: Path) -> list[_Block]:
    blocks: list[_Block] = []
    wavelength: float | None = None
    for index, line in enumerate(lines):
        if (match := _WAVELENGTH.search(line)) is not None and "data for" in line.lower():
            wavelength = micrometers(match[1], match[2], file, index + 1) * 1e3
            continue
        found = {name: match.start() for name, text in _COLUMNS.items() if (match := re.search(text, line.lower()))}
        if "angle" in found and "distortion" in found:
            names = sorted(found, key=lambda name: found[name])
            blocks.append(_Block(index + 1, wavelength, names, TableRows(file, len(names))))
        elif blocks:
            blocks[-1].table.take(line, index + 1)
    full = [block for block in blocks if block.table.rows]
    for index, block in enumerate(full):
        if len(block.table.rows) < 2:
            raise FileError(file, "rows of this table", block.line, value=1, expected="two or more")
        if block.wavelength_nm in [before.wavelength_nm for before in full[:index]]:
            which = "no wavelength" if block.wavelength_nm is None else f"{block.wavelength_nm:g} nm"
            raise FileError(file, f"this is the second table of {which}", block.line, hint="Save one of each")
    return full


def _chosen(file: Path, blocks: list[_Block], wavelength_nm: float | None) -> _Block:
    if wavelength_nm is None:
        return blocks[0]
    for block in blocks:
        if block.wavelength_nm is not None and abs(block.wavelength_nm - wavelength_nm) < 0.5:
            return block
    known = ", ".join("?" if b.wavelength_nm is None else f"{b.wavelength_nm:g}" for b in blocks)
    raise FileError(file, "wavelength_nm", value=wavelength_nm, expected=f"one of {known}")


def _lateral_color(file: Path, points: FieldPoints, chosen: _Block, blocks: list[_Block]) -> LateralColor | None:
    own, known = np.abs(chosen.columns["real"]), dict[float, Array]()
    for block in blocks:
        if block.wavelength_nm is None or "real" not in block.columns:
            continue
        if not np.array_equal(block.columns["angle"], chosen.columns["angle"]):
            raise FileError(file, "the angles of this table differ from those of the other wavelengths", block.line)
        known[block.wavelength_nm] = np.abs(block.columns["real"])
    if len(known) < 2:
        return None
    shift = np.stack([(known[w] - own) * 1e3 for w in sorted(known)])
    return LateralColor(np.array(sorted(known)), points, shift)


def _grid_distortion(lines: list[str], file: Path, wavelength_nm: float | None) -> Distortion:
    """Return the distortion along the diagonal of the grid, on which all other points must lie, too."""
    start = next((index for index, line in enumerate(lines) if _GRID_HEADING.search(line)), None)
    if start is None:
        raise FileError(file, "has no table of predicted and real X and Y", hint="Save the text of Grid Distortion")
    _check_grid_header(lines[:start], file, wavelength_nm)
    listed = TableRows(file, _GRID_COLUMNS)
    for index in range(start + 1, len(lines)):
        listed.take(lines[index], index + 1)
    table = np.array(listed.rows).reshape(-1, _GRID_COLUMNS)
    ideal, real = table[:, 5:7], table[:, 7:9]
    diagonal = (table[:, 0] == table[:, 1]) & (table[:, 0] > 0)
    height = np.hypot(*ideal[diagonal].T)
    if height.size < 3 or not height.all() or not np.isfinite(table).all():
        expected = "complete, with rows (i, j) = (1, 1), (2, 2), (3, 3) at least"
        raise FileError(file, "the grid of points", expected=expected)
    order = np.argsort(height, kind="stable")
    with in_file(file):
        found = Distortion(FieldPoints(height_mm=height[order]), np.hypot(*real[diagonal].T)[order] / height[order])
    radius, largest = np.hypot(*ideal.T), height[order][-1]
    ratio = even_curve(height[order], found.ratio, radius)
    apart = np.hypot(*(real - ideal * ratio[:, None]).T) / largest
    if (worst := float(apart[radius <= largest * (1 + 1e-6)].max(initial=0.0))) > _SYMMETRIC:
        what = f"the distortion is not rotationally symmetric: a point deviates by {worst:.2g} of the largest height"
        raise FileError(file, what)
    return found


def _check_grid_header(lines: list[str], file: Path, wavelength_nm: float | None) -> None:
    for index, line in enumerate(lines):
        if (match := _GRID_UNITS.match(line)) is not None and not match[1].lower().startswith("millimet"):
            hint = "Set the lens to mm, and save again"
            raise FileError(file, "units", index + 1, value=match[1], expected="Millimeters", hint=hint)
        if (match := _GRID_REFERENCE.search(line)) is not None and (number(match[1]) or number(match[2])):
            value = (number(match[1]), number(match[2]))
            raise FileError(file, "reference field", index + 1, value=value, expected="the axis, (0, 0)")
        if (match := _GRID_WAVELENGTH.match(line)) is not None and wavelength_nm is not None:
            own = micrometers(match[1], match[2], file, index + 1) * 1e3
            if abs(own - wavelength_nm) > _SAME_GRID_NM:
                raise FileError(file, "wavelength_nm", index + 1, value=wavelength_nm, expected=f"{own:g}")
