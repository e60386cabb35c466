"""Opening a measurement: a folder, a protocol, an EMVA 1288 descriptor or a file of several frames."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, TypedDict, Unpack

from photosite.errors import FileError, InputError
from photosite.files.small_files import check_stored_file
from photosite.frames.conditions import Where, label, parse_where
from photosite.frames.frame_file import FrameFile, SetProperties, split_selection
from photosite.frames.frame_set import FrameSet
from photosite.frames.frame_settings import FrameSettings, Kind, exposure_by_pattern
from photosite.frames.from_files import frame_sets_from_files
from photosite.frames.io.emva_descriptor import looks_like_descriptor, read_descriptor
from photosite.frames.io.format_table import NAMES, frame_stem, is_frame_name
from photosite.frames.io.formats import read_headers, select_headers
from photosite.frames.io.headerless import EXAMPLE as HEADERLESS_EXAMPLE
from photosite.frames.io.headerless import SUFFIXES as HEADERLESS_SUFFIXES
from photosite.frames.io.headerless import guess_text
from photosite.frames.io.protocol import read_protocol
from photosite.frames.io.raspberry_pi import has_raw_data
from photosite.frames.layout import Layout, parse_layout
from photosite.frames.raw_frame import MOST_BITS, check_bits
from photosite.frames.sections import Section, parse_region
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.values.cfa import cfa_from, tile_text
from photosite.values.exposure import check_exposure


def capture_folders(
    path: str | PathLike[str], sensor: Sensor | None = None, names: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return the subfolders with the frames of each capture of one exposure; none for frames of one folder.

    Parameters
    ----------
    path
        Folder of a measurement.
    sensor
        Sensor whose captures are looked for if `names` is empty.
    names
        Subfolders, from the most to the least sensitive capture.

    Raises
    ------
    InputError
        If one of `names` is no subfolder.

    Examples
    --------
    >>> capture_folders(".", load_sensor("dual-gain-phone"))
    ()
    """
    for name in names:
        if not Path(path, name).is_dir():
            raise InputError("captures", value=name, expected=f"a subfolder of {path}")
    if names or sensor is None or sensor.captures is None:
        return tuple(names)
    known = tuple(sensor.captures.names)
    return known if all(Path(path, name).is_dir() for name in known) else ()


PROTOCOL_NAMES = ("protocol.yaml", "protocol.yml")

KindPatterns = Mapping[Kind, tuple[str, ...]]
"""Glob patterns of the dark and of the light frames."""


class FrameArguments(TypedDict, total=False):
    """The fields of `FrameOptions` as keyword arguments."""

    bits: int | None
    cfa: str | Sequence[Sequence[str]] | None
    black_level_dn: float | None
    exposure_s: float | None
    dark: str | Sequence[str]
    light: str | Sequence[str]
    exposure_from_name: str | None
    region: str | None
    where: Where
    together: Collection[str]
    sensor: Sensor | None
    layout: str | None


