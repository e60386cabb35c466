"""The view that calibrates a folder of frames: the groups as they are understood, and the results of `calibrate`."""

from __future__ import annotations

import base64
import math
import shlex
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from photosite.app.copy_text import sensor_lines, source_name
from photosite.app.state import FILE, Part, Places, SensorState, Text, changed_sensor
from photosite.app.workers import Progress
from photosite.calibration.calibrate import calibrate
from photosite.calibration.parameters import PARAMETER_LABELS
from photosite.calibration.photon_transfer.channel import Curve
from photosite.calibration.result import Calibration
from photosite.errors import InputError, PhotositeWarning
from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.frames.open import open_frames
from photosite.values.uncertain import COVERAGE_95


class FolderRequest(Part):
    """A folder of the served folder."""

    folder: Text = Field("", description="Name in the served folder; empty is the served folder itself.")


class GroupEdit(Part):
    """What a group of frames is taken for."""

    kind: Literal["dark", "light", "omit"]
    exposure_s: float = Field(gt=0, le=1e6)


class CalibrationRequest(FolderRequest):
    """A calibration of a folder's frames."""

    sensor: SensorState | None = Field(
        None, description="Sensor as known before: pixel size, volts, spectra. None: that of a protocol."
    )
    groups: Annotated[tuple[GroupEdit, ...], Field(max_length=2000)] = ()
    """One for each group of the folder, in order; empty takes them as they are found."""


def folder_path(folder: str, places: Places) -> Path:
    """Return the path of a folder of the served folder."""
    if not folder:
        if places.folder is None:
            raise InputError("no folder is served", hint="Start photosite serve with a folder")
        return places.folder.resolve()
    path = places.path(f"{FILE}{folder}")
    if path is None or not path.is_dir():
        raise InputError("folder", value=folder, expected="a folder of the served folder")
    return path


def list_frames(request: FolderRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the groups of frames of a folder as `open_frames` understands them."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PhotositeWarning)
        frames = open_frames(folder_path(request.folder, places))
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
    notes = [*frames.notes, *_texts(caught)]
    return {**own, "groups": groups, "notes": notes, "sensor": None if frames.sensor is None else frames.sensor.name}


def _texts(caught: list[warnings.WarningMessage]) -> list[str]:
    return list(dict.fromkeys(str(w.message) for w in caught if isinstance(w.message, PhotositeWarning)))


def edited(frames: FrameSet, edits: tuple[GroupEdit, ...]) -> FrameSet:
    """Return the frames with other kinds and exposure times of their groups, or without some groups.

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
            kept.append(replace(group, kind=edit.kind, exposure_s=edit.exposure_s, photons_per_pixel=photons))
    keys = [(group.kind, group.exposure_s, group.photons_per_pixel, group.gain_setting) for group in kept]
    if len(set(keys)) < len(keys):
        same = next(key for key in keys if keys.count(key) > 1)
        hint = "Put the frames of one setting into one folder, or omit one group"
        raise InputError(f"two groups are {same[0]} frames of {same[1]:g} s", hint=hint)
    kept.sort(key=lambda group: (group.kind != "dark", group.exposure_s, group.photons_per_pixel or 0.0))
    return replace(frames, groups=tuple(kept))


def run_calibration(request: CalibrationRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the results of `calibrate`: parameters, curves, and the report and sensor file in base64."""

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total, "frames")

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PhotositeWarning)
        frames = edited(open_frames(folder_path(request.folder, places)), request.groups)
        if len(frames.gain_settings) > 1:
            hint = "Omit the groups of the others, or use the command photosite calibrate, which does series"
            raise InputError("gain settings", value=len(frames.gain_settings), expected="one", hint=hint)
        sensor = frames.sensor if request.sensor is None else changed_sensor(request.sensor, places)
        found = calibrate(frames, sensor, progress=report)
        files = _files(found)
    result = found.to_dict()
    return {
        "title": f"{found.frame_count} frames of {found.rows} × {found.cols} pixels, {found.bits} bits",
        "parameters": [_row(name, entry) for name, entry in result["parameters"].items()],
        "channels": {
            channel: [_row(name, entry) for name, entry in entries.items()]
            for channel, entries in result["channels"].items()
        },
        "curves": _curves(found),
        "warnings": list(dict.fromkeys([*found.warnings, *_texts(caught)])),
        "rejected": list(found.rejected),
        "files": files,
    }


