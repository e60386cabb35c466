"""The state of the page as text that reproduces it: Python, a command, and the section of a notebook."""

from __future__ import annotations

import dataclasses
import json
import shlex
from pathlib import Path
from typing import Any

from photosite.app.lens_state import LensState
from photosite.app.places import Places
from photosite.app.state import CameraState, FlickerState, MotionState, SensorState, light_name, prepared
from photosite.scene.scene_request import BUILT_IN_SCENES
from photosite.sensor.gain_table import GAIN_TABLE
from photosite.values.exposure import format_exposure, parse_exposure


def python_text(state: CameraState, places: Places) -> str:
    """Return Python code whose `dn` is the array of digital numbers on the page, and `picture` the developed picture.

    Examples
    --------
    >>> print(python_text(CameraState(), Places()).splitlines()[2])
    sensor = ps.load_sensor('nikon-d200')
    """
    found = prepared(state, places)
    taken, request = state.capture, found.request
    lines = ["import photosite as ps", "", *sensor_lines(state.sensor, places)]
    lines += lens_lines(state.lens, places)
    cells = f", cells_per_pixel={taken.cells_per_pixel}" if taken.cells_per_pixel != 1 else ""
    lines.append(f"camera = ps.Camera(optics, sensor{cells})")
    options = dict(request.options)
    if request.source in BUILT_IN_SCENES:
        lines.append(f"scene = ps.charts.{request.source.replace('-', '_')}({_arguments(options)})")
    else:
        lines.append(f"scene = ps.read_scene({_arguments({'': request.source, **options})})")
    if state.scene.dynamic:
        seen = {name: part for name, part in (("flicker", state.scene.flicker), ("motion", state.scene.motion)) if part}
        made = ", ".join(f"{name}={_dynamic(part)}" for name, part in seen.items())
        lines.append(f"scene = ps.scenes.DynamicScene(scene, {made})")
    lines.append(f"exposure_s = {taken.exposure_s!r}")
    place: dict[str, Any] = {"seed": taken.seed}
    if taken.temperature_c is not None:
        place["temperature_c"] = taken.temperature_c
    lines.append(f"raw = camera.capture(scene, exposure_s, {_arguments(place)})")
    if taken.noise:
        lines += ["dn = raw.dn", f"picture = ps.develop(raw, exposure={state.brightness!r})"]
    else:
        lines.append("dn = camera.clean_dn(camera.mean_electrons(scene, exposure_s))")
    return "\n".join(lines) + "\n"


def _dynamic(part: FlickerState | MotionState) -> str:
    """Return Python code that makes a flicker or a motion."""
    value = part.flicker() if isinstance(part, FlickerState) else part.motion()
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(part, FlickerState) and part.kind == "table":
        fields["table"] = part.table  # as it was given: dividing it by its mean again can change its last digit
    return f"ps.scenes.{type(value).__name__}({_arguments(fields)})"


def _flicker_text(flicker: FlickerState) -> str:
    """Return a flicker as the option --flicker takes it.

    Examples
    --------
    >>> _flicker_text(FlickerState(kind="pulse", frequency_hz=250, duty=0.4, phase_deg=90))
    '250.0Hz:duty=0.4:phase=90.0'
    """
    if flicker.kind == "table":
        return f"{flicker.frequency_hz!r}Hz:table={','.join(map(repr, flicker.table))}"
    size = repr(flicker.depth) if flicker.kind == "sine" else f"duty={flicker.duty!r}"
    phase = f":phase={flicker.phase_deg!r}" if flicker.phase_deg else ""
    return f"{flicker.frequency_hz!r}Hz:{size}{phase}"


def sensor_lines(state: SensorState, places: Places) -> list[str]:
    """Return lines of Python code that make a sensor."""
    lines = [f"sensor = ps.load_sensor({source_name(state.source, places)!r})"]
    table = {name: value for name, value in state.changes.items() if name in GAIN_TABLE}
    values = {name: value for name, value in state.changes.items() if name not in GAIN_TABLE}
    lines += [f"sensor = sensor.with_(**{table!r})"] if table else []
    if state.gain_setting is not None:
        lines.append(f"sensor = sensor.at_gain_setting({state.gain_setting!r})")
    lines += [f"sensor = sensor.with_(**{values!r})"] if values else []
    if state.binning is not None:
        lines.append(f"sensor = sensor.binned({state.binning.factor!r}, {state.binning.kind!r})")
    return lines


