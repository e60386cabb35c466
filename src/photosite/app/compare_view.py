"""The view that compares: cameras in the same light, and measured frames with their simulation."""

from __future__ import annotations

import base64
import json
import shlex
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from photosite.app.copy_text import exposure_text, lens_lines, sensor_lines, source_name
from photosite.app.lens_state import LensState, lens
from photosite.app.places import Part, Places, Text
from photosite.app.quality_values import QualityValues
from photosite.app.recorded_warnings import recorded_warnings
from photosite.app.state import LIGHT, SensorState, changed_sensor, light_name
from photosite.app.workers import Progress, steps
from photosite.camera.camera import Camera
from photosite.develop.develop import save_picture
from photosite.errors import InputError
from photosite.frames.io.formats import raw_files, read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.charts.color_checker import find_chart
from photosite.scene.scene import DEFAULT_DISTANCE_M
from photosite.studies.camera_comparison import compare_cameras
from photosite.validation.frame_validation import CaptureConditions, FrameValidation, validate_frames
from photosite.validation.lamp import load_lamp

_MOST_SHOWN = 1_000_000
"""Pixels of a picture of the chart, which is averaged beyond."""


class CameraChoice(Part):
    """A sensor behind a lens."""

    sensor: SensorState = SensorState()
    lens: LensState = LensState(f_number=2.8)


class Comparison(Part):
    """Cameras in the same light, as for `photosite.studies.compare_cameras`."""

    cameras: Annotated[tuple[CameraChoice, ...], Field(min_length=1, max_length=8)] = (CameraChoice(),)
    exposure_s: float = Field(1 / 15, gt=0, le=1e5, description="Exposure time in s.")
    illuminant: Text = Field("3200K", description=LIGHT)
    mean_luminance_cd_m2: float = Field(40.0, gt=0, le=1e9, description="Mean luminance of the chart's patches.")
    distance_m: float = Field(DEFAULT_DISTANCE_M, gt=0, le=1e6, description="Distance from the lens to the chart.")
    seed: int = Field(0, ge=0, lt=1 << 53, description="Key of the noise in the frames of the chart.")
    values: QualityValues = ()


_CONDITIONS = ("exposure_s", "mean_luminance_cd_m2", "distance_m", "seed")


def _conditions(request: Comparison, places: Places) -> dict[str, Any]:
    """Return the conditions as `compare_cameras` takes them."""
    conditions = {name: getattr(request, name) for name in _CONDITIONS}
    values = {"values": request.values} if request.values else {}
    return {"illuminant": light_name(request.illuminant, places), **conditions, **values}


def _labels(cameras: tuple[CameraChoice, ...], places: Places) -> list[str]:
    """Return a label for each camera, of what the cameras differ in."""
    sensors = [_sensor_label(one.sensor, places) for one in cameras]
    lenses = [_lens_label(one.lens, places) for one in cameras]
    labels: list[str] = []
    for sensor, behind in zip(sensors, lenses, strict=True):
        same_lens, same_sensor = len(set(lenses)) == 1, len(set(sensors)) == 1
        base = sensor if same_lens else behind if same_sensor else f"{sensor}, {behind}"
        label, number = base, 2
        while label in labels:
            label, number = f"{base} ({number})", number + 1
        labels.append(label)
    return labels


def _sensor_label(state: SensorState, places: Places) -> str:
    label = _file_name(state.source, places)
    if state.gain_setting is not None:
        label += f" at {state.gain_setting:g}"
    return f"{label}, changed" if state.changed else label


def _lens_label(state: LensState, places: Places) -> str:
    if state.source is not None:
        return _file_name(state.source, places)
    transmittance = "" if state.transmittance == 1 else f", {100 * state.transmittance:g} %"
    falloff = "" if state.falloff == "none" else f", {state.falloff}"
    parts = "" if state.diffraction_limited else ", with further fields"
    return f"f/{state.f_number:g}, {state.focal_length_mm:g} mm{transmittance}{falloff}{parts}"


def _file_name(source: str, places: Places) -> str:
    return source_name(source, places).replace("\\", "/").rsplit("/", 1)[-1]


