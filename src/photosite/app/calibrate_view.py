"""The view that calibrates a folder of frames: the groups as they are understood, and the results."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from photosite.app.calibrate_results import result_of
from photosite.app.copy_text import sensor_lines, source_name
from photosite.app.places import FILE, UPLOAD, Part, Places, Text
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.state import SensorState, changed_sensor
from photosite.app.workers import Progress
from photosite.calibration.calibrate import calibrate
from photosite.calibration.setting import MapsWanted
from photosite.errors import InputError
from photosite.frames.conditions import label
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.frames.io.format_table import is_frame_name
from photosite.frames.open import capture_folders, open_frames, open_settings

_READING = ("bits", "cfa", "black_level_dn", "exposure_s", "region", "layout", "where")

_FLAGS = {"black_level_dn": "--black-level", "exposure_s": "--exposure"}


class FolderRequest(Part):
    """A folder of the served folder, or an uploaded one."""

    folder: Text = Field("", description="Name in the served folder, or upload:ID; empty is the served folder itself.")
    bits: int | None = Field(None, ge=1, le=16, description="Bit depth, for files that do not state it.")
    cfa: Text = Field("", description="Color filter array, for files that do not state it.")
    black_level_dn: float | None = Field(None, ge=0, lt=65536, description="Black level to compare dark frames with.")
    exposure_s: float | None = Field(None, gt=0, le=1e6, description="Exposure time of frames that state none.")
    region: Text = Field("", description="Pixels with light, for files that do not state them.")
    layout: Text = Field("", description="Pixels of headerless files.")
    where: Text = Field("", description="Setting to choose, where the files state several: filter=R.")

    @property
    def reading(self) -> dict[str, Any]:
        """The options of `open_frames` that are given."""
        given = {name: getattr(self, name) for name in _READING}
        return {name: value for name, value in given.items() if value not in (None, "")}


class GroupEdit(Part):
    """What a group of frames is taken for."""

    kind: Literal["dark", "light", "omit"]
    exposure_s: float = Field(gt=0, le=1e6)
    gain_setting: float | None = Field(None, ge=0, le=1e9)


class CalibrationRequest(FolderRequest):
    """A calibration of a folder's frames."""

    sensor: SensorState | None = Field(
        None, description="Sensor as known before: pixel size, volts, spectra. None: that of a protocol."
    )
    groups: Annotated[tuple[GroupEdit, ...], Field(max_length=2000)] = ()
    """One for each group of the folder, in order; empty takes them as they are found."""
    each_setting: bool = Field(False, description="Calibrate each of several settings that the files state.")
    maps: bool = Field(False, description="Also measure maps of the chip, and its defects.")
    pixel_gain: bool = Field(False, description="Also measure the gain of each pixel, with the maps.")
    captures: Annotated[tuple[Text, ...], Field(max_length=8)] = ()
    """Subfolders with the frames of each capture, from the most to the least sensitive."""


def folder_path(folder: str, places: Places) -> Path:
    """Return the path of a folder of the served folder, or of an uploaded one."""
    if not folder:
        if places.folder is None:
            raise InputError("no folder is served", hint="Start photosite serve with a folder, or upload one")
        return places.folder.resolve()
    path = places.path(folder if folder.startswith(UPLOAD) else f"{FILE}{folder}")
    if path is None or not path.is_dir():
        raise InputError("folder", value=folder, expected="a folder of the served folder")
    return path


