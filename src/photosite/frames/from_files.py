"""From listed files to a frame set: complete the settings, check that the frames agree, and group them."""

from __future__ import annotations

import difflib
import math
import os
import re
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Never, TypeVar

import numpy as np
from numpy.typing import NDArray

from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.files.small_files import file_stamp
from photosite.frames.conditions import label, selected, separated
from photosite.frames.covered_lines import level_change, shifted_down
from photosite.frames.frame_file import (
    WHICH_SENSOR,
    FrameFile,
    FrameHeader,
    FrameLocation,
    OwnOutputError,
    SetProperties,
    bits_from,
    check_sensor,
    of_bits,
)
from photosite.frames.frame_set import (
    STEADY_TEMPERATURE_C,
    TEMPERATURE_VARIED,
    FrameSet,
    FrameSource,
    group_frames,
    without_border,
)
from photosite.frames.frame_settings import FrameSettings, Kind, settings_from_names
from photosite.frames.io.format_table import Format, frame_stem
from photosite.frames.io.formats import (
    detect_format,
    open_stored_rows,
    overscan_levels,
    read_bordered,
    read_frame,
    read_headers,
    read_leveled,
    read_numbers,
    read_pixels,
    read_whole,
    select_headers,
)
from photosite.frames.io.headerless import LAYOUT
from photosite.frames.raw_frame import MASKED_BORDER, Numbers, RawFrame, masked_border_note, stated_border
from photosite.frames.sections import lines_around
from photosite.frames.stored_numbers import (
    MOST_BELOW_ZERO,
    Conversion,
    NumberKind,
    NumberRange,
    StoredNumbers,
    as_signed,
    conversion_diagnostics,
    conversion_of,
    falls_below_zero,
    joined,
)
from photosite.frames.stored_rows import StoredRows
from photosite.values.cfa import MONOCHROME, Cfa, tile_text
from photosite.values.diagnostic import Diagnostic, DiagnosticKind

Value = TypeVar("Value", bound=object)

EXPOSURE_HINT = (
    "Pass {exposure_s} if it is one for all, or write a protocol.yaml: 'photosite_protocol: 1', then 'frames:' with "
    "'- {{kind: dark, exposure: 1/100, files: dark*.png}}' and so on"
)

_NUMBER_AT_END = re.compile(r"[-_ .]*(?:#|n|no|frame|img)?[-_ .]*\d+$", re.IGNORECASE)

_SAME_EXPOSURE = 1.2
"""Ratio of listed to stated exposure up to which they count as the same."""


@dataclass(frozen=True)
class _OpenedFrame:
    """A frame whose header was read; all its settings but the kind are known."""

    file: FrameFile
    header: FrameHeader
    stamp: tuple[int, ...] | None  # `file_stamp` before the header was read
    format: Format | None  # None for a headerless file
    conditions: Mapping[str, str] = field(default_factory=dict)
    kept: _KeptNumbers = field(default_factory=lambda: _KeptNumbers())

    @property
    def settings(self) -> FrameSettings:
        return self.file.settings

    @property
    def unit(self) -> str:
        return self.header.names[0]


class _KeptNumbers:
    """Numbers of a frame that were read when it was opened, for its first read; they stay with the process."""

    def __init__(self) -> None:
        self._stored: list[StoredNumbers] = []

    def keep(self, stored: StoredNumbers) -> None:
        """Keep the numbers, unless they are many."""
        if stored.size <= _MOST_KEPT_PIXELS:
            self._stored[:] = [stored]

    def taken(self) -> StoredNumbers | None:
        """Return the numbers, once."""
        try:
            return self._stored.pop()
        except IndexError:
            return None

    def __reduce__(self) -> tuple[type[_KeptNumbers], tuple[()]]:
        return _KeptNumbers, ()


_MOST_KEPT_PIXELS = 1 << 25
"""Pixels of a frame that is kept for its first read."""


