"""Frames in Adobe DNG 1.4: written for LibRaw, and read from any DNG of one sample per pixel.

Writing. One directory, uncompressed 16-bit. A mosaic is CFA (2 x 2 pixels of up to four colors, or X-Trans), a
monochrome frame LinearRaw of one sample. Levels,
exposure, color matrices and noise profile are in DNG's tags; what these cannot hold, or hold only as a ratio of 32-bit
integers, is also in ImageDescription (`photosite.frames.frame_file`). AsShotNeutral, ISO, FNumber, FocalLength and
DateTime are written if the metadata have as_shot_neutral, iso, f_number, focal_length_mm and date_time (ISO 8601);
without the first, readers choose the white balance. LibRaw truncates BlackLevel to a whole number, opens nothing
smaller than 22 x 22 pixels, and has its own levels and matrices for known makers and models. Make is therefore
"photosite", and the camera's name is in Model.

Reading. Levels, mosaic and matrix come from the tags; LibRaw, which rounds black levels and moves odd margins, only
decodes the pixels. The frame is the active area. The mean of the masked areas (optical black) is the black level if the
file states none.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.frames.covered_lines import line_means
from photosite.frames.frame_file import FrameHeader, FrameLocation, describe_frame, parse_description
from photosite.frames.io.camera_raw import check_filled, check_size, open_libraw
from photosite.frames.io.tiff import (
    BITS,
    COMPRESSION,
    DESCRIPTION,
    LENGTH,
    ORIENTATION,
    PHOTOMETRIC,
    RECOMMENDED_EXPOSURE_INDEX,
    SAMPLES,
    SUB_IFDS,
    WIDTH,
    Directory,
    camera_settings,
    checked_size,
    exposure_of,
    has_tag,
    read_directories,
)
from photosite.frames.io.tiff import read_pixels as read_tiff_pixels
from photosite.frames.raw_frame import (
    MASKED_BORDER,
    OPTICAL_BLACK,
    RawFrame,
    masked_border_note,
    neutral_text,
    stated_border,
)
from photosite.values.cfa import MONOCHROME, Cfa, channel_names, channel_sites, plane_names, tile_text
from photosite.values.exif_time import DATE_TIME, OFFSET_TIME, SUBSEC_TIME
from photosite.values.region import Border

CFA, LINEAR_RAW = 32803, 34892
NEW_SUBFILE_TYPE, MAKE, MODEL, EXPOSURE_TIME, ISO = 254, 271, 272, 33434, 34855
F_NUMBER, FOCAL_LENGTH = 33437, 37386
CFA_REPEAT_DIM, CFA_PATTERN = 33421, 33422
DNG_VERSION, DNG_BACKWARD_VERSION, UNIQUE_CAMERA_MODEL = 50706, 50707, 50708
CFA_PLANE_COLOR, CFA_LAYOUT = 50710, 50711
BLACK_LEVEL, BLACK_LEVEL_DELTA_H, BLACK_LEVEL_DELTA_V, WHITE_LEVEL = 50714, 50715, 50716, 50717
DEFAULT_CROP_ORIGIN, DEFAULT_CROP_SIZE = 50719, 50720
COLOR_MATRIX_1, COLOR_MATRIX_2, CALIBRATION_1, CALIBRATION_2 = 50721, 50722, 50723, 50724
ANALOG_BALANCE, AS_SHOT_NEUTRAL, ILLUMINANT_1, ILLUMINANT_2 = 50727, 50728, 50778, 50779
ACTIVE_AREA, MASKED_AREAS, NOISE_PROFILE = 50829, 50830, 51041
ILLUMINANT_A, D65 = 17, 21
"""Exif's LightSource."""

LIBRAW_SMALLEST = 22

_COLORS = {0: "R", 1: "G", 2: "B", 3: "Cy", 4: "M", 5: "Y", 6: "W"}
"""TIFF/EP CFAPattern, and white as DNG adds it. The planes are in the order of these numbers."""