def _row(name: str, entry: dict[str, Any]) -> dict[str, Any]:
    label = PARAMETER_LABELS[name]
    interval = entry.get("interval_95")
    return {
        "name": name,
        "label": label.label,
        "unit": label.unit,
        "topic": label.topic,
        "value": _finite(entry["value"]),
        "standard_uncertainty": _finite(entry["standard_uncertainty"]),
        "interval_95": None if interval is None else [_finite(end) for end in interval],
        "reason": entry.get("reason", ""),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _curves(found: Calibration) -> list[dict[str, Any]]:
    """Return the points and lines behind the fits, by kind of curve."""
    kinds: dict[str, dict[str, Curve]] = {}
    for channel, curves in found.curves.items():
        for kind, curve in curves.items():
            kinds.setdefault(kind, {})[channel] = curve
    return [
        {
            "kind": kind,
            "title": next(iter(curves.values())).title,
            "x_label": next(iter(curves.values())).x_label,
            "y_label": next(iter(curves.values())).y_label,
            "channels": {channel: _points(curve) for channel, curve in curves.items()},
        }
        for kind, curves in kinds.items()
    ]


def _points(curve: Curve) -> dict[str, Any]:
    keep = np.isfinite(curve.x) & np.isfinite(curve.y)
    x, y, u = curve.x[keep], curve.y[keep], curve.y_uncertainty[keep]
    residual: list[float | None] = []
    if curve.intercept is not None and curve.slope is not None:
        spread = np.sqrt(u**2 + curve.extra_variance)
        with np.errstate(divide="ignore", invalid="ignore"):
            residual = [_finite(value) for value in ((y - curve.intercept - curve.slope * x) / spread).tolist()]
    return {
        "x": x.tolist(),
        "y": y.tolist(),
        "half_95": [_finite(value) for value in (COVERAGE_95 * u).tolist()],
        "used": curve.used[keep].tolist(),
        "intercept": curve.intercept,
        "slope": curve.slope,
        "residual": residual,
    }


def _files(found: Calibration) -> dict[str, str]:
    """Return the report, and the sensor file where the sensor is known, in base64."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.html")
        found.report(report)
        files = [report]
        if found.base is not None:
            files.append(Path(folder, "mine.sensor.yaml"))
            found.save(files[-1])
        return {path.name: base64.b64encode(path.read_bytes()).decode() for path in files}


def calibration_code(request: CalibrationRequest, places: Places) -> tuple[str, str]:
    """Return the calibration as Python code and as a command, which takes groups as they are found."""
    path = str(folder_path(request.folder, places))
    lines = ["import photosite as ps", "", f"frames = ps.open_frames({path!r})"]
    if request.groups:
        parts = [
            f"replace(groups[{number}], kind={edit.kind!r}, exposure_s={edit.exposure_s!r})"
            for number, edit in sorted(
                ((number, edit) for number, edit in enumerate(request.groups) if edit.kind != "omit"),
                key=lambda pair: (pair[1].kind != "dark", pair[1].exposure_s),
            )
        ]
        lines[0] = "from dataclasses import replace\n\nimport photosite as ps"
        lines += ["groups = frames.groups", "frames = replace(", "    frames,", "    groups=("]
        lines += [*(f"        {part}," for part in parts), "    ),", ")"]
    sensor = ""
    if request.sensor is not None:
        lines += sensor_lines(request.sensor, places)
        sensor = ", sensor"
    lines += [f"cal = ps.calibrate(frames{sensor})", "print(cal)", 'cal.report("report.html")']
    command = ""
    changed = request.sensor is not None and (request.sensor.changed or request.sensor.gain_setting is not None)
    if not request.groups and not changed:
        words = ["photosite", "calibrate", path]
        if request.sensor is not None:
            words += ["--sensor", source_name(request.sensor.source, places), "-o", "mine.sensor.yaml"]
        command = shlex.join([*words, "--report", "report.html"])
    return "\n".join(lines) + "\n", command