KIND_BY_LEVEL = DiagnosticKind(
    "kind-by-level",
    "warning",
    "Neither files nor names state the kind of the frames; they were classified as dark or light by their level.",
    "All results are wrong if the classification is.",
    "Name the files after their kind, pass the patterns of dark and of light frames, or write a protocol.",
)
OTHER_EXPOSURE = DiagnosticKind(
    "other-exposure-stated",
    "warning",
    "Files state another exposure time than the one listed for them, which is used.",
    "Dark current and responsivity are wrong by the ratio of the two times if the listed one is wrong.",
    "Check the unit of the listed exposure times.",
    ("dark_current*", "dark_voltage*", "responsivity*", "quantum_efficiency*"),
)
OTHER_ORIENTATION = DiagnosticKind(
    "other-orientation",
    "note",
    "Some files state another orientation than the others.",
    "Pixels are read as they are stored, which is the order of the sensor in files of cameras. If a program turned "
    "some frames, DSNU and PRNU contain other pixels; frames whose pattern shows it are left out (turned-frame).",
    "Use the files as the camera wrote them.",
    ("dsnu*", "prnu*"),
    "number of files",
)
LIT_BORDER = DiagnosticKind(
    "black-level-of-border",
    "warning",
    "The masked border around a frame and its stated black level, or its image, do not agree.",
    "The stated black level may be wrong.",
    "Take dark frames: a calibration measures the black level from them.",
    ("black_level_dn",),
)
OWN_OUTPUTS = DiagnosticKind(
    "own-outputs-skipped",
    "note",
    "The folder has outputs of photosite, such as maps and pictures.",
    "They are skipped.",
    "None. Outputs in another folder are not listed.",
    size="number of files",
    false_alarms="none: the files state it",
)
SKY_FRAMES = DiagnosticKind(
    "pictures-left-out",
    "note",
    "Frames of type LIGHT or OBJECT are beside frames of type FLAT: in astronomy, pictures of the sky.",
    "They are left out of the calibration.",
    "List them as light frames in a protocol, or with --light, if they are flat fields.",
    size="number of frames",
)
ASSUMED_BITS = DiagnosticKind(
    "assumed-bit-depth",
    "warning",
    "The bit depth of the converter is not stated; that of the files is assumed.",
    "The saturation and all that follows from it are wrong if the converter has fewer bits.",
    "State the bits in a protocol or with --bits.",
    ("saturation_*", "dynamic_range*"),
)


OVERSCAN = DiagnosticKind(
    "overscan-levels",
    "note",
    "The files state overscan, the level of which follows the black level of each frame.",
    "Frames are shifted by whole numbers to the level of the first dark frame, each amplifier by itself: drifts of the "
    "black level do not count as light or dark current. A drift below half a number stays.",
    "None. `black-level-shifts` states what is left.",
    size="largest shift of the frames that were compared, DN",
    false_alarms="none: the files state it",
)
MASKED_LEVELS = DiagnosticKind(
    "masked-border-levels",
    "note",
    "The files have a masked border, the level of which follows the black level of each frame.",
    "Frames are shifted by whole numbers to the level of the first dark frame of their exposure time, where the border "
    "shows a change: drifts of the black level do not count as light. Frames of other exposure times are not compared, "
    "because covered pixels have dark current.",
    "None. `black-level-shifts` states what is left.",
    false_alarms="none: the files state it; padding of camera raw is used if flat fields do not brighten it",
)


def frame_sets_from_files(
    files: Sequence[FrameFile],
    source: str,
    properties: SetProperties,
    where: Mapping[str, str] | None = None,
    together: Collection[str] = (),
) -> list[FrameSet]:
    """Return the frame set of each setting of listed files.

    Headers are read here; pixels only of one frame whose properties the header does not state, and for classification.

    Parameters
    ----------
    files
        The listed files.
    source
        What was opened, for messages and the frame set.
    properties
        Properties that the listing or the caller states.
    where
        Selection of frames by their conditions.
    together
        Conditions that do not separate settings.
    """
    _check_existing(files)
    _check_unique(files)
    opened, skipped = _open_all(files, properties)
    opened, pictures = _without_pictures(opened, {file.path for file in files if file.settings.kind is not None})
    skipped += pictures
    frames = selected(opened, where or {})
    settings = []
    for found, same in separated(frames, together):
        one = _frame_set(same, f"{source} ({label(found)})" if found else source, properties)
        settings.append(replace(one, conditions=found, diagnostics=(*one.diagnostics, *skipped)))
    return settings


def _open_all(files: Sequence[FrameFile], stated: SetProperties) -> tuple[list[_OpenedFrame], tuple[Diagnostic, ...]]:
    """Open the files; in a folder, outputs of photosite are skipped, and named in a diagnostic."""
    opened: list[_OpenedFrame] = []
    skipped: list[OwnOutputError] = []
    for file in files:
        try:
            opened += _open(file, stated)
        except OwnOutputError as error:
            if file.listed_in is not None or not file.names:
                raise
            skipped.append(error)
    if not opened and skipped:
        raise skipped[0]
    if not skipped:
        return opened, ()
    names = ", ".join(f"{Path(error.path).name} ({error.kind})" for error in skipped[:_MOST_NAMED])
    more = f" and {len(skipped) - _MOST_NAMED} more" if len(skipped) > _MOST_NAMED else ""
    return opened, (OWN_OUTPUTS(f"skipped {names}{more}, which photosite wrote", float(len(skipped))),)


_MOST_NAMED = 6