_CODES = {name: code for code, name in _COLORS.items()} | {"C": 6}
"""Clear pixels count as white ones."""

_XTRANS = (6, 6)
# CIE 15, 2 degree observer
_D65_WHITE_XYZ = (0.3127 / 0.3290, 1.0, (1 - 0.3127 - 0.3290) / 0.3290)
_A_WHITE_XYZ = (0.44758 / 0.40745, 1.0, (1 - 0.44758 - 0.40745) / 0.40745)

Tag = tuple[int, str, int, Any, bool]
Area = tuple[int, int, int, int]
"""First row and column, and the ones after the last."""


def write(frame: RawFrame, path: Path) -> None:
    """Write the frame as DNG."""
    import tifffile

    tags = [*_common_tags(frame), *_color_tags(frame)]
    if min(frame.shape) < LIBRAW_SMALLEST:
        problem = (
            f"the frame has {frame.shape[0]} x {frame.shape[1]} pixels; LibRaw and programs based on it open no DNG "
            f"smaller than {LIBRAW_SMALLEST} x {LIBRAW_SMALLEST}"
        )
        warnings.warn(PhotositeWarning(problem), stacklevel=3)
    tifffile.imwrite(
        path,
        frame.dn,
        photometric="cfa" if frame.is_mosaic else "minisblack",
        description=describe_frame(frame),
        metadata=None,
        software="photosite",
        extratags=tags,
    )
    if not frame.is_mosaic:
        # tifffile requires three samples for LinearRaw; in DNG monochrome sensors have one.
        with tifffile.TiffFile(path, mode="r+") as file:
            file.pages.first.tags["PhotometricInterpretation"].overwrite(LINEAR_RAW)


def check_cfa(cfa: Cfa) -> None:
    """Raise `InputError` for a color filter array that LibRaw does not read from DNG: Quad Bayer, RGBW of 4 x 4, ...

    LibRaw reads tiles of 2 x 2 pixels in up to four of DNG's colors, and X-Trans, 6 x 6 pixels of red, green and blue.
    """
    names, size = channel_names(cfa), (len(cfa), len(cfa[0]))
    coded = len({_CODES.get(name, name) for name in names}) == len(names) <= 4 and set(names) <= _CODES.keys()
    if len(names) == 1 or (coded and (size == (2, 2) or (size == _XTRANS and set(names) == {"R", "G", "B"}))):
        return
    expected = "monochrome, 2 x 2 pixels of R, G, B, Cy, M, Y and W or C, or X-Trans in DNG, as LibRaw reads it"
    raise InputError("cfa", value=tile_text(cfa), expected=expected, hint="Save as TIFF (.tif) or HDF5 (.h5)")


def _planes(cfa: Cfa) -> tuple[str, ...]:
    """Return the channels in the order of CFAPlaneColor, hence of the rows of ColorMatrix1 and NoiseProfile.

    LibRaw takes the second of three as green, of which a tile has two pixels.
    """
    names = sorted(channel_names(cfa), key=lambda name: _CODES.get(name, len(_CODES)))
    most = max(names, key=lambda name: len(channel_sites(cfa, name)))
    return (names[0], most, *(name for name in names[1:] if name != most)) if len(names) == 3 else tuple(names)


