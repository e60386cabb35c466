"""A lens as a whole from the files that ISET's ray-trace macros write with Zemax and with CODE V.

ISETPARMS.txt holds assignments: names, focal length, f-number, the range of wavelengths, the ideal (paraxial) image
heights. Beside it lie, for a lens called NAME,

NAME_DI_.dat                     real image heights, mm: for each ideal height, from the axis outwards, one number
                                 for each wavelength
NAME_RI_.dat                     relative illumination in that order
NAME_CRA_.dat                    angles of the chief ray at the sensor, radians (Zemax only)
NAME_2D_PSF_Fld2_Wave1.dat       point spreads, or NAME_PSF_2_1.dat: numbers of the height and the wavelength, from 1

Point spreads are Zemax's listings, computed for images at -y, or bare grids of CODE V, for images at +y. Source of the
layout: the macros ISET_RT_ZEMAX.ZPL (2005 to 2013) and ISET_RT_CODEV.SEQ in ISETCam, opticalimage/raytrace.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError
from photosite.optics.compound import Lens
from photosite.optics.distortion import Distortion, LateralColor, combined_mapping
from photosite.optics.illumination import IlluminationTable
from photosite.optics.io.listings import codev, zemax
from photosite.optics.io.listings.design_files import FirstRow, Layout, design_of
from photosite.optics.io.listings.parameters import Parameters, is_parameters, read_parameters
from photosite.optics.io.listings.text import PsfListing, read_text, rows_of_numbers
from photosite.optics.lens import DiffractionLimited
from photosite.optics.lens_design import LensDesign
from photosite.optics.radial_table import FieldPoints
from photosite.optics.warn import warn_user

Array = NDArray[np.float64]

_FAR_MM = 1e9
"""Zemax writes 1e10 for infinity, CODE V more."""
_LEAST_MAGNIFICATION = 1e-3
"""Above it the magnification, written to 1e-6, tells the distance best; below, the distance from the first surface."""
_STEP_NM = 0.5
"""Zemax's macro rounds the printed step of wavelengths to whole nanometres."""
_SAME_NM = 0.6
_SAME_HEIGHT = 2e-3
"""Of the largest height."""
_SAME_ILLUMINATION = 0.02
_SAMPLE_DIGITS = 2
"""Of a chief ray's place in samples: the heights' seven digits tell no more."""


def set_of(path: str | PathLike[str]) -> Path | None:
    """The parameters of a set: this file if it is one, or the one in this folder; None if there is none.

    Raises
    ------
    FileError
        If the folder holds several.
    """
    source = Path(path)
    if source.is_dir():
        found = sorted(file for file in _files(source) if file.name.lower().endswith("isetparms.txt"))
        if len(found) > 1:
            raise FileError(source, f"holds several sets, {found[0].name} and {found[1].name}: name the file")
        return found[0] if found else None
    return source if source.suffix.lower() == ".txt" and source.is_file() and is_parameters(source) else None


def read_ray_trace(path: str | PathLike[str]) -> RayTrace:
    """The set of files that ISET's macros write with Zemax or CODE V; its point spreads are read when asked for.

    Parameters
    ----------
    path
        ISETPARMS.txt, or its folder.

    Raises
    ------
    FileError
        If the parameters or the distorted heights are missing or wrong.
    """
    source = Path(path)
    parameters = set_of(source)
    if parameters is None:
        what = "holds no ISETPARMS.txt" if source.is_dir() else "is no ISETPARMS.txt: it sets no baseLensFileName"
        raise FileError(source, what if source.exists() else "there is no such file")
    said = read_parameters(parameters)
    names = {file.name.lower(): file for file in _files(parameters.parent)}
    base = PureWindowsPath(said.base_name).name
    file = _beside(parameters, names, f"{base}_DI_.dat")
    table = _table(file, said)
    if (table[0] != 0).any() or (np.diff(table, axis=0) <= 0).any():
        raise FileError(
            file,
            f"heights begin with 0 and grow at each of {table.shape[1]} wavelengths: a row, or a number a line, for "
            f"each of {said.heights} heights; these do not",
        )
    waves = _wavelengths(parameters, said, table.shape[1])
    return RayTrace(parameters, said, base, names, waves, np.linspace(0.0, said.largest_height_mm, said.heights), table)


