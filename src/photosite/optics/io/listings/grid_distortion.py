"""Zemax's listing of grid distortion: where the points of a grid fall, and where they would without distortion.

Units are Millimeters.
Wavelength: 0.55000 µm
Reference Coordinates: Xref = 0.00000E+000, Yref = 0.00000E+000

   i    j      X-Field       Y-Field      R-Field   Predicted X   Predicted Y        Real X        Real Y   Distortion
 -32  -32 -1.94201E+001 -1.48108E+001 2.37825E+001 -6.96011E-001 -5.22008E-001 -6.64084E-001 -4.98063E-001 -4.587114%

After AsphereF=2mm_GridDistortion_3.dat of ISETCam, opticalimage/raytrace/zemax/20050902 db, and the documentation of
mascado. The points of the diagonal become the curve; all others must lie on it.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.optics.distortion import Distortion
from photosite.optics.io.listings.text import NUMBER, TableRows, micrometers, number
from photosite.optics.radial_table import FieldPoints, even_curve

Array = NDArray[np.float64]

_HEADING = re.compile(r"predicted\s+x\s+predicted\s+y\s+real\s+x\s+real\s+y", re.IGNORECASE)
_UNITS = re.compile(r"^\s*Units are\s*:?\s*([A-Za-z]+)", re.IGNORECASE)
_WAVELENGTH = re.compile(rf"^\s*Wavelength\s*:?\s*({NUMBER})\s*(\S*m\S*)", re.IGNORECASE)
_REFERENCE = re.compile(rf"Xref\s*=\s*({NUMBER}),?\s+Yref\s*=\s*({NUMBER})", re.IGNORECASE)
_COLUMNS = 10
_SYMMETRIC = 2e-3
"""Of the largest height: how far a point may lie from where a lens with symmetry has it."""
_SAME_NM = 0.5


def is_grid_distortion(lines: list[str]) -> bool:
    """Whether these are a listing of grid distortion."""
    return "grid distortion" in " ".join(lines[:12]).lower()


def read_grid_distortion(lines: list[str], file: Path, wavelength_nm: float | None = None) -> Distortion:
    """The distortion of a listing's wavelength.

    Parameters
    ----------
    lines
        Of the file.
    file
        For messages.
    wavelength_nm
        Refused if the listing is of another.

    Raises
    ------
    FileError
        If it is damaged, not in mm, not about the axis, or the distortion is not the same all around the axis.
    """
    start = next((index for index, line in enumerate(lines) if _HEADING.search(line)), None)
    if start is None:
        raise FileError(file, "has no table of predicted and real X and Y; save the text of Grid Distortion")
    _check_head(lines[:start], file, wavelength_nm)
    listed = TableRows(file, _COLUMNS)
    for index in range(start + 1, len(lines)):
        listed.take(lines[index], index + 1)
    table = np.array(listed.rows).reshape(-1, _COLUMNS)
    ideal, real = table[:, 5:7], table[:, 7:9]
    diagonal = (table[:, 0] == table[:, 1]) & (table[:, 0] > 0)
    height = np.hypot(*ideal[diagonal].T)
    if height.size < 3 or not height.all() or not np.isfinite(table).all():
        raise FileError(file, "holds no grid of points: rows (i, j) = (1, 1), (2, 2), (3, 3) at least are expected")
    order = np.argsort(height, kind="stable")
    try:
        found = Distortion(FieldPoints(height_mm=height[order]), np.hypot(*real[diagonal].T)[order] / height[order])
    except InputError as error:
        raise FileError(file, str(error)) from None
    _check_symmetry(file, found, ideal, real)
    return found


def _check_head(lines: list[str], file: Path, wavelength_nm: float | None) -> None:
    for index, line in enumerate(lines):
        if (said := _UNITS.match(line)) is not None and not said[1].lower().startswith("millimet"):
            raise FileError(file, f"its units are {said[1]}; set the lens to mm and save again", index + 1)
        if (said := _REFERENCE.search(line)) is not None and (number(said[1]) or number(said[2])):
            raise FileError(file, "its reference is not the axis; set the reference field to (0, 0)", index + 1)
        if (said := _WAVELENGTH.match(line)) is not None and wavelength_nm is not None:
            own = micrometers(said[1], said[2], file, index + 1) * 1e3
            if abs(own - wavelength_nm) > _SAME_NM:
                raise FileError(file, f"has no distortion at {wavelength_nm:g} nm; it is of {own:g} nm", index + 1)


def _check_symmetry(file: Path, found: Distortion, ideal: Array, real: Array) -> None:
    """Refuse points that do not lie on the diagonal's curve, along their own radius."""
    assert found.field.height_mm is not None
    radius, largest = np.hypot(*ideal.T), found.field.height_mm[-1]
    ratio = even_curve(found.field.height_mm, found.ratio, radius)
    apart = np.hypot(*(real - ideal * ratio[:, None]).T) / largest
    if (worst := float(apart[radius <= largest * (1 + 1e-6)].max(initial=0.0))) > _SYMMETRIC:
        raise FileError(
            file,
            f"its distortion is not the same all around the axis: a point lies {worst:.2g} of the largest height from "
            "where symmetry has it",
        )
