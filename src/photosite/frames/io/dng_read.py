"""Frames read from DNG: photosite's own, and any other of one sample a pixel.

Levels, mosaic and matrix come from the file's tags, exactly and where the tags say they start; LibRaw, which rounds
black levels and moves odd margins, only decodes the pixels. The frame is the active area. Masked areas (optical black)
are read for their mean, which is the black level where the file states none.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.frames.io import dng
from photosite.frames.io.camera_raw import opened
from photosite.frames.io.header import FrameHeader, described
from photosite.frames.io.tiff import (
    BITS,
    COMPRESSION,
    DESCRIPTION,
    LENGTH,
    PHOTOMETRIC,
    SAMPLES,
    WIDTH,
    camera_settings,
    checked_size,
    exposure_of,
    read_tiff_pixels,
)
from photosite.frames.io.tiff_directory import SUB_IFDS, Directory, read_directories
from photosite.frames.levels import BORDER, border_note
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import MONOCHROME, Cfa, channel_names

MASKED_AREAS = 50830
_CFA = 32803
_COLOURS = {0: "R", 1: "G", 2: "B", 3: "C", 4: "M", 5: "Y", 6: "W"}
"""TIFF/EP CFAPattern, and white as DNG adds it."""


def read_dng_header(path: Path) -> FrameHeader:
    """What a DNG says of its frame.

    Raises
    ------
    FileError
        If the file is truncated or holds no frame of one sample a pixel, or is photosite's and was edited.
    """
    directories = read_directories(path)
    top, raw = directories[0], _raw_directory(path, directories)
    text = top.text(DESCRIPTION) or ""
    rows, cols = int(raw.number(LENGTH) or 0), int(raw.number(WIDTH) or 0)
    if (own := described(path, text, rows, cols, 16)) is not None:
        checked_size(path, raw)
        _check_unedited(path, own, top)
        return own
    try:
        return _header_of_tags(path, top, raw, _active_area(path, raw))
    except (ValueError, OverflowError) as error:  # counts and values that cannot be
        raise FileError(path, f"is damaged: its tags contradict each other ({error})") from None


def _header_of_tags(path: Path, top: Directory, raw: Directory, area: tuple[int, int, int, int]) -> FrameHeader:
    top_edge, left, bottom, right = area
    white = raw.number(dng.WHITE_LEVEL) or (1 << int(raw.number(BITS) or 16)) - 1
    cfa = _cfa(path, raw)
    black_level_dn, notes = _black_level(raw)
    return FrameHeader(
        bottom - top_edge,
        right - left,
        None,
        bits=int(white).bit_length(),
        cfa=cfa,
        black_level_dn=black_level_dn,
        white_level_dn=float(white),
        exposure_s=exposure_of(top),
        color_matrix=_color_matrix(top, raw, cfa),
        noise_profile=_noise_profile(top, raw, cfa),
        metadata=MappingProxyType(_metadata(top)),
        notes=notes,
        masked_border=bool(raw.numbers(MASKED_AREAS)),
    )


def read_dng(path: Path, bits: int | None = None, cfa: Cfa | None = None) -> tuple[RawFrame, tuple[str, ...]]:
    """The active area of a DNG.

    Parameters
    ----------
    path
        The file.
    bits, cfa
        What the file should say, to have it checked.

    Raises
    ------
    FileError
        If the file cannot be decoded, or is not what was expected.

    Returns
    -------
    RawFrame, tuple of str
        The frame, and what its reader should know.
    """
    header = read_dng_header(path)
    dn, border_dn = _decoded(path)
    if border_dn is None:
        return header.frame(path, dn, bits, cfa), header.notes
    stated = header.black_level_dn is not None
    header = replace(
        header,
        black_level_dn=header.black_level_dn if stated else border_dn,
        metadata=MappingProxyType({**header.metadata, BORDER: border_dn}),
    )
    frame = header.frame(path, dn, bits, cfa)
    return frame, header.notes + border_note(frame)


def _decoded(path: Path) -> tuple[NDArray[np.uint16], float | None]:
    """The active area's numbers, and the mean of the masked areas where there are some."""
    directories = read_directories(path)
    top, raw = directories[0], _raw_directory(path, directories)
    rows, cols = int(raw.number(LENGTH) or 0), int(raw.number(WIDTH) or 0)
    if raw is top and raw.number(COMPRESSION) in (None, 1) and raw.number(BITS) == 16:
        pixels = read_tiff_pixels(path)
    else:
        with opened(path) as decoder:
            pixels = decoder.raw_image.copy()
    if pixels.shape != (rows, cols):
        raise FileError(path, f"decodes to {pixels.shape} pixels where its tags say {rows} x {cols}")
    top_edge, left, bottom, right = _active_area(path, raw)
    masked = [pixels[t:b, lft:r].ravel() for t, lft, b, r in _masked_areas(path, raw)]
    border_dn = float(np.concatenate(masked).mean()) if masked else None
    return np.ascontiguousarray(pixels[top_edge:bottom, left:right]), border_dn