def compare(request: Comparison, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return `compare_cameras` of the cameras, with its warnings."""
    cameras = {
        label: Camera(lens(one.lens, places), changed_sensor(one.sensor, places))
        for label, one in zip(_labels(request.cameras, places), request.cameras, strict=True)
    }
    with recorded_warnings() as texts:
        found = compare_cameras(cameras, on_progress=steps(progress), **_conditions(request, places)).to_dict()
    return {**found, "illuminant": _file_name(request.illuminant, places), "notes": texts}


def compare_code(request: Comparison, places: Places) -> tuple[str, str]:
    """Return the comparison as Python code, and as camera files with a command, which takes unchanged sensors only."""
    labels = _labels(request.cameras, places)
    lines = ["import photosite as ps", "", "cameras = {}"]
    for label, one in zip(labels, request.cameras, strict=True):
        lines += [*sensor_lines(one.sensor, places), *lens_lines(one.lens, places)]
        lines.append(f"cameras[{label!r}] = ps.Camera(optics, sensor)")
    conditions = _conditions(request, places)
    arguments = ", ".join(f"{name}={value!r}" for name, value in conditions.items())
    lines += [f"found = ps.studies.compare_cameras(cameras, {arguments})", "print(found)", "found.plot()"]
    command = ""
    if not any(one.sensor.changed for one in request.cameras):
        names = [f"workbench-{number}.camera.yaml" for number in range(1, len(labels) + 1)]
        for name, label, one in zip(names, labels, request.cameras, strict=True):
            content = json.dumps(_camera_file(label, one, places), indent=1)
            command += f"cat > {name} <<'END'\n{content}\nEND\n"
        words = ["photosite", "cameras", "compare", *names, "--exposure", exposure_text(request.exposure_s)]
        words += ["--illuminant", conditions["illuminant"], "--luminance", repr(request.mean_luminance_cd_m2)]
        words += ["--distance", repr(request.distance_m), "--seed", str(request.seed)]
        command += shlex.join([*words, *(word for name in request.values for word in ("--value", name))])
    return "\n".join(lines) + "\n", command


def _camera_file(label: str, one: CameraChoice, places: Places) -> dict[str, Any]:
    """Return the fields of a camera file; JSON is YAML."""
    content: dict[str, Any] = {"photosite_camera": 1, "name": label, "sensor": source_name(one.sensor.source, places)}
    if one.sensor.gain_setting is not None:
        content["gain_setting"] = one.sensor.gain_setting
    source = one.lens.source
    return content | {"optics": one.lens.fields if source is None else source_name(source, places)}


class ValidationRequest(Part):
    """Measured frames of a ColorChecker and the camera and light that simulate them, as `photosite validate`."""

    measured: Annotated[tuple[Text, ...], Field(min_length=1, max_length=32)]
    """Raw frames of one scene and setting: names of files, or folders of the served folder."""
    sensor: SensorState = SensorState()
    lens: LensState = LensState()
    illuminant: Text = Field("A", description=LIGHT)
    luminance_cd_m2: float | None = Field(None, gt=0, le=1e9, description="Mean luminance of the patches.")
    exposure_s: float | None = Field(None, gt=0, le=1e5, description="Exposure time. None: that of the files.")
    distance_m: float = Field(DEFAULT_DISTANCE_M, gt=0, le=1e6, description="Distance from the lens to the chart.")
    black_level_dn: float | None = Field(None, ge=0, le=1 << 24, description="Black level of files without it.")
    corners: tuple[tuple[float, float], ...] = Field((), max_length=4)
    """Outer corners (row, col) of the dark skin, bluish green, black and white patches. Empty: the chart is found."""
    fit: Literal["fill_factor", "light"] | None = Field(None, description="Parameter fitted to the patch means.")
    tolerance_percent: float = Field(0.0, ge=0, le=1000, description="Relative tolerance of means and noise.")
    level: float = Field(0.05, gt=0, lt=1, description="False-alarm rate of the verdict.")
    seed: int = Field(0, ge=0, lt=1 << 53, description="Key of the simulation's noise.")


_OF_VERDICT = ("fit", "level", "tolerance_percent", "seed")


def _paths(request: ValidationRequest, places: Places) -> list[Path]:
    found = [places.path(name) for name in request.measured]
    if None in found:
        raise InputError("measured", value=request.measured[found.index(None)], expected="files that were measured")
    return [path for path in found if path is not None]


def run_validation(request: ValidationRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return `validate_frames` of the files, and the chart as measured and as simulated as PNG in base64."""
    if request.corners and len(request.corners) != 4:
        raise InputError("corners", value=len(request.corners), expected="4, or none to find the chart")
    sensor = changed_sensor(request.sensor, places)
    conditions = CaptureConditions(
        sensor=sensor,
        optics=lens(request.lens, places),
        lamp=load_lamp(light_name(request.illuminant, places)),
        exposure_s=request.exposure_s,
        luminance_cd_m2=request.luminance_cd_m2,
        distance_m=request.distance_m,
    )
    frames: list[RawFrame] = []
    files = [file for path in _paths(request, places) for file in raw_files(path)]
    for number, file in enumerate(files):
        if progress is not None:
            progress(number, len(files), "frames read")
        frame = read_raw(file)
        frames.append(
            frame if request.black_level_dn is None else replace(frame, black_level_dn=request.black_level_dn)
        )
    corners: Any = request.corners or find_chart(replace(frames[0], cfa=sensor.array.cfa))
    if progress is not None:
        progress(0, 0, "the chart is simulated")
    test: dict[str, Any] = {name: getattr(request, name) for name in _OF_VERDICT}
    with recorded_warnings() as texts:
        found = validate_frames(frames, conditions, corners, **test)
    return {
        **found.to_dict(),
        "warnings": texts,
        "fit_summary": found.fit_summary,
        "pictures": _pictures(found),
    }


def _pictures(found: FrameValidation) -> dict[str, Any]:
    """Return the chart in both frames, averaged to at most `_MOST_SHOWN` pixels."""
    seen, made, start = found.pictures()
    step = int(np.ceil((seen.shape[0] * seen.shape[1] / _MOST_SHOWN) ** 0.5))
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder, "measured.png"), Path(folder, "simulated.png")
        for picture, file in zip((seen, made), files, strict=True):
            save_picture(_averaged(picture, step), file)
        texts = [base64.b64encode(file.read_bytes()).decode() for file in files]
    return {"measured": texts[0], "simulated": texts[1], "row": start[0], "col": start[1], "step": step}


