"""TIFF: stacks of one page a band, pages of many samples a pixel, and display pictures.

The first page's ImageDescription, or a file of the same name that ends in .json, describes a cube as JSON:
wavelength_nm (bands,), units, and optionally distance_m, width_m, light, no_data. Alternatively each page's description
states its wavelength, such as "band 450 nm".
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
from numpy.typing import ArrayLike, NDArray

from photosite.errors import FileError, PhotositeError
from photosite.files.tiff_pages import bytes_held, decoded, pages_of
from photosite.files.writing import Piece, atomic_path, write_bands
from photosite.scene.cube import RawCube, SpectralCube, Stated, wavelengths_in_nm
from photosite.scene.io.color_space import space_of_tiff
from photosite.scene.io.picture import FLATTEN, ORIENTATION, TRANSPARENT, scene_of_picture, turned
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene
from photosite.scene.scene_cube import cube_of_scene
from photosite.scene.units import Units, file_units

_DESCRIBED = ("wavelength_nm", "units", "light", "distance_m", "width_m", "no_data")
_STRIP_BYTES = 4 << 20
_LARGEST_COMPRESSED = 1 << 30
"""Bytes of a compressed page of many samples, which is decoded as a whole."""

_WHITE_IS_ZERO, _BLACK_IS_ZERO, _RGB, _PALETTE = 0, 1, 2, 3
"""Photometric interpretations."""
_GRAYS = (_WHITE_IS_ZERO, _BLACK_IS_ZERO)
_COLORS = {2: "RGB", 3: "a palette", 5: "CMYK", 6: "YCbCr", 8: "Lab", 9: "Lab (ICC)", 10: "Lab (ITU)"}
_OPACITY = (1, 2)
"""Kinds of extra samples, associated or not."""
_PLANES = 2
"""Planar configuration of planes that follow each other."""
_MOST_SAMPLES = 4


def open_cube(path: Path, options: ReadOptions) -> SpectralCube | Scene:
    """Open the cube of a TIFF file, in place or copied where it is compressed; read a picture as a scene."""
    import tifffile

    level = tifffile.logger().level
    tifffile.logger().setLevel(logging.CRITICAL)  # damage is reported here
    try:
        with tifffile.TiffFile(path) as file:
            return _content(path, file, options)
    except PhotositeError:
        raise
    except Exception as error:  # tifffile passes on the exceptions of its parsers and decoders
        reason = " ".join(str(error).split()) or type(error).__name__
        hint = "Check that the file is complete"
        raise FileError(path, f"cannot be read as TIFF ({reason[:200]})", hint=hint) from None
    finally:
        tifffile.logger().setLevel(level)


def _content(path: Path, file: Any, options: ReadOptions) -> SpectralCube | Scene:
    pages = [page for page in pages_of(path, file) if not page.is_reduced]
    if not pages:
        raise FileError(path, "has no pages")
    first = pages[0]
    if first.dtype is None or first.dtype.kind not in "fiu":
        raise FileError(path, "values", value=str(first.dtype or "unknown"), expected="integers or floats")
    dtype = np.dtype(first.dtype).newbyteorder(file.byteorder)
    size = path.stat().st_size
    if int(first.photometric) in _COLORS and first.samplesperpixel <= _MOST_SAMPLES:
        if len(pages) > 1:
            raise FileError(path, f"has {len(pages)} pages in color", hint="Save one of them")
        return _read_picture(path, first, size, options)
    if len(pages) == 1 and _is_gray_picture(path, first, options):
        return _read_picture(path, first, size, options)
    if len(pages) == 1 and len(first.shape) == 3:
        shape, place = _samples(path, first, dtype, size)
    else:
        shape, place = _stack(path, pages, dtype, size)
    description = _description(path, first)
    stated = Stated(path, description)
    values: ArrayLike | None = stated.numbers("wavelength_nm", shape[2])
    if values is None and len(pages) == shape[2]:
        values = _wavelengths_by_page(pages)
    units = _units(path, options, description.get("units"))
    return RawCube(
        name=str(path),
        shape=shape,
        wavelength_nm=wavelengths_in_nm(path, values, None if values is None else "nm", options.wavelength_nm),
        quantity=units.quantity,
        title=path.stem,
        scale=units.scale,
        **stated.head(shape[2]),
        **place,
    )


def _is_gray_picture(path: Path, page: Any, options: ReadOptions) -> bool:
    """Return whether a single gray page is a picture: of 8 or 16 bits, and not described as a band."""
    extra = tuple(int(kind) for kind in page.extrasamples)
    alone = page.samplesperpixel == 1 + len(extra) <= 2 and all(kind in _OPACITY for kind in extra)
    gray = int(page.photometric) in _GRAYS and alone and page.dtype in (np.uint8, np.uint16)
    undescribed = gray and options.units is None and options.wavelength_nm is None
    return undescribed and not _description(path, page) and _wavelengths_by_page([page]) is None


def _read_picture(path: Path, page: Any, size: int, options: ReadOptions) -> Scene:
    _check_stored(path, page, size)
    form = int(page.photometric)
    if form not in (*_GRAYS, _RGB, _PALETTE):
        raise FileError(path, "colors", value=_COLORS.get(form, form), expected="gray, or red, green and blue")
    if page.dtype not in (np.uint8, np.uint16):
        raise FileError(
            path,
            "values of a picture",
            value=str(page.dtype),
            expected="unsigned integers of 8 or 16 bits",
            hint="Convert the picture, or pass its array to photosite.pictures.from_rgb or from_hdr",
        )
    if int(page.bitspersample) != 8 * page.dtype.itemsize:
        raise FileError(path, "bits a value", value=page.bitspersample, expected="8 or 16")
    space = space_of_tiff(path, page)
    values = decoded(path, page)
    values = values.reshape(*values.shape[:2], -1) if int(page.planarconfig) != _PLANES else np.moveaxis(values, 0, 2)
    count = 3 if form == _RGB else 1
    colors, opacity = values[:, :, :count], values[:, :, count:]
    if (opacity != np.iinfo(values.dtype).max).any():
        raise FileError(path, TRANSPARENT, hint=FLATTEN)
    if form == _PALETTE:
        palette = np.asarray(page.colormap, np.uint16)
        palette = palette if (palette & 0xFF).any() else (palette >> 8).astype(np.uint8)  # some writers use 8 bits
        colors = np.moveaxis(palette[:, colors[:, :, 0]], 0, 2)
    if form == _WHITE_IS_ZERO:
        colors = np.iinfo(values.dtype).max - colors
    orientation = page.tags[ORIENTATION].value if ORIENTATION in page.tags else 1
    return scene_of_picture(path, turned(colors, orientation), space, options)


def _stack(
    path: Path, pages: list[Any], dtype: np.dtype[Any], size: int
) -> tuple[tuple[int, int, int], dict[str, Any]]:
    """Return shape and place of pages of one band each."""
    first = pages[0]
    for number, page in enumerate(pages, start=1):
        if len(page.shape) != 2 or page.shape != first.shape or page.dtype != first.dtype:
            raise FileError(
                path,
                f"page {number}",
                value=f"{page.shape} of {page.dtype}",
                expected=f"gray and like page 1, {first.shape} of {first.dtype}, in a stack of bands",
            )
        _check_stored(path, page, size)
    rows, cols = first.shape
    shape = rows, cols, len(pages)
    if all(page.is_contiguous for page in pages):
        return shape, {"path": path, "dtype": dtype, "band_offsets": tuple(int(p.dataoffsets[0]) for p in pages)}
    pieces: Iterator[Piece] = ((band, 0, decoded(path, page)[None]) for band, page in enumerate(pages))
    return shape, _copied(path, pieces, shape, dtype)


def _samples(path: Path, page: Any, dtype: np.dtype[Any], size: int) -> tuple[tuple[int, int, int], dict[str, Any]]:
    """Return shape and place of one page of many samples a pixel."""
    _check_stored(path, page, size)
    planes = int(page.planarconfig) == _PLANES
    rows, cols, bands = page.shape[1:] + page.shape[:1] if planes else page.shape
    shape = int(rows), int(cols), int(bands)
    if page.is_contiguous:
        kind = "bsq" if planes else "bip"
        return shape, {"path": path, "dtype": dtype, "offset": int(page.dataoffsets[0]), "interleave": kind}
    if math.prod(shape) * dtype.itemsize > _LARGEST_COMPRESSED:
        hint = "Save it uncompressed, or with a page a band"
        raise FileError(path, "has a compressed page of more than 1 GiB", hint=hint)
    values: NDArray[Any] = decoded(path, page)
    pieces: Iterator[Piece] = iter([(0, 0, values if planes else np.moveaxis(values, 2, 0))])
    return shape, _copied(path, pieces, shape, dtype)


def _copied(path: Path, pieces: Iterator[Piece], shape: tuple[int, int, int], dtype: np.dtype[Any]) -> dict[str, Any]:
    native = dtype.newbyteorder("=")
    copy, folder = write_bands(path, pieces, shape, native)
    return {"path": copy, "dtype": native, "keep": folder}


def _check_stored(path: Path, page: Any, size: int) -> None:
    """Check that a page's image data are in the file, before decoding: tifffile fills missing data with zeros."""
    counts, offsets = page.databytecounts, page.dataoffsets
    short = page.nbytes > bytes_held(int(page.compression), sum(counts))
    if short or not offsets or max(a + b for a, b in zip(offsets, counts, strict=True)) > size or 0 in offsets:
        raise FileError(path, f"is truncated: the image data of page {page.index + 1} are not complete")