def _masked_areas(path: Path, raw: Directory) -> list[tuple[int, int, int, int]]:
    """First row and column, and the ones after the last, of each rectangle."""
    rows, cols = int(raw.number(LENGTH) or 0), int(raw.number(WIDTH) or 0)
    edges = [int(edge) for edge in raw.numbers(MASKED_AREAS) or ()]
    areas = list(zip(edges[::4], edges[1::4], edges[2::4], edges[3::4], strict=False))
    if len(edges) % 4 or not all(0 <= t < b <= rows and 0 <= left < r <= cols for t, left, b, r in areas):
        raise FileError(path, f"is damaged: masked areas {tuple(edges)} in {rows} x {cols} pixels")
    return areas


def _raw_directory(path: Path, directories: list[Directory]) -> Directory:
    """The largest full-resolution directory; previews are marked by NewSubfileType."""
    every = [child for page in directories for child in (page, *page.children.get(SUB_IFDS, ()))]
    raws = [page for page in every if page.number(PHOTOMETRIC) in (_CFA, dng.LINEAR_RAW) and not page.number(254)]
    if not raws:
        raise FileError(path, "is a DNG without a raw image")
    raw: Directory = max(raws, key=lambda page: (page.number(WIDTH) or 0) * (page.number(LENGTH) or 0))
    if (samples := raw.number(SAMPLES) or 1) != 1:
        raise FileError(path, f"is a developed DNG of {samples} samples a pixel; a raw frame has one")
    return raw


def _active_area(path: Path, raw: Directory) -> tuple[int, int, int, int]:
    """First row and column of the active area, and the ones after its last."""
    rows, cols = int(raw.number(LENGTH) or 0), int(raw.number(WIDTH) or 0)
    match raw.numbers(dng.ACTIVE_AREA) or (0, 0, rows, cols):
        case (top, left, bottom, right) if 0 <= top < bottom <= rows and 0 <= left < right <= cols:
            return int(top), int(left), int(bottom), int(right)
        case area:
            raise FileError(path, f"is damaged: active area {area} in {rows} x {cols} pixels")


def _check_unedited(path: Path, own: FrameHeader, top: Directory) -> None:
    """photosite writes some things twice; where they differ, somebody has edited the file."""
    black, exposure_s = own.black_level_dn or 0.0, own.exposure_s
    white = int(own.white_level_dn or 0)
    said: list[tuple[str, Any, Any]] = [
        ("black level", _rounded(black), top.number(dng.BLACK_LEVEL)),
        ("white level", white, top.number(dng.WHITE_LEVEL)),
        ("exposure", None if exposure_s is None else _rounded(exposure_s), exposure_of(top)),
    ]
    if own.cfa is not None and len(channel_names(own.cfa)) > 1:
        said.append(("colour filter array", own.cfa, _cfa(path, top)))
    for what, described_value, tagged in said:
        if described_value != tagged:
            raise FileError(
                path,
                f"was edited: its tags say {what} {tagged}, its description {described_value}; "
                "remove ImageDescription to go by the tags",
            )


