"""Frames in Adobe DNG 1.4, written so that LibRaw reads the same pixels, levels, mosaic and colour.

One directory, uncompressed 16-bit. A mosaic is CFA, a chip of one channel is LinearRaw of one sample. The levels,
exposure, colour matrix and noise profile are in DNG's own tags; what these cannot say, or say only as a ratio of
32-bit integers, is in ImageDescription (`photosite.frames.io.header`).

White balance (AsShotNeutral) is written where the frame's metadata say "as_shot_neutral"; else readers choose it.

LibRaw takes BlackLevel as a whole number, cutting off the fraction that the file has, and opens nothing under 22
pixels on a side. It looks cameras up by maker and model and puts its own white level and matrix for known ones beside
the file's: Make is therefore "photosite", and the camera's name is in Model.
"""

from __future__ import annotations

import warnings
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, PhotositeWarning
from photosite.frames.io.header import describe
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import NAMED

LINEAR_RAW = 34892
DNG_VERSION, UNIQUE_CAMERA_MODEL = 50706, 50708
CFA_REPEAT_DIM, CFA_PATTERN, CFA_PLANE_COLOR = 33421, 33422, 50710
BLACK_LEVEL, WHITE_LEVEL, ACTIVE_AREA = 50714, 50717, 50829
COLOR_MATRIX_1, ILLUMINANT_1, NOISE_PROFILE = 50721, 50778, 51041
MAKE, MODEL, ORIENTATION, ISO = 271, 272, 274, 34855
AS_SHOT_NEUTRAL = 50728
D65 = 21

NEUTRAL_NAME = "as_shot_neutral"
"""Of the metadata: what a gray surface reads in R, G and B above black, the largest 1, such as "1,0.9,0.4"."""

PLANES = ("R", "G", "B")
"""The colours in the order of CFAPlaneColor, hence of the rows of ColorMatrix1 and NoiseProfile."""

LIBRAW_SMALLEST = 22

_BAYER = {NAMED[name] for name in ("rggb", "bggr", "gbrg", "grbg")}
_D65_WHITE_XYZ = (0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290)  # CIE 15, 2 degree observer

Tag = tuple[int, str, int, Any, bool]


def write_dng(frame: RawFrame, path: Path) -> None:
    """Write the frame as DNG.

    Raises
    ------
    InputError
        If DNG cannot hold the frame: a mosaic other than the four Bayer orders, a white level with a fraction.

    Warns
    -----
    PhotositeWarning
        If the frame is too small for LibRaw.
    """
    import tifffile

    tags = [*_common_tags(frame), *_colour_tags(frame)]
    if min(frame.shape) < LIBRAW_SMALLEST:
        warnings.warn(
            f"LibRaw and what is built on it open no DNG under {LIBRAW_SMALLEST} x {LIBRAW_SMALLEST} pixels; "
            f"this one is {frame.shape[0]} x {frame.shape[1]}",
            PhotositeWarning,
            stacklevel=3,
        )
    tifffile.imwrite(
        path,
        frame.dn,
        photometric="cfa" if frame.is_mosaic else "minisblack",
        description=describe(frame),
        metadata=None,
        software="photosite",
        extratags=tags,
    )
    if not frame.is_mosaic:
        # tifffile holds LinearRaw to three samples; DNG has it with one for monochrome chips.
        with tifffile.TiffFile(path, mode="r+") as file:
            file.pages.first.tags["PhotometricInterpretation"].overwrite(LINEAR_RAW)