def _without_pictures(
    frames: list[_OpenedFrame], known: Collection[Path]
) -> tuple[list[_OpenedFrame], tuple[Diagnostic, ...]]:
    """Leave out frames of type LIGHT or OBJECT beside those of type FLAT: astronomers' pictures of the sky.

    Files whose kind a listing or the caller states, `known`, stay.
    """

    def words(frame: _OpenedFrame) -> set[str]:
        stated = frame.header.metadata.get("image_type") or " ".join(frame.file.names)
        return set(re.findall("[a-z]+", str(stated).lower())) if frame.file.path not in known else set()

    every = [words(frame) for frame in frames]
    is_flat = [
        frame.settings.kind == "light" and any("flat" in word for word in own)
        for frame, own in zip(frames, every, strict=True)
    ]
    is_picture = [
        frame.settings.kind != "dark" and not flat and not own.isdisjoint(_PICTURES)
        for frame, own, flat in zip(frames, every, is_flat, strict=True)
    ]
    if not (any(is_flat) and any(is_picture)):
        return frames, ()
    first = next(frame.file.path for frame, picture in zip(frames, is_picture, strict=True) if picture)
    text = f"{sum(is_picture)} frames of type LIGHT or OBJECT beside flat fields, such as {first.name}, are left out"
    kept = [frame for frame, picture in zip(frames, is_picture, strict=True) if not picture]
    return kept, (SKY_FRAMES(text, float(sum(is_picture))),)


_PICTURES = {"light", "lights", "object", "science", "expose"}


def _frame_set(frames: list[_OpenedFrame], source: str, properties: SetProperties) -> FrameSet:
    if properties.region is None:
        for frame in frames:
            frame.header.check_sections(frame.file.path)
    frames, border_warnings = _complete_headers(frames)
    _warn_of_header_notes(frames)
    shape = _common("size", frames, [(f.header.rows, f.header.cols) for f in frames], properties.shape)
    stated_bits = _stated_bits(frames, properties)
    bits = _bits(frames, properties, stated_bits)
    conversion, numbers = _conversion(frames, stated_bits) or (None, None)
    if conversion is not None and numbers is not None:
        bits = conversion.bits(bits, numbers) or bits
    cfas = [f.header.resolve_cfa(f.file.path, properties.cfa) for f in frames]
    cfa = _common("color filter array", frames, cfas, None)
    if properties.sensor is not None:
        cfa = cfa or properties.sensor.array.cfa
        stated = tuple(any(getattr(f.header, name) is not None for f in frames) for name in ("bits", "cfa"))
        check_sensor(source, properties.sensor, bits, cfa, stated=(stated[0], stated[1]))
    levels, leveled = _overscan(frames)
    references, followed = _references(frames)
    given = properties.bits is not None or any(f.header.bits is not None for f in frames)
    bits_of = None if given or properties.sensor is None else properties.sensor.name
    beside = _common("border without light", frames, [f.header.border for f in frames], None)
    sources = [
        FrameSource(
            f.file.name,
            _FrameReading(
                f.file.path,
                f.file.location,
                bits,
                cfa,
                shape,
                f.header,
                f.format,
                f.stamp,
                conversion,
                levels,
                one,
                f.kept,
                bits_of,
            ),
            True,
            path=f.file.path,
            whole=partial(_read_whole, f.file, conversion) if beside else None,
        )
        for f, one in zip(frames, references, strict=True)
    ]
    listed = zip(sources, [f.file.settings for f in frames], strict=True)
    settings, level_warning = classify_by_level(list(listed), bits)
    try:
        groups = group_frames(zip(sources, settings, strict=True))
    except InputError as error:
        raise error.in_file(source) from None
    found = [(KIND_BY_LEVEL, level_warning), (OTHER_EXPOSURE, _exposure_warning(frames))]
    found += [(TEMPERATURE_VARIED, _temperature_warning(settings)), *((LIT_BORDER, each) for each in border_warnings)]
    diagnostics = (*_warned(found, source), *_other_orientations(frames), *_assumed_bits(frames, properties))
    diagnostics += (*leveled, *followed)
    if conversion is not None and numbers is not None:
        diagnostics += conversion_diagnostics(conversion, numbers, stated_bits)
    stated_black = _shared([f.header.black_level_dn for f in frames])
    if stated_black is not None and conversion is not None:
        stated_black += conversion.added
    opened = FrameSet(
        groups,
        *shape,
        bits,
        cfa or MONOCHROME,
        source,
        sensor=properties.sensor,
        black_level_dn=stated_black if properties.black_level_dn is None else properties.black_level_dn,
        diagnostics=diagnostics,
        white_level_dn=_shared([f.header.white_level_dn for f in frames]),
        border=beside,
        amplifiers=_shared([f.header.amplifiers for f in frames]) or (),
    )
    if properties.region is not None:
        return without_border(opened, lines_around(properties.region, shape, beside, source))
    part = _shared([stated_border(f.header.metadata) for f in frames])
    return opened if part is None else without_border(opened, part)


