"""Lenses from the files that ISET's ray-trace macros write with Zemax and with CODE V.

ISETPARMS.txt holds Matlab assignments:

lensFile='EO54852.ZMX';     %Lens file name
psfSpacing=0.0002500;   % PSF GRID SPACING IN MM
wave=400:50:700;            % WAVELENGTH SAMPLES (NM)
imgHeightNum=13;             % Number of IMAGE HEIGHTS

CODE V's macro writes the heights as a range, imgHeight=0:0.25:3, without semicolons. For a lens called NAME, the other
files are

NAME_DI_.dat                     real image heights, mm: for each ideal height, from the axis outwards, one number
                                 for each wavelength
NAME_RI_.dat                     relative illumination in that order
NAME_CRA_.dat                    angles of the chief ray at the sensor, radians (Zemax only)
NAME_2D_PSF_Fld2_Wave1.dat       PSFs, or NAME_PSF_2_1.dat: numbers of the height and the wavelength, from 1

PSFs are Zemax listings, computed for images at -y, or bare grids of CODE V, for images at +y. Source: the macros
ISET_RT_ZEMAX.ZPL (2005 to 2013) and ISET_RT_CODEV.SEQ in ISETCam, opticalimage/raytrace.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, Field, ValidationError, model_validator

from photosite.errors import FileError, InputError, PhotositeWarning, in_file
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor, combined_mapping
from photosite.optics.field_points import FieldPoints
from photosite.optics.illumination import IlluminationTable
from photosite.optics.io import zemax
from photosite.optics.io.listing import (
    NUMBER,
    FirstRow,
    Layout,
    PsfListing,
    lens_design_of,
    number,
    read_grid,
    read_text,
    rows_of_numbers,
)
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.values.validated import input_error

Array = NDArray[np.float64]

_ASSIGNMENT = re.compile(r"""^\s*"?\s*([A-Za-z]\w*)\s*(\([^)]*\))?\s*=\s*(?:'([^']*)'?|([^;%"]*))""")
_OWN_NAMES = re.compile(r"^\s*\"?\s*(?:baseLensFileName|psfSize|imgHeight(?:Num|Max)?|fnumber_eff)\s*=", re.MULTILINE)
"""Assignments that only ISETPARMS.txt has."""
_MOST_HEIGHTS = 10_000
_FAR_MM = 1e9
"""Zemax writes 1e10 for infinity, CODE V more."""
_LEAST_MAGNIFICATION = 1e-3
"""Above it, the magnification, printed to 1e-6, is the best measure of the distance; below, the printed distance."""
_STEP_NM = 0.5
"""Zemax's macro rounds the printed wavelength step to whole nanometers."""
_SAME_NM = 0.6
"""The macros round wavelengths to whole nanometers."""
_SAME_HEIGHT = 2e-3
"""Relative to the largest height."""
_SAME_ILLUMINATION = 0.02
_SAMPLE_DIGITS = 2
"""Decimals of a chief ray's position in samples, which the seven digits of the heights support."""


def _float(text: str) -> float:
    return number(text.strip()) if re.fullmatch(NUMBER, text.strip()) else math.nan


def _range(text: str) -> tuple[float, float, float]:
    """Return first, step and last of first:step:last, NaN for other text."""
    parts = tuple(map(_float, text.split(":")))
    return parts if len(parts) == 3 else (math.nan, math.nan, math.nan)


def _first_step_last(text: str) -> tuple[float, float, float]:
    first, step, last = _range(text) if ":" in text else (_float(text), 0.0, _float(text))
    if not (0 < first <= last and math.isfinite(step)):
        raise ValueError("first:step:last in nm, increasing")
    return first, step, last


Value = Annotated[float, BeforeValidator(_float), Field(allow_inf_nan=False)]
Positive = Annotated[Value, Field(gt=0)]
Count = Annotated[int, Field(ge=2, le=_MOST_HEIGHTS)]