def command_text(state: CameraState, places: Places) -> str:
    """Return the command that writes the frame on the page to shot.tif, or its noise-free frame to clean.tif.

    Examples
    --------
    >>> command_text(CameraState(), Places()).split("--illuminant")[0]
    'photosite simulate --sensor nikon-d200 --scene macbeth '
    """
    taken, lens, scene = state.capture, state.lens, state.scene
    words = ["photosite", "simulate", "--sensor", source_name(state.sensor.source, places)]
    if state.sensor.gain_setting is not None:
        words += ["--gain-setting", repr(state.sensor.gain_setting)]
    for name, value in state.sensor.changes.items():
        words += ["--sensor-option", f"{name}={json.dumps(value)}"]
    if (binning := state.sensor.binning) is not None:
        words += ["--bin", str(binning.factor), "--bin-kind", binning.kind]
    words += ["--scene", source_name(scene.source, places)]
    for flag, value in (
        ("--illuminant", None if scene.illuminant is None else light_name(scene.illuminant, places)),
        ("--luminance", scene.mean_luminance_cd_m2),
        ("--distance", scene.distance_m),
        ("--width", scene.width_m),
    ):
        if value is not None:
            words += [flag, str(value)]
    for name, value in scene.options.items():
        words += ["--scene-option", f"{name}={json.dumps(value)}"]
    if scene.flicker is not None:
        words += ["--flicker", _flicker_text(scene.flicker)]
    if (motion := scene.motion) is not None:
        rates = (motion.rows_per_s, motion.cols_per_s, motion.rotation_deg_per_s, motion.scale_per_s)
        words += [f"--motion={','.join(map(repr, rates))}"]
    if lens.source is not None:
        words += ["--optics", source_name(lens.source, places)]
    elif lens.diffraction_limited:
        words += ["--f-number", repr(lens.f_number), "--focal-length", repr(lens.focal_length_mm)]
        for name, value in lens.fields.items():
            if name not in ("f_number", "focal_length_mm"):
                words += ["--lens-option", f"{name}={value}"]
    else:
        words += ["--optics", OPTICS_FILE]
    words += ["--exposure", exposure_text(taken.exposure_s), "--seed", str(taken.seed)]
    if taken.temperature_c is not None:
        words += ["--temperature", repr(taken.temperature_c)]
    if taken.cells_per_pixel != 1:
        words += ["--cells", str(taken.cells_per_pixel)]
    words += ["-o", "shot.tif"]
    if not taken.noise:
        words += ["--clean", "clean.tif"]
    return optics_file_text(lens) + shlex.join(words)


OPTICS_FILE = "workbench.optics.yaml"
"""The optics file that a command writes for a lens that its options cannot describe."""


def optics_file_text(lens: LensState) -> str:
    """Return the command that writes `OPTICS_FILE`; nothing for a lens that needs none. JSON is YAML."""
    if lens.source is not None or lens.diffraction_limited:
        return ""
    content = json.dumps({"photosite_optics": 1, **lens.fields}, indent=1)
    return f"cat > {OPTICS_FILE} <<'END'\n{content}\nEND\n"


def exposure_text(exposure_s: float) -> str:
    """Return a short text that is parsed to exactly this exposure time.

    Examples
    --------
    >>> exposure_text(1 / 3), exposure_text(0.0123456789)
    ('1/3', '0.0123456789')
    """
    short = format_exposure(exposure_s)
    return short if parse_exposure(short) == exposure_s else repr(exposure_s)


def lens_lines(lens: LensState, places: Places) -> list[str]:
    """Return lines of Python code that make a lens."""
    if lens.source is not None:
        return [f"optics = ps.load_optics({source_name(lens.source, places)!r})"]
    if lens.diffraction_limited:
        return [f"optics = ps.DiffractionLimited({_arguments(lens.fields)})"]
    return [f"optics = ps.load_optics({lens.fields!r})"]


def source_name(name: str, places: Places) -> str:
    """Return what the library and the commands take for a name in a state: a built-in name, or a path."""
    path: Path | None = places.path(name)
    return name if path is None else str(path)


def _arguments(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value!r}" if name else repr(value) for name, value in values.items())