def _warned(found: Iterable[tuple[DiagnosticKind, PhotositeWarning | None]], source: str) -> list[Diagnostic]:
    """Issue warnings, and return their diagnostics."""
    diagnostics = []
    for kind, warning in found:
        if warning is not None:
            # A hint with arguments is spelled as the interface writes them; the remedy of the kind says the same.
            diagnostics.append(kind(warning.what if warning.arguments else str(warning)))
            warning.where = source
            warnings.warn(warning, stacklevel=7)
    return diagnostics


def _check_existing(files: Sequence[FrameFile]) -> None:
    # os.path returns False for names that are invalid; pathlib raises.
    missing = [file for file in files if not os.path.isfile(file.path)]
    if not missing:
        return
    first = missing[0]
    folder = first.path.parent
    hint = None
    if not os.path.isdir(folder):
        problem = f"there is no folder {folder}"
    elif os.path.isdir(first.path):
        problem = "the path is a folder, not a frame"
    else:
        problem = "there is no such file"
        names = [p.name for p in folder.iterdir()]
        similar = [name for name in names if name.lower() == first.path.name.lower()]
        similar = similar or difflib.get_close_matches(first.path.name, names, n=1, cutoff=0.8)
        hint = f"There is a file '{similar[0]}'" if similar else None
    if len(missing) > 1:
        problem += f", and {len(missing) - 1} more of {len(files)} are missing"
    raise first.error(problem, hint=hint)


def _check_unique(files: Sequence[FrameFile]) -> None:
    """Reject repeated files: a frame counted twice makes noise look smaller than it is."""
    seen: dict[tuple[Path, str | None], FrameFile] = {}
    for file in files:
        before = seen.setdefault((file.path.resolve(), file.selection), file)
        if before is not file:
            place = f"line {before.line}" if before.line is not None else str(before.path)
            raise file.error(f"the frame is listed twice, first at {place}", hint="Remove one: it would hide noise")


def _open(file: FrameFile, stated: SetProperties) -> Iterator[_OpenedFrame]:
    """Yield each frame of a file, with settings from its listing, else its metadata, else its names."""
    stamp, layout = file_stamp(file.path), stated.layout
    format = None if layout is not None else detect_format(file.path)
    headers = read_headers(file.path, layout) if format is None else format.load().read_headers(file.path)
    for header in select_headers(file.path, headers, file.selection):
        frame = replace(file, location=header.location)
        if file.names:
            settings = file.settings.or_else(header.settings)
            part = header.location.part if header.location else ""
            parts = part.split("/")[::-1] if isinstance(part, str) and layout is None else []
            settings = settings.or_else(settings_from_names(Path(frame.name), (*parts, *file.names), settings))
        else:
            settings = file.settings.or_else(replace(header.settings, photons_per_pixel=None))
        if settings.exposure_s is None and stated.exposure_s is not None:
            settings = replace(settings, exposure_s=stated.exposure_s)
        if settings.exposure_s is None:
            sources = "file and name do" if file.names else "file does"
            what, arguments = f"the {sources} not state the exposure time", {"exposure_s": 0.02}
            raise frame.error(what, hint=EXPOSURE_HINT, arguments=arguments)
        try:
            settings = replace(settings, level=_level_name(file, header)).validated()
        except InputError as error:
            raise frame.error(error.what, value=error.value, expected=error.expected) from None
        conditions = {**header.conditions, **file.conditions}
        yield _OpenedFrame(replace(frame, settings=settings), header, stamp, format, conditions)


def _level_name(file: FrameFile, header: FrameHeader) -> str:
    """Return what tells the file's light level from others: its entry, else its folder and its name without a number.

    Every file that holds several frames is a level.
    """
    if file.line is not None:
        return f"line {file.line}"
    part = header.location.part if header.location else ""
    if header.location is not None:
        return f"{file.path}{part if isinstance(part, str) else ''}"
    return f"{file.path.parent}/{_NUMBER_AT_END.sub('', frame_stem(file.path))}"


def _complete_headers(frames: list[_OpenedFrame]) -> tuple[list[_OpenedFrame], list[PhotositeWarning]]:
    """Add what only decoding shows: bits and mosaic of camera raw, black level of a masked border.

    One frame, the first dark one if there is one, is decoded for all. When the other frames are read, their bits and
    mosaic are checked.
    """
    unknown = [n for n, f in enumerate(frames) if f.header.stored_bits is None and f.header.bits is None]
    masked = [n for n, f in enumerate(frames) if f.header.masked_border]
    if not unknown and not masked:
        return frames, []
    one = next((n for n in unknown or masked if frames[n].file.settings.kind == "dark"), (unknown or masked)[0])
    decoded, notes = read_frame(frames[one].file.path)
    complete = list(frames)
    shown = {name: getattr(decoded, name) for name in ("bits", "cfa", "black_level_dn", "white_level_dn")}
    covered = len(unknown) == len(frames) and _is_covered(frames, one, decoded)
    for n in unknown:
        header = replace(frames[n].header, notes=notes, masked_border=covered, **shown)
        complete[n] = replace(frames[n], header=header)
    for n in masked:
        if frames[n].header.black_level_dn is None:
            header = replace(frames[n].header, black_level_dn=decoded.black_level_dn)
            complete[n] = replace(frames[n], header=header)
    # Pixels outside the visible area of camera raw need not be masked; in a dark frame that does not matter.
    compare = not unknown or frames[one].file.settings.kind == "dark"
    border = masked_border_note(decoded) if compare else ()
    return complete, [PhotositeWarning(f"{frames[one].file.name}: {note}") for note in border]