def _averaged(picture: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    rows, cols = (max(size // step, 1) for size in picture.shape[:2])
    blocks = picture[: rows * step, : cols * step].reshape(rows, step, cols, step, 3)
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)


def validation_code(request: ValidationRequest, places: Places) -> tuple[str, str]:
    """Return the comparison as Python code, and as a command for an unchanged sensor behind a lossless ideal lens."""
    paths = [str(path) for path in _paths(request, places)]
    lamp = light_name(request.illuminant, places)
    given = {
        name: value
        for name in ("exposure_s", "luminance_cd_m2", "distance_m")
        if (value := getattr(request, name)) is not None
    }
    lines = [
        "from dataclasses import replace",
        "from pathlib import Path",
        "import photosite as ps",
        "from photosite.frames.io.formats import raw_files",
        "from photosite.metrics.charts.color_checker import find_chart",
        "from photosite.validation.frame_validation import CaptureConditions, validate_frames",
        "from photosite.validation.lamp import load_lamp",
        "",
        *sensor_lines(request.sensor, places),
        *lens_lines(request.lens, places),
        f"files = [file for path in {paths!r} for file in raw_files(Path(path))]",
        "frames = [ps.read_raw(file) for file in files]",
    ]
    if request.black_level_dn is not None:
        lines.append(f"frames = [replace(frame, black_level_dn={request.black_level_dn!r}) for frame in frames]")
    arguments = ", ".join(f"{name}={value!r}" for name, value in given.items())
    lines.append(f"conditions = CaptureConditions(sensor, optics, load_lamp({lamp!r}), {arguments})")
    corners = repr(request.corners) if request.corners else "find_chart(replace(frames[0], cfa=sensor.array.cfa))"
    test = ", ".join(f"{name}={getattr(request, name)!r}" for name in _OF_VERDICT)
    lines += [f"corners = {corners}", f"found = validate_frames(frames, conditions, corners, {test})", "print(found)"]
    plain = request.lens.diffraction_limited and request.lens.fields.keys() <= {"f_number", "focal_length_mm"}
    command = ""
    if plain and not request.sensor.changed and request.sensor.gain_setting is None:
        words = ["photosite", "validate", *(word for path in paths for word in ("--measured", path))]
        words += ["--sensor", source_name(request.sensor.source, places), "--illuminant", lamp]
        words += ["--f-number", repr(request.lens.f_number), "--focal-length", repr(request.lens.focal_length_mm)]
        words += ["--distance", repr(request.distance_m)]
        for flag, value in (
            ("--luminance", request.luminance_cd_m2),
            ("--exposure", None if request.exposure_s is None else exposure_text(request.exposure_s)),
            ("--black-level", request.black_level_dn),
            ("--fit", request.fit),
        ):
            words += [] if value is None else [flag, str(value)]
        shown = [f"{row!r},{col!r}" for row, col in request.corners]
        words += ["--corners", *shown] if request.corners else ["--detect"]
        words += ["--tolerance", repr(request.tolerance_percent), "--level", repr(request.level)]
        command = shlex.join([*words, "--seed", str(request.seed)])
    return "\n".join(lines) + "\n", command