def _common_tags(frame: RawFrame) -> list[Tag]:
    rows, cols = frame.shape
    if frame.white_level_dn != int(frame.white_level_dn):
        hint = "Save as .tif or .png"
        raise InputError("white_level_dn", value=frame.white_level_dn, expected="a whole number in DNG", hint=hint)
    camera = str(frame.metadata.get("camera", "unnamed camera")).encode("ascii", "replace").decode("ascii")
    tags: list[Tag] = [
        (DNG_VERSION, "B", 4, bytes((1, 4, 0, 0)), True),
        (DNG_BACKWARD_VERSION, "B", 4, bytes((1, 1, 0, 0)), True),
        (UNIQUE_CAMERA_MODEL, "s", 0, f"photosite {camera}", True),
        (MAKE, "s", 0, "photosite", True),
        (MODEL, "s", 0, camera, True),
        (ORIENTATION, "H", 1, int(frame.metadata.get("orientation", 1)), True),
        (BLACK_LEVEL, "2I", 1, _ratio(frame.black_level_dn, "black_level_dn"), True),
        (WHITE_LEVEL, "I", 1, int(frame.white_level_dn), True),
        (DEFAULT_CROP_ORIGIN, "I", 2, (0, 0), True),
        *_area_tags(*(stated_border(frame.metadata) or (0, 0, 0, 0)), rows, cols),
    ]
    if frame.exposure_s is not None:
        tags.append((EXPOSURE_TIME, "2I", 1, _ratio(frame.exposure_s, "exposure_s"), True))
    iso = frame.metadata.get("iso")
    if isinstance(iso, int | float) and iso == int(iso) and 0 < iso < 1 << 32:
        # 16 bits; higher values are 65535 and RecommendedExposureIndex (CIPA DC-008, 4.6.6).
        tags.append((ISO, "H", 1, min(int(iso), 65535), True))
        if iso >= 65535:
            tags.append((RECOMMENDED_EXPOSURE_INDEX, "I", 1, int(iso), True))
    for name, tag in (("f_number", F_NUMBER), ("focal_length_mm", FOCAL_LENGTH)):
        if (value := frame.metadata.get(name)) is not None:
            tags.append((tag, "2I", 1, _ratio(float(value), name), True))
    if (taken := frame.metadata.get("date_time")) is not None:
        at = datetime.fromisoformat(str(taken))
        tags.append((DATE_TIME, "s", 0, at.strftime("%Y:%m:%d %H:%M:%S"), True))
        if at.microsecond:
            tags.append((SUBSEC_TIME, "s", 0, f"{at.microsecond:06d}", True))
        if at.utcoffset() is not None:
            tags.append((OFFSET_TIME, "s", 0, at.isoformat()[-6:], True))
    if frame.noise_profile is not None:
        profile = _by_plane(frame, frame.noise_profile, 2, "noise_profile")
        tags.append((NOISE_PROFILE, "d", profile.size, tuple(profile.ravel().tolist()), True))
    return tags


def _area_tags(top: int, bottom: int, left: int, right: int, rows: int, cols: int) -> list[Tag]:
    """Return the tags of the active area, and of the masked areas around it if there are any."""
    last_row, last_col = rows - bottom, cols - right
    tags: list[Tag] = [
        (ACTIVE_AREA, "I", 4, (top, left, last_row, last_col), True),
        (DEFAULT_CROP_SIZE, "I", 2, (last_col - left, last_row - top), True),
    ]
    areas = (
        *((0, 0, top, cols), (last_row, 0, rows, cols)),
        *((top, 0, last_row, left), (top, last_col, last_row, cols)),
    )
    masked = [edge for area in areas if area[0] < area[2] and area[1] < area[3] for edge in area]
    return [*tags, (MASKED_AREAS, "I", len(masked), tuple(masked), True)] if masked else tags


def _color_tags(frame: RawFrame) -> list[Tag]:
    if not frame.is_mosaic:
        return []
    check_cfa(frame.cfa)
    pattern = bytes(_CODES[name] for row in frame.cfa for name in row)
    planes = _planes(frame.cfa)
    tags: list[Tag] = [
        (CFA_REPEAT_DIM, "H", 2, (len(frame.cfa), len(frame.cfa[0])), True),
        (CFA_PATTERN, "B", len(pattern), pattern, True),
        (CFA_PLANE_COLOR, "B", len(planes), bytes(_CODES[name] for name in planes), True),
        (CFA_LAYOUT, "H", 1, 1, True),  # rectangular
    ]
    if frame.color_matrix is None:
        return tags
    two = frame.color_matrix_a is not None
    if frame.color_matrix_a is not None:  # the lower color temperature is the first (DNG 1.7, chapter 6)
        tags += _matrix_tags(frame, frame.color_matrix_a, "color_matrix_a", ILLUMINANT_A, _A_WHITE_XYZ, second=False)
    tags += _matrix_tags(frame, frame.color_matrix, "color_matrix", D65, _D65_WHITE_XYZ, second=two)
    if (neutral := frame.as_shot_neutral) is not None:
        of_channel = dict(zip(plane_names(frame.cfa), neutral, strict=True))
        ratios = sum((_ratio(of_channel[name], "as_shot_neutral") for name in planes), ())
        tags.append((AS_SHOT_NEUTRAL, "2I", len(planes), ratios, True))
    return tags