_BRIGHTER_BORDER = 1e-3
"""Change of the level of a border, relative to that of the frame in light, from which the border is not covered."""


def _is_covered(frames: Sequence[_OpenedFrame], number: int, dark: RawFrame) -> bool:
    """Return whether the lines beside the visible area of camera raw stay dark in the flat field of the longest time.

    Cameras do not state whether they are masked.
    """
    lit = [frame for frame in frames if frame.settings.kind == "light"]
    if frames[number].settings.kind != "dark" or not lit or MASKED_BORDER not in dark.metadata:
        return False
    bright = read_frame(max(lit, key=lambda frame: frame.settings.exposure_s or 0.0).file.path)[0]
    signal = float(bright.dn.mean()) - float(dark.dn.mean())
    change = bright.metadata.get(MASKED_BORDER, math.inf) - dark.metadata[MASKED_BORDER]
    return bool(abs(change) < _BRIGHTER_BORDER * signal)


def _warn_of_header_notes(frames: Sequence[_OpenedFrame]) -> None:
    noted = [frame for frame in frames if frame.header.notes]
    if noted:
        others = f" (and {len(noted) - 1} more frames)" if len(noted) > 1 else ""
        problem = f"{'; '.join(noted[0].header.notes)}{others}"
        warnings.warn(PhotositeWarning(problem, where=noted[0].file.name), stacklevel=7)


def _common(what: str, frames: Sequence[_OpenedFrame], values: Sequence[Value], stated: Value | None) -> Value:
    """Return the value that all frames share."""
    for frame, value in zip(frames, values, strict=True):
        if stated is not None and value != stated:
            raise frame.file.error(f"the {what} is {_text(value)}, but {_text(stated)} is stated for the set")
        if value != values[0]:
            first = f"{frames[0].file.name} has {_text(values[0])}"
            raise frame.file.error(f"the {what} is {_text(value)}, but {first}", hint="Frames of a set must agree")
    return values[0]


def _text(value: Any) -> str:
    match value:
        case None:
            return "not stated"
        case (int(), int()):
            return f"{value[0]} x {value[1]}"
        case (int(), int(), int(), int()):
            return "{} rows at top, {} at bottom, {} columns at left, {} at right".format(*value)
        case (tuple(), *_):
            return tile_text(value)
    return str(value)


def _bits(frames: Sequence[_OpenedFrame], properties: SetProperties, stated: int | None) -> int:
    stored = frames[0].header.stored_bits
    if properties.bits is None and properties.sensor is not None and stated is not None and stated > (stored or stated):
        what = f"the files store {stored} bits, but the sensor '{properties.sensor.name}' has {stated}"
        raise frames[0].file.error(what, hint=WHICH_SENSOR)
    return _common("bit depth", frames, [f.header.resolve_bits(f.file.path, stated) for f in frames], None)


def _other_orientations(frames: Sequence[_OpenedFrame]) -> tuple[Diagnostic, ...]:
    """Return a diagnostic if files state different orientations."""
    found = [frame.header.metadata.get("orientation") for frame in frames]
    stated = [value if isinstance(value, int) else 1 for value in found]
    usual = max(set(stated), key=stated.count)
    others = [(frame.file.name, turned) for frame, turned in zip(frames, stated, strict=True) if turned != usual]
    if not others:
        return ()
    (name, turned), count = others[0], len(others)
    return (
        OTHER_ORIENTATION(
            f"{count} of {len(frames)} files state another orientation than the others, first: {name} ({turned}, the "
            f"others {usual}); pixels are read as they are stored",
            count,
        ),
    )


