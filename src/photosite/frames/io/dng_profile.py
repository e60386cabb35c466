"""DNG's NoiseProfile tag put into a DNG file, and read from one.

The pixels and every other tag stay as they are: the raw directory is written once more at the end of the file with the
tag in it, and what pointed to the old one points to the new (TIFF 6.0 lets directories lie anywhere).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError
from photosite.files.atomic import atomic_path
from photosite.frames.io import dng
from photosite.frames.io.dng_read import read_dng_header
from photosite.frames.io.header import MARK, FrameHeader
from photosite.frames.io.read import read_raw
from photosite.frames.io.tiff import DESCRIPTION
from photosite.frames.io.tiff_directory import read_directories
from photosite.sensor.noise_profile import LOST, NoiseProfile
from photosite.values.cfa import channel_names
from photosite.values.measured import Measured

DNG_LOSS = f"the levels are the file's; lost: uncertainties, gain setting (the file's ISO stands for it), {LOST}"

_CFA, _SUBFILE, _WIDTH, _LENGTH, _PHOTOMETRIC, _SUB_IFDS = 32803, 254, 256, 257, 262, 330
_DOUBLE = 12


def read_dng_profile(path: str | PathLike[str]) -> NoiseProfile:
    """The noise profile in a DNG file.

    Raises
    ------
    FileError
        If the file cannot be read, holds no NoiseProfile, or one that cannot be.
    """
    place = Path(path)
    header = _sound_header(place)
    if header.noise_profile is None:
        raise FileError(place, "has no NoiseProfile tag")
    table = np.asarray(header.noise_profile, dtype=np.float64)
    if not (np.isfinite(table).all() and table[:, 0].min() > 0):
        raise FileError(place, f"has a NoiseProfile that cannot be: {table.tolist()}")
    iso = header.metadata.get("gain_setting", header.metadata.get("iso"))
    notes: tuple[str, ...] = ()
    if np.ptp(table[:, 0]) > 0.01 * table[:, 0].mean():
        notes = ("the channels' slopes differ, though one chip has one gain: their mean is taken",)
    return NoiseProfile(
        channel_names(header.cfa or (("M",),)),
        tuple(Measured(float(slope)) for slope, _ in table),
        tuple(Measured(float(offset)) for _, offset in table),
        float(iso) if isinstance(iso, int | float) else None,
        header.black_level_dn or 0.0,
        header.white_level_dn,
        str(header.metadata.get("camera") or ""),
        notes,
    )


def _sound_header(path: Path) -> FrameHeader:
    header = read_dng_header(path)
    black, white = header.black_level_dn or 0.0, header.white_level_dn or 65535.0
    if not 0 <= black < white < float("inf"):
        raise FileError(path, f"is damaged: its black level {black:g} is not below its white level {white:g}")
    return header


def write_dng_profile(profile: NoiseProfile, source: str | PathLike[str], path: str | PathLike[str]) -> None:
    """A copy of a DNG file with this noise profile in its NoiseProfile tag.

    Parameters
    ----------
    profile
        The profile; it is brought to the file's black and white level.
    source
        The DNG file.
    path
        The copy; it may be the file itself.

    Raises
    ------
    FileError
        If the source is no DNG of one sample a pixel, is BigTIFF or damaged, or the copy cannot be written.
    """
    place = Path(source)
    header = _sound_header(place)
    content = place.read_bytes()
    table = _table(profile, header)
    if (read_directories(place)[0].text(DESCRIPTION) or "").startswith(f'{{"{MARK}"'):
        # photosite's own frames say it twice; both must agree.
        replace(read_raw(place), noise_profile=table).save(path)
        return
    names = channel_names(header.cfa or (("M",),))
    planes = [name for name in dng.PLANES if name in names]
    alike = len(planes) < len(names) or len(names) == 1 or not np.ptp(table, axis=0).any()
    values = table.mean(axis=0, keepdims=True) if alike else table[[names.index(name) for name in planes]]
    try:
        changed = _with_tag(place, content, tuple(values.ravel().tolist()))
    except (struct.error, ValueError) as error:  # directories that a lenient reader passes over
        raise FileError(place, f"is damaged: its directories cannot be rewritten ({error})") from None
    with atomic_path(path) as temporary:
        temporary.write_bytes(changed)
        _check_written(place, temporary, np.broadcast_to(values, table.shape) if alike else table)


def _check_written(place: Path, temporary: Path, wanted: NDArray[np.float64]) -> None:
    try:
        written = read_dng_header(temporary).noise_profile
    except FileError as error:
        raise FileError(place, f"is damaged: with a NoiseProfile in it, it {error.format_content()}") from None
    if written is None or not np.allclose(written, wanted, rtol=1e-12, atol=0.0):
        raise FileError(place, "is damaged: a NoiseProfile written into it cannot be read back")


def _table(profile: NoiseProfile, header: FrameHeader) -> NDArray[np.float64]:
    """(channels, 2) in the order of the file's channels; the mean for channels that the profile does not name."""
    scaled = profile.at_levels(header.black_level_dn or 0.0, header.white_level_dn or 65535.0)
    pairs = {
        name: (slope.value, offset.value)
        for name, slope, offset in zip(scaled.channels, scaled.slope, scaled.offset, strict=True)
    }
    mean = tuple(np.mean([*pairs.values()], axis=0).tolist())
    return np.array([pairs.get(name, mean) for name in channel_names(header.cfa or (("M",),))])