def list_frames(request: FolderRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the groups of frames of a folder as `open_frames` understands them, and subfolders with both kinds.

    Of several settings, their names and numbers of frames are listed in place of the groups.
    """
    path = folder_path(request.folder, places)
    with recorded_warnings() as texts:
        opened = open_settings(path, **request.reading)
    settings = [{"name": label(each.conditions), "frames": each.frame_count} for each in opened]
    frames, listed = opened[0], opened[0].groups if len(opened) == 1 else ()
    groups = [
        {
            "kind": group.kind,
            "exposure_s": group.exposure_s,
            "gain_setting": group.gain_setting,
            "frames": len(group),
            "first": Path(group.frames[0].name).name,
            "last": Path(group.frames[-1].name).name,
        }
        for group in listed
    ]
    own = {name: getattr(frames, name) for name in ("rows", "cols", "bits", "black_level_dn")}
    notes = [*dict.fromkeys([*(text for each in opened for text in each.warnings), *texts])]
    sensor = None if frames.sensor is None else frames.sensor.name
    kinds: dict[str, set[str]] = {}
    for group in listed:
        for frame in group.frames:
            kinds.setdefault(Path(frame.name).parent.name, set()).add(group.kind)
    both = [name for name in _subfolders(path) if len(kinds.get(name, ())) > 1]
    return {**own, "groups": groups, "notes": notes, "sensor": sensor, "subfolders": both, "settings": settings}


_MOST_SUBFOLDERS = 40


def _subfolders(path: Path) -> list[str]:
    """Return the subfolders that hold frames, by name."""
    folders = sorted(entry for entry in path.iterdir() if entry.is_dir() and not entry.is_symlink())
    return [
        folder.name for folder in folders[:_MOST_SUBFOLDERS] if any(is_frame_name(entry) for entry in folder.iterdir())
    ]


def edited(frames: FrameSet, edits: tuple[GroupEdit, ...]) -> FrameSet:
    """Return the frames with other kinds, exposure times and gain settings of their groups, or without some groups.

    Raises
    ------
    InputError
        If there is not one edit for each group, or two groups become the same.
    """
    if not edits:
        return frames
    if len(edits) != len(frames.groups):
        raise InputError("groups", value=len(edits), expected=f"{len(frames.groups)}, one for each group of the folder")
    kept: list[FrameGroup] = []
    for group, edit in zip(frames.groups, edits, strict=True):
        if edit.kind != "omit":
            photons = group.photons_per_pixel if edit.kind == group.kind else None
            values = {"kind": edit.kind, "exposure_s": edit.exposure_s, "gain_setting": edit.gain_setting}
            kept.append(replace(group, photons_per_pixel=photons, **values))  # type: ignore[arg-type]
    keys = [(group.kind, group.exposure_s, group.photons_per_pixel, group.gain_setting) for group in kept]
    if len(set(keys)) < len(keys):
        same = next(key for key in keys if keys.count(key) > 1)
        hint = "Put the frames of one setting into one folder, or omit one group"
        raise InputError(f"two groups are {same[0]} frames of {same[1]:g} s", hint=hint)
    kept.sort(
        key=lambda group: (
            group.kind != "dark",
            group.exposure_s,
            group.photons_per_pixel or 0.0,
            group.gain_setting or 0.0,
        )
    )
    return replace(frames, groups=tuple(kept))


def run_calibration(request: CalibrationRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the results of a calibration: parameters, curves, maps, and files for download."""

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total, "frames")
            if done == total:
                progress(0, 1, "estimates")

    with recorded_warnings() as texts:
        path = folder_path(request.folder, places)
        sensor = None if request.sensor is None else changed_sensor(request.sensor, places)
        frames: FrameSet | dict[str, FrameSet] | list[FrameSet]
        if names := capture_folders(path, sensor, request.captures):
            if request.groups:
                raise InputError("groups", expected="left as they are found with the frames of each capture")
            frames = {name: open_frames(path / name, sensor=sensor, **request.reading) for name in names}
        elif request.each_setting:
            if request.groups:
                raise InputError("groups", expected="left as they are found with several settings")
            frames = open_settings(path, sensor=sensor, **request.reading)
        else:
            frames = edited(open_frames(path, sensor=sensor, **request.reading), request.groups)
        maps: MapsWanted = "gain" if request.pixel_gain else request.maps
        result = result_of(calibrate(frames, sensor, maps=maps, progress=report), places)
    return replace(result, warnings=tuple(dict.fromkeys([*result.warnings, *texts]))).to_dict()


def calibration_code(request: CalibrationRequest, places: Places) -> tuple[str, str]:
    """Return the calibration as Python code, and as a command where the groups and the sensor are unchanged."""
    path = str(folder_path(request.folder, places))
    lines = ["import photosite as ps", ""]
    maps = ', maps="gain"' if request.pixel_gain else ", maps=True" if request.maps else ""
    sensor = ""
    reading = "".join(f", {name}={value!r}" for name, value in request.reading.items())
    if request.sensor is not None:
        lines += sensor_lines(request.sensor, places)
        sensor = ", sensor"
    if request.captures:
        lines += [
            f"folder, names = {path!r}, {list(request.captures)!r}",
            f'frames = {{name: ps.open_frames(f"{{folder}}/{{name}}"{reading}) for name in names}}',
        ]
    elif request.each_setting:
        lines[0] += "\nfrom photosite.frames.open import open_settings"
        lines.append(f"frames = open_settings({path!r}{reading})")
    else:
        lines.append(f"frames = ps.open_frames({path!r}{reading})")
        if request.groups:
            lines[0] = "from dataclasses import replace\n\nimport photosite as ps"
            lines += _edit_lines(request.groups)
    lines += [f"cal = ps.calibrate(frames{sensor}{maps})", "print(cal)", 'cal.report("report.html")']
    command = ""
    changed = request.sensor is not None and (request.sensor.changed or request.sensor.gain_setting is not None)
    if not request.groups and not changed:
        words = ["photosite", "calibrate", path]
        for name, value in request.reading.items():
            words += [_FLAGS.get(name, f"--{name}"), str(value)]
        if request.sensor is not None:
            words += ["--sensor", source_name(request.sensor.source, places)]
            if (
                not request.captures
                and not request.each_setting
                and changed_sensor(request.sensor, places).captures is None
            ):
                words += ["-o", "mine.sensor.yaml"]
        if request.captures:
            words += ["--captures", ",".join(request.captures)]
        words += ["--pixel-gain"] if request.pixel_gain else ["--maps"] if request.maps else []
        command = shlex.join([*words, "--report", "report.html"])
    return "\n".join(lines) + "\n", command


def _edit_lines(groups: tuple[GroupEdit, ...]) -> list[str]:
    """Return Python code that makes the frame set of edited groups."""
    kept = [(number, edit) for number, edit in enumerate(groups) if edit.kind != "omit"]
    kept.sort(key=lambda pair: (pair[1].kind != "dark", pair[1].exposure_s, pair[1].gain_setting or 0.0))
    parts = [
        f"replace(groups[{number}], kind={edit.kind!r}, exposure_s={edit.exposure_s!r}, "
        f"gain_setting={edit.gain_setting!r})"
        for number, edit in kept
    ]
    lines = ["groups = frames.groups", "frames = replace(", "    frames,", "    groups=("]
    return [*lines, *(f"        {part}," for part in parts), "    ),", ")"]