def _matrix_tags(
    frame: RawFrame, rows: NDArray[np.float64], what: str, light: int, white_xyz: Sequence[float], *, second: bool
) -> list[Tag]:
    """Return ColorMatrix and CalibrationIlluminant, of the first or second illuminant."""
    matrix = _by_plane(frame, rows, 3, what)
    if (matrix @ np.array(white_xyz)).min() <= 0:
        expected = "one that gives positive camera values for the illuminant's white"
        raise InputError(what, value=matrix.tolist(), expected=expected)
    ratios = sum((_ratio(x, what, signed=True) for x in matrix.ravel()), ())
    matrix_tag, light_tag = (COLOR_MATRIX_2, ILLUMINANT_2) if second else (COLOR_MATRIX_1, ILLUMINANT_1)
    return [(matrix_tag, "2i", matrix.size, ratios, True), (light_tag, "H", 1, light, True)]


def _by_plane(frame: RawFrame, rows: NDArray[np.float64], cols: int, what: str) -> NDArray[np.float64]:
    """Reorder rows from the order of `frame.channels` to that of the planes."""
    table = np.asarray(rows, dtype=np.float64)
    expected = (len(frame.channels), cols)
    if table.shape != expected:
        raise InputError(what, value=table.shape, expected=f"of shape {expected}")
    if not frame.is_mosaic:
        return table
    return table[[frame.channels.index(name) for name in _planes(frame.cfa)]]


def _ratio(value: float, what: str, *, signed: bool = False) -> tuple[int, int]:
    """Return the nearest ratio of two 32-bit integers."""
    highest = (1 << 31) - 1 if signed else (1 << 32) - 1
    if not abs(value) <= highest:
        raise InputError(what, value=value, expected=f"at most {highest} in DNG")
    ratio = Fraction(float(value)).limit_denominator(int(highest / max(1.0, abs(value))))
    if value != 0 and ratio == 0:
        raise InputError(what, value=value, expected="0 or a ratio of two 32-bit integers in DNG")
    return ratio.numerator, ratio.denominator


def recognizes(path: Path, head: bytes) -> bool:
    """Return whether a TIFF file is a DNG."""
    return has_tag(path, DNG_VERSION)


def read_headers(path: Path) -> tuple[FrameHeader]:
    """Read the header of a DNG, which holds one frame."""
    return (read_dng_header(path),)


def read_dng_header(path: Path) -> FrameHeader:
    """Read the header of a DNG's frame."""
    directories = read_directories(path)
    top, raw = directories[0], raw_directory(path, directories)
    text = top.text(DESCRIPTION) or ""
    if (own := parse_description(path, text, *_size(raw), 16)) is not None:
        checked_size(path, raw)
        _check_unedited(path, own, top)
        if OPTICAL_BLACK not in own.metadata:
            return own
        first_row, first_col, end_row, end_col = _active_area(path, raw)
        metadata = {name: value for name, value in own.metadata.items() if name != OPTICAL_BLACK}
        rows, cols, border = end_row - first_row, end_col - first_col, _border(path, raw)
        return replace(own, rows=rows, cols=cols, metadata=metadata, masked_border=True, border=border)
    try:
        return _header_from_tags(path, top, raw)
    except (ValueError, OverflowError) as error:  # inconsistent counts, invalid values
        raise FileError(path, f"the file is damaged: its tags contradict each other ({error})") from None


