"""The fields of the page, with descriptions, units and limits from the models and docstrings of the library."""

from __future__ import annotations

import inspect
import math
import re
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from photosite.app.state import CaptureState, LensState, Part, Places, SceneState, SensorState, changed_sensor
from photosite.optics.checks import LOWEST_F_NUMBER, SHORTEST_FOCAL_MM
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.charts.chart import Chart
from photosite.scene.options import ReadOptions
from photosite.scene.scene_request import BUILT_IN_SCENES, chart_function
from photosite.sensor.effects.model import Effects
from photosite.sensor.file_units import ASSUMED_SWING, CONVERSION, SWING, in_file_units
from photosite.sensor.io.sensor_file import preset_names
from photosite.sensor.model import Sensor
from photosite.sensor.sections import SECTIONS, Array
from photosite.sensor.shutter import Shutter
from photosite.values.uncertain import Measured

Kind = Literal["number", "whole", "choice", "flag", "text"]


class FormField(Part):
    """One field of the page."""

    name: str
    label: str
    description: str
    unit: str
    kind: Kind
    value: Any = None
    lowest: float | None = None
    highest: float | None = None
    slider: tuple[float, float] | None = None
    logarithmic: bool = False
    choices: tuple[str, ...] = ()
    optional: bool = False


class FormGroup(Part):
    """Fields under one heading. An optional group is an effect of the sensor that can be switched on."""

    name: str
    title: str
    description: str = ""
    optional: bool = False
    enabled: bool = True
    example: Any = None
    fields: tuple[FormField, ...] = ()
    note: str = ""


class Form(Part):
    """All groups of the camera view for a sensor and a scene."""

    scene: tuple[FormGroup, ...]
    lens: tuple[FormGroup, ...]
    sensor: tuple[FormGroup, ...]
    capture: tuple[FormGroup, ...]
    sensors: tuple[str, ...]
    scenes: tuple[str, ...]
    gain_settings: tuple[float, ...]
    gain_setting: float | None


_SHOWN_UNITS = {
    "none": "", "1": "", "um": "µm", "uV/e-": "µV/e⁻", "e-": "e⁻", "e-/s": "e⁻/s", "DN/e-": "DN/e⁻", "us": "µs",
    "deg C": "°C", "deg": "°",
}  # fmt: skip
_SUFFIXES = {"_cd_m2": "cd/m²", "_m": "m", "_mm": "mm", "_s": "s", "_deg": "°", "_nm": "nm", "_c": "°C"}

_LIGHT: dict[str, dict[str, Any]] = {
    "illuminant": {},
    "mean_luminance_cd_m2": {"slider": (0.01, 1e5), "logarithmic": True},
    "distance_m": {"slider": (0.1, 100.0), "logarithmic": True},
    "width_m": {"slider": (0.01, 100.0), "logarithmic": True},
}
"""Fields of the light and place, and what the page adds to their models."""

_OF_SENSOR = {
    "pixel": ("width_um", "height_um", "fill_factor", "well_capacity_e", "conversion_gain_uv_per_e", "voltage_swing_v"),
    "noise": (
        *("read_noise_e", "row_noise_e", "column_noise_e", "dsnu_e", "prnu_percent", "dark_current_e_per_s"),
        *("dcnu_percent", "dark_current_temperature_c", "dark_doubling_c"),
    ),
    "readout": ("bits", "analog_gain", "black_level_dn"),
}
"""The fields on the page; noise in electrons."""

_TITLES = {"pixel": "Pixel", "noise": "Noise", "readout": "Readout"}


def form(sensor: SensorState, scene: str, places: Places) -> Form:
    """Return the fields for a sensor and a scene, with the sensor's values."""
    found = changed_sensor(sensor, places)
    return Form(
        scene=tuple(_scene_groups(scene)),
        lens=(FormGroup(name="lens", title="Lens", fields=_lens_fields()),),
        sensor=tuple(_sensor_groups(found)),
        capture=(FormGroup(name="capture", title="Exposure", fields=_capture_fields()),),
        sensors=preset_names(),
        scenes=BUILT_IN_SCENES,
        gain_settings=found.all_gain_settings,
        gain_setting=found.gain_setting,
    )