class Parameters(BaseModel, frozen=True):
    """The assignments of ISETPARMS.txt, in its units."""

    program: Literal["zemax", "codev"] = "zemax"
    """The program whose macro wrote the file: Zemax's writes the number of heights, CODE V's a range."""
    base_name: str = Field(alias="baseLensFileName")
    """Beginning of the names of the other files; may include a Windows folder."""
    lens_file: str = Field("", alias="lensFile")
    focal_length_mm: Positive = Field(alias="efl")
    f_number: Positive = Field(alias="fnumber")
    """Ratio of the effective focal length to the diameter of the entrance pupil."""
    magnification: Value = Field(alias="mag")
    """0 for far objects, otherwise negative."""
    object_distance_mm: Positive = Field(alias="objDist")
    """Distance from the first surface."""
    wavelengths_nm: Annotated[tuple[float, float, float], BeforeValidator(_first_step_last)] = Field(alias="wave")
    """First, step, last."""
    reference_nm: Positive = Field(alias="refWave")
    heights: Count = Field(alias="imgHeightNum")
    """Number of ideal image heights, evenly spaced from 0 to the largest."""
    largest_height_mm: Positive = Field(alias="imgHeightMax")
    samples: Count = Field(alias="psfSize")
    """Requested samples of PSFs on each axis."""
    spacing_mm: Positive = Field(alias="psfSpacing")

    @model_validator(mode="before")
    @classmethod
    def _heights(cls, raw: dict[str, str]) -> dict[str, str]:
        """Replace CODE V's range of heights by their number and the largest."""
        if "imgHeight" not in raw:
            return raw
        first, step, last = _range(raw["imgHeight"])
        if not (first == 0 and 0 < step <= last <= _MOST_HEIGHTS * step):
            expected = f"0:step:last in mm, at most {_MOST_HEIGHTS} heights"
            raise InputError("imgHeight", value=raw["imgHeight"], expected=expected)
        return raw | {"program": "codev", "imgHeightNum": str(round(last / step) + 1), "imgHeightMax": str(last)}

    @model_validator(mode="after")
    def _check(self) -> Self:
        first, _, last = self.wavelengths_nm
        if not first - _SAME_NM <= self.reference_nm <= last + _SAME_NM:
            expected = f"in nm, from {first:g} to {last:g} as in wave"
            raise InputError("refWave", value=self.reference_nm, expected=expected)
        return self


def read_parameters(path: Path) -> Parameters:
    """Read ISETPARMS.txt; raise `FileError` with the line if an assignment is missing or invalid."""
    values: dict[str, str] = {}
    lines: dict[str, int] = {}
    for index, line in enumerate(read_text(path, "ISETPARMS.txt"), start=1):
        if (match := _ASSIGNMENT.match(line)) is None:
            continue
        name, element, quoted, bare = match.groups()
        if element is None:
            values[name], lines[name] = (bare if quoted is None else quoted).strip(), index
        elif name == "objDist":
            raise FileError(path, "holds several object distances (the 3D macro)", hint="Export with the 2D macro")
    try:
        return Parameters.model_validate(values)
    except ValidationError as error:
        found = input_error(error)
        raise found.in_file(path, lines.get(found.what)) from None


def find_set(path: str | PathLike[str]) -> Path | None:
    """Return the ISETPARMS.txt that the path is, or that is in the folder, or None; raise `FileError` for several."""
    source = Path(path)
    if source.is_dir():
        found = sorted(file for file in _files(source) if file.name.lower().endswith("isetparms.txt"))
        if len(found) > 1:
            what = f"holds several sets, {found[0].name} and {found[1].name}"
            raise FileError(source, what, hint="Name one of the files")
        return found[0] if found else None
    return source if source.suffix.lower() == ".txt" and source.is_file() and _is_parameters(source) else None


def _is_parameters(path: Path) -> bool:
    try:
        return _OWN_NAMES.search("\n".join(read_text(path, "a text"))) is not None
    except FileError:
        return False


def read_ray_trace(path: str | PathLike[str]) -> RayTrace:
    """Read ISETPARMS.txt, or its folder, and the other files of the set; PSFs are read when used.

    Raises `FileError` if the parameters or the distorted heights are missing or invalid, as the methods of the result
    do for the other files.
    """
    source = Path(path)
    parameters = find_set(source)
    if parameters is None:
        what = "holds no ISETPARMS.txt" if source.is_dir() else "is not an ISETPARMS.txt: it sets no baseLensFileName"
        raise FileError(source, what if source.exists() else "no such file or folder")
    read = read_parameters(parameters)
    names = {file.name.lower(): file for file in _files(parameters.parent)}
    base = PureWindowsPath(read.base_name).name
    file = _beside(parameters, names, f"{base}_DI_.dat")
    table = _table(file, read)
    if (table[0] != 0).any() or (np.diff(table, axis=0) <= 0).any():
        layout = f"{read.heights} heights at {table.shape[1]} wavelengths, one row or one number per line"
        raise FileError(file, "heights", expected=f"increasing from 0: {layout}")
    waves = _wavelengths(parameters, read, table.shape[1])
    return RayTrace(parameters, read, base, names, waves, np.linspace(0.0, read.largest_height_mm, read.heights), table)