@dataclass(frozen=True, eq=False)
class RayTrace:
    """What a set of files says; `read_ray_trace` makes it.

    Parameters
    ----------
    path
        ISETPARMS.txt.
    parameters
        What it holds.
    base
        What the other files' names begin with.
    names
        Files of the folder by their names in lower case.
    wavelength_nm
        (L,).
    ideal_mm
        (F,) ideal image heights, from 0.
    real_mm
        (F, L) where chief rays fall on the sensor.

    Examples
    --------
    >>> from photosite.optics.io.listings.ray_trace import read_ray_trace
    >>> lens = read_ray_trace("ISETPARMS.txt").lens()                  # doctest: +SKIP
    """

    path: Path
    parameters: Parameters
    base: str
    names: Mapping[str, Path]
    wavelength_nm: Array
    ideal_mm: Array
    real_mm: Array

    def lens(self, **options: Any) -> Lens:
        """All of it: point spreads, distortion, lateral colour, relative illumination, focus.

        Parameters
        ----------
        options
            As `point_spreads`.

        Raises
        ------
        FileError
            If a file is missing or wrong.
        """
        said = self.parameters
        distortion, color = self.distortion()
        try:
            combined_mapping(distortion, color, said.focal_length_mm * 1e-3)  # refuses what folds back
            return Lens(
                DiffractionLimited(said.f_number, said.focal_length_mm),
                self.point_spreads(**options),
                self.focus_distance_m,
                self.relative_illumination(),
                distortion,
                color,
                name=PureWindowsPath(said.lens_file or self.base).stem,
            )
        except InputError as error:
            raise FileError(self.path, str(error)) from None

    @property
    def focus_distance_m(self) -> float:
        """Of the objects that all was computed for, from the lens."""
        said = self.parameters
        if said.object_distance_mm >= _FAR_MM:
            return math.inf
        size = abs(said.magnification)
        if size >= _LEAST_MAGNIFICATION:
            return said.focal_length_mm * (1 + 1 / size) * 1e-3
        return said.object_distance_mm * 1e-3

    def distortion(self, wavelength_nm: float | None = None) -> tuple[Distortion, LateralColor | None]:
        """Distortion at a wavelength, and how far the others fall from it.

        Parameters
        ----------
        wavelength_nm
            None: the design's reference wavelength. Between the set's wavelengths linear.

        Raises
        ------
        FileError
            If the heights cannot be, or the wavelength is not within the set's.
        """
        first, last = self.wavelength_nm[[0, -1]]
        if wavelength_nm is not None and not first - _SAME_NM <= wavelength_nm <= last + _SAME_NM:
            raise FileError(self.path, f"has no distortion at {wavelength_nm:g} nm; it has {first:g} to {last:g} nm")
        own = self._at(self.real_mm, wavelength_nm)
        try:
            distortion = Distortion.from_real_heights(FieldPoints(height_mm=self.ideal_mm), own, 1.0)
            if self.wavelength_nm.size == 1:
                return distortion, None
            shift = (self.real_mm.T - own) * 1e3
            return distortion, LateralColor(self.wavelength_nm, FieldPoints(height_mm=own), shift)
        except InputError as error:
            raise FileError(self._file("DI"), str(error)) from None

    def relative_illumination(self) -> IlluminationTable:
        """At the reference wavelength.

        Raises
        ------
        FileError
            If the file is missing or wrong.

        Warns
        -----
        PhotositeWarning
            If another wavelength's differs by more than 2 % of that on the axis.
        """
        table = _table(self._file("RI"), self.parameters, self.wavelength_nm.size)
        own = self._at(table)
        if (apart := float(np.abs(table - own[:, None]).max())) > _SAME_ILLUMINATION:
            warn_user(
                f"{self._file('RI').name}: relative illumination differs by up to {apart:.2g} between wavelengths; "
                f"that at {self.parameters.reference_nm:g} nm is used for all",
            )
        try:
            return IlluminationTable(FieldPoints(height_mm=self._at(self.real_mm)), own)
        except InputError as error:
            raise FileError(self._file("RI"), str(error)) from None

    def exit_pupil_mm(self) -> float:
        """Distance of the exit pupil from the sensor, at the reference wavelength; inf for a telecentric lens.

        It is that which fits tan(angle) of the chief rays best over the field (least squares), what a sensor's
        `angular_response` asks for.

        Raises
        ------
        FileError
            If there is no file of chief-ray angles, or it is wrong.
        """
        file = self._file("CRA")
        table = _table(file, self.parameters, self.wavelength_nm.size)
        if (table < 0).any() or (table >= math.pi / 2).any():
            raise FileError(file, "chief-ray angles are in radians, from 0 to below pi / 2")
        height, slope = self._at(self.real_mm), np.tan(self._at(table))
        through = float(height @ slope)
        return math.inf if through == 0 else float(height @ height) / through

    def point_spreads(self, first_row: FirstRow = "top", **options: Any) -> LensDesign:
        """Over the field and wavelengths; fields are the real heights at the reference wavelength.

        Parameters
        ----------
        first_row
            Where the first row of samples lies on the image surface, y up.
        options
            `tolerance`, `rank`, `detail_um` and `nodes` of `LensDesign`.

        Raises
        ------
        FileError
            If a file is missing or wrong, or is of another wavelength or height than its name says.
        """
        listings = [
            self._listing(f, w, first_row) for f in range(self.ideal_mm.size) for w in range(self.wavelength_nm.size)
        ]
        return design_of(self.path, listings, Layout("image", first_row), options)

    def _listing(self, f: int, w: int, first_row: FirstRow) -> PsfListing:
        new, old = f"{self.base}_2D_PSF_Fld{f + 1}_Wave{w + 1}.dat", f"{self.base}_PSF_{f + 1}_{w + 1}.dat"
        file = _beside(self.path, self.names, old if old.lower() in self.names else new)
        if self.parameters.program == "zemax":
            listing, side = zemax.read_psf(file), -1.0
            if listing.field is not None and listing.field[1]:
                side = math.copysign(1.0, listing.field[1])
            self._check(listing, f, w)
        else:
            listing, side = codev.read_psf(file), 1.0
            size = self.parameters.samples
            if listing.samples.shape != (size, size):
                raise FileError(file, f"holds {listing.samples.shape} samples; psfSize is {size}")
            listing = replace(listing, spacing_um=self.parameters.spacing_mm * 1e3)
        return replace(
            listing,
            origin=self._chief_ray(listing, side * self.real_mm[f, w], -1 if first_row == "top" else 1),
            wavelength_nm=float(self.wavelength_nm[w]),
            field=(0.0, side * float(self._at(self.real_mm)[f])),
            field_unit="mm",
        )

    def _check(self, listing: PsfListing, f: int, w: int) -> None:
        """Refuse a listing of another wavelength or height than its name says."""
        wave, height = self.wavelength_nm[w], self.ideal_mm[f]
        if listing.wavelength_nm is not None and abs(listing.wavelength_nm - wave) > _SAME_NM:
            raise FileError(listing.path, f"is of {listing.wavelength_nm:g} nm, by its name of {wave:g} nm")
        if listing.field is None or listing.field_unit != "mm":
            return
        if abs(math.hypot(*listing.field) - height) > _SAME_HEIGHT * self.ideal_mm[-1]:
            at = math.hypot(*listing.field)
            raise FileError(listing.path, f"is of the image height {at:g} mm, by its name of {height:g} mm")

    @staticmethod
    def _chief_ray(listing: PsfListing, height_mm: float, row_of_y: int) -> tuple[float, float]:
        """(row, col) of the chief ray, which a listing centred on its centroid does not have at its center point."""
        if listing.center_mm is None or listing.spacing_um is None:
            return listing.origin
        x, y = listing.center_mm
        up, right = (height_mm - y) * 1e3 / listing.spacing_um, -x * 1e3 / listing.spacing_um
        if max(abs(up), abs(right)) > min(listing.samples.shape) / 2:
            raise FileError(
                listing.path,
                f"lies at {y:g} mm on the image surface, the chief ray by the file of real heights at {height_mm:g} mm",
            )
        up, right = round(up, _SAMPLE_DIGITS), round(right, _SAMPLE_DIGITS)
        return listing.origin[0] + row_of_y * up, listing.origin[1] + right

    def _at(self, table: Array, wavelength_nm: float | None = None) -> Array:
        """(F,) of a table (F, L) at a wavelength."""
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
        raise FileError(parameters, f"there is no {name:.200} beside it; its name begins as baseLensFileName says")
    return file


def _table(file: Path, said: Parameters, waves: int | None = None) -> Array:
    """(F, L) of numbers, heights one after another."""
    values = rows_of_numbers(read_text(file, "a table of numbers"), 0, file).reshape(-1)
    expected = f"{said.heights} heights (imgHeightNum)" + ("" if waves is None else f" at {waves} wavelengths")
    if not values.size or values.size % said.heights or (waves is not None and values.size != waves * said.heights):
        raise FileError(file, f"holds {values.size} numbers, which are not those of {expected}")
    return values.reshape(said.heights, -1)


def _wavelengths(path: Path, said: Parameters, count: int) -> Array:
    """As many as the tables hold, from the first to the last: the printed step is rounded."""
    first, step, last = said.wavelengths_nm
    if count == 1 and first == last:
        return np.array([first])
    if count == 1 or not first < last or abs((last - first) / (count - 1) - step) > _STEP_NM:
        raise FileError(
            path, f"wave={first:g}:{step:g}:{last:g} are not the {count} wavelengths that {said.heights} heights have"
        )
    return np.linspace(first, last, count)