def _rounded(value: float) -> float:
    numerator, denominator = dng.ratio(value, "value")
    return numerator / denominator


def _cfa(path: Path, raw: Directory) -> Cfa:
    if raw.number(PHOTOMETRIC) == dng.LINEAR_RAW:
        return MONOCHROME
    size, pattern = raw.numbers(dng.CFA_REPEAT_DIM), raw.numbers(dng.CFA_PATTERN)
    if size is None or pattern is None or len(size) != 2 or len(pattern) != size[0] * size[1]:
        raise FileError(path, "is damaged: a mosaic without its colour filter array")
    if (raw.number(50711) or 1) != 1:
        raise FileError(path, f"has CFALayout {raw.number(50711)}; only rectangular mosaics (1) are read")
    names = [_COLOURS.get(int(code), f"C{code}") for code in pattern]
    return tuple(tuple(names[row * size[1] : (row + 1) * size[1]]) for row in range(size[0]))


def _black_level(raw: Directory) -> tuple[float | None, tuple[str, ...]]:
    """The mean black level, and a note where it is a mean of different ones; None where masked areas are to tell it.

    DNG 1.4: without a tag the level is 0, and masked areas serve to measure it.
    """
    if raw.numbers(dng.BLACK_LEVEL) is None and raw.numbers(MASKED_AREAS):
        return None, ()
    levels = raw.numbers(dng.BLACK_LEVEL) or (0.0,)
    along_row, along_col = raw.numbers(50715) or (0.0,), raw.numbers(50716) or (0.0,)  # BlackLevelDeltaH, -V
    mean = float(np.mean(levels) + np.mean(along_row) + np.mean(along_col))
    if all(len(set(part)) == 1 for part in (levels, along_row, along_col)):
        return mean, ()
    spread = f"{min(levels):g} to {max(levels):g} DN within the tile"
    return mean, (f"black levels differ from pixel to pixel, {spread}; their mean, {mean:g} DN, is taken",)


def _color_matrix(top: Directory, raw: Directory, cfa: Cfa) -> NDArray[np.float64] | None:
    """The ColorMatrix of D65, CameraCalibration and AnalogBalance included (DNG 1.4, chapter 6)."""
    for matrix_tag, light_tag, calibration_tag in ((50721, 50778, 50723), (50722, 50779, 50724)):
        values, light = top.numbers(matrix_tag), top.number(light_tag)
        if values is None or light != dng.D65:
            continue
        planes = len(values) // 3
        matrix = np.reshape(values, (planes, 3))
        if (calibration := top.numbers(calibration_tag)) is not None:
            matrix = np.reshape(calibration, (planes, planes)) @ matrix
        if (balance := top.numbers(50727)) is not None:
            matrix = np.diag(balance) @ matrix
        return _by_channel(matrix, raw, cfa)
    return None


def _noise_profile(top: Directory, raw: Directory, cfa: Cfa) -> NDArray[np.float64] | None:
    values = raw.numbers(dng.NOISE_PROFILE) or top.numbers(dng.NOISE_PROFILE)
    if values is None:
        return None
    profile = np.reshape(values, (-1, 2))
    if len(profile) == 1:
        return np.repeat(profile, len(channel_names(cfa)), axis=0)
    return _by_channel(profile, raw, cfa)


def _by_channel(table: NDArray[np.float64], raw: Directory, cfa: Cfa) -> NDArray[np.float64] | None:
    """Rows in the order of CFAPlaneColor put into the order of the tile's channels."""
    planes = [_COLOURS.get(int(code)) for code in raw.numbers(dng.CFA_PLANE_COLOR) or (0, 1, 2)]
    if cfa == MONOCHROME:
        planes = ["M"]
    channels = channel_names(cfa)
    if len(planes) != len(table) or not set(channels) <= set(planes):
        return None
    return np.asarray(table[[planes.index(name) for name in channels]], dtype=np.float64)


def _metadata(top: Directory) -> dict[str, Any]:
    camera = top.text(dng.UNIQUE_CAMERA_MODEL)
    return camera_settings(top) if camera is None else {"camera": camera, **camera_settings(top)}