def _scene_groups(scene: str) -> Iterator[FormGroup]:
    about = {**parameters_of(Chart.under), "mean_luminance_cd_m2": parameters_of(Chart.under)["luminance_cd_m2"]}
    infos = {name: SceneState.model_fields[name] for name in _LIGHT}
    about["illuminant"] = infos["illuminant"].description or ""
    fields = [_field(name, info, info.default, about[name]) for name, info in infos.items()]
    fields = [found.model_copy(update=_LIGHT[found.name]) for found in fields]
    yield FormGroup(name="light", title="Light and place", fields=tuple(fields))
    if scene in BUILT_IN_SCENES:
        function = chart_function(scene)
        model: type[BaseModel] = function.options
        words = parameters_of(function)
        fields = [_field(name, info, info.default, words.get(name, "")) for name, info in model.model_fields.items()]
        title = f"Options of {scene}"
    else:
        words = parameters_of(ReadOptions)
        own = ("units", "tolerance", "no_data", "negative", "method", "out_of_gamut", "variable")
        fields = [
            _field(name, info, info.default, words.get(name, ""))
            for name, info in ReadOptions.model_fields.items()
            if name in own
        ]
        title = "Options of reading the file"
    if fields:
        yield FormGroup(name="options", title=title, fields=tuple(fields))


def _lens_fields() -> tuple[FormField, ...]:
    words = parameters_of(DiffractionLimited)
    limits = {"f_number": (LOWEST_F_NUMBER, 32.0), "focal_length_mm": (SHORTEST_FOCAL_MM, 400.0)}
    fields = []
    for name in ("f_number", "focal_length_mm", "transmittance", "falloff"):
        info = LensState.model_fields[name]
        found = _field(name, info, info.default, words[name])
        if name in limits:
            lowest, highest = limits[name]
            found = found.model_copy(
                update={"lowest": lowest, "slider": (max(lowest, 1.0), highest), "logarithmic": True}
            )
        elif name == "transmittance":
            found = found.model_copy(update={"lowest": 0.0, "highest": 1.0, "slider": (0.0, 1.0)})
        fields.append(found)
    return tuple(fields)


def _capture_fields() -> tuple[FormField, ...]:
    sliders = {"exposure_s": (1e-5, 100.0), "temperature_c": (-40.0, 80.0)}
    fields = []
    for name, info in CaptureState.model_fields.items():
        found = _field(name, info, info.default, info.description or "")
        if name == "cells_per_pixel":
            found = found.model_copy(update={"kind": "choice", "choices": ("1", "3", "5"), "value": "1"})
        if name in sliders:
            found = found.model_copy(update={"slider": sliders[name], "logarithmic": name == "exposure_s"})
        fields.append(found)
    return tuple(fields)


def _sensor_groups(sensor: Sensor) -> Iterator[FormGroup]:
    infos = Array.model_fields
    yield FormGroup(name="array", title="Array", fields=tuple(
        _field(name, infos[name], getattr(sensor.array, name)) for name in ("rows", "cols")
    ))  # fmt: skip
    for section, names in _OF_SENSOR.items():
        infos = {**SECTIONS[section][0].model_fields, **SECTIONS[section][1].model_fields}
        if sensor.pixel.voltage_swing_v == ASSUMED_SWING:
            names = tuple(name for name in names if name not in (CONVERSION, SWING))
        values = _values(sensor, names)
        fields = tuple(_field(name, infos[name], values[name]) for name in names)
        yield FormGroup(name=section, title=_TITLES[section], fields=fields)
    for section, kind in {"shutter": Shutter}.items():
        yield _optional(section, Sensor.model_fields[section], kind, getattr(sensor, section))
    for name, info in Effects.model_fields.items():
        yield _optional(name, info, _model_of(info.annotation), getattr(sensor.effects, name, None))


