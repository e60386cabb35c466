"""TIFF: stacks of one page a band, and pages of many samples a pixel.

What the numbers are stands in the first page's ImageDescription as JSON, or in a JSON file of the same name beside it:
wavelength_nm (bands,), units, and if wanted distance_m, width_m, light, no_data. Pages whose description has a number
of nanometres, such as "band 450 nm", say their wavelength each.
"""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, PhotositeError
from photosite.files.atomic import atomic_path
from photosite.scene.bands import wavelengths_in_nm
from photosite.scene.cube import Array, RawCube, SpectralCube
from photosite.scene.io.hdf5_cube import stated_units
from photosite.scene.io.picture import is_grey_tiff, is_tiff_picture, read_tiff_page
from photosite.scene.io.spool import Piece, spooled
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units

_STRIP_BYTES = 4 << 20
_DENSEST = 2000
"""Bytes of values to a byte in the file: more than deflate reaches."""
_MOST_PACKED = 1 << 30
"""Bytes of a compressed page of many samples, which is unpacked as a whole."""


def open_cube(path: Path, said: ReadOptions) -> SpectralCube | Scene:
    """The cube of a TIFF file; numbers that lie in one piece are read where they are, others are laid out anew.

    A page of red, green and blue is a picture, and a scene at once.

    Raises
    ------
    FileError
        If it is damaged, or does not say what is needed.
    """
    import tifffile

    level = logging.getLogger("tifffile").level
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # what it complains of is raised or harmless
    try:
        with tifffile.TiffFile(path) as file:
            return _cube(path, file, said)
    except PhotositeError:
        raise
    except Exception as error:  # tifffile hands on whatever a damaged directory makes it stumble over
        reason = " ".join(str(error).split()) or type(error).__name__
        if "imagecodecs" in reason:
            raise FileError(
                path, f"is packed in a way that needs another package ({reason[:100]}); save it without compression"
            ) from None
        raise FileError(path, f"cannot be read as TIFF ({reason[:200]}); is it truncated?") from None
    finally:
        logging.getLogger("tifffile").setLevel(level)


def _cube(path: Path, file: Any, said: ReadOptions) -> SpectralCube | Scene:
    pages = [page for page in file.pages if not page.is_reduced]
    if not pages:
        raise FileError(path, "has no pages")
    first = pages[0]
    if first.dtype is None or first.dtype.kind not in "fiu":
        raise FileError(path, f"holds {first.dtype or 'unknown numbers'}; a cube's are integers or floats")
    dtype = np.dtype(first.dtype).newbyteorder(file.byteorder)
    size = path.stat().st_size
    if is_tiff_picture(first):
        if len(pages) > 1:
            raise FileError(path, f"has {len(pages)} pages in colours; save the one that is meant")
        _check_there(path, first, size)
        return read_tiff_page(path, first, said)
    if len(pages) == 1 and _is_grey_picture(path, first, said):
        _check_there(path, first, size)
        return read_tiff_page(path, first, said)
    if len(pages) == 1 and len(first.shape) == 3:
        shape, place = _samples(path, first, dtype, size)
    else:
        shape, place = _stack(path, pages, dtype, size)
    told = _told(path, first, shape[2])
    values = told.get("wavelength_nm")
    if values is None and len(pages) == shape[2]:
        values = _by_page(pages)
    units = _units(path, said, told.get("units"))
    return RawCube(
        name=str(path),
        shape=shape,
        wavelength_nm=wavelengths_in_nm(path, values, None if values is None else "nm", said.wavelength_nm),
        quantity=units.quantity,
        light=told.get("light"),
        distance_m=told.get("distance_m"),
        width_m=told.get("width_m"),
        title=path.stem,
        scale=units.scale,
        no_data=told.get("no_data"),
        **place,
    )


def _is_grey_picture(path: Path, page: Any, said: ReadOptions) -> bool:
    """Whether a lone page of grey is one, and no band: nobody says what a band is to be."""
    unsaid = said.units is None and said.wavelength_nm is None and is_grey_tiff(page)
    return unsaid and not _told(path, page, int(page.samplesperpixel)) and _by_page([page]) is None


def _stack(
    path: Path, pages: list[Any], dtype: np.dtype[Any], size: int
) -> tuple[tuple[int, int, int], dict[str, Any]]:
    """Pages of one band each."""
    first = pages[0]
    for number, page in enumerate(pages):
        if len(page.shape) != 2 or page.shape != first.shape or page.dtype != first.dtype:
            raise FileError(
                path,
                f"page {number + 1} is {page.shape} of {page.dtype}, page 1 {first.shape} of {first.dtype}; a stack "
                "has one grey page a band, all alike",
            )
        _check_there(path, page, size)
    rows, cols = first.shape
    shape = rows, cols, len(pages)
    if all(page.is_contiguous for page in pages):
        return shape, {"path": path, "dtype": dtype, "band_offsets": tuple(int(p.dataoffsets[0]) for p in pages)}
    pieces: Iterator[Piece] = ((band, 0, page.asarray()[None]) for band, page in enumerate(pages))
    return shape, _laid_out(path, pieces, shape, dtype)