@dataclass(frozen=True, kw_only=True)
class FrameOptions:
    """How the frames of a measurement are opened.

    Parameters
    ----------
    bits, cfa
        Bit depth of the converter and color filter array (`"rggb"` or its tile), if neither files nor protocol state
        them.
    black_level_dn
        Black level, which the dark frames are compared with. It overrides that of the files.
    exposure_s
        Exposure time of the frames that state none, such as those of a microscope camera at one exposure time.
    dark, light
        Glob patterns (`"DSC_00*.NEF"`, `"run1/*"`) of the dark and the light frames. They override metadata and names,
        and apply to folders and files without a protocol or descriptor.
    exposure_from_name
        Regular expression that finds the exposure time in the name of a file or its subfolder
        (`photosite.frames.frame_settings.exposure_by_pattern`). It overrides metadata, and applies to folders without a
        protocol or descriptor.
    region
        Part of the stored images that receives light, if the files state none or more: `"[1:200,1:160]"`, columns
        then rows counted from 1 as in IRAF, or `"0:160,0:200"`, rows then columns as in NumPy.
    where
        The setting to open, if there are several that differ in read mode, binning, filter or another condition
        (`photosite.frames.conditions`): `"filter=R"`, or `{"filter": "R", "binning": "2x2"}`. `unit` and
        `gain_setting` select frames too.
    together
        Conditions that do not separate settings, such as "set_temperature_c" for a series of temperatures.
    sensor
        The sensor that took the frames, for bits and mosaic that they do not state. Default: that of the protocol.
    layout
        How the pixels of headerless files are stored, such as `"3280x2464,packed=mipi10,stride=4128"`
        (`photosite.frames.layout`). All files of a folder with their suffixes (.raw, .bin, ...) are frames then.

    Examples
    --------
    >>> FrameOptions(dark="bias/*", light="flat/*").patterns
    {'dark': ('bias/*',), 'light': ('flat/*',)}
    """

    bits: int | None = None
    cfa: str | Sequence[Sequence[str]] | None = None
    black_level_dn: float | None = None
    exposure_s: float | None = None
    dark: str | Sequence[str] = ()
    light: str | Sequence[str] = ()
    exposure_from_name: str | None = None
    region: str | None = None
    where: Where = ()
    together: Collection[str] = ()
    sensor: Sensor | None = None
    layout: str | None = None

    @property
    def patterns(self) -> KindPatterns:
        """Glob patterns by kind."""
        return {"dark": _texts(self.dark), "light": _texts(self.light)}

    @property
    def properties(self) -> SetProperties:
        """What is stated of all frames; raise `InputError` if it is invalid."""
        check_bits(self.bits, MOST_BITS)
        black = self.black_level_dn
        if black is not None and not 0 <= black < 1 << (self.bits or MOST_BITS):
            raise InputError("black_level_dn", value=black, expected="0 or above, within the bits of the frames")
        return SetProperties(
            bits=self.bits,
            cfa=None if self.cfa is None else cfa_from(self.cfa),
            black_level_dn=black,
            exposure_s=None if self.exposure_s is None else check_exposure(self.exposure_s),
            sensor=self.sensor,
            region=None if self.region is None else parse_region(self.region),
            layout=None if self.layout is None else parse_layout(self.layout),
        )


