"""One PSF per file, and the `LensDesign` that many such files make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, in_file
from photosite.optics.checks import camera_wavelengths
from photosite.optics.io.listing import grid_of_numbers, is_grid_row, read_text
from photosite.optics.lens_design import LensDesign
from photosite.optics.sampled_psf import check_spacing, encircled_radius, normalised, resampled

Array = NDArray[np.float64]
Axes = Literal["image", "upright"]
FirstRow = Literal["top", "bottom"]

_ENCLOSED = 0.999
"""Energy of each PSF within the square that is kept; the faint rest of a large grid is dropped."""
_LEAST_HALF = 8
_MOST_HALF = 512
_FIELD_DIGITS = 6
"""Decimals, in deg or mm, to which the fields of different files are compared."""


@dataclass(frozen=True, eq=False)
class PsfListing:
    """One PSF as a file states it; None for what the file does not state.

    Parameters
    ----------
    path
        The file.
    samples
        (rows, cols) in the order of the file.
    origin
        (row, col), from 0, of the sample at the reference of the field point.
    spacing_um, wavelength_nm
        Distance between samples, and wavelength of the light.
    field, field_unit
        (x, y) of the field point, in "deg" or "mm".
    center_mm
        (x, y) of the origin on the image surface.
    """

    path: Path
    samples: Array
    origin: tuple[float, float]
    spacing_um: float | None = None
    wavelength_nm: float | None = None
    field: tuple[float, float] | None = None
    field_unit: str | None = None
    center_mm: tuple[float, float] | None = None

    def known(self, name: Literal["wavelength_nm", "spacing_um", "field"]) -> Any:
        """Return a value that the listing, or the index for it, must state."""
        if (value := getattr(self, name)) is None:
            key = "field_deg or field_mm" if name == "field" else name
            raise FileError(self.path, f"does not state its {key}", hint="Give it in an index, a YAML file")
        return value


def read_grid(path: str | PathLike[str]) -> PsfListing:
    """Read a bare grid of numbers, with any lines of text above it.

    Raises `FileError` if there is no grid of 3 x 3 numbers or more, or text within it; with the line.
    """
    file = Path(path)
    lines = read_text(file, "a grid of a PSF")
    start = next((i for i, line in enumerate(lines) if is_grid_row(line)), None)
    if start is None:
        raise FileError(file, "holds no rows of numbers")
    samples = grid_of_numbers(lines, start, file)
    return PsfListing(file, samples, (samples.shape[0] // 2, samples.shape[1] // 2))


@dataclass(frozen=True)
class Layout:
    """Orientation of a program's grids; the defaults are those of Zemax.

    Parameters
    ----------
    axes
        "image": as on the image surface, which is rotated by 180 degrees from the frame. "upright": as the frame.
    first_row
        Position of the first row of samples, "top" or "bottom".
    """

    axes: Axes = "image"
    first_row: FirstRow = "top"

    def upright(self, listing: PsfListing) -> tuple[Array, tuple[float, float]]:
        """Return samples and origin in the orientation of the frame, rows downwards."""
        samples, (row, col) = listing.samples, listing.origin
        rows, cols = samples.shape
        if self.first_row == "bottom":
            samples, row = samples[::-1], rows - 1 - row
        if self.axes == "image":
            samples, row, col = samples[::-1, ::-1], rows - 1 - row, cols - 1 - col
        return samples, (row, col)

    def field_point(self, listing: PsfListing) -> tuple[float, float]:
        """Return (y, x) of the field point, y down in the frame; on image axes a positive angle is imaged at +y."""
        x, y = listing.known("field")
        down, right = (y, -x) if self.axes == "image" else (-y, x)
        return round(down, _FIELD_DIGITS) + 0.0, round(right, _FIELD_DIGITS) + 0.0


def lens_design_of(
    source: Path, listings: Sequence[PsfListing], layout: Layout, options: Mapping[str, Any]
) -> LensDesign:
    """Return the lens design of many listings, one PSF for every field point and wavelength, in any order.

    Parameters
    ----------
    source
        The folder or file that names them, for messages.
    listings, layout
        The PSFs, and the orientation of their grids.
    options
        Options of `LensDesign`.

    Raises
    ------
    FileError
        If a listing lacks a value, or the listings do not form a complete design.
    """
    table: dict[tuple[tuple[float, float], float], PsfListing] = {}
    for listing in listings:
        with in_file(listing.path):
            camera_wavelengths([listing.known("wavelength_nm")])
            check_spacing(listing.known("spacing_um"))
        key = layout.field_point(listing), round(listing.known("wavelength_nm"), 3)
        if key in table:
            raise FileError(listing.path, f"has the same field and wavelength as {table[key].path.name}")
        table[key] = listing
    unit: Literal["deg", "mm"] = "deg" if listings[0].field_unit == "deg" else "mm"
    if any(listing.field_unit != unit for listing in listings):
        raise FileError(source, "mixes fields in degrees and in mm", hint="Give all in the same unit, in an index")
    points = sorted({point for point, _ in table}, key=lambda p: (np.hypot(*p), p))
    waves = sorted({wave for _, wave in table})
    for point, wave in product(points, waves):
        if (point, wave) not in table:
            x, y = next(known.field or (0, 0) for (at, _), known in table.items() if at == point)
            raise FileError(source, f"has no PSF at {wave:g} nm for the field ({x:g}, {y:g}) {unit}")
    psf, spacing = _on_one_grid([[table[point, wave] for wave in waves] for point in points], layout)
    y, x = np.array(points).T
    with in_file(source):
        return LensDesign(np.array(waves), psf, spacing, y, x, unit=unit, **options)


def _on_one_grid(table: list[list[PsfListing]], layout: Layout) -> tuple[Array, float]:
    """Return (F, L, n, n) samples of the finest spacing, large enough for each PSF, and that spacing in um."""
    spacing = min(listing.known("spacing_um") for row in table for listing in row)
    upright = [[_upright(listing, layout) for listing in row] for row in table]
    half = max(np.ceil(max(reach for row in upright for *_, reach in row) / spacing), _LEAST_HALF)
    if half > _MOST_HALF:
        path, across = table[0][0].path, f"{2 * half + 1:.4g}"
        raise FileError(path, f"needs {across} samples across with the others", hint="Save fewer or coarser samples")
    count = 2 * int(half) + 1
    psf = np.empty((len(table), len(table[0]), count, count))
    for f, row in enumerate(upright):
        for w, (samples, origin, own, _) in enumerate(row):
            psf[f, w] = resampled(samples, origin, own, count, spacing)
    return psf, spacing


def _upright(listing: PsfListing, layout: Layout) -> tuple[Array, tuple[float, float], float, float]:
    """Return samples, origin, spacing in um, and the radius about the origin that encloses the energy, in um."""
    samples, origin = layout.upright(listing)
    spacing = listing.known("spacing_um")
    with in_file(listing.path):
        samples = normalised(samples, "samples")
    return samples, origin, spacing, _reach(samples, origin) * spacing


def _reach(samples: Array, origin: tuple[float, float]) -> float:
    """Return the radius about the origin that encloses nearly all energy, in samples."""
    rows, cols = samples.shape
    middle = round(origin[0]), round(origin[1])
    margin = max(middle[0], rows - 1 - middle[0], middle[1], cols - 1 - middle[1])
    framed = np.zeros((2 * margin + 1, 2 * margin + 1))
    first = margin - middle[0], margin - middle[1]
    framed[first[0] : first[0] + rows, first[1] : first[1] + cols] = samples
    return encircled_radius(framed, 1.0, _ENCLOSED)
