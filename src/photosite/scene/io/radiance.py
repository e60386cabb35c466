"""Radiance pictures (.hdr, .pic): light of any range, a byte of exponent shared by red, green and blue."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.color.colour_science import colour_science
from photosite.errors import FileError
from photosite.scene.io.light_picture import scene_of_light
from photosite.scene.io.picture import check_said
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene

_MAGIC = (b"#?RADIANCE", b"#?RGBE")
_FORMATS = {"32-bit_rle_rgbe": "rgb", "32-bit_rle_xyze": "xyz"}
_SIZE = re.compile(r"-Y (\d+) \+X (\d+)")
_LONGEST_HEAD = 1 << 16
_MOST_PIXELS = 1 << 28
_RLE_COLS = (8, 0x7FFF)
"""Widths that run-length coding by colour is used for."""

_EFFICACY_LM_W = 179.0
"""Radiance's own luminous efficacy of white: its W/sr/m2 are luminance by 179."""

_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def read(path: Path, said: ReadOptions) -> Scene:
    """The scene of a Radiance picture: the light that it shows, its range kept.

    Red, green and blue are taken for those of Rec. 709 unless the file has other PRIMARIES, which are refused. Values
    are divided by the file's EXPOSURE.

    Raises
    ------
    FileError
        If it is damaged, has colours that photosite does not know, or nobody says how bright it is: the options'
        mean luminance, or units="radiance" for a file that holds Radiance's own W/sr/m2.
    """
    absolute = said.units is not None and said.units.strip().lower() == "radiance"
    if said.units is not None and not absolute:
        raise FileError(path, f"units are 'radiance' for values in W/sr/m2 as Radiance writes them, not '{said.units}'")
    check_said(path, ReadOptions(wavelength_nm=said.wavelength_nm, variable=said.variable))
    if absolute and said.mean_luminance_cd_m2 is not None:
        raise FileError(
            path, "is said twice how bright: units='radiance' and mean_luminance_cd_m2; leave one of them out"
        )
    if said.mean_luminance_cd_m2 is None and not absolute:
        raise FileError(
            path,
            "does not say how bright it is; say the mean (mean_luminance_cd_m2=100), or units='radiance' if its values "
            "are W/sr/m2 as Radiance writes them",
        )
    return scene_of_light(path, _values(path), said, _EFFICACY_LM_W if absolute else None)


def _values(path: Path) -> NDArray[np.float64]:
    """(rows, cols, 3) linear sRGB."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    form, exposure, rows, cols, start = _head(path, content)
    codes = _pixels(path, np.frombuffer(content, np.uint8, offset=start), rows, cols)
    # Radiance's own rule: the middle of a step of the mantissa; an exponent of 0 is black.
    scale = np.ldexp(np.float64(1.0), codes[..., 3].astype(np.int32) - (128 + 8)).astype(np.float64)
    scale[codes[..., 3] == 0] = 0.0
    values: NDArray[np.float64] = (codes[..., :3] + 0.5) * scale[..., None] / exposure
    if form == "xyz":
        matrix = np.asarray(colour_science().RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB, np.float64)
        values = values @ matrix.T
    return values


def _head(path: Path, content: bytes) -> tuple[str, float, int, int, int]:
    """Form, exposure, rows, cols, and where the pixels begin."""
    end = content.find(b"\n\n", 0, _LONGEST_HEAD)
    line_end = content.find(b"\n", end + 2, end + 2 + 256) if end > 0 else -1
    if not content.startswith(_MAGIC) or line_end < 0:
        raise FileError(path, "is no Radiance picture, or is truncated in its head")
    lines = content[:end].decode("latin-1").splitlines()[1:]
    told = dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))
    form = _FORMATS.get(told.get("FORMAT", "32-bit_rle_rgbe").strip())
    if form is None:
        raise FileError(path, f"has the FORMAT '{told['FORMAT']}'; known are {', '.join(_FORMATS)}")
    exposure = 1.0
    try:
        for line in lines:
            if line.startswith("EXPOSURE="):  # they multiply
                exposure *= float(line.split("=", 1)[1])
        primaries = [float(word) for word in told.get("PRIMARIES", "").split()]
    except ValueError:
        raise FileError(path, "has an EXPOSURE or PRIMARIES that are no numbers") from None
    if not 0 < exposure < np.inf:
        raise FileError(path, f"has an EXPOSURE of {exposure:g}; it is above 0")
    if form == "rgb" and primaries and not np.allclose(primaries, _REC709, atol=2e-3):
        raise FileError(path, f"has the PRIMARIES {told['PRIMARIES'].strip()}; convert it to those of Rec. 709")
    if "COLORCORR" in told:
        raise FileError(path, "has a COLORCORR, colours changed by an unknown purpose; remove it with ra_xyze")
    size = _SIZE.fullmatch(content[end + 2 : line_end].decode("latin-1").strip())
    if size is None:
        raise FileError(path, "is turned or mirrored: its size must read '-Y rows +X cols'")
    rows, cols = int(size[1]), int(size[2])
    if rows * cols == 0 or rows * cols > _MOST_PIXELS:
        raise FileError(path, f"says that it has {rows} x {cols} pixels, which cannot be")
    return form, exposure, rows, cols, line_end + 1


def _pixels(path: Path, data: NDArray[np.uint8], rows: int, cols: int) -> NDArray[np.uint8]:
    """(rows, cols, 4) mantissas and exponents."""
    coded = _RLE_COLS[0] <= cols <= _RLE_COLS[1] and data.size >= 4 and (data[0], data[1]) == (2, 2) and data[2] < 128
    if not coded:
        if data.size != rows * cols * 4:
            raise FileError(
                path,
                f"holds {data.size} bytes of pixels where {rows} x {cols} take {rows * cols * 4}; it is truncated, or "
                "coded in the way of before 1991, which ra_xyze changes",
            )
        return data.reshape(rows, cols, 4)
    codes = np.empty((rows, 4, cols), np.uint8)
    stream = memoryview(data.tobytes())
    at = 0
    for row in range(rows):
        if (
            len(stream) < at + 4
            or tuple(stream[at : at + 2]) != (2, 2)
            or stream[at + 2] * 256 + stream[at + 3] != cols
        ):
            raise FileError(path, f"is truncated or damaged in row {row + 1} of {rows}")
        at = _row(path, stream, at + 4, codes[row], row)
    return np.moveaxis(codes, 1, 2)


def _row(path: Path, stream: Any, at: int, codes: NDArray[np.uint8], row: int) -> int:
    """Decode one row's four runs of codes; where the next row begins."""
    cols = codes.shape[1]
    for plane in codes:
        col = 0
        while col < cols:
            count = stream[at] if at < len(stream) else 0
            run = count > 128
            count -= 128 if run else 0
            if count == 0 or col + count > cols or at + 1 + (1 if run else count) > len(stream):
                raise FileError(path, f"is truncated or damaged in row {row + 1}")
            if run:
                plane[col : col + count] = stream[at + 1]
                at += 2
            else:
                plane[col : col + count] = stream[at + 1 : at + 1 + count]
                at += 1 + count
            col += count
    return at