def open_frames(path: str | PathLike[str], **options: Unpack[FrameArguments]) -> FrameSet:
    """Open the frames of a measurement, grouped by kind, exposure and gain setting.

    Headers are read here, pixels when they are needed. Settings come from three sources; an earlier one overrides
    the later ones:

    1. the protocol or descriptor, or the patterns `dark` and `light`;
    2. the file's metadata (exposure time, ISO or gain, temperature, kind): Exif and TIFF/EP in camera raw, DNG and
       TIFF, keywords in FITS, attributes in HDF5, and the description in files that photosite wrote;
    3. the names of the file and its subfolder, such as `dark_10ms_iso400.tif` (`photosite.frames.frame_settings`).

    If no source states the kind, frames are classified by their signal level, with a warning. A file of several frames
    (pages of TIFF; datasets, stacks and units of HDF5 and FITS) stands for all of them.

    Parameters
    ----------
    path
        A YAML protocol, an EMVA 1288 descriptor, a folder, or a file of several frames. A protocol.yaml or a single
        descriptor in a folder defines its frames; otherwise all frames in the folder are used. A folder without frames
        is searched one level down, unless a subfolder is a measurement with its own listing.
        A part of a file is named in brackets: `"x.fits[1]"`.
    **options
        Fields of `photosite.frames.open.FrameOptions`: `bits` and `cfa` that files do not state; `black_level_dn`,
        `exposure_s`; patterns `dark` and `light`; `exposure_from_name`; `region` with light; `where`, a selection of
        settings, and `together`; `sensor`; `layout` of headerless files.

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
        kind or exposure is unknown; if there are several settings.

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
    found = open_settings(path, **options)
    if len(found) > 1:
        choice = {"where": label(found[0].conditions)}
        raise FileError(path, f"the frames have {settings_text(found)}", hint="Pass {where}", arguments=choice)
    return found[0]


def settings_text(settings: Sequence[FrameSet]) -> str:
    """Return the settings of frames in words, with the number of frames of each."""
    counts = [(label(each.conditions), each.frame_count) for each in settings[:_MOST_SETTINGS]]
    names = "; ".join(f"{name} ({count} frame{'s' * (count > 1)})" for name, count in counts)
    more = f"; {len(settings) - _MOST_SETTINGS} more" if len(settings) > _MOST_SETTINGS else ""
    return f"{len(settings)} settings: {names}{more}"


_MOST_SETTINGS = 8


def open_settings(path: str | PathLike[str], **options: Unpack[FrameArguments]) -> list[FrameSet]:
    """Open the frames of a measurement of one or several settings, a frame set each.

    Settings differ in a condition of `photosite.frames.conditions`: camera, read mode, binning, filter, part of a file,
    ... Frames of different ones are never in one set. Gain settings are not separated: they are a series.

    Parameters
    ----------
    path, **options
        As for `open_frames`; `where` may leave several settings.

    Returns
    -------
    list of FrameSet
        `FrameSet.conditions` has the conditions by which each differs from the others.

    Raises
    ------
    InputError, FileError
        As for `open_frames`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from photosite.frames.raw_frame import RawFrame
    >>> dn = np.full((2, 3), 64, np.uint16)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for mode in ("fast", "slow"):
    ...         RawFrame(dn, 12, exposure_s=1.0, metadata={"read_mode": mode}).save(f"{folder}/dark_{mode}.png")
    ...     settings = open_settings(folder)
    >>> [dict(each.conditions) for each in settings]
    [{'read_mode': 'fast'}, {'read_mode': 'slow'}]
    """
    chosen = FrameOptions(**options)
    given, patterns = chosen.properties, chosen.patterns
    choice = parse_where(chosen.where), chosen.together
    name, selection = split_selection(os.fspath(path))
    place = Path(name)
    if not os.path.exists(place):  # which is False, too, for a name that the system refuses
        raise FileError(place, "there is no such file or folder")
    if not place.is_dir():
        check_stored_file(place)
    listing = _find_listing(place) if place.is_dir() else place
    if listing is None:
        files = _frame_files_in_folder(place, patterns, chosen.exposure_from_name, given.layout is not None)
        return frame_sets_from_files(files, str(place), given, *choice)
    if chosen.exposure_from_name is not None:
        what = "exposure_from_name applies to folders without a protocol or descriptor"
        raise InputError(what, hint=f"Omit it: {listing} states the exposure times")
    if listing is place and _is_frame(place, given.layout is not None):
        return frame_sets_from_files([_stack(place, patterns, selection, given.layout)], str(path), given, *choice)
    if any(patterns.values()):
        raise InputError("patterns for dark and light frames apply to folders only", hint=f"{listing} states the kinds")
    if listing.suffix.lower() in (".yaml", ".yml"):
        protocol = read_protocol(listing)
        sensor = given.sensor
        if sensor is None and protocol.sensor is not None:
            sensor = load_sensor(listing.parent / protocol.sensor)
        stated = SetProperties(
            protocol.bits,
            protocol.cfa,
            black_level_dn=protocol.black_level_dn,
            sensor=sensor,
            region=protocol.region,
            layout=protocol.layout,
        )
        files, kind = protocol.frame_files(listing), "protocol"
    elif looks_like_descriptor(listing):
        (files, stated), kind = read_descriptor(listing), "descriptor"
        stated = replace(stated, sensor=given.sensor)
    else:
        hint = "A descriptor's first command is 'v' or 'n'"
        raise FileError(place, "the file is neither a YAML protocol nor an EMVA 1288 descriptor", hint=hint)
    return frame_sets_from_files(files, str(listing), _agreed(listing, stated, given, kind), *choice)


def _texts(patterns: str | Sequence[str]) -> tuple[str, ...]:
    return (patterns,) if isinstance(patterns, str) else tuple(patterns)


def _stack(file: Path, patterns: KindPatterns, selection: str | None, layout: Layout | None) -> FrameFile:
    headers = read_headers(file, layout)
    if len(select_headers(file, headers, selection)) == 1:
        if len(headers) > 1:
            what = f"the selection is one frame of {len(headers)}"
            raise FileError(f"{file}[{selection}]", what, hint=f"Omit [{selection}] for all of them")
        hint = "A measurement is a folder, an EMVA 1288 descriptor or a YAML protocol"
        raise FileError(file, "the file holds a single frame", hint=hint)
    settings = FrameSettings(kind=_kind_by_pattern(file, patterns))
    return FrameFile(file, settings, names=(frame_stem(file),), selection=selection)


def _agreed(path: Path, stated: SetProperties, given: SetProperties, what: str) -> SetProperties:
    """Return what a listing states, completed by what the caller states; the two must not contradict each other."""
    for name in ("bits", "cfa", "black_level_dn", "exposure_s", "region", "layout"):
        from_listing, from_caller = getattr(stated, name), getattr(given, name)
        if from_listing is None:
            stated = replace(stated, **{name: from_caller})
        elif from_caller is not None and from_caller != from_listing:
            raise FileError(
                path, name, value=_shown(from_caller), expected=f"{_shown(from_listing)}, as the {what} states"
            )
    return stated


def _shown(value: Any) -> Any:
    return (
        value
        if isinstance(value, int | float)
        else str(value)
        if isinstance(value, Section | Layout)
        else tile_text(value)
    )


def _find_listing(folder: Path) -> Path | None:
    """Return the protocol or descriptor of a folder, or None."""
    files = _files(folder)
    for name in PROTOCOL_NAMES:
        if folder / name in files:
            return folder / name
    descriptors = [file for file in files if _is_descriptor(file)]
    if len(descriptors) > 1:
        names = ", ".join(p.name for p in descriptors[:3])
        raise FileError(folder, f"the folder has {len(descriptors)} descriptors ({names})", hint="Open one of them")
    return descriptors[0] if descriptors else None


def _frame_files_in_folder(
    folder: Path, patterns: KindPatterns, times: str | None, headerless: bool
) -> list[FrameFile]:
    """List the frames in a folder, or in its subfolders if it has none itself."""
    images = [p for p in _files(folder) if _is_frame(p, headerless)]
    names: dict[Path, tuple[str, ...]] = {image: (frame_stem(image),) for image in images} or {
        image: (frame_stem(image), image.parent.name) for image in _images_in_subfolders(folder, headerless)
    }
    for pattern in (pattern for texts in patterns.values() for pattern in texts):
        if not any(image.match(pattern) for image in names):
            example = next(iter(names)).name
            raise FileError(folder, "pattern", value=pattern, expected=f"one that matches a frame, such as {example}")

    def settings(image: Path, texts: tuple[str, ...]) -> FrameSettings:
        exposure_s = None if times is None else exposure_by_pattern(image, (image.name, *texts[1:]), times)
        return FrameSettings(_kind_by_pattern(image, patterns), exposure_s)

    return [FrameFile(image, settings(image, texts), names=texts) for image, texts in names.items()]


def _kind_by_pattern(image: Path, patterns: KindPatterns) -> Kind | None:
    """Return the kind whose patterns match a file, or None."""
    matching = [(kind, pattern) for kind, texts in patterns.items() for pattern in texts if image.match(pattern)]
    if len({kind for kind, _ in matching}) > 1:
        both = " and ".join(repr(pattern) for _, pattern in matching)
        raise FileError(image, f"dark and light patterns match the file: {both}", hint="Make the patterns narrower")
    return matching[0][0] if matching else None


def _files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))


def _is_frame(path: Path, headerless: bool) -> bool:
    """Return whether a file of a folder is taken for a frame; of JPEG files, those with raw data are."""
    suffix = path.suffix.lower()
    if headerless:
        return suffix in HEADERLESS_SUFFIXES
    return is_frame_name(path) or (suffix in (".jpg", ".jpeg") and has_raw_data(path))


def _images_in_subfolders(folder: Path, headerless: bool) -> list[Path]:
    subfolders = sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))
    files = [file for subfolder in subfolders for file in _files(subfolder)]
    listings = [p for p in files if p.name in PROTOCOL_NAMES or _is_descriptor(p)]
    images = [p for p in files if _is_frame(p, headerless)]
    if images and not listings:
        return images
    problem = f"the folder has no frames ({NAMES}), no protocol.yaml and no EMVA 1288 descriptor"
    if listings:
        hint = f"Its subfolder {listings[0].parent.name} is a separate measurement: open that"
        raise FileError(folder, problem, hint=hint)
    unknown = next((p for p in (*_files(folder), *files) if p.suffix.lower() in HEADERLESS_SUFFIXES), None)
    if unknown is not None:
        guess = guess_text(unknown)
        what = f"{problem}; {unknown.name} can be headerless{f', of the layout {guess}' if guess else ''}"
        layout = guess.split(" or ")[0] or HEADERLESS_EXAMPLE
        hint = "Pass {layout}" if guess else "Pass its columns, rows and numbers: {layout}"
        raise FileError(folder, what, hint=hint, arguments={"layout": layout})
    if subfolders:
        problem += f"; its subfolders ({', '.join(p.name for p in subfolders)}) have none either"
    raise FileError(folder, problem)


def _is_descriptor(file: Path) -> bool:
    return file.suffix.lower() == ".txt" and looks_like_descriptor(file)
