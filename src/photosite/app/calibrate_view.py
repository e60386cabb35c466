"""The view that calibrates a folder of frames: the groups as they are understood, and the results.

Frames of one gain setting are calibrated by `calibrate`, those of several by `calibrate_series`, those of each capture
of one exposure, in subfolders, by `calibrate_captures`, and frames that combine captures by `calibrate_combined`.
"""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from photosite.app.calibrate_results import Result, combined_result, of_captures, of_one, of_series
from photosite.app.copy_text import sensor_lines, source_name
from photosite.app.places import FILE, UPLOAD, Part, Places, Text
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.state import SensorState, changed_sensor
from photosite.app.workers import Progress
from photosite.calibration.calibrate import calibrate
from photosite.calibration.captures.combined import calibrate_combined
from photosite.calibration.captures.each_capture import calibrate_captures
from photosite.calibration.gain_series.calibrate_series import calibrate_series
from photosite.calibration.photon_transfer.knees import SeveralCapturesError
from photosite.errors import InputError
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.frames.io.formats import SUFFIXES
from photosite.frames.open import open_frames
from photosite.sensor.model import Sensor

Method = Literal["one", "series", "captures", "combined"]
"""How frames are calibrated: of one gain setting and capture, of several settings, of each capture, or combined."""


class FolderRequest(Part):
    """A folder of the served folder, or an uploaded one."""

    folder: Text = Field("", description="Name in the served folder, or upload:ID; empty is the served folder itself.")


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
    maps: bool = Field(False, description="Also measure maps of the chip, and its defects.")
    captures: Annotated[tuple[Text, ...], Field(max_length=8)] = ()
    """Subfolders with the frames of each capture, from the most to the least sensitive."""
    method: Method | None = Field(None, description="None: as the frames and the sensor need it.")


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
    """Return the groups of frames of a folder as `open_frames` understands them, and subfolders with both kinds."""
    path = folder_path(request.folder, places)
    with recorded_warnings() as texts:
        frames = open_frames(path)
    groups = [
        {
            "kind": group.kind,
            "exposure_s": group.exposure_s,
            "gain_setting": group.gain_setting,
            "frames": len(group),
            "first": Path(group.frames[0].name).name,
            "last": Path(group.frames[-1].name).name,
        }
        for group in frames.groups
    ]
    own = {name: getattr(frames, name) for name in ("rows", "cols", "bits", "black_level_dn")}
    notes = [*frames.notes, *texts]
    sensor = None if frames.sensor is None else frames.sensor.name
    kinds: dict[str, set[str]] = {}
    for group in frames.groups:
        for frame in group.frames:
            kinds.setdefault(Path(frame.name).parent.name, set()).add(group.kind)
    both = [name for name in _subfolders(path) if len(kinds.get(name, ())) > 1]
    return {**own, "groups": groups, "notes": notes, "sensor": sensor, "subfolders": both}


_MOST_SUBFOLDERS = 40


def _subfolders(path: Path) -> list[str]:
    """Return the subfolders that hold frames, by name."""
    folders = sorted(entry for entry in path.iterdir() if entry.is_dir() and not entry.is_symlink())
    return [
        folder.name
        for folder in folders[:_MOST_SUBFOLDERS]
        if any(entry.suffix.lower() in SUFFIXES for entry in folder.iterdir())
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
        result = _calibrated(request, places, report)
    return replace(result, warnings=tuple(dict.fromkeys([*result.warnings, *texts]))).to_dict()


def _calibrated(request: CalibrationRequest, places: Places, report: Any) -> Result:
    path = folder_path(request.folder, places)
    stated = None if request.sensor is None else changed_sensor(request.sensor, places)
    method = request.method
    if method == "captures" or (method is None and _capture_names(request, path, stated)):
        names = _capture_names(request, path, stated)
        if request.groups:
            raise InputError("groups", expected="left as they are found with the frames of each capture")
        parts = {name: open_frames(path / name) for name in names}
        return of_captures(calibrate_captures(parts, stated, maps=request.maps, progress=report), places)
    frames = edited(open_frames(path), request.groups)
    sensor = frames.sensor if stated is None else stated
    if method == "series" or (method is None and len(frames.gain_settings) > 1):
        if request.maps:
            hint = "Omit the groups of the other settings"
            raise InputError("maps need frames of one gain setting", hint=hint)
        return of_series(calibrate_series(frames, sensor, progress=report), places)
    combined = frames.bits > 16 or (sensor is not None and sensor.captures is not None)
    if method == "combined" or (method is None and combined):
        return combined_result(calibrate_combined(frames, sensor), places)
    try:
        found = calibrate(frames, sensor, maps=request.maps, progress=report)
        return of_one(found, frames.gain_settings[0], places)
    except SeveralCapturesError:
        if method is not None:
            raise
        return combined_result(calibrate_combined(frames, sensor), places)


def _capture_names(request: CalibrationRequest, path: Path, sensor: Sensor | None) -> list[str]:
    """Return the subfolders of the captures: those of the request, else those of the sensor where all are there."""
    if request.captures:
        known = _subfolders(path)
        if missing := [name for name in request.captures if name not in known]:
            raise InputError(
                "captures", value=missing[0], expected=f"one of {', '.join(known)}, subfolders with frames"
            )
        return list(request.captures)
    names = [] if sensor is None or sensor.captures is None else list(sensor.captures.names)
    return names if names and set(names) <= set(_subfolders(path)) else []


def calibration_code(request: CalibrationRequest, places: Places) -> tuple[str, str]:
    """Return the calibration as Python code and as a command, which takes unchanged groups and no maps of captures."""
    path, method = str(folder_path(request.folder, places)), request.method or "one"
    lines = ["import photosite as ps", ""]
    sensor, maps = "", ", maps=True" if request.maps and (method == "one" or request.captures) else ""
    if request.sensor is not None:
        lines += sensor_lines(request.sensor, places)
        sensor = ", sensor"
    if request.captures:
        lines += [
            f"folder, names = {path!r}, {list(request.captures)!r}",
            'frames = {name: ps.open_frames(f"{folder}/{name}") for name in names}',
            f"cal = ps.calibrate_captures(frames{sensor}{maps})",
        ]
    else:
        lines.append(f"frames = ps.open_frames({path!r})")
        if request.groups:
            lines[0] = "from dataclasses import replace\n\nimport photosite as ps"
            lines += _edit_lines(request.groups)
        calibrated = {"one": "calibrate", "series": "calibrate_series"}.get(method, "calibrate_combined")
        lines.append(f"cal = ps.{calibrated}(frames{sensor}{maps})")
    lines += ["print(cal)", 'cal.report("report.html")']
    command = ""
    changed = request.sensor is not None and (request.sensor.changed or request.sensor.gain_setting is not None)
    if not request.groups and not changed and not (request.captures and request.maps):
        words = ["photosite", "calibrate", path]
        if request.sensor is not None:
            words += ["--sensor", source_name(request.sensor.source, places)]
            if method in ("one", "series") and not request.captures:
                words += ["-o", "mine.sensor.yaml"]
        if request.captures:
            words += ["--captures", ",".join(request.captures)]
        words += ["--maps"] if maps else []
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