@dataclass(frozen=True, eq=False)
class RayTrace:
    """The content of a set of files, from `read_ray_trace`.

    Parameters
    ----------
    path, parameters
        ISETPARMS.txt, and its content.
    base, names
        Beginning of the names of the other files; files of the folder by their names in lower case.
    wavelength_nm
        (L,).
    ideal_mm, real_mm
        (F,) ideal image heights, from 0, and (F, L) chief-ray positions on the sensor.

    Examples
    --------
    >>> from photosite.optics.io.iset import read_ray_trace
    >>> lens = read_ray_trace("ISETPARMS.txt").lens()                  # doctest: +SKIP
    """

    path: Path
    parameters: Parameters
    base: str
    names: Mapping[str, Path]
    wavelength_nm: Array
    ideal_mm: Array
    real_mm: Array

    def lens(self) -> Lens:
        """Return the lens: PSFs, distortion, lateral color, relative illumination, focus."""
        read = self.parameters
        distortion, color = self.distortion()
        with in_file(self.path):
            combined_mapping(distortion, color, read.focal_length_mm * 1e-3)  # raises if the image folds back
            return Lens(
                DiffractionLimited(read.f_number, read.focal_length_mm),
                self.point_spreads(),
                self.focus_distance_m,
                self.relative_illumination(),
                distortion,
                color,
                name=PureWindowsPath(read.lens_file or self.base).stem,
            )

    @property
    def focus_distance_m(self) -> float:
        """Distance of the objects for which the set was computed, from the lens."""
        read = self.parameters
        if read.object_distance_mm >= _FAR_MM:
            return math.inf
        size = abs(read.magnification)
        if size >= _LEAST_MAGNIFICATION:
            return read.focal_length_mm * (1 + 1 / size) * 1e-3
        return read.object_distance_mm * 1e-3

    def distortion(self, wavelength_nm: float | None = None) -> tuple[Distortion, LateralColor | None]:
        """Return the distortion at a wavelength, and the displacements of the others.

        None is the reference wavelength of the design. Heights are linear between the wavelengths of the set.
        """
        first, last = self.wavelength_nm[[0, -1]]
        if wavelength_nm is not None and not first - _SAME_NM <= wavelength_nm <= last + _SAME_NM:
            expected = f"from {first:g} to {last:g}"
            raise FileError(self.path, "wavelength_nm", value=wavelength_nm, expected=expected)
        own = self._at(self.real_mm, wavelength_nm)
        with in_file(self._file("DI")):
            distortion = Distortion.from_real_heights(FieldPoints(height_mm=self.ideal_mm), own, 1.0)
            if self.wavelength_nm.size == 1:
                return distortion, None
            shift = (self.real_mm.T - own) * 1e3
            return distortion, LateralColor(self.wavelength_nm, FieldPoints(height_mm=own), shift)

    def relative_illumination(self) -> IlluminationTable:
        """Return the relative illumination at the reference wavelength.

        A `PhotositeWarning` says if another wavelength differs by more than 2 % of the value on the axis.
        """
        table = _table(self._file("RI"), self.parameters, self.wavelength_nm.size)
        own = self._at(table)
        if (apart := float(np.abs(table - own[:, None]).max())) > _SAME_ILLUMINATION:
            what = (
                f"{self._file('RI').name}: relative illumination differs by up to {apart:.2g} between wavelengths; "
                f"that at {self.parameters.reference_nm:g} nm is used for all"
            )
            warnings.warn(PhotositeWarning(what), stacklevel=2)
        with in_file(self._file("RI")):
            return IlluminationTable(FieldPoints(height_mm=self._at(self.real_mm)), own)

    def exit_pupil_mm(self) -> float:
        """Return the distance of the exit pupil from the sensor, at the reference wavelength; inf if telecentric.

        It is the least-squares fit to tan(angle) of the chief rays over the field, as `angular_response` of a sensor
        requires.
        """
        file = self._file("CRA")
        table = _table(file, self.parameters, self.wavelength_nm.size)
        if (table < 0).any() or (table >= math.pi / 2).any():
            raise FileError(file, "chief-ray angles", expected="in radians, from 0 to below pi / 2")
        height, slope = self._at(self.real_mm), np.tan(self._at(table))
        through = float(height @ slope)
        return math.inf if through == 0 else float(height @ height) / through

    def point_spreads(self, first_row: FirstRow = "top", **options: Any) -> LensDesign:
        """Return the PSFs over field and wavelength, at the real heights of the reference wavelength.

        Parameters
        ----------
        first_row
            Position of the first row of samples on the image surface, y up.
        **options
            `tolerance`, `rank`, `detail_um` and `nodes` of `LensDesign`.
        """
        listings = [
            self._listing(f, w, first_row) for f in range(self.ideal_mm.size) for w in range(self.wavelength_nm.size)
        ]
        return lens_design_of(self.path, listings, Layout("image", first_row), options)

    def _listing(self, f: int, w: int, first_row: FirstRow) -> PsfListing:
        new, old = f"{self.base}_2D_PSF_Fld{f + 1}_Wave{w + 1}.dat", f"{self.base}_PSF_{f + 1}_{w + 1}.dat"
        file = _beside(self.path, self.names, old if old.lower() in self.names else new)
        if self.parameters.program == "zemax":
            listing, side = zemax.read_psf(file), -1.0
            if listing.field is not None and listing.field[1]:
                side = math.copysign(1.0, listing.field[1])
            self._check(listing, f, w)
        else:
            listing, side = read_grid(file), 1.0
            size = self.parameters.samples
            if listing.samples.shape != (size, size):
                raise FileError(file, "samples", value=listing.samples.shape, expected=f"{(size, size)}, see psfSize")
            listing = replace(listing, spacing_um=self.parameters.spacing_mm * 1e3)
        return replace(
            listing,
            origin=self._chief_ray(listing, side * self.real_mm[f, w], -1 if first_row == "top" else 1),
            wavelength_nm=float(self.wavelength_nm[w]),
            field=(0.0, side * float(self._at(self.real_mm)[f])),
            field_unit="mm",
        )

    def _check(self, listing: PsfListing, f: int, w: int) -> None:
        """Raise `FileError` for a listing of another wavelength or height than its name states."""
        wave, height = self.wavelength_nm[w], self.ideal_mm[f]
        if listing.wavelength_nm is not None and abs(listing.wavelength_nm - wave) > _SAME_NM:
            expected = f"{wave:g} nm, as its name states"
            raise FileError(listing.path, "wavelength", value=listing.wavelength_nm, expected=expected)
        if listing.field is None or listing.field_unit != "mm":
            return
        own = math.hypot(*listing.field)
        if abs(own - height) > _SAME_HEIGHT * self.ideal_mm[-1]:
            raise FileError(listing.path, "image height", value=own, expected=f"{height:g} mm, as its name states")

    @staticmethod
    def _chief_ray(listing: PsfListing, height_mm: float, row_of_y: int) -> tuple[float, float]:
        """Return (row, col) of the chief ray, which is not the center point of a listing about its centroid."""
        if listing.center_mm is None or listing.spacing_um is None:
            return listing.origin
        x, y = listing.center_mm
        up, right = (height_mm - y) * 1e3 / listing.spacing_um, -x * 1e3 / listing.spacing_um
        if max(abs(up), abs(right)) > min(listing.samples.shape) / 2:
            expected = f"near the chief ray at {height_mm:g} mm, by the file of real heights"
            raise FileError(listing.path, "center coordinates", value=y, expected=expected)
        up, right = round(up, _SAMPLE_DIGITS), round(right, _SAMPLE_DIGITS)
        return listing.origin[0] + row_of_y * up, listing.origin[1] + right

    def _at(self, table: Array, wavelength_nm: float | None = None) -> Array:
        """Return (F,) of a table (F, L) at a wavelength."""
        wave = self.parameters.reference_nm if wavelength_nm is None else wavelength_nm
        return np.array([np.interp(wave, self.wavelength_nm, row) for row in table])

    def _file(self, kind: str) -> Path:
        return _beside(self.path, self.names, f"{self.base}_{kind}_.dat")


