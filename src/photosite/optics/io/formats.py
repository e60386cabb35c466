"""All file formats of optics, in one table, and the readers that choose among them."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.small_files import reading
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.io import design_index, iset, optics_file, tables, zemax
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign, LensDesignOptions
from photosite.optics.tables import PsfOptions, PsfTable


@dataclass(frozen=True)
class Format:
    """One file format.

    Parameters
    ----------
    name
        Name of the format; `program` in an optics file selects by it.
    holds
        Kind of value: "lens", "OTFs", "PSFs", "lens design", "relative illumination", "distortion", "pupil amplitude".
    read, write
        path, **options -> value; value, path -> None, or None if the format is only read.
    suffixes
        Suffixes of file names; none if `matches` decides.
    options
        Options of `read` that mean something for this format.
    matches
        Whether a path is of this format; None: by its suffix, if it has any.
    """

    name: str
    holds: str
    read: Callable[..., Any]
    suffixes: tuple[str, ...] = ()
    options: tuple[str, ...] = ()
    write: Callable[..., None] | None = None
    matches: Callable[[Path], bool] | None = None

    def fits(self, path: Path) -> bool:
        """Return whether a path is of this format."""
        if self.matches is not None:
            return self.matches(path)
        return not self.suffixes or path.suffix.lower() in self.suffixes


def _psfs(load: Callable[[Path], Mapping[str, Any]]) -> Callable[..., PsfTable]:
    return lambda path, **options: tables.read_psf(path, load, **options)


def _is_set(path: Path) -> bool:
    return iset.find_set(path) is not None


_PSF_OPTIONS = tuple(PsfOptions.__annotations__)
_LISTING_OPTIONS = tuple(LensDesignOptions.__annotations__)
_SUM_OPTIONS = tuple(name for name in _LISTING_OPTIONS if name != "first_row")

FORMATS = (
    Format("iset", "lens", lambda path: iset.read_ray_trace(path).lens(), matches=_is_set),
    Format(
        "optics file",
        "lens",
        lambda path: optics_file.read_optics(path, partial(read, folder=path.parent)),
        write=optics_file.write_optics,
    ),
    Format("csv", "OTFs", tables.load_otf_table, options=("beyond",), write=tables.write_otf),
    Format("npz", "PSFs", _psfs(tables.load_npz), (".npz",), _PSF_OPTIONS, tables.write_psf),
    Format("hdf5", "PSFs", _psfs(tables.load_hdf5), (".h5", ".hdf5"), _PSF_OPTIONS),
    Format("tiff", "PSFs", _psfs(tables.load_tiff), (".tif", ".tiff"), _PSF_OPTIONS),
    Format("text", "PSFs", _psfs(tables.load_text), (".txt", ".csv", ".dat"), _PSF_OPTIONS),
    Format(
        "iset",
        "lens design",
        lambda path, **options: iset.read_ray_trace(path).point_spreads(**options),
        options=_LISTING_OPTIONS,
        matches=_is_set,
    ),
    Format("npz", "lens design", tables.read_design, (".npz",), _SUM_OPTIONS, tables.write_design),
    Format("zemax", "lens design", design_index.read_folder, options=_LISTING_OPTIONS, matches=Path.is_dir),
    Format("index", "lens design", design_index.read_index, options=_LISTING_OPTIONS),
    Format("zemax", "relative illumination", zemax.read_relative_illumination),
    Format("iset", "relative illumination", lambda path: iset.read_ray_trace(path).relative_illumination()),
    Format("zemax", "distortion", zemax.read_distortion, options=("wavelength_nm",)),
    Format(
        "iset",
        "distortion",
        lambda path, **options: iset.read_ray_trace(path).distortion(**options),
        options=("wavelength_nm",),
    ),
    Format("npz", "pupil amplitude", tables.read_amplitude, write=tables.write_amplitude),
)
"""The formats; of those that hold a kind of value, the first that fits is used."""


def read(
    holds: str,
    file: str | PathLike[str],
    *,
    program: str | None = None,
    folder: Path = Path(),
    sha256: str | None = None,
    **options: Any,
) -> Any:
    """Return the value of a kind that a file holds.

    Parameters
    ----------
    holds, program
        Kind of value, and name of the format, see `Format`. None: the first that fits.
    file, folder
        The file, relative to a folder.
    sha256
        SHA-256 of the file, hexadecimal, where an optics file states it.
    **options
        Options of the format; an unknown one raises `InputError`.

    Raises
    ------
    FileError
        If no format fits, the file is invalid, or it is another one than `sha256` states.
    """
    path = folder / file
    known = [entry for entry in FORMATS if entry.holds == holds and program in (None, entry.name)]
    chosen = next((entry for entry in known if entry.fits(path)), None)
    if chosen is None:
        suffixes = ", ".join(sorted(suffix for entry in known for suffix in entry.suffixes))
        raise FileError(path, "suffix", value=path.suffix, expected=f"one of {suffixes} for {holds}")
    for name in options:
        if name not in chosen.options:
            possible = {option for entry in known for option in entry.options}
            if name not in possible:
                raise InputError(f"unknown option '{name}'", hint=did_you_mean(name, sorted(possible)))
            raise FileError(path, name, value=options[name], expected=f"omitted for a file of format {chosen.name}")
    if chosen.suffixes and not os.path.isfile(path):  # False for an invalid name
        raise FileError(path, "no such file")
    found = chosen.read(path, **options)
    if sha256 is not None:
        _check_digest(path, sha256)
    return found


def _check_digest(path: Path, sha256: str) -> None:
    with reading(path), path.open("rb") as stream:
        found = hashlib.file_digest(stream, "sha256").hexdigest()
    if found != sha256.lower():
        hint = "Save the lens again, or remove sha256 if the file was changed on purpose"
        raise FileError(path, "is not the file that was written with the optics file", hint=hint)


_FIELDS = "fields of a lens"


def load_optics(source: str | PathLike[str] | Mapping[str, Any]) -> Lens:
    """Return the lens of an optics file, or of its fields.

    Parameters
    ----------
    source
        A YAML file with the fields listed in `photosite.optics.io.optics_file`; or these fields; or the ISETPARMS.txt,
        or its folder, of a set of files that ISET's macros wrote with Zemax or CODE V (`photosite.optics.io.iset`).
        Files that the fields name are relative to the optics file, or to the current folder.

    Raises
    ------
    FileError
        If the file is missing or does not describe a lens, or a file that it names is invalid; with the line.
    InputError
        If fields do not describe a lens.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "mine.optics.yaml")
    ...     _ = file.write_text("photosite_optics: 1\\nf_number: 2.8\\nfocal_lenght_mm: 50\\n")
    ...     load_optics(file)
    Traceback (most recent call last):
    photosite.errors.FileError: ...mine.optics.yaml:3: unknown field 'focal_lenght_mm'. Did you mean 'focal_length_mm'?
    >>> blur = {"kind": "wavefront", "zernike": {"8": 50}, "unit": "nm"}
    >>> load_optics({"f_number": 2.8, "focal_length_mm": 50, "blur": blur}).base.f_number
    2.8
    """
    if isinstance(source, Mapping):
        try:
            found = parse_optics(source, _FIELDS)
        except FileError as error:
            if error.path != _FIELDS:
                raise
            raise InputError(error.what, **error.fields) from None
        return found if isinstance(found, Lens) else Lens(found)
    lens: Lens = read("lens", source)
    return lens


def parse_optics(data: Mapping[str, Any], path: str | PathLike[str], section: str = "") -> Lens | DiffractionLimited:
    """Return the lens of the fields of an optics file, see `photosite.optics.io.optics_file.parse_optics`."""
    return optics_file.parse_optics(data, path, partial(read, folder=Path(path).parent), section)


def load_lens_design(path: str | PathLike[str], **options: Unpack[LensDesignOptions]) -> LensDesign:
    """Return PSFs over the field.

    Parameters
    ----------
    path
        A folder of Zemax listings, an index (`photosite.optics.io.design_index`), an .npz archive, or the
        ISETPARMS.txt, or its folder, of a set that ISET's macros wrote (`photosite.optics.io.iset`).
    **options
        Of `photosite.optics.lens_design.LensDesignOptions`; they override those of an index.

    Raises
    ------
    FileError
        If a file is missing or invalid, or a PSF is missing.
    InputError
        If there is no such option.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> r2 = np.add.outer(np.arange(-10, 11) ** 2, np.arange(-10, 11) ** 2) / 4
    >>> psf = np.stack([np.exp(-r2 / 2), np.exp(-r2 / 4)])[:, None]
    >>> place = {"field_y": [0, 0], "field_x": [0, 8], "unit": "mm"}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savez(f"{folder}/lens.npz", wavelength_nm=[550.0], psf=psf, spacing_um=0.5, **place)
    ...     design = load_lens_design(f"{folder}/lens.npz", rank=1)
    >>> design.psf.shape, design.rank
    ((2, 1, 21, 21), 1)
    """
    design: LensDesign = read("lens design", path, **options)
    return design


def load_psf_table(path: str | PathLike[str], **options: Unpack[PsfOptions]) -> PsfTable:
    """Return a table of PSFs from an .npz archive, an HDF5 file, a TIFF stack or a matrix of text.

    Parameters
    ----------
    path
        .npz or HDF5 with `psf` (L, n, n) or (n, n), `spacing_um` and `wavelength_nm`; in HDF5 the two may be
        attributes. A TIFF stack has a page for each wavelength; a text file (.txt, .csv, .dat) holds one.
    **options
        `spacing_um` and `wavelength_nm`, if the file does not state them, and `normalize`; see `PsfTable`.

    Raises
    ------
    FileError
        If the file is missing or damaged, lacks its spacing or wavelengths, or its content is invalid.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> r2 = np.add.outer(np.arange(-8, 9) ** 2, np.arange(-8, 9) ** 2)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/psf.txt", np.exp(-r2 / 8))
    ...     table = load_psf_table(f"{folder}/psf.txt", spacing_um=0.5, wavelength_nm=550, normalize=True)
    >>> table.samples.shape
    (1, 17, 17)
    """
    table: PsfTable = read("PSFs", path, **options)
    return table
