"""Frame sets opened: from a folder, an EMVA 1288 descriptor or a YAML protocol."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from photosite.errors import FileError, InputError
from photosite.frames.frame_set import FrameSet, Kind
from photosite.frames.io.emva import looks_like_descriptor, read_descriptor
from photosite.frames.io.protocol import file_entries, read_protocol
from photosite.frames.io.read import FORMATS, SUFFIXES, read_headers
from photosite.frames.listing import Expected, FileEntry, frame_set_of_files
from photosite.sensor.model import Sensor
from photosite.values.cfa import cfa_from

PROTOCOL_NAMES = ("protocol.yaml", "protocol.yml")


def open_frames(
    path: str | PathLike[str],
    *,
    bits: int | None = None,
    cfa: str | Sequence[Sequence[str]] | None = None,
    dark: str | Sequence[str] = (),
    light: str | Sequence[str] = (),
) -> FrameSet:
    """The frames of a measurement, grouped by kind, exposure and gain setting, read when asked for.

    Each setting is told by the first that speaks of it: a protocol or descriptor; the file's metadata (exposure, ISO or
    gain, temperature, kind: Exif and TIFF/EP in camera raw, DNG and TIFF, keywords in FITS, attributes in HDF5,
    photosite's own description); the names of a file and of the subfolder it is in:

    - dark, darks, bias, `d_012`: a dark frame; light, lights, flat, flats, bright, `b_012`: a light one;
    - `10ms`, `0.04s`, `250us`, `1-8000s` (1/8000 s): the exposure time;
    - `iso400`, `gain_2.5`: the gain setting; `_-10C`: the temperature.

    Where none of them says dark or light, the frames are read and told by their level, and a warning says so. A file of
    several frames (pages of TIFF; datasets, stacks and units of HDF5 and FITS) stands for all of them; they are read
    one by one.

    Parameters
    ----------
    path
        A YAML protocol, an EMVA 1288 descriptor, a folder, or a file of several frames. A folder that holds a
        protocol.yaml or one descriptor stands for it; in any other, all frames are taken. A folder that holds none
        itself is searched one level down, as long as no subfolder is a measurement of its own.
    bits
        Bits of the converter, where neither the files nor the protocol say.
    cfa
        The colour filter array (`"rggb"` or its tile), where neither the files nor the protocol say.
    dark, light
        Patterns (`"DSC_00*.NEF"`, `"run1/*"`) of the files that are dark and light frames, whatever else says so; for
        folders and files without a protocol or descriptor.

    Returns
    -------
    FrameSet
        All files are known to be there, whole as far as their headers tell, and alike. No pixels were read, but of
        one frame of camera raw, or of DNG with masked areas, and where level has to tell dark from light.

    Raises
    ------
    InputError
        If bits or cfa cannot be, or patterns are given where a protocol or descriptor speaks.
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
    patterns: _Patterns = {"dark": _texts(dark), "light": _texts(light)}
    place = Path(path)
    if not place.exists():
        raise FileError(place, "there is no such file or folder")
    listed = _listing_in(place) if place.is_dir() else place
    if listed is None:
        return frame_set_of_files(_entries_of_folder(place, patterns), str(place), expected)
    if listed is place and place.suffix.lower() in SUFFIXES:
        return frame_set_of_files([_entry_of_stack(place, patterns)], str(place), expected)
    if any(patterns.values()):
        raise InputError(f"dark and light patterns are for folders; {listed} says itself what its frames are")
    if listed.suffix.lower() in (".yaml", ".yml"):
        return _open_protocol(listed, expected)
    if looks_like_descriptor(listed):
        return _open_descriptor(listed, expected)
    raise FileError(place, "is no EMVA 1288 descriptor, whose first command is 'v' or 'n', and no YAML protocol")


_Patterns = dict[Kind, tuple[str, ...]]


def _texts(patterns: str | Sequence[str]) -> tuple[str, ...]:
    return (patterns,) if isinstance(patterns, str) else tuple(patterns)


def _listing_in(folder: Path) -> Path | None:
    """The protocol or descriptor that stands for a folder, or None."""
    files = _files(folder)
    for name in PROTOCOL_NAMES:
        if folder / name in files:
            return folder / name
    descriptors = [p for p in files if p.suffix.lower() == ".txt" and looks_like_descriptor(p)]
    if len(descriptors) > 1:
        raise FileError(folder, f"holds {len(descriptors)} descriptors, {descriptors[0].name} and others; name one")
    return descriptors[0] if descriptors else None


def _entries_of_folder(folder: Path, patterns: _Patterns) -> list[FileEntry]:
    images = _images(_files(folder))
    names: dict[Path, tuple[str, ...]] = {image: (image.stem,) for image in images}
    if not names:
        names = {image: (image.stem, image.parent.name) for image in _images_one_level_down(folder)}
    matched = {pattern: False for texts in patterns.values() for pattern in texts}
    entries = [
        FileEntry(image, _kind_by_pattern(image, patterns, matched), None, names=said) for image, said in names.items()
    ]
    for pattern, used in matched.items():
        if not used:
            raise FileError(folder, f"no frame matches the pattern '{pattern}'; there is {entries[0].path.name}, say")
    return entries


def _kind_by_pattern(image: Path, patterns: _Patterns, matched: dict[str, bool]) -> Kind | None:
    fitting = [(kind, pattern) for kind, texts in patterns.items() for pattern in texts if image.match(pattern)]
    for _, pattern in fitting:
        matched[pattern] = True
    kinds = {kind for kind, _ in fitting}
    if len(kinds) > 1:
        raise FileError(image, f"matches dark and light patterns, {' and '.join(repr(p) for _, p in fitting)}")
    return kinds.pop() if kinds else None


def _entry_of_stack(file: Path, patterns: _Patterns) -> FileEntry:
    if len(read_headers(file)) == 1:
        raise FileError(file, "is one frame; a measurement is a folder, an EMVA 1288 descriptor or a YAML protocol")
    matched = {pattern: False for texts in patterns.values() for pattern in texts}
    return FileEntry(file, _kind_by_pattern(file, patterns, matched), None, names=(file.stem,))


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
    why = f"holds no frames ({FORMATS}), no protocol.yaml and no EMVA 1288 descriptor"
    if own:
        why += f"; its subfolder {own[0].parent.name} is a measurement of its own: name that"
    elif below:
        why += f", and its subfolders ({', '.join(place.name for place in below)}) hold no frames either"
    raise FileError(folder, why)


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
    from photosite.sensor.io.sensor_file import load_sensor

    return load_sensor(path.parent / name)