def _files(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError as error:
        raise FileError(folder, f"cannot be read: {error.strerror or error}") from None


def _beside(parameters: Path, names: Mapping[str, Path], name: str) -> Path:
    if (file := names.get(name.lower())) is None:
        raise FileError(parameters, f"there is no {name:.200} beside it", hint="Names begin with baseLensFileName")
    return file


def _table(file: Path, read: Parameters, waves: int | None = None) -> Array:
    """Return (F, L) numbers, one height after another."""
    values = rows_of_numbers(read_text(file, "a table of numbers"), 0, file).reshape(-1)
    expected = f"{read.heights} heights (imgHeightNum)" + ("" if waves is None else f" x {waves} wavelengths")
    if not values.size or values.size % read.heights or (waves is not None and values.size != waves * read.heights):
        raise FileError(file, "numbers", value=values.size, expected=f"those of {expected}")
    return values.reshape(read.heights, -1)


def _wavelengths(path: Path, read: Parameters, count: int) -> Array:
    """Return as many wavelengths as the tables hold, from the first to the last; the printed step is rounded."""
    first, step, last = read.wavelengths_nm
    if count == 1 and first == last:
        return np.array([first])
    if count == 1 or not first < last or abs((last - first) / (count - 1) - step) > _STEP_NM:
        value, expected = f"{first:g}:{step:g}:{last:g}", f"the {count} wavelengths of the tables"
        raise FileError(path, "wave", value=value, expected=expected)
    return np.linspace(first, last, count)