def _values(sensor: Sensor, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the sensor's values by field, in the fields' units."""
    parts = (sensor.pixel, sensor.noise, sensor.readout)
    own = {name: value for part in parts for name, value in part}
    stated = {name: value for name, value in own.items() if isinstance(value, Measured)}
    other = [name for name in names if name not in own]
    converted = in_file_units(stated, None, sensor.readout.bits, other)[0] if other else {}
    return {name: own[name] if name in own else converted[name] for name in names}


def _optional(name: str, info: FieldInfo, kind: type[BaseModel] | None, value: Any) -> FormGroup:
    example = info.examples[0] if info.examples else {}
    dumped = {} if value is None else value.model_dump(mode="json", exclude_none=True)
    fields, others = [], []
    for field, of_field in (kind.model_fields if kind is not None else {}).items():
        if _kind_of(of_field.annotation) is None:
            others.append(field)
            continue
        default = None if of_field.is_required() else of_field.default
        fields.append(_field(field, of_field, dumped.get(field, example.get(field, default))))
    note = f"Tables are set in the sensor file: {', '.join(others)}." if others else ""
    return FormGroup(
        name=name,
        title=_label(name),
        description=info.description or "",
        optional=True,
        enabled=value is not None,
        example=dumped or example,
        fields=tuple(fields),
        note=note,
    )


def _model_of(annotation: Any) -> type[BaseModel] | None:
    return next((part for part in _parts(annotation) if isinstance(part, type) and issubclass(part, BaseModel)), None)


def _parts(annotation: Any) -> list[Any]:
    if get_origin(annotation) is Annotated:
        return _parts(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return [inner for part in get_args(annotation) for inner in _parts(part)]
    return [annotation]


def _kind_of(annotation: Any) -> Kind | None:
    """Return how a field is edited; None for tables and nested sections."""
    parts = _parts(annotation)
    if any(get_origin(part) is Literal for part in parts):
        return "choice"
    for kinds, kind in (((bool,), "flag"), ((float, Measured), "number"), ((int,), "whole"), ((str,), "text")):
        if any(part in kinds for part in parts):
            return kind  # type: ignore[return-value]
    return None


def _field(name: str, info: FieldInfo, value: Any, description: str | None = None) -> FormField:
    """Return the field of a model's field."""
    kind = _kind_of(info.annotation) or "text"
    number = value.value if isinstance(value, Measured) else value
    lowest, highest = _limits(info)
    finite = isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)
    example = info.examples[0] if info.examples else None
    slider, logarithmic = None, False
    if kind in ("number", "whole"):
        slider, logarithmic = _slider(number if finite else None, example, lowest, highest, kind == "whole")
    extra = info.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    choices = [str(c) for part in _parts(info.annotation) if get_origin(part) is Literal for c in get_args(part)]
    return FormField(
        name=name,
        label=_label(name),
        description=(description if description is not None else info.description or "").partition(" Instead of ")[0],
        unit=_SHOWN_UNITS.get(unit, unit) if unit else _unit_of(name),
        kind=kind,
        value=number if finite or not isinstance(number, float) else str(number),
        lowest=lowest,
        highest=highest,
        slider=slider,
        logarithmic=logarithmic,
        choices=tuple(choices),
        optional=type(None) in _parts(info.annotation) and (not info.is_required()),
    )


def _limits(info: FieldInfo) -> tuple[float | None, float | None]:
    metadata = [*info.metadata, *(m for part in [info.annotation] for m in getattr(part, "__metadata__", ()))]
    for part in get_args(info.annotation):
        for entry in getattr(part, "__metadata__", ()):
            metadata += entry.metadata if isinstance(entry, FieldInfo) else [entry]
    low = next((m.gt if isinstance(m, Gt) else m.ge for m in metadata if isinstance(m, Gt | Ge)), None)
    high = next((m.lt if isinstance(m, Lt) else m.le for m in metadata if isinstance(m, Lt | Le)), None)
    return tuple(  # type: ignore[return-value]
        float(m) if isinstance(m, int | float) and math.isfinite(m) else None for m in (low, high)
    )


def _slider(
    value: float | None, example: Any, lowest: float | None, highest: float | None, whole: bool
) -> tuple[tuple[float, float] | None, bool]:
    """Return the range of the slider, which the number field beside it can exceed, and whether it is logarithmic."""
    if lowest is not None and highest is not None and highest <= 1000:
        return (lowest, highest), False
    size = value if value else example if isinstance(example, int | float) and not isinstance(example, bool) else None
    if not size or size < 0:
        return None, False
    top = size * 10 if highest is None else min(size * 10, highest)
    if value == 0 or value is None:
        return (0.0, float(top)), False
    bottom = size / 10 if not whole else max(1.0, round(size / 10))
    return (float(bottom), float(top)), True


def _label(name: str) -> str:
    words = re.sub(r"_(um|mm|nm|mv|uv_per_e|e_per_s|e|v|percent|dn|us|s|deg|m|cd_m2|c)$", "", name).replace("_", " ")
    shown = {"dsnu": "DSNU", "prnu": "PRNU", "dcnu": "DCNU", "f number": "f-number", "cols": "Columns"}
    return shown.get(words, words[:1].upper() + words[1:])


def _unit_of(name: str) -> str:
    return next((unit for suffix, unit in _SUFFIXES.items() if name.endswith(suffix)), "")


def parameters_of(documented: Any) -> dict[str, str]:
    """Return the descriptions of parameters in a numpydoc docstring.

    Examples
    --------
    >>> parameters_of(DiffractionLimited)["focal_length_mm"]
    'Focal length f.'
    """
    text = inspect.getdoc(documented) or ""
    match = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n[A-Z][a-z]+\n-+\n|\Z)", text, re.DOTALL | re.MULTILINE)
    found: dict[str, str] = {}
    names: list[str] = []
    for line in match[1].splitlines() if match else []:
        if line and not line.startswith(" "):
            names = [name.strip() for name in line.split(":")[0].split(",")]
        elif line.strip():
            for name in names:
                found[name] = f"{found.get(name, '')} {line.strip()}".strip()
    return {name: words.replace("`", "") for name, words in found.items()}