def _header_from_tags(path: Path, top: Directory, raw: Directory) -> FrameHeader:
    first_row, first_col, end_row, end_col = _active_area(path, raw)
    white = raw.number(WHITE_LEVEL) or (1 << int(raw.number(BITS) or 16)) - 1
    cfa = _cfa(path, raw)
    black_level_dn, notes = _black_level(raw)
    return FrameHeader(
        end_row - first_row,
        end_col - first_col,
        None,
        bits=int(white).bit_length(),
        cfa=cfa,
        black_level_dn=black_level_dn,
        white_level_dn=float(white),
        exposure_s=exposure_of(top),
        color_matrix=_color_matrix(top, raw, cfa, D65),
        color_matrix_a=_color_matrix(top, raw, cfa, ILLUMINANT_A),
        noise_profile=_noise_profile(top, raw, cfa),
        metadata=_metadata(top, raw, cfa),
        notes=notes,
        masked_border=bool(raw.numbers(MASKED_AREAS)),
        border=_border(path, raw) if raw.numbers(MASKED_AREAS) else None,
    )


def read_frame(path: Path, bits: int | None = None, cfa: Cfa | None = None) -> tuple[RawFrame, tuple[str, ...]]:
    """Read the active area of a DNG, with notes for warnings."""
    return read_bordered(path, bits, cfa)[:2]


def read_bordered(
    path: Path, bits: int | None = None, cfa: Cfa | None = None
) -> tuple[RawFrame, tuple[str, ...], NDArray[np.float64]]:
    """Read the active area of a DNG, notes for warnings, and the means of the lines of its masked areas."""
    header = read_dng_header(path)
    pixels, raw = _all_pixels(path)
    first_row, first_col, end_row, end_col = _active_area(path, raw)
    dn = np.ascontiguousarray(pixels[first_row:end_row, first_col:end_col])
    masked = [pixels[t:b, left:r] for t, left, b, r in _masked_areas(path, raw)]
    if not masked:
        return header.to_frame(path, dn, bits, cfa), header.notes, np.zeros(0)
    border_dn = float(np.concatenate([area.ravel() for area in masked]).mean())
    header = replace(
        header,
        black_level_dn=border_dn if header.black_level_dn is None else header.black_level_dn,
        metadata={**header.metadata, MASKED_BORDER: border_dn},
    )
    frame = header.to_frame(path, dn, bits, cfa)
    return frame, header.notes + masked_border_note(frame), line_means(masked)


def read_whole(path: Path, location: FrameLocation | None = None) -> NDArray[np.uint16]:
    """Read the digital numbers of a DNG with those around its active area."""
    return np.ascontiguousarray(_all_pixels(path)[0])


_LOSSLESS_JPEG = 7


def _all_pixels(path: Path) -> tuple[NDArray[np.uint16], Directory]:
    directories = read_directories(path)
    top, raw = directories[0], raw_directory(path, directories)
    if raw is top and raw.number(COMPRESSION) in (None, 1) and raw.number(BITS) == 16:
        pixels = np.asarray(read_tiff_pixels(path), np.uint16)
    else:
        with open_libraw(path) as decoder:
            if raw.number(COMPRESSION) == _LOSSLESS_JPEG:  # of which LibRaw fills the missing rest with zeros
                check_size(path, decoder.sizes)
                check_filled(path, decoder.raw_image)
            pixels = decoder.raw_image.copy()
    if pixels.shape != _size(raw):
        raise FileError(path, f"the decoded size is {pixels.shape}, that of the tags {_size(raw)}")
    return pixels, raw


def _border(path: Path, raw: Directory) -> Border | None:
    """Return the lines around the active area."""
    (rows, cols), (top, left, bottom, right) = _size(raw), _active_area(path, raw)
    border = top, rows - bottom, left, cols - right
    return border if any(border) else None