def _units(path: Path, options: ReadOptions, stated: str | None) -> Units:
    try:
        return file_units(path, options, stated)
    except FileError as error:
        beside = path.with_suffix(".json")
        if stated is not None or not beside.is_file():
            raise
        what = f"{error.what}, and {beside.name} does not either"
        raise FileError(path, what, hint=error.hint, arguments=error.arguments) from None


def _description(path: Path, page: Any) -> dict[str, Any]:
    """Return the JSON description of a cube; the file beside it overrides the page's."""
    own, beside = (page.description or "").lstrip(), path.with_suffix(".json")
    found: dict[str, Any] = {}
    if own.startswith("{"):
        try:
            found = _parsed(path, own)
        except FileError:
            if not beside.is_file():  # which may replace it
                raise
    if beside.is_file():
        found |= _parsed(beside, beside.read_text(encoding="utf-8", errors="replace"))
    return found


def _parsed(where: Path, text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise FileError(where, "has a description that is not valid JSON") from None
    if not isinstance(content, dict):
        raise FileError(where, "has a description that is not a JSON object")
    return {name: content[name] for name in _DESCRIBED if content.get(name) is not None}


def _wavelengths_by_page(pages: list[Any]) -> list[float] | None:
    """Return wavelengths from the pages' descriptions, if each has one number of nanometers."""
    found = [re.findall(r"(\d+(?:\.\d+)?)\s*nm\b", page.description or "") for page in pages]
    return [float(numbers[0]) for numbers in found] if all(len(numbers) == 1 for numbers in found) else None


def write(scene: Scene, path: Path) -> None:
    """Write photon radiance in single precision, a page a band, strip by strip."""
    import tifffile

    cube = cube_of_scene(scene)
    rows, cols, bands = cube.shape
    description: dict[str, Any] = {
        "wavelength_nm": cube.wavelength_nm.tolist(),
        "units": "photons/s/sr/m2/nm",
        "distance_m": scene.distance_m,
        "width_m": scene.width_m,
        "light": None if cube.light is None else cube.light.tolist(),
    }
    step = max(1, min(rows, _STRIP_BYTES // (4 * cols)))
    for _ in cube.blocks(max(1, _STRIP_BYTES // (cols * bands))):
        pass  # raises for invalid scenes; pages are written by bands, not by rows
    big = 4 * rows * cols * bands > 4_000_000_000
    with atomic_path(path) as temporary, tifffile.TiffWriter(temporary, bigtiff=big) as file:
        for band in range(bands):
            file.write(
                _strips(scene, band, step),
                shape=(rows, cols),
                dtype=np.float32,
                rowsperstrip=step,
                photometric="minisblack",
                description=json.dumps(description) if band == 0 else None,
                metadata=None,
                software="photosite",
            )


def _strips(scene: Scene, band: int, step: int) -> Iterator[NDArray[np.float32]]:
    spectrum = scene.basis[:, band]
    for first in range(0, scene.shape[0], step):
        weights = scene.weights[:, first : first + step].astype(np.float64)
        yield np.maximum(np.tensordot(spectrum, weights, axes=1), 0.0).astype(np.float32)
