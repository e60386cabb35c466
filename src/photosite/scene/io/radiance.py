"""Radiance pictures (.hdr, .pic): light of any range, with one exponent shared by red, green and blue."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import PUBLISHED_SRGB_FROM_XYZ
from photosite.errors import FileError
from photosite.files.small_files import reading
from photosite.scene.io.picture import scene_of_light
from photosite.scene.options import ReadOptions
from photosite.scene.scene import Scene

_MAGIC = (b"#?RADIANCE", b"#?RGBE")
_FORMATS = {"32-bit_rle_rgbe": "rgb", "32-bit_rle_xyze": "xyz"}
_SIZE = re.compile(r"-Y (\d+) \+X (\d+)")
_LONGEST_HEAD, _LONGEST_SIZE = 1 << 16, 256
"""Bytes of the header, and of the line after it that states the size."""
_MOST_BYTES_PER_PIXEL = 8
_MOST_PIXELS = 1 << 28
_LONGEST_RUN = 127
_RLE_COLS = (8, 0x7FFF)
"""Widths that are run-length coded."""

_EFFICACY_LM_W = 179.0
"""Radiance's own luminous efficacy of white, from its W/sr/m2 to luminance."""

_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


def read(path: Path, options: ReadOptions) -> Scene:
    """Read a Radiance picture as the light it shows, with its full range.

    Red, green and blue are those of Rec. 709; other PRIMARIES are refused. Values are divided by the file's EXPOSURE.
    The brightness is given by the options' mean luminance, or by units="radiance" for Radiance's own W/sr/m2.
    """
    absolute = options.units is not None and options.units.strip().lower() == "radiance"
    if options.units is not None and not absolute:
        raise FileError(path, "units", value=options.units, expected="'radiance' for a Radiance picture in W/sr/m2")
    if absolute and options.mean_luminance_cd_m2 is not None:
        raise FileError(path, "units and mean_luminance_cd_m2 are both given", hint="Leave one of them out")
    if not absolute:
        what, or_else = "does not state the luminance of its scene", ", or units='radiance' if its values are W/sr/m2"
        options.require(path, what, or_else, mean_luminance_cd_m2=100)
    return scene_of_light(path, _values(path), options, _EFFICACY_LM_W if absolute else None)


def _values(path: Path) -> NDArray[np.float64]:
    """Return (rows, cols, 3) linear sRGB."""
    with reading(path), path.open("rb") as file:
        content = file.read(_LONGEST_HEAD + _LONGEST_SIZE)
        form, exposure, rows, cols, start = _head(path, content)
        content += file.read(_MOST_BYTES_PER_PIXEL * rows * cols)  # more are never decoded
    values = _decoded(path, content[start:], rows, cols) / exposure
    if form == "xyz":
        values = values @ PUBLISHED_SRGB_FROM_XYZ.T
    return values


def _head(path: Path, content: bytes) -> tuple[str, float, int, int, int]:
    """Return form, exposure, rows, cols, and the position of the pixels."""
    end = content.find(b"\n\n", 0, _LONGEST_HEAD)
    line_end = content.find(b"\n", end + 2, end + 2 + _LONGEST_SIZE) if end > 0 else -1
    if not content.startswith(_MAGIC) or line_end < 0:
        raise FileError(path, "is not a Radiance picture, or is truncated in its header")
    lines = content[:end].decode("latin-1").splitlines()[1:]
    variables = dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))
    form = _FORMATS.get(variables.get("FORMAT", "32-bit_rle_rgbe").strip())
    if form is None:
        raise FileError(path, "FORMAT", value=variables["FORMAT"], expected=" or ".join(_FORMATS))
    exposure = 1.0
    try:
        for line in lines:
            if line.startswith("EXPOSURE="):  # several multiply
                exposure *= float(line.split("=", 1)[1])
        primaries = [float(word) for word in variables.get("PRIMARIES", "").split()]
    except ValueError:
        raise FileError(path, "EXPOSURE and PRIMARIES must be numbers") from None
    if not 0 < exposure < np.inf:
        raise FileError(path, "EXPOSURE", value=exposure, expected="above 0")
    if form == "rgb" and primaries and not np.allclose(primaries, _REC709, atol=2e-3):
        raise FileError(path, "PRIMARIES", value=primaries, expected="those of Rec. 709", hint="Convert the picture")
    if "COLORCORR" in variables:
        raise FileError(path, "has a COLORCORR, which is not supported", hint="Remove it with ra_xyze")
    size = _SIZE.fullmatch(content[end + 2 : line_end].decode("latin-1").strip())
    if size is None:
        raise FileError(path, "is rotated or mirrored", hint="Write it with a size line '-Y rows +X cols'")
    rows, cols = int(size[1]), int(size[2])
    if rows * cols == 0 or rows * cols > _MOST_PIXELS:
        raise FileError(path, "size", value=f"{rows} x {cols} pixels", expected=f"1 to {_MOST_PIXELS} pixels")
    return form, exposure, rows, cols, line_end + 1


def _decoded(path: Path, data: bytes, rows: int, cols: int) -> NDArray[np.float64]:
    """Return (rows, cols, 3) values of the pixels.

    Radiance's rule puts a value in the middle of its mantissa's step; the decoder puts it at the lower end. The step
    follows from the brightest channel, whose mantissa is 128 to 255.
    """
    import imagecodecs

    if rows * cols * 4 > max(1, len(data)) * _LONGEST_RUN:
        raise FileError(path, f"is damaged or truncated: {len(data)} bytes cannot hold {rows} x {cols} pixels")
    compressed = _RLE_COLS[0] <= cols <= _RLE_COLS[1] and data[:2] == b"\2\2" and data[2:3] < b"\x80"
    low = np.empty((rows, cols, 3), np.float32)
    try:
        imagecodecs.rgbe_decode(data, header=False, rle=compressed, out=low)
    except Exception as error:  # of the library's own classes
        reason = " ".join(str(error).split())
        hint = "Convert files of before 1991 with ra_xyze"
        raise FileError(path, f"is damaged or truncated ({reason})", hint=hint) from None
    values = low.astype(np.float64)
    _, exponent = np.frexp(values.max(axis=2, keepdims=True))
    return np.where(values.max(axis=2, keepdims=True) > 0, values + np.ldexp(0.5, exponent - 8), 0.0)