def _size(raw: Directory) -> tuple[int, int]:
    return int(raw.number(LENGTH) or 0), int(raw.number(WIDTH) or 0)


def _active_area(path: Path, raw: Directory) -> Area:
    rows, cols = _size(raw)
    match raw.numbers(ACTIVE_AREA) or (0, 0, rows, cols):
        case (int(top), int(left), int(bottom), int(right)) if 0 <= top < bottom <= rows and 0 <= left < right <= cols:
            return top, left, bottom, right
        case area:
            raise FileError(path, f"the file is damaged: active area {area} in {rows} x {cols} pixels")


def _masked_areas(path: Path, raw: Directory) -> list[Area]:
    rows, cols = _size(raw)
    edges = raw.numbers(MASKED_AREAS) or ()
    areas = list(zip(edges[::4], edges[1::4], edges[2::4], edges[3::4], strict=False))
    whole = len(edges) % 4 == 0 and all(isinstance(edge, int) for edge in edges)
    if not whole or not all(0 <= t < b <= rows and 0 <= left < r <= cols for t, left, b, r in areas):
        raise FileError(path, f"the file is damaged: masked areas {edges} in {rows} x {cols} pixels")
    return areas


def raw_directory(path: Path, directories: list[Directory]) -> Directory:
    """Return the largest full-resolution directory; previews are marked by NewSubfileType."""
    every = [child for page in directories for child in (page, *page.children.get(SUB_IFDS, ()))]
    raws = [p for p in every if p.number(PHOTOMETRIC) in (CFA, LINEAR_RAW) and not p.number(NEW_SUBFILE_TYPE)]
    if not raws:
        raise FileError(path, "the DNG has no raw image")
    raw: Directory = max(raws, key=lambda page: (page.number(WIDTH) or 0) * (page.number(LENGTH) or 0))
    if (samples := raw.number(SAMPLES) or 1) != 1:
        raise FileError(path, f"the DNG is developed, with {samples} samples per pixel; a raw frame has one")
    return raw


def _check_unedited(path: Path, own: FrameHeader, top: Directory) -> None:
    """Check that tags and description of a frame from photosite agree; if not, the file was edited."""
    black, exposure_s = own.black_level_dn or 0.0, own.exposure_s
    pairs: list[tuple[str, Any, Any]] = [
        ("black level", _rounded(black), top.number(BLACK_LEVEL)),
        ("white level", int(own.white_level_dn or 0), top.number(WHITE_LEVEL)),
        ("exposure", None if exposure_s is None else _rounded(exposure_s), exposure_of(top)),
    ]
    if own.cfa is not None and len(channel_names(own.cfa)) > 1:
        coded = tuple(tuple(_COLORS.get(_CODES.get(name, -1)) for name in row) for row in own.cfa)
        pairs.append(("color filter array", coded, _cfa(path, top)))
    for what, in_description, in_tags in pairs:
        if in_description != in_tags:
            problem = f"the file was edited: its tags state {what} {in_tags}, its description {in_description}"
            raise FileError(path, problem, hint="Remove ImageDescription to use the tags")


def _rounded(value: float) -> float:
    numerator, denominator = _ratio(value, "value")
    return numerator / denominator


def _cfa(path: Path, raw: Directory) -> Cfa:
    if raw.number(PHOTOMETRIC) == LINEAR_RAW:
        return MONOCHROME
    size, pattern = raw.numbers(CFA_REPEAT_DIM), raw.numbers(CFA_PATTERN)
    if size is None or pattern is None or len(size) != 2 or len(pattern) != size[0] * size[1]:
        raise FileError(path, "the file is damaged: a mosaic without its color filter array")
    if (layout := raw.number(CFA_LAYOUT) or 1) != 1:
        raise FileError(path, "CFALayout", value=layout, expected="1, a rectangular mosaic")
    names = [_COLORS.get(int(code), f"C{code}") for code in pattern]
    return tuple(tuple(names[row * size[1] : (row + 1) * size[1]]) for row in range(size[0]))


