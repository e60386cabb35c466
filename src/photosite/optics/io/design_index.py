"""Indices of PSF files: a YAML file that lists files and states what they do not; or a folder of Zemax listings.

photosite_lens_design: 1
program: zemax              # or grid: bare grids of numbers
axes: image                 # of samples and fields: image, as computed (inverted); upright, as the frame
first_row: top              # of the samples: top (y up) or bottom
symmetric: true             # rotationally; the fields lie along one radius
files:
  - {file: axis-450.txt, wavelength_nm: 450, field_deg: [0, 0], spacing_um: 0.25}
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StrictBool, StrictInt

from photosite.errors import FileError, InputError, in_file
from photosite.files.yaml import check_version, line_of, read_yaml, validated
from photosite.optics.checks import camera_wavelengths
from photosite.optics.io import zemax
from photosite.optics.io.listing import Axes, FirstRow, Layout, PsfListing, lens_design_of, read_grid
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import check_spacing
from photosite.values.validated import Number, PositiveNumber, Section

_SUFFIXES = (".txt", ".dat", ".psf")


class _File(Section):
    """One PSF file, and what it does not state."""

    file: str
    wavelength_nm: PositiveNumber | None = None
    field_deg: tuple[Number, Number] | None = None
    field_mm: tuple[Number, Number] | None = None
    spacing_um: PositiveNumber | None = None
    origin: tuple[Number, Number] | None = None

    def listing(self, folder: Path, program: str) -> PsfListing:
        """Return the PSF of the file with the stated values."""
        listing = (read_grid if program == "grid" else zemax.read_psf)(folder / self.file)
        changes: dict[str, Any] = {}
        if self.wavelength_nm is not None:
            camera_wavelengths([self.wavelength_nm])
            changes["wavelength_nm"] = float(self.wavelength_nm)
        if self.spacing_um is not None:
            check_spacing(self.spacing_um)
            changes["spacing_um"] = float(self.spacing_um)
        for field, unit in ((self.field_deg, "deg"), (self.field_mm, "mm")):
            changes |= {"field": field, "field_unit": unit} if field is not None else {}
        if self.origin is not None:
            (row, col), (rows, cols) = self.origin, listing.samples.shape
            if not (1 <= row <= rows and 1 <= col <= cols):
                expected = f"[row, column] within the {rows} x {cols} samples, from 1"
                raise InputError("origin", value=list(self.origin), expected=expected)
            changes["origin"] = (row - 1, col - 1)
        return replace(listing, **changes)


class _Index(Section):
    photosite_lens_design: Literal[1]
    program: Literal["zemax", "grid"] = "zemax"
    axes: Axes = "image"
    first_row: FirstRow = "top"
    symmetric: StrictBool | None = None
    tolerance: Number | None = None
    rank: StrictInt | None = None
    detail_um: Number | None = None
    nodes: StrictInt | None = None
    files: Annotated[tuple[_File, ...], Field(min_length=1)]
    provenance: Any = None


def read_folder(path: Path, first_row: FirstRow = "top", **options: Any) -> LensDesign:
    """Read a folder of Zemax listings (.txt, .dat or .psf) that each state wavelength, field and spacing.

    `first_row` is that of `Layout`; other options are those of `LensDesign`. Raises `FileError` if there is no listing
    of a PSF, or one is invalid.
    """
    listings = [zemax.read_psf(file) for file in sorted(path.iterdir()) if zemax.is_psf_file(file, _SUFFIXES)]
    if not listings:
        raise FileError(path, "holds no listing of a PSF (.txt, .dat or .psf)", hint="Name an index, a YAML file")
    return lens_design_of(path, listings, Layout(first_row=first_row), options)


def read_index(path: Path, first_row: FirstRow | None = None, **options: Any) -> LensDesign:
    """Read an index; the arguments override its entries.

    Raises `FileError` if the index or a file that it names is invalid, or a PSF is missing.
    """
    data = read_yaml(path, "an index of PSF files")
    check_version(path, data, "photosite_lens_design")
    index: _Index = validated(_Index, data, path)
    listings = []
    for number, file in enumerate(index.files):
        with in_file(path, line_of(data["files"], number)):
            listings.append(file.listing(path.parent, index.program))
    stated = index.model_dump(include={"symmetric", "tolerance", "rank", "detail_um", "nodes"}, exclude_none=True)
    return lens_design_of(path, listings, Layout(index.axes, first_row or index.first_row), {**stated, **options})