def _conversion(frames: Sequence[_OpenedFrame], bits: int | None) -> tuple[Conversion, NumberRange] | None:
    """Return the conversion of stored to digital numbers, and their range; None for unsigned numbers as they are.

    The frames of the shortest and of the longest exposure, which show darkness and the most light, are read first; all
    frames are read where these have negative numbers or fractions.
    """
    kinds, stored_bits = {frame.header.numbers for frame in frames}, frames[0].header.stored_bits
    known = bits is None or stored_bits is None or bits >= stored_bits or frames[0].header.bits is not None
    if kinds == {"unsigned"} and known:
        unstated = stored_bits == 16 and bits in (None, 16) and all(frame.header.bits is None for frame in frames)
        return _below_zero(frames, bits) if unstated else None

    def found(some: Sequence[_OpenedFrame]) -> NumberRange:
        pixels = ((f.file.name, read_pixels(f.file.path, f.file.location)) for f in some)
        return joined(NumberRange.of(name, stored) for name, stored in pixels)

    brightest = max([frame for frame in frames if frame.settings.kind != "dark"] or frames, key=_exposure)
    if kinds == {"unsigned"}:
        first = found([brightest])
        conversion = conversion_of(first, "unsigned", bits, stored_bits)
        return None if conversion.plain else (conversion, first)
    kind: NumberKind = "float" if "float" in kinds else "signed"
    first = found([min(frames, key=_exposure), brightest])
    if first.lowest < 0 or not first.whole:
        first = found(frames)
    return conversion_of(first, kind, bits, stored_bits), first


def _below_zero(frames: Sequence[_OpenedFrame], bits: int | None) -> tuple[Conversion, NumberRange] | None:
    """Return the conversion of unsigned numbers that are below 0, where a dark frame has such, and their range."""
    dark = next((frame for frame in frames if frame.settings.kind == "dark"), None)
    if dark is None:
        return None
    if not falls_below_zero(stored := read_pixels(dark.file.path, dark.file.location)):
        if not dark.header.overscan:  # whose frames are shifted as they are read
            dark.kept.keep(stored)
        return None
    pixels = ((f.file.name, as_signed(read_pixels(f.file.path, f.file.location))) for f in frames)
    found = joined(NumberRange.of(name, numbers) for name, numbers in pixels)
    if found.lowest < -MOST_BELOW_ZERO:
        what = (
            "dark frames have numbers below 0 that are stored as 65535 and less, and others have numbers of both kinds"
        )
        raise dark.file.error(what, hint="Export the frames as signed numbers, or raise the camera's black level")
    return replace(conversion_of(found, "signed", bits, None), below_zero=True), found


def _stated_bits(frames: Sequence[_OpenedFrame], properties: SetProperties) -> int | None:
    """Return the bits of files that do not state them, from the listing, the caller or the sensor."""
    if properties.bits is None and any(frame.header.bits is not None for frame in frames):
        return None
    if properties.bits is None and properties.sensor is not None:
        return properties.sensor.readout.bits
    return properties.bits


def _exposure(frame: _OpenedFrame) -> float:
    return frame.settings.exposure_s or 0.0


def _read_whole(file: FrameFile, conversion: Conversion | None) -> Numbers:
    return (conversion or Conversion()).apply(file.name, read_whole(file.path, file.location))


def _assumed_bits(frames: Sequence[_OpenedFrame], properties: SetProperties) -> tuple[Diagnostic, ...]:
    """Return a diagnostic if the bit depth is assumed and larger than that of most converters."""
    assumed = [f.header.stored_bits for f in frames if f.header.bits is None]
    if not assumed or assumed[0] is None or assumed[0] <= 8:
        return ()
    if properties.bits is not None or properties.sensor is not None:
        return ()
    return (
        ASSUMED_BITS(
            f"the bit depth is not stated; the {assumed[0]} bits that the files store are assumed, with saturation at "
            f"{(1 << assumed[0]) - 1} DN. If the converter has fewer bits, state them: saturation depends on them"
        ),
    )