def _black_level(raw: Directory) -> tuple[float | None, tuple[str, ...]]:
    """Return the mean black level, with a note if levels differ; None if masked areas are to give it.

    DNG 1.4: without the tag the level is 0, and masked areas serve to measure it.
    """
    if raw.numbers(BLACK_LEVEL) is None and raw.numbers(MASKED_AREAS):
        return None, ()
    levels = raw.numbers(BLACK_LEVEL) or (0.0,)
    along_row, along_col = raw.numbers(BLACK_LEVEL_DELTA_H) or (0.0,), raw.numbers(BLACK_LEVEL_DELTA_V) or (0.0,)
    mean = float(np.mean(levels) + np.mean(along_row) + np.mean(along_col))
    if all(len(set(part)) == 1 for part in (levels, along_row, along_col)):
        return mean, ()
    spread = f"{min(levels):g} to {max(levels):g} DN within the tile"
    return mean, (f"black levels differ between pixels, {spread}; their mean, {mean:g} DN, is used",)


def _color_matrix(top: Directory, raw: Directory, cfa: Cfa, wanted: int) -> NDArray[np.float64] | None:
    """Return an illuminant's ColorMatrix, with CameraCalibration and AnalogBalance (DNG 1.4, chapter 6)."""
    for matrix_tag, light_tag, calibration_tag in (
        (COLOR_MATRIX_1, ILLUMINANT_1, CALIBRATION_1),
        (COLOR_MATRIX_2, ILLUMINANT_2, CALIBRATION_2),
    ):
        values, light = top.numbers(matrix_tag), top.number(light_tag)
        if values is None or light != wanted:
            continue
        planes = len(values) // 3
        matrix = np.reshape(values, (planes, 3))
        if (calibration := top.numbers(calibration_tag)) is not None:
            matrix = np.reshape(calibration, (planes, planes)) @ matrix
        if (balance := top.numbers(ANALOG_BALANCE)) is not None:
            matrix = np.diag(balance) @ matrix
        return _by_channel(matrix, raw, cfa)
    return None


def _noise_profile(top: Directory, raw: Directory, cfa: Cfa) -> NDArray[np.float64] | None:
    values = raw.numbers(NOISE_PROFILE) or top.numbers(NOISE_PROFILE)
    if values is None:
        return None
    profile = np.reshape(values, (-1, 2))
    if len(profile) == 1:
        return np.repeat(profile, len(channel_names(cfa)), axis=0)
    return _by_channel(profile, raw, cfa)


def _by_channel(table: NDArray[np.float64], raw: Directory, cfa: Cfa) -> NDArray[np.float64] | None:
    """Reorder rows from the order of CFAPlaneColor to that of the tile's channels."""
    planes = [_COLORS.get(int(code)) for code in raw.numbers(CFA_PLANE_COLOR) or (0, 1, 2)]
    if cfa == MONOCHROME:
        planes = ["M"]
    channels = channel_names(cfa)
    if len(planes) != len(table) or not set(channels) <= set(planes):
        return None
    return np.asarray(table[[planes.index(name) for name in channels]], dtype=np.float64)


def _metadata(top: Directory, raw: Directory, cfa: Cfa) -> dict[str, Any]:
    camera = top.text(UNIQUE_CAMERA_MODEL)
    found = camera_settings(top) if camera is None else {"camera": camera, **camera_settings(top)}
    neutral, planes = top.numbers(AS_SHOT_NEUTRAL), raw.numbers(CFA_PLANE_COLOR) or (0, 1, 2)
    of_plane = dict(zip((_COLORS.get(int(code)) for code in planes), neutral or (), strict=False))
    if neutral is None or len(neutral) != len(planes) or of_plane.keys() != set(channel_names(cfa)):
        return found
    if min(neutral) <= 0:
        return found
    return found | {"as_shot_neutral": neutral_text([of_plane[name] for name in plane_names(cfa)])}