@dataclass(frozen=True)
class _Placed:
    """A directory and the four bytes that point to it."""

    pointer: int
    entries: tuple[bytes, ...]
    link: bytes
    numbers: dict[int, int]


def _with_tag(path: Path, content: bytes, values: tuple[float, ...]) -> bytes:
    order = {b"II": "<", b"MM": ">"}[content[:2]]  # read_dng_header has seen that it is TIFF
    if struct.unpack(f"{order}H", content[2:4])[0] != 42:
        raise FileError(path, "is a BigTIFF DNG; the noise profile is written into classic ones only")
    raws = [
        placed
        for placed in _directories(content, order)
        if placed.numbers.get(_PHOTOMETRIC) in (_CFA, dng.LINEAR_RAW) and not placed.numbers.get(_SUBFILE)
    ]
    raw = max(raws, key=lambda placed: placed.numbers.get(_WIDTH, 0) * placed.numbers.get(_LENGTH, 0))
    end = len(content) + len(content) % 2
    data = struct.pack(f"{order}{len(values)}d", *values)
    new = struct.pack(f"{order}HHII", dng.NOISE_PROFILE, _DOUBLE, len(values), end)
    entries = [entry for entry in raw.entries if _tag(entry, order) != dng.NOISE_PROFILE]
    entries = sorted([*entries, new], key=lambda entry: _tag(entry, order))
    result = bytearray(content) + bytes(end - len(content)) + data
    struct.pack_into(f"{order}I", result, raw.pointer, len(result))
    return bytes(result + struct.pack(f"{order}H", len(entries)) + b"".join(entries) + raw.link)


def _directories(content: bytes, order: str) -> Iterator[_Placed]:
    """Every directory of the chain and its SubIFDs, with where it is pointed to; read_dng_header has checked them."""
    pointers = [4]
    while pointers:
        pointer = pointers.pop()
        (offset,) = struct.unpack_from(f"{order}I", content, pointer)
        if not offset:
            continue
        (count,) = struct.unpack_from(f"{order}H", content, offset)
        start, end = offset + 2, offset + 2 + 12 * count
        entries = tuple(content[at : at + 12] for at in range(start, end, 12))
        numbers = {}
        for at, entry in zip(range(start, end, 12), entries, strict=True):
            tag, kind, length = struct.unpack(f"{order}HHI", entry[:8])
            numbers[tag] = (
                struct.unpack(f"{order}H", entry[8:10])[0] if kind == 3 else struct.unpack(f"{order}I", entry[8:])[0]
            )
            if tag == _SUB_IFDS:
                first = at + 8 if length == 1 else numbers[tag]
                pointers.extend(range(first, first + 4 * length, 4))
        pointers.append(end)
        yield _Placed(pointer, entries, content[end : end + 4], numbers)


def _tag(entry: bytes, order: str) -> int:
    return int(struct.unpack(f"{order}H", entry[:2])[0])
