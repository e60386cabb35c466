"""Measured charts as CSV: a line per patch and a column per wavelength, or the reverse, by the heading.

    patch,400,410,420            wavelength_nm,white,gray
    white,0.81,0.85,0.88         400,0.81,0.19
    gray,0.19,0.19,0.19          410,0.85,0.19

Separated by commas, semicolons or tabs. Lines that begin with # are comments; `# units: percent` states the units.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from photosite.color.wavelength_units import heading_unit
from photosite.errors import FileError, InputError
from photosite.files.writing import atomic_path
from photosite.scene.cube import wavelengths_in_nm
from photosite.scene.io.patch_table import PatchTable, checked_names, number, patch_table, patches_across, read_text
from photosite.scene.scene import Scene
from photosite.scene.units import Units, parse_units

Line = tuple[int, list[str]]

_COMMENT = re.compile(r"#\s*(units|cols|title)\s*[:=]\s*(.+)", re.IGNORECASE)
_WAVELENGTH = re.compile(
    r"(?:(?:lambda|wavelengths?|wl|spectral|spec|refl(?:ectance)?|band|nm|r)[ _]*)*"
    r"(\d+(?:[.,]\d+)?)[ _]*(nm|um|µm|μm)?",
    re.IGNORECASE,
)
_EXPECTED = "a heading 'patch,400,410,...' with a line per patch, or 'wavelength_nm,first,second,...'"


def read_patches(path: Path) -> PatchTable:
    """Read the table of a file; errors have the line where it is known."""
    comments, lines = _lines(read_text(path))
    if len(lines) < 2:
        raise FileError(path, f"has no chart; expected {_EXPECTED}")
    heading, body = lines[0], lines[1:]
    for line_number, cells in body:
        if len(cells) != len(heading[1]):
            expected = f"{len(heading[1])} as in the heading"
            raise FileError(path, "number of cells", line_number, value=len(cells), expected=expected)
    is_wavelength, unit = heading_unit(heading[1][0])
    table = _by_lines(path, heading, body, unit) if is_wavelength else _by_columns(path, heading, body)
    try:
        units: Units | None = parse_units(comments["units"]) if "units" in comments else None
    except InputError as error:
        raise error.in_file(path) from None
    cols = patches_across(comments.get("cols", ""))
    return PatchTable(path, table.names, table.wavelength_nm, table.values, units, cols, comments.get("title"))


def _lines(text: str) -> tuple[dict[str, str], list[Line]]:
    """Return the values in comments, and the cells of the other lines."""
    comments: dict[str, str] = {}
    kept: list[tuple[int, str]] = []
    for line_number, line in enumerate(text.split("\n"), start=1):
        if match := _COMMENT.fullmatch(line.strip()):
            comments[match[1].lower()] = " ".join(match[2].split())
        elif not line.lstrip().startswith("#") and line.strip(" ,;\t"):
            kept.append((line_number, line))
    mark = max("\t;,", key=kept[0][1].count) if kept else ","
    return comments, [
        (at, [cell.strip() for cell in row]) for at, line in kept for row in csv.reader([line], delimiter=mark)
    ]


def _by_columns(path: Path, heading: Line, body: list[Line]) -> PatchTable:
    """Parse a line per patch: its name first, then its spectrum in the columns headed by a wavelength."""
    found = [(k, match) for k, cell in enumerate(heading[1]) if (match := _WAVELENGTH.fullmatch(cell))]
    if not found or found[0][0] == 0:
        raise FileError(path, f"the heading has no wavelengths; expected {_EXPECTED}", heading[0])
    units = {match[2] for _, match in found}
    if len(units) > 1:
        raise FileError(path, "the wavelengths in the heading have mixed units", heading[0])
    grid = wavelengths_in_nm(path, [float(match[1].replace(",", ".")) for _, match in found], units.pop(), None)
    values = [[number(path, cells[k], at, f"'{heading[1][k]}'", gaps=True) for k, _ in found] for at, cells in body]
    names = checked_names(path, [cells[0] for _, cells in body], [at for at, _ in body])
    return PatchTable(path, names, grid, np.array(values))


def _by_lines(path: Path, heading: Line, body: list[Line], unit: str | None) -> PatchTable:
    """Parse a line per wavelength and a column per patch."""
    names = heading[1][1:]
    if not names:
        raise FileError(path, f"the heading has no patches; expected {_EXPECTED}", heading[0])
    wavelengths = [number(path, cells[0], at, "a wavelength") for at, cells in body]
    grid = wavelengths_in_nm(path, wavelengths, unit, None)
    values = [
        [number(path, cell, at, f"'{name[:30]}'", gaps=True) for name, cell in zip(names, cells[1:], strict=True)]
        for at, cells in body
    ]
    return PatchTable(path, checked_names(path, names, [heading[0]] * len(names)), grid, np.array(values).T)


def write(scene: Scene, path: Path) -> None:
    """Write the patches of a chart: reflectances where known, else energy radiance."""
    table = patch_table(scene, path)
    reflects = table.units is not None and table.units.quantity == "reflectance"
    title = " ".join((table.title or "").split())
    lines = [f"# units: {'reflectance' if reflects else 'W/m2/sr/nm'}", f"# cols: {table.cols}", f"# title: {title}"]
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.write("\n".join([*lines, ""]))
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["patch", *(f"{wavelength:g}nm" for wavelength in table.wavelength_nm)])
        rows.writerows(
            [name, *(f"{value:.7g}" for value in row)] for name, row in zip(table.names, table.values, strict=True)
        )