@dataclass(frozen=True)
class _FrameReading:
    """Reads a frame, and checks it against what all frames share."""

    path: Path
    location: FrameLocation | None
    bits: int
    cfa: Cfa | None
    shape: tuple[int, int]
    header: FrameHeader = field(compare=False)  # and format: of the file while it has the stamp
    format: Format | None
    stamp: tuple[int, ...] | None
    conversion: Conversion | None = None  # None for numbers that are stored as unsigned integers
    levels: tuple[float, ...] | None = None  # of the overscan, by amplifier, to which the numbers are shifted
    reference: _Reference | None = None  # whose masked border the numbers follow
    kept: _KeptNumbers = field(default_factory=_KeptNumbers, compare=False)  # read when the frame set was opened
    bits_of: str | None = None  # name of the sensor that gives the bit depth; None where files or the caller state it

    def __call__(self) -> Numbers:
        """Return the digital numbers."""
        with bits_from(self.bits_of):
            return self._read()

    def _read(self) -> Numbers:
        if self.conversion is not None:
            stored = self.conversion.apply(self._name, self._stored())
            dn = of_bits(self._name, stored, self.bits)
        elif self.reference is not None:
            dn = self.reference.followed(self.path, self.bits, self.cfa)
        elif self.levels is None and (kept := self.kept.taken()) is not None and self._unchanged:
            dn = of_bits(self._name, Conversion().apply(self._name, kept), self.bits)
        elif self.location is None and self.format is not None and self._unchanged:
            dn = read_numbers(self.path, self.format, self.header, self.bits, self.cfa)
        elif self.location is None:
            dn = read_frame(self.path, self.bits, self.cfa)[0].dn
        else:
            dn = of_bits(self._name, Conversion().apply(self._name, self._stored()), self.bits)
        return dn if dn.shape == self.shape else self._changed(dn.shape)

    def _stored(self) -> StoredNumbers:
        if self.levels is None:
            return read_pixels(self.path, self.location)
        return read_leveled(self.path, self.location, self.levels, (1 << self.bits) - 1)

    def open_rows(self) -> StoredRows | None:
        """Open the frame to read some rows at a time; None where its pixels are not stored as they are."""
        if self.conversion is not None or self.reference is not None:
            return None
        known = self._unchanged
        if self.header.first_pixel is not None and known:
            return StoredRows(self.path, self.header.first_pixel, self.shape)
        if self.location is not None and str(self.location.part).startswith(LAYOUT):
            return None
        format = self.format if known else None
        opened = open_stored_rows(self.path, self.location, self.bits, self.cfa, format)
        return opened if opened is None or opened.shape == self.shape else self._changed(opened.shape)

    @property
    def _unchanged(self) -> bool:
        return self.stamp is not None and self.stamp == file_stamp(self.path)

    @property
    def _name(self) -> str:
        return f"{self.path}{self.location.label if self.location else ''}"

    def _changed(self, shape: tuple[int, ...]) -> Never:
        raise FileError(self._name, f"the frame was {self.shape} when the frame set was opened and is now {shape}")


@dataclass(frozen=True)
class _Reference:
    """A frame whose masked border others of the same exposure time follow."""

    path: Path
    stamp: tuple[int, ...] | None

    def followed(self, path: Path, bits: int, cfa: Cfa | None) -> Numbers:
        """Return the digital numbers of a frame, shifted by a whole number to the level of this one."""
        dn, means = read_bordered(path, bits, cfa)
        if path == self.path:
            _border_means[self] = means
            return dn
        if self not in _border_means:
            _border_means[self] = read_bordered(self.path, bits, cfa)[1]
        moved: Numbers = shifted_down(dn, round(level_change(means, _border_means[self])), (1 << bits) - 1)
        return moved


_border_means: dict[_Reference, NDArray[np.float64]] = {}
"""Line means of the masked borders of the reference frames that this process has read."""


def _references(frames: Sequence[_OpenedFrame]) -> tuple[list[_Reference | None], tuple[Diagnostic, ...]]:
    """Return the reference of each frame, the first dark one of its exposure time and gain, and a diagnostic."""
    if not all(frame.header.masked_border and frame.header.location is None for frame in frames):
        return [None] * len(frames), ()
    first: dict[tuple[float | None, float | None], _Reference] = {}
    for frame in sorted(frames, key=lambda each: each.settings.kind != "dark"):
        setting = frame.settings.exposure_s, frame.settings.gain_setting
        first.setdefault(setting, _Reference(frame.file.path, frame.stamp))
    text = "frames follow the level of their masked borders, those of each exposure time by themselves"
    return [first[frame.settings.exposure_s, frame.settings.gain_setting] for frame in frames], (MASKED_LEVELS(text),)


def _overscan(frames: Sequence[_OpenedFrame]) -> tuple[tuple[float, ...] | None, tuple[Diagnostic, ...]]:
    """Return the overscan levels of the first dark frame, if all frames state overscan, and a diagnostic."""
    if not all(frame.header.overscan for frame in frames):
        return None, ()
    first = next((frame for frame in frames if frame.settings.kind == "dark"), frames[0])
    last = frames[-1] if frames[-1] is not first else frames[0]
    levels = overscan_levels(first.file.path, first.file.location)
    others = overscan_levels(last.file.path, last.file.location)
    drift = max((b - a for a, b in zip(levels, others, strict=True)), key=abs)
    known = " and ".join(f"{level:.1f}" for level in levels)
    text = (
        f"frames are shifted to the overscan level of {first.file.name}, {known} DN; "
        f"that of {last.file.name} differs by {drift:.1f} DN"
    )
    return levels, (OVERSCAN(text, abs(drift)),)


def _shared(values: Sequence[Value | None]) -> Value | None:
    """Return the value that all frames state, or None."""
    return values[0] if len(set(values)) == 1 else None


