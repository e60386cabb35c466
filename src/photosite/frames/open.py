"""Frame sets opened: from a folder, an EMVA 1288 descriptor or a YAML protocol."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from photosite.cfa import cfa_from
from photosite.errors import FileError, InputError
from photosite.frames.emva import looks_like_descriptor, read_descriptor
from photosite.frames.frame_set import KINDS, FrameSet, Kind
from photosite.frames.header import FrameHeader, stated_number
from photosite.frames.listing import Expected, FileEntry, frame_set_of_files
from photosite.frames.protocol import file_entries, read_protocol
from photosite.frames.read import SUFFIXES, read_header
from photosite.sensor.model import Sensor

PROTOCOL_NAMES = ("protocol.yaml", "protocol.yml")

_KIND_WORDS: dict[str, Kind] = {
    "dark": "dark",
    "darks": "dark",
    "bias": "dark",
    "light": "light",
    "lights": "light",
    "flat": "light",
    "flats": "light",
    "bright": "light",
}
_EXAMPLE = "'photosite_protocol: 1', then 'frames:' with '- {kind: dark, exposure: 1/100, files: dark*.png}' and so on"


def open_frames(
    path: str | PathLike[str], *, bits: int | None = None, cfa: str | Sequence[Sequence[str]] | None = None
) -> FrameSet:
    """The frames of a measurement, grouped by kind and exposure, read when asked for.

    Parameters
    ----------
    path
        A YAML protocol, an EMVA 1288 descriptor, or a folder. A folder that holds a protocol.yaml or one descriptor
        stands for it; in any other, all frames are taken, with the exposure and kind their files state. A folder
        that holds none itself is searched one level down, as long as no subfolder is a measurement of its own. Where
        a file states no kind, a word of its name does, or else of its subfolder's: dark, bias; light, flat, bright.
    bits
        Bits of the converter, where neither the files nor the protocol say.
    cfa
        The colour filter array (`"rggb"` or its tile), where neither the files nor the protocol say.

    Returns
    -------
    FrameSet
        All files are known to be there, whole as far as their headers tell, and alike. No pixels were read.

    Raises
    ------
    InputError
        If bits or cfa cannot be.
    FileError
        If a file is missing, truncated, listed twice, unlike the others or unlike what was said, or its kind or
        exposure cannot be told.

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
    if bits is not None and not 1 <= bits <= 16:
        raise InputError(f"a converter has 1 to 16 bits, not {bits}")
    expected = Expected(bits, None if cfa is None else cfa_from(cfa))
    place = Path(path)
    if place.is_dir():
        return _open_folder(place, expected)
    if not place.exists():
        raise FileError(place, "there is no such file or folder")
    if place.suffix.lower() in (".yaml", ".yml"):
        return _open_protocol(place, expected)
    if place.suffix.lower() in SUFFIXES:
        raise FileError(place, "is one frame; a measurement is a folder, an EMVA 1288 descriptor or a YAML protocol")
    if looks_like_descriptor(place):
        return _open_descriptor(place, expected)
    raise FileError(place, "is no EMVA 1288 descriptor, whose first command is 'v' or 'n', and no YAML protocol")


def _open_folder(folder: Path, expected: Expected) -> FrameSet:
    files = _files(folder)
    for name in PROTOCOL_NAMES:
        if folder / name in files:
            return _open_protocol(folder / name, expected)
    descriptors = [p for p in files if p.suffix.lower() == ".txt" and looks_like_descriptor(p)]
    if len(descriptors) > 1:
        raise FileError(folder, f"holds {len(descriptors)} descriptors, {descriptors[0].name} and others; name one")
    if descriptors:
        return _open_descriptor(descriptors[0], expected)
    images = _images(files)
    if images:
        entries = [_entry(image, read_header(image)) for image in images]
    else:
        entries = [_entry(image, read_header(image), image.parent.name) for image in _images_one_level_down(folder)]
    return frame_set_of_files(entries, str(folder), expected)


def _files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))


def _images(files: list[Path]) -> list[Path]:
    return [p for p in files if p.suffix.lower() in SUFFIXES]


def _images_one_level_down(folder: Path) -> list[Path]:
    """The frames of the subfolders, dark/ and light/ say, of a folder that holds none itself."""
    below = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    files = [file for place in below for file in _files(place)]
    own = [p for p in files if p.name in PROTOCOL_NAMES or (p.suffix.lower() == ".txt" and looks_like_descriptor(p))]
    images = _images(files)
    if images and not own:
        return images
    why = "holds no frames (DNG, camera raw, TIFF, PNG), no protocol.yaml and no EMVA 1288 descriptor"
    if own:
        why += f"; its subfolder {own[0].parent.name} is a measurement of its own: name that"
    elif below:
        why += f", and its subfolders ({', '.join(place.name for place in below)}) hold no frames either"
    raise FileError(folder, why)


def _entry(image: Path, header: FrameHeader, subfolder: str = "") -> FileEntry:
    if header.exposure_s is None:
        raise FileError(image, f"does not state its exposure; say it in a protocol.yaml: {_EXAMPLE}")
    photons = stated_number(image, header, "photons_per_pixel")
    return FileEntry(image, _kind(image, header, subfolder), header.exposure_s, photons)


def _kind(image: Path, header: FrameHeader, subfolder: str) -> Kind:
    stated = header.metadata.get("kind")
    if stated is not None:
        for kind in KINDS:
            if stated == kind:
                return kind
        raise FileError(image, f"states the kind {stated!r}; a frame is dark or light")
    kinds = _kinds_named(image.stem) or _kinds_named(subfolder)
    if len(kinds) != 1:
        why = "both dark and light in its name" if kinds else "neither in its file nor in its name"
        raise FileError(image, f"dark or light? It says {why}; say it in a protocol.yaml: {_EXAMPLE}")
    return kinds.pop()


def _kinds_named(name: str) -> set[Kind]:
    return {_KIND_WORDS[word] for word in re.findall("[a-z]+", name.lower()) if word in _KIND_WORDS}


def _open_descriptor(path: Path, expected: Expected) -> FrameSet:
    descriptor = read_descriptor(path)
    if expected.bits is not None and expected.bits != descriptor.bits:
        raise FileError(path, f"says {descriptor.bits} bits, not the {expected.bits} asked for")
    shape = (descriptor.rows, descriptor.cols)
    return frame_set_of_files(descriptor.entries, str(path), Expected(descriptor.bits, expected.cfa, shape))


def _open_protocol(path: Path, expected: Expected) -> FrameSet:
    protocol = read_protocol(path)
    for what, said, asked in (("bits", protocol.bits, expected.bits), ("cfa", protocol.cfa, expected.cfa)):
        if said is not None and asked is not None and said != asked:
            raise FileError(path, f"says {what} {said}, not the {asked} asked for")
    merged = Expected(
        expected.bits if protocol.bits is None else protocol.bits,
        expected.cfa if protocol.cfa is None else protocol.cfa,
        black_level_dn=protocol.black_level_dn,
        sensor=_sensor(path, protocol.sensor),
    )
    return frame_set_of_files(file_entries(protocol, path), str(path), merged)


def _sensor(path: Path, name: str | None) -> Sensor | None:
    if name is None:
        return None
    from photosite.sensor.file import load_sensor

    return load_sensor(path.parent / name)