def _common_tags(frame: RawFrame) -> list[Tag]:
    rows, cols = frame.shape
    if frame.white_level_dn != int(frame.white_level_dn):
        raise InputError(f"DNG keeps white levels as whole numbers, not {frame.white_level_dn}; save as .tif or .png")
    camera = _ascii(str(frame.metadata.get("camera", "unnamed camera")))
    tags: list[Tag] = [
        (DNG_VERSION, "B", 4, bytes((1, 4, 0, 0)), True),
        (50707, "B", 4, bytes((1, 1, 0, 0)), True),  # DNGBackwardVersion
        (UNIQUE_CAMERA_MODEL, "s", 0, f"photosite {camera}", True),
        (MAKE, "s", 0, "photosite", True),
        (MODEL, "s", 0, camera, True),
        (ORIENTATION, "H", 1, 1, True),
        (BLACK_LEVEL, "2I", 1, ratio(frame.black_level_dn, "black level"), True),
        (WHITE_LEVEL, "I", 1, int(frame.white_level_dn), True),
        (ACTIVE_AREA, "I", 4, (0, 0, rows, cols), True),
        (50719, "I", 2, (0, 0), True),  # DefaultCropOrigin
        (50720, "I", 2, (cols, rows), True),  # DefaultCropSize
    ]
    if frame.exposure_s is not None:
        tags.append((33434, "2I", 1, ratio(frame.exposure_s, "exposure"), True))
    iso = frame.metadata.get("iso")
    if isinstance(iso, int | float) and iso == int(iso) and 0 < iso < 65536:
        tags.append((ISO, "H", 1, int(iso), True))
    if frame.noise_profile is not None:
        profile = _by_plane(frame, frame.noise_profile, 2, "noise profile")
        tags.append((NOISE_PROFILE, "d", profile.size, tuple(profile.ravel().tolist()), True))
    return tags


def _colour_tags(frame: RawFrame) -> list[Tag]:
    if not frame.is_mosaic:
        return []
    if frame.cfa not in _BAYER:
        raise InputError(
            f"DNG is written for the Bayer mosaics rggb, bggr, gbrg, grbg and for one channel, not {frame.cfa}; "
            "save as .tif or .png"
        )
    pattern = bytes(PLANES.index(name) for row in frame.cfa for name in row)
    tags: list[Tag] = [
        (CFA_REPEAT_DIM, "H", 2, (2, 2), True),
        (CFA_PATTERN, "B", 4, pattern, True),
        (CFA_PLANE_COLOR, "B", 3, bytes((0, 1, 2)), True),
        (50711, "H", 1, 1, True),  # CFALayout: rectangular
    ]
    if frame.color_matrix is None:
        return tags
    matrix = _by_plane(frame, frame.color_matrix, 3, "colour matrix")
    white = matrix @ np.array(_D65_WHITE_XYZ)
    if white.min() <= 0:
        raise InputError(f"the colour matrix turns the white of D65 into {white.tolist()}; all must be above 0")
    return [
        *tags,
        (COLOR_MATRIX_1, "2i", 9, sum((ratio(x, "colour matrix", signed=True) for x in matrix.ravel()), ()), True),
        (ILLUMINANT_1, "H", 1, D65, True),
        *_neutral_tags(frame),
    ]


def _neutral_tags(frame: RawFrame) -> list[Tag]:
    """AsShotNeutral where the metadata say what gray reads; a frame does not tell the light it was taken in."""
    said = frame.metadata.get(NEUTRAL_NAME)
    if said is None:
        return []
    try:
        neutral = [float(part) for part in str(said).split(",")]
    except ValueError:
        neutral = []
    if len(neutral) != 3 or not all(0 < part <= 1 for part in neutral):
        raise InputError(f"{NEUTRAL_NAME} is three numbers above 0 up to 1, for R, G and B, not {said!r}")
    return [(AS_SHOT_NEUTRAL, "2I", 3, sum((ratio(x, "neutral") for x in neutral), ()), True)]


def _by_plane(frame: RawFrame, rows: NDArray[np.float64], cols: int, what: str) -> NDArray[np.float64]:
    """Rows in the order of `frame.channels` put into the order of the planes."""
    table = np.asarray(rows, dtype=np.float64)
    if table.shape != (len(frame.channels), cols):
        raise InputError(
            f"the {what} of {len(frame.channels)} channels is ({len(frame.channels)}, {cols}), not {table.shape}"
        )
    if not frame.is_mosaic:
        return table
    return table[[frame.channels.index(name) for name in PLANES if name in frame.channels]]


def ratio(value: float, what: str, *, signed: bool = False) -> tuple[int, int]:
    """The nearest ratio of two 32-bit integers."""
    highest = (1 << 31) - 1 if signed else (1 << 32) - 1
    if not abs(value) <= highest:
        raise InputError(f"DNG cannot hold a {what} of {value}")
    ratio = Fraction(float(value)).limit_denominator(int(highest / max(1.0, abs(value))))
    if value != 0 and ratio == 0:
        raise InputError(f"DNG cannot hold a {what} of {value}: it is too small")
    return ratio.numerator, ratio.denominator


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode("ascii")