def _exposure_warning(frames: Sequence[_OpenedFrame]) -> PhotositeWarning | None:
    """Return a warning if listed exposures differ from those that the files state."""
    pairs = [(f.file.name, f.header.exposure_s or 0.0, f.file.settings.exposure_s or 0.0) for f in frames]
    different = [
        (name, stated, listed)
        for name, stated, listed in pairs
        if stated and not 1 / _SAME_EXPOSURE < listed / stated < _SAME_EXPOSURE
    ]
    if not different:
        return None
    name, stated, listed = different[0]
    problem = (
        f"{len(different)} files state another exposure time than the one listed ({name}: {stated:g} s, "
        f"listed {listed:g} s); the listed one is used"
    )
    return PhotositeWarning(problem, hint="Check its unit")


def _temperature_warning(settings: Sequence[FrameSettings]) -> PhotositeWarning | None:
    stated = [s.temperature_c for s in settings if s.temperature_c is not None]
    if not stated or max(stated) - min(stated) <= STEADY_TEMPERATURE_C:
        return None
    return PhotositeWarning(
        f"the sensor's temperature varied from {min(stated):g} to {max(stated):g} degrees Celsius; dark current "
        "doubles about every 7, so its estimate holds for a mean temperature"
    )


DARK_SPREADS, LIGHT_SPREADS = 1.0, 5.0
"""Limits above the darkest frame, in units of its pixel spread: dark up to the first, light above the second."""

DARKEST_FRACTION = 0.25
"""Largest level of a dark frame, as a fraction of the converter's range."""

_LEAST_SPREAD_DN = 12**-0.5
"""Standard deviation of rounding to whole numbers."""

_NORMAL_MAD = 1.4826
"""Ratio of standard deviation to median absolute deviation of a normal distribution."""

_HINT = "Pass {dark} and {light}, name the files after their kind, or write a protocol.yaml"
_ARGUMENTS = {"dark": "dark*", "light": "flat*"}


def classify_by_level(
    frames: Sequence[tuple[FrameSource, FrameSettings]], bits: int
) -> tuple[list[FrameSettings], PhotositeWarning | None]:
    """Complete the kind of frames by their mean level, with a warning if any were classified.

    Frames without a kind are read once. The reference of each gain setting is its first frame known to be dark, or else
    its darkest frame. A frame at most `DARK_SPREADS` of the reference's pixel spread above the reference is dark, one
    more than `LIGHT_SPREADS` above is light; between the two is an error.
    """
    complete = [settings for _, settings in frames]
    levels: dict[int, float] = {}
    for gain in dict.fromkeys(settings.gain_setting for settings in complete if settings.kind is None):
        same_gain = [n for n, settings in enumerate(complete) if settings.gain_setting == gain]
        unknown = [n for n in same_gain if complete[n].kind is None]
        levels |= {n: float(frames[n][0].read().mean()) for n in unknown}
        dark = next((n for n in same_gain if complete[n].kind == "dark"), min(unknown, key=levels.__getitem__))
        reference, spread = _level_and_spread(frames[dark][0])
        if reference > DARKEST_FRACTION * (1 << bits):
            problem = f"the darkest frame has a mean of {reference:.1f} DN, too high for a dark frame"
            raise FileError(frames[dark][0].name, problem, hint=_HINT, arguments=_ARGUMENTS)
        for n in unknown:
            kind = _kind(frames[n][0].name, levels[n] - reference, spread, reference)
            complete[n] = replace(complete[n], kind=kind)
    return complete, _warning(complete, levels)


def _level_and_spread(source: FrameSource) -> tuple[float, float]:
    """Return the mean, and the standard deviation over pixels, robust to hot pixels."""
    dn = source.read().astype(np.float64)
    spread = _NORMAL_MAD * float(np.median(np.abs(dn - np.median(dn))))
    return float(dn.mean()), max(spread, _LEAST_SPREAD_DN)


def _kind(name: str, above: float, spread: float, reference: float) -> Kind:
    if above <= DARK_SPREADS * spread:
        return "dark"
    if above > LIGHT_SPREADS * spread:
        return "light"
    problem = (
        f"the frame can be dark or light: its mean is {above:.2f} DN above that of the darkest frame, "
        f"{reference:.2f} DN, with a pixel spread of {spread:.2f} DN"
    )
    raise FileError(name, problem, hint=_HINT, arguments=_ARGUMENTS)


def _warning(settings: Sequence[FrameSettings], levels: dict[int, float]) -> PhotositeWarning | None:
    if not levels:
        return None
    parts = []
    for kind in ("dark", "light"):
        own = [level for n, level in levels.items() if settings[n].kind == kind]
        if own:
            parts.append(f"{len(own)} {kind} (mean {min(own):.1f} to {max(own):.1f} DN)")
    return PhotositeWarning(
        f"neither files nor names state the kind, so frames were classified by level: {' and '.join(parts)}",
        hint="If this is wrong, pass {dark} and {light} or write a protocol.yaml",
        arguments=_ARGUMENTS,
    )