def _samples(path: Path, page: Any, dtype: np.dtype[Any], size: int) -> tuple[tuple[int, int, int], dict[str, Any]]:
    """One page of many samples a pixel."""
    _check_there(path, page, size)
    apart = int(page.planarconfig) == 2
    rows, cols, bands = page.shape[1:] + page.shape[:1] if apart else page.shape
    shape = int(rows), int(cols), int(bands)
    if page.is_contiguous:
        kind = "bsq" if apart else "bip"
        return shape, {"path": path, "dtype": dtype, "offset": int(page.dataoffsets[0]), "interleave": kind}
    if math.prod(shape) * dtype.itemsize > _MOST_PACKED:
        raise FileError(path, "packs more than 1 GiB into one compressed page; save it uncompressed or a page a band")
    values: NDArray[Any] = page.asarray()
    pieces: Iterator[Piece] = iter([(0, 0, values if apart else np.moveaxis(values, 2, 0))])
    return shape, _laid_out(path, pieces, shape, dtype)


def _laid_out(path: Path, pieces: Iterator[Piece], shape: tuple[int, int, int], dtype: np.dtype[Any]) -> dict[str, Any]:
    native = dtype.newbyteorder("=")
    copy, folder = spooled(path, pieces, shape, native)
    return {"path": copy, "dtype": native, "keep": folder}


def _check_there(path: Path, page: Any, size: int) -> None:
    """Whether a page's numbers are in the file: tifffile fills with zeros what is not."""
    counts, offsets = page.databytecounts, page.dataoffsets
    there = sum(counts)
    short = page.nbytes > _DENSEST * there if int(page.compression) != 1 else page.nbytes > there
    if short or not offsets or max(a + b for a, b in zip(offsets, counts, strict=True)) > size or 0 in offsets:
        raise FileError(path, f"is truncated: page {page.index + 1} lies beyond its end")


def _units(path: Path, said: ReadOptions, stated: str | None) -> Units:
    try:
        return stated_units(path, said, stated)
    except FileError as error:
        beside = path.with_suffix(".json")
        if stated is not None or not beside.is_file():
            raise
        raise FileError(path, f"{error.format_content()} ({beside.name} beside it does not say them either)") from None


def _told(path: Path, page: Any, bands: int) -> dict[str, Any]:
    """What JSON in the description, or in a file beside this one, says; that file counts where both say something."""
    own, beside = (page.description or "").lstrip(), path.with_suffix(".json")
    told: dict[str, Any] = {}
    if own.startswith("{"):
        try:
            told = _described(path, own, bands)
        except FileError:
            if not beside.is_file():  # which may be there to mend it
                raise
    if beside.is_file():
        told |= _described(beside, beside.read_text(encoding="utf-8", errors="replace"), bands)
    return told


def _described(where: Path, text: str, bands: int) -> dict[str, Any]:
    """What a text of JSON says of a cube."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise FileError(where, "holds a description that is no JSON; it is cut off, or has a comma too many") from None
    if not isinstance(content, dict):
        raise FileError(where, "describes no cube: its JSON is no object of names and values")
    told: dict[str, Any] = {}
    for name in ("wavelength_nm", "light"):
        if content.get(name) is not None:
            told[name] = _numbers(where, name, content[name], bands)
    for name in ("distance_m", "width_m", "no_data"):
        if content.get(name) is not None:
            told[name] = float(_numbers(where, name, [content[name]], 1)[0])
            if name != "no_data" and told[name] <= 0:
                raise FileError(where, f"its {name} is {told[name]:g}, not above 0")
    if content.get("units") is not None:
        told["units"] = str(content["units"])
    return told


def _numbers(path: Path, name: str, values: Any, count: int) -> Array:
    good = isinstance(values, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    try:
        array = np.array(values if good else [], np.float64)
    except OverflowError:
        array = np.array([np.inf])
    if array.shape != (count,) or not np.isfinite(array).all():
        raise FileError(
            path,
            f"its {name} is not {count} finite numbers, one for each band" if count > 1 else f"its {name} is no number",
        )
    return array


def _by_page(pages: list[Any]) -> list[float] | None:
    """Wavelengths from the pages' descriptions, where each has one number of nanometres."""
    found = [re.findall(r"(\d+(?:\.\d+)?)\s*nm\b", page.description or "") for page in pages]
    return [float(numbers[0]) for numbers in found] if all(len(numbers) == 1 for numbers in found) else None


def write(scene: Scene, path: Path) -> None:
    """A page a band of photon radiance in single precision, strip by strip; what they are in the first description.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    import tifffile

    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    told: dict[str, Any] = {
        "wavelength_nm": cube.wavelength_nm.tolist(),
        "units": "photons/s/sr/m2/nm",
        "distance_m": scene.distance_m,
        "width_m": scene.width_m,
        "light": None if cube.light is None else cube.light.tolist(),
    }
    step = max(1, min(rows, _STRIP_BYTES // (4 * cols)))
    for _ in cube.blocks(max(1, _STRIP_BYTES // (cols * bands))):
        pass  # it says what a scene cannot be; pages go by bands, not by rows
    big = 4 * rows * cols * bands > 4_000_000_000
    with atomic_path(path) as temporary, tifffile.TiffWriter(temporary, bigtiff=big) as file:
        for band in range(bands):
            file.write(
                _strips(scene, band, step),
                shape=(rows, cols),
                dtype=np.float32,
                rowsperstrip=step,
                photometric="minisblack",
                description=json.dumps(told) if band == 0 else None,
                metadata=None,
                software="photosite",
            )


def _strips(scene: Scene, band: int, step: int) -> Iterator[NDArray[np.float32]]:
    spectrum = scene.basis[:, band]
    for first in range(0, scene.shape[0], step):
        weights = scene.weights[:, first : first + step].astype(np.float64)
        yield np.maximum(np.tensordot(spectrum, weights, axes=1), 0.0).astype(np.float32)
