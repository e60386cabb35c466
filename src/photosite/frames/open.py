"""Opening a measurement: a folder, a protocol, an EMVA 1288 descriptor or a file of several frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path

from photosite.errors import FileError, InputError
from photosite.frames.folder import KindPatterns, find_listing, frame_files_in_folder, kind_by_pattern
from photosite.frames.frame_file import FrameFile, SetProperties
from photosite.frames.frame_set import FrameSet
from photosite.frames.frame_settings import FrameSettings
from photosite.frames.from_files import frame_set_from_files
from photosite.frames.io.emva_descriptor import looks_like_descriptor, read_descriptor
from photosite.frames.io.protocol import read_protocol
from photosite.frames.io.read import SUFFIXES, read_headers
from photosite.frames.raw_frame import check_bits
from photosite.sensor.io.sensor_file import load_sensor
from photosite.values.cfa import cfa_from


def open_frames(
    path: str | PathLike[str],
    *,
    bits: int | None = None,
    cfa: str | Sequence[Sequence[str]] | None = None,
    dark: str | Sequence[str] = (),
    light: str | Sequence[str] = (),
) -> FrameSet:
    """Open the frames of a measurement, grouped by kind, exposure and gain setting.

    Headers are read here, pixels when they are needed. Settings come from three sources; an earlier one overrides
    the later ones:

    1. the protocol or descriptor, or the patterns `dark` and `light`;
    2. the file's metadata (exposure time, ISO or gain, temperature, kind): Exif and TIFF/EP in camera raw, DNG and
       TIFF, keywords in FITS, attributes in HDF5, and the description in files that photosite wrote;
    3. the names of the file and its subfolder: dark, darks, bias, `d_012` for a dark frame; light, lights, flat, flats,
       bright, `b_012` for a light frame; `10ms`, `0.04s`, `250us`, `1-8000s` (1/8000 s) for the exposure time;
       `iso400`, `gain_2.5` for the gain setting; `_-10C` for the temperature.

    If no source states the kind, frames are classified by their signal level, with a warning. A file of several frames
    (pages of TIFF; datasets, stacks and units of HDF5 and FITS) stands for all of them.

    Parameters
    ----------
    path
        A YAML protocol, an EMVA 1288 descriptor, a folder, or a file of several frames. A protocol.yaml or a single
        descriptor in a folder defines its frames; otherwise all frames in the folder are used. A folder without frames
        is searched one level down, unless a subfolder is a measurement with its own listing.
    bits
        Bit depth of the converter, if neither files nor protocol state it.
    cfa
        Colour filter array (`"rggb"` or its tile), if neither files nor protocol state it.
    dark, light
        Glob patterns (`"DSC_00*.NEF"`, `"run1/*"`) of the dark and the light frames. They override metadata and names,
        and apply to folders and files without a protocol or descriptor.

    Returns
    -------
    FrameSet
        All files exist, are complete as far as their headers show, and agree in size, bits and mosaic. Pixels were read
        only of one frame of camera raw or of DNG with masked areas, and for classification by level.

    Raises
    ------
    InputError
        If bits or cfa are invalid, or patterns are given with a protocol or descriptor.
    FileError
        If a file is missing, truncated, listed twice, or inconsistent with the others or with stated properties, or its
        kind or exposure is unknown.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.raw_frame import RawFrame
    >>> dark = RawFrame(np.full((2, 3), 64, np.uint16), bits=12, exposure_s=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     dark.save(f"{folder}/dark_1.png")
    ...     dark.save(f"{folder}/dark_2.png")
    ...     frames = open_frames(folder)
    >>> [(group.kind, group.exposure_s, len(group)) for group in frames.groups], frames.bits
    ([('dark', 0.1, 2)], 12)
    """
    check_bits(bits)
    given = SetProperties(bits, None if cfa is None else cfa_from(cfa))
    patterns: KindPatterns = {"dark": _texts(dark), "light": _texts(light)}
    place = Path(path)
    if not place.exists():
        raise FileError(place, "there is no such file or folder")
    listing = find_listing(place) if place.is_dir() else place
    if listing is None:
        return frame_set_from_files(frame_files_in_folder(place, patterns), str(place), given)
    if listing is place and place.suffix.lower() in SUFFIXES:
        return frame_set_from_files([_stack(place, patterns)], str(place), given)
    if any(patterns.values()):
        raise InputError("patterns for dark and light frames apply to folders only", hint=f"{listing} states the kinds")
    if listing.suffix.lower() in (".yaml", ".yml"):
        return _open_protocol(listing, given)
    if looks_like_descriptor(listing):
        return _open_descriptor(listing, given)
    raise FileError(
        place,
        "the file is neither a YAML protocol nor an EMVA 1288 descriptor",
        hint="A descriptor's first command is 'v' or 'n'",
    )


def _texts(patterns: str | Sequence[str]) -> tuple[str, ...]:
    return (patterns,) if isinstance(patterns, str) else tuple(patterns)


def _stack(file: Path, patterns: KindPatterns) -> FrameFile:
    if len(read_headers(file)) == 1:
        hint = "A measurement is a folder, an EMVA 1288 descriptor or a YAML protocol"
        raise FileError(file, "the file holds a single frame", hint=hint)
    return FrameFile(file, FrameSettings(kind=kind_by_pattern(file, patterns)), names=(file.stem,))


def _open_descriptor(path: Path, given: SetProperties) -> FrameSet:
    descriptor = read_descriptor(path)
    if given.bits not in (None, descriptor.bits):
        raise FileError(path, "bits", value=given.bits, expected=f"{descriptor.bits}, as the descriptor states")
    stated = SetProperties(descriptor.bits, given.cfa, (descriptor.rows, descriptor.cols))
    return frame_set_from_files(descriptor.files, str(path), stated)


def _open_protocol(path: Path, given: SetProperties) -> FrameSet:
    protocol = read_protocol(path)
    stated = SetProperties(
        protocol.bits,
        protocol.cfa,
        black_level_dn=protocol.black_level_dn,
        sensor=None if protocol.sensor is None else load_sensor(path.parent / protocol.sensor),
    )
    for name in ("bits", "cfa"):
        from_protocol, from_caller = getattr(stated, name), getattr(given, name)
        if from_protocol is None:
            stated = replace(stated, **{name: from_caller})
        elif from_caller is not None and from_caller != from_protocol:
            raise FileError(path, name, value=from_caller, expected=f"{from_protocol}, as the protocol states")
    return frame_set_from_files(protocol.frame_files(path), str(path), stated)
