"""DNG's NoiseProfile tag: read from a DNG file, or added to a copy of one.

Pixels and all other tags stay as they are. The raw directory is written again at the end of the file with the tag
added, and pointers to the old directory are changed (TIFF 6.0 allows directories anywhere).
"""

from __future__ import annotations

import struct
from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.writing import atomic_path
from photosite.frames.frame_file import FrameHeader, is_description
from photosite.frames.io import dng
from photosite.frames.io.dng import read_dng_header
from photosite.frames.io.formats import read_raw
from photosite.frames.io.tiff import DESCRIPTION, read_directories
from photosite.sensor.noise_profile import NOT_IN_PROFILE, NoiseProfile
from photosite.values.cfa import MONOCHROME, channel_names
from photosite.values.uncertain import Measured

DNG_LOSS = f"the levels are the file's; not in the tag: uncertainties, gain setting (the file's ISO), {NOT_IN_PROFILE}"

_DOUBLE = 12


def read_dng_profile(path: str | PathLike[str]) -> NoiseProfile:
    """Read the noise profile of a DNG file; one that is missing or invalid is a `FileError`."""
    file = Path(path)
    header = _header(file)
    if header.noise_profile is None:
        raise FileError(file, "the file has no NoiseProfile tag")
    table = np.asarray(header.noise_profile, dtype=np.float64)
    if not (np.isfinite(table).all() and table[:, 0].min() > 0):
        raise FileError(file, "NoiseProfile", value=table.tolist(), expected="finite, with slopes above 0")
    iso = header.metadata.get("gain_setting", header.metadata.get("iso"))
    notes: tuple[str, ...] = ()
    if np.ptp(table[:, 0]) > 0.01 * table[:, 0].mean():
        notes = ("the channels' slopes differ, although a sensor has one gain; their mean is used",)
    return NoiseProfile(
        channel_names(header.cfa or MONOCHROME),
        tuple(Measured(float(slope)) for slope, _ in table),
        tuple(Measured(float(offset)) for _, offset in table),
        float(iso) if isinstance(iso, int | float) else None,
        header.black_level_dn or 0.0,
        header.white_level_dn,
        str(header.metadata.get("camera") or ""),
        notes,
    )


def _header(path: Path) -> FrameHeader:
    """Read the header of a DNG, with levels that a noise profile can be scaled to."""
    header = read_dng_header(path)
    black, white = header.black_level_dn or 0.0, header.white_level_dn or 65535.0
    if not 0 <= black < white < float("inf"):
        raise FileError(path, f"the file is damaged: its black level {black:g} is not below its white level {white:g}")
    return header


def write_dng_profile(profile: NoiseProfile, source: str | PathLike[str], path: str | PathLike[str]) -> None:
    """Copy a DNG file, or change it in place, and set its NoiseProfile tag.

    The profile is converted to the file's black and white level. BigTIFF is not supported.
    """
    file = Path(source)
    header = _header(file)
    content = file.read_bytes()
    table = _table(profile, header)
    if is_description(read_directories(file)[0].text(DESCRIPTION) or ""):
        # Frames from photosite have the profile in the description, too; both must agree.
        replace(read_raw(file), noise_profile=table).save(path)
        return
    names = channel_names(header.cfa or MONOCHROME)
    planes = [name for name in ("R", "G", "B") if name in names]
    one_row = len(planes) < len(names) or len(names) == 1 or not np.ptp(table, axis=0).any()
    values = table.mean(axis=0, keepdims=True) if one_row else table[[names.index(name) for name in planes]]
    try:
        changed = _with_tag(file, content, tuple(values.ravel().tolist()))
    except (struct.error, ValueError) as error:  # directories that a lenient reader accepts
        raise FileError(file, f"the file is damaged: its directories cannot be rewritten ({error})") from None
    with atomic_path(path) as temporary:
        temporary.write_bytes(changed)
        _check_written(file, temporary, np.broadcast_to(values, table.shape) if one_row else table)


def _check_written(source: Path, written: Path, expected: NDArray[np.float64]) -> None:
    try:
        found = read_dng_header(written).noise_profile
    except FileError as error:
        problem = f"the file is damaged: after adding a NoiseProfile, {error.format_content()}"
        raise FileError(source, problem) from None
    if found is None or not np.allclose(found, expected, rtol=1e-12, atol=0.0):
        raise FileError(source, "the file is damaged: a NoiseProfile written into it cannot be read back")


def _table(profile: NoiseProfile, header: FrameHeader) -> NDArray[np.float64]:
    """Return (channels, 2) in the order of the file's channels; the mean for channels without an entry."""
    scaled = profile.at_levels(header.black_level_dn or 0.0, header.white_level_dn or 65535.0)
    values = ((slope.value, offset.value) for slope, offset in zip(scaled.slope, scaled.offset, strict=True))
    pairs = dict(zip(scaled.channels, values, strict=True))
    mean = tuple(np.mean([*pairs.values()], axis=0).tolist())
    return np.array([pairs.get(name, mean) for name in channel_names(header.cfa or MONOCHROME)])


def _with_tag(path: Path, content: bytes, values: tuple[float, ...]) -> bytes:
    """Return a file's content with NoiseProfile in a new raw directory at its end."""
    raw = dng.raw_directory(path, read_directories(path))
    order = raw.order
    if struct.unpack(f"{order}H", content[2:4])[0] != 42:
        raise FileError(path, "the file is a BigTIFF DNG; the noise profile can be added to classic TIFF only")
    (count,) = struct.unpack_from(f"{order}H", content, raw.offset)
    start, end = raw.offset + 2, raw.offset + 2 + 12 * count
    place = len(content) + len(content) % 2
    entries = {struct.unpack_from(f"{order}H", content, at)[0]: content[at : at + 12] for at in range(start, end, 12)}
    entries[dng.NOISE_PROFILE] = struct.pack(f"{order}HHII", dng.NOISE_PROFILE, _DOUBLE, len(values), place)
    result = bytearray(content.ljust(place, b"\0")) + struct.pack(f"{order}{len(values)}d", *values)
    struct.pack_into(f"{order}I", result, raw.pointer, len(result))
    in_order = b"".join(entries[tag] for tag in sorted(entries))  # TIFF 6.0: entries are sorted by tag
    return bytes(result + struct.pack(f"{order}H", len(entries)) + in_order + content[end : end + 4])
