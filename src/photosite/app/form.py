"""The fields of the page, with descriptions, units and limits from the models and docstrings of the library.

A field is a number, text or choice, or consists of others: a section of a sensor file, a table of columns over a grid,
a list of sections, or entries by name. `Field.value` is that of the sensor, in the form that a sensor file has.
"""

from __future__ import annotations

import inspect
import math
import re
import types
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from photosite.app.lens_state import LensState
from photosite.app.places import Part, Places
from photosite.app.state import (
    BinningState,
    CaptureState,
    FlickerState,
    MotionState,
    SceneState,
    SensorState,
    changed_sensor,
)
from photosite.optics.checks import LOWEST_F_NUMBER, SHORTEST_FOCAL_MM
from photosite.optics.diffraction import DiffractionLimited
from photosite.scene.charts.chart import Chart
from photosite.scene.options import ReadOptions
from photosite.scene.scene_request import BUILT_IN_SCENES, chart_function
from photosite.sensor.effects.model import Effects
from photosite.sensor.file_units import ASSUMED_SWING, CONVERSION, SWING, in_file_units
from photosite.sensor.io.sensor_file import preset_names
from photosite.sensor.model import Sensor
from photosite.sensor.optical_stack import OpticalStack
from photosite.sensor.quantity import Bounds, as_file_value
from photosite.sensor.sections import SECTIONS, Array, GainSetting
from photosite.values.cfa import NAMED, tile_text
from photosite.values.uncertain import Measured

Kind = Literal[
    "number", "whole", "choice", "choices", "flag", "text", "numbers", "matrix", "table", "section", "list", "entries"
]


class FormField(Part):
    """One field of the page.

    Parameters
    ----------
    value, example
        Value of the sensor, or the default; value to begin with where an optional part is added.
    slider, logarithmic
        Range of the slider, which the number field beside it can exceed.
    choices
        Values of a choice, or words that are valid in place of numbers.
    fields
        Of a section or of each entry of a list; the columns of a table, the grid first; the one item of entries.
    keys
        Names that entries have: the channels. Empty: any.
    only
        Fields beside this one, and their values with which this one applies.
    """

    name: str
    label: str
    description: str
    unit: str
    kind: Kind
    value: Any = None
    example: Any = None
    lowest: float | None = None
    highest: float | None = None
    slider: tuple[float, float] | None = None
    logarithmic: bool = False
    choices: tuple[str, ...] = ()
    optional: bool = False
    fields: tuple[FormField, ...] = ()
    keys: tuple[str, ...] = ()
    only: Mapping[str, tuple[str, ...]] | None = None


class FormGroup(Part):
    """Fields under one heading."""

    name: str
    title: str
    fields: tuple[FormField, ...] = ()


class Form(Part):
    """All groups of the camera view for a sensor and a scene."""

    scene: tuple[FormGroup, ...]
    lens: tuple[FormGroup, ...]
    sensor: tuple[FormGroup, ...]
    binning: FormField
    capture: tuple[FormGroup, ...]
    sensors: tuple[str, ...]
    scenes: tuple[str, ...]


_SHOWN_UNITS = {
    "none": "", "1": "", "um": "µm", "uV/e-": "µV/e⁻", "e-": "e⁻", "e-/s": "e⁻/s", "DN/e-": "DN/e⁻", "us": "µs",
    "deg C": "°C", "deg": "°",
}  # fmt: skip
_SUFFIXES = {
    "_cd_m2": "cd/m²", "_m": "m", "_mm": "mm", "_deg_per_s": "°/s", "_per_s": "1/s", "_s": "s", "_deg": "°",
    "_nm": "nm", "_um": "µm", "_c": "°C", "_hz": "Hz",
}  # fmt: skip

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
_PROVENANCE = ("source", "assumed")


def form(sensor: SensorState, scene: str, places: Places) -> Form:
    """Return the fields for a sensor and a scene, with the sensor's values."""
    found = changed_sensor(sensor, places)
    as_in_file = changed_sensor(SensorState(source=sensor.source), places)
    binning = SensorState.model_fields["binning"]
    return Form(
        scene=tuple(_scene_groups(scene)),
        lens=(FormGroup(name="lens", title="Lens", fields=_lens_fields()),),
        sensor=(*_sensor_groups(found), _gain_group(as_in_file)),
        binning=_field("binning", binning, None, example=BinningState().model_dump()),
        capture=(FormGroup(name="capture", title="Exposure", fields=_capture_fields()),),
        sensors=preset_names(),
        scenes=BUILT_IN_SCENES,
    )


def _scene_groups(scene: str) -> Iterator[FormGroup]:
    about = parameters_of(Chart.under)
    infos = {name: SceneState.model_fields[name] for name in _LIGHT}
    about["illuminant"] = infos["illuminant"].description or ""
    fields = [_field(name, info, info.default, about[name]) for name, info in infos.items()]
    fields = [found.model_copy(update=_LIGHT[found.name]) for found in fields]
    examples = {"flicker": FlickerState().model_dump(), "motion": MotionState(cols_per_s=100.0).model_dump()}
    for name, example in examples.items():
        fields.append(_field(name, SceneState.model_fields[name], None, example=example))
    yield FormGroup(name="light", title="Light and place", fields=tuple(fields))
    if scene in BUILT_IN_SCENES:
        function = chart_function(scene)
        model: type[BaseModel] = function.options
        words, names = parameters_of(function), tuple(model.model_fields)
        title = f"Options of {scene}"
    else:
        model, words, title = ReadOptions, parameters_of(ReadOptions), "Options of reading the file"
        names = tuple(name for name in ReadOptions.model_fields if name not in SceneState.model_fields)
    fields = [
        _field(name, info, info.default, words.get(name, ""))
        for name, info in model.model_fields.items()
        if name in names
    ]
    if fields:
        yield FormGroup(name="options", title=title, fields=tuple(fields))


def _lens_fields() -> tuple[FormField, ...]:
    words = parameters_of(DiffractionLimited)
    limits = {"f_number": (LOWEST_F_NUMBER, 32.0), "focal_length_mm": (SHORTEST_FOCAL_MM, 400.0)}
    fields = []
    for name, info in LensState.model_fields.items():
        if name == "source":
            continue
        found = _field(name, info, info.default, words.get(name))
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
    own, channels = Sensor.model_fields, sensor.channel_names
    infos = Array.model_fields
    tile = _field("cfa", infos["cfa"], tile_text(sensor.array.cfa))
    yield FormGroup(name="array", title="Array", fields=(
        *(_field(name, infos[name], getattr(sensor.array, name)) for name in ("rows", "cols")),
        tile.model_copy(update={"choices": tuple(NAMED)}),
        _field("stacked", infos["stacked"], sensor.array.stacked),
        _field("serial", own["serial"], sensor.serial),
    ))  # fmt: skip
    for section, names in _OF_SENSOR.items():
        infos = {**SECTIONS[section][0].model_fields, **SECTIONS[section][1].model_fields}
        if sensor.pixel.voltage_swing_v == ASSUMED_SWING:
            names = tuple(name for name in names if name not in (CONVERSION, SWING))
        values = _values(sensor, names)
        fields = tuple(_field(name, infos[name], values[name]) for name in names)
        yield FormGroup(name=section, title=_TITLES[section], fields=fields)
    yield FormGroup(name="response", title="Spectral response", fields=(
        _field("channels", own["channels"], sensor.channels, channels=channels),
    ))  # fmt: skip
    for name, title, model in (
        ("optical_stack", "Optical stack", OpticalStack),
        ("effects", "Shutter and effects", Effects),
    ):
        fields = tuple(
            _field(part, info, getattr(getattr(sensor, name), part, None), channels=channels)
            for part, info in model.model_fields.items()
        )
        if name == "effects":
            fields = (_field("shutter", own["shutter"], sensor.shutter), *fields)
        yield FormGroup(name=name, title=title, fields=fields)
    yield FormGroup(name="captures", title="Captures", fields=(
        _field("captures", own["captures"], sensor.captures, channels=channels),
    ))  # fmt: skip


_OF_SETTING = (
    *("conversion_gain_uv_per_e", "analog_gain", "well_capacity_e", "read_noise_e", "row_noise_e", "column_noise_e"),
    *("dsnu_e", "prnu_percent", "dark_current_e_per_s", "dcnu_percent", "black_level_dn"),
)
"""Values of a gain setting on the page; noise in electrons."""
_OWN_SETTING = "Gain setting of the sensor file's values, such as ISO 100. It is needed where there are others."
_OTHER_SETTINGS = "Others, ascending. An empty field has the value of the sensor file's own setting."


def _gain_group(sensor: Sensor) -> FormGroup:
    """Return the fields of the sensor's gain settings, as its file has them."""
    own, volts = Sensor.model_fields, sensor.pixel.voltage_swing_v != ASSUMED_SWING
    names = tuple(name for name in _OF_SETTING if volts or name != CONVERSION)
    of_model = {name: info for pair in SECTIONS.values() for kind in pair for name, info in kind.model_fields.items()}
    setting = GainSetting.model_fields["setting"]
    fields = [_field("setting", setting, None)]
    for name in names:
        field = _field(name, of_model[name], None)
        fields.append(field.model_copy(update={"optional": True, "slider": None}))
    values = [_setting_values(sensor, entry.setting, names) for entry in sensor.gain_settings]
    table = _field("gain_settings", own["gain_settings"], (), _OTHER_SETTINGS)
    last = sensor.all_gain_settings[-1] if sensor.all_gain_settings else 100.0
    at_last = sensor.at_gain_setting(last) if sensor.all_gain_settings else sensor
    example = [{"setting": 2 * last, "analog_gain": 2 * at_last.readout.analog_gain.value}]
    return FormGroup(name="gain_settings", title="Gain settings", fields=(
        _field("gain_setting", own["gain_setting"], sensor.gain_setting, _OWN_SETTING),
        _field("gain_setting_is_iso", own["gain_setting_is_iso"], sensor.gain_setting_is_iso),
        table.model_copy(update={"fields": tuple(fields), "value": values, "example": example}),
    ))  # fmt: skip


def _setting_values(sensor: Sensor, setting: float, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the values of a gain setting that differ from the sensor's own, with the ten digits that a link needs."""
    own, values = (_values(each, names) for each in (sensor, sensor.at_gain_setting(setting)))
    digits = {name: (float(f"{value.value:.10g}"), float(f"{own[name].value:.10g}")) for name, value in values.items()}
    return {"setting": setting} | {name: there for name, (there, here) in digits.items() if there != here}


def _values(sensor: Sensor, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the sensor's values by field, in the fields' units."""
    parts = (sensor.pixel, sensor.noise, sensor.readout)
    own = {name: value for part in parts for name, value in part}
    stated = {name: value for name, value in own.items() if isinstance(value, Measured)}
    other = [name for name in names if name not in own]
    converted = in_file_units(stated, None, sensor.readout.bits, other)[0] if other else {}
    return {name: own[name] if name in own else converted[name] for name in names}


def _parts(annotation: Any) -> list[Any]:
    """Return the types of a union, without None."""
    if get_origin(annotation) is Annotated:
        return _parts(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return [inner for part in get_args(annotation) for inner in _parts(part)]
    return [] if annotation is type(None) else [annotation]


_OF_TUPLE: dict[Kind | None, Kind] = {
    "section": "list",
    "number": "numbers",
    "whole": "numbers",
    "numbers": "matrix",
    "choice": "choices",
}


def _kind_of(annotation: Any) -> tuple[Kind | None, Any]:
    """Return how a field is edited, and the model of its section, the type of its entries, or None."""
    parts = _parts(annotation)
    for part in parts:
        if isinstance(part, type) and issubclass(part, BaseModel):
            return "section", part
    for part in parts:
        if get_origin(part) is tuple:
            inner, model = _kind_of(get_args(part)[0])
            return _OF_TUPLE.get(inner), model
    for part in parts:
        if get_origin(part) is dict:
            return "entries", get_args(part)[1]
    if any(get_origin(part) is Literal for part in parts):
        return "choice", None
    for kinds, kind in (((bool,), "flag"), ((float, Measured), "number"), ((int,), "whole"), ((str,), "text")):
        if any(part in kinds for part in parts):
            return kind, None  # type: ignore[return-value]
    return None, None


def _literals(annotation: Any) -> tuple[str, ...]:
    found: list[str] = []
    for part in _parts(annotation):
        if get_origin(part) is Literal:
            found += [str(choice) for choice in get_args(part)]
        elif get_origin(part) is tuple:
            found += _literals(get_args(part)[0])
    return tuple(found)


def _plain(value: Any) -> Any:
    """Return a value as a sensor file has it, without fields that are None."""
    if isinstance(value, Measured):
        value = as_file_value(value)
    if isinstance(value, BaseModel):
        return {name: _plain(part) for name, part in value if part is not None}
    if isinstance(value, Mapping):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _for_channels(example: Any, channels: tuple[str, ...]) -> Any:
    """Return an example of a monochrome sensor for other channels."""
    if isinstance(example, dict):
        if list(example) == ["M"]:
            return dict.fromkeys(channels, _for_channels(example["M"], channels))
        return {name: _for_channels(part, channels) for name, part in example.items()}
    return example


def _field(
    name: str,
    info: FieldInfo,
    value: Any,
    description: str | None = None,
    *,
    channels: tuple[str, ...] = ("M",),
    example: Any = None,
) -> FormField:
    """Return the field of a model's field."""
    kind, inner = _kind_of(info.annotation)
    extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
    number = value.value if isinstance(value, Measured) else value
    lowest, highest = _limits(info)
    finite = isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)
    example = info.examples[0] if info.examples and example is None else example
    if kind == "section" and example is not None and not isinstance(example, dict):
        example = inner.model_validate(example)  # a short form, such as one number for a filter
    slider, logarithmic = None, False
    if kind in ("number", "whole"):
        slider, logarithmic = _slider(number if finite else None, example, lowest, highest, kind == "whole")
        if isinstance(stated := extra.get("slider"), list):
            low, high = (float(end) for end in stated)  # type: ignore[arg-type]
            slider, logarithmic = (low, high), low > 0
    unit = str(extra.get("unit", ""))
    fields: tuple[FormField, ...] = ()
    if kind in ("section", "list"):
        fields = _section_fields(inner, channels)
    elif kind == "entries":
        fields = (_field(name, FieldInfo(annotation=inner), None, "", channels=channels),)
    return FormField(
        name=name,
        label=_label(name),
        description=(description if description is not None else info.description or "").partition(" Instead of ")[0],
        unit=_SHOWN_UNITS.get(unit, unit) if unit else _unit_of(name),
        kind=kind or "text",
        value=_plain(value) if kind in _OF_TUPLE.values() or fields else _plain(number),
        example=None if kind in ("number", "whole", "flag", "text") else _for_channels(_plain(example), channels),
        lowest=lowest,
        highest=highest,
        slider=slider,
        logarithmic=logarithmic,
        choices=_literals(info.annotation),
        optional=info.annotation is not None and type(None) in get_args(info.annotation) and not info.is_required(),
        fields=fields,
        keys=channels if extra.get("keys") == "channels" else (),
        only=extra.get("only"),
    )


def _section_fields(model: type[BaseModel], channels: tuple[str, ...]) -> tuple[FormField, ...]:
    """Return the fields of a section; those over a grid become a table."""
    made = {
        name: _field(name, info, None if info.is_required() else info.default, channels=channels)
        for name, info in model.model_fields.items()
        if name not in _PROVENANCE
    }
    over: dict[str, list[str]] = {}
    for name, info in model.model_fields.items():
        if isinstance(info.json_schema_extra, dict) and (grid := info.json_schema_extra.get("over")) is not None:
            over.setdefault(str(grid), []).append(name)
    columns = {name for names in over.values() for name in names}
    return tuple(
        found if name not in over else _table(found, [made[column] for column in over[name]])
        for name, found in made.items()
        if name not in columns
    )


def _table(grid: FormField, columns: list[FormField]) -> FormField:
    return FormField(
        name=grid.name,
        label=columns[0].label,
        description=columns[0].description,
        unit="",
        kind="table",
        fields=(grid, *columns),
        optional=grid.optional,
        only=grid.only,
    )


def _limits(info: FieldInfo) -> tuple[float | None, float | None]:
    metadata = [*info.metadata, *(m for part in [info.annotation] for m in getattr(part, "__metadata__", ()))]
    for part in get_args(info.annotation):
        for entry in getattr(part, "__metadata__", ()):
            metadata += entry.metadata if isinstance(entry, FieldInfo) else [entry]
    low = next((m.gt if isinstance(m, Gt) else m.ge for m in metadata if isinstance(m, Gt | Ge)), None)
    high = next((m.lt if isinstance(m, Lt) else m.le for m in metadata if isinstance(m, Lt | Le)), None)
    for bounds in (getattr(m, "func", None) for m in metadata):
        if isinstance(bounds, Bounds):
            low, high = bounds.lowest, bounds.highest
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
    words = re.sub(
        r"_(um|mm|nm|mv|uv_per_e|deg_per_s|e_per_s|per_s|e|v|percent|dn|us|s|deg|m|hz|lsb|cd_m2|c)$", "", name
    )
    words = words.replace("_", " ")
    shown = {
        "dsnu": "DSNU", "prnu": "PRNU", "dcnu": "DCNU", "f number": "f-number", "cols": "Columns",
        "cfa": "Color filter array", "em gain": "EM gain", "dn per": "DN per electron", "decay pixels": "Decay",
        "charge of": "Charge of capture", "overscan cols": "Overscan columns", "places are": "Places in",
        "zernike": "Zernike coefficients", "max field": "Largest field angle", "k1": "k1", "k2": "k2", "k3": "k3",
        "gain setting is iso": "Settings are ISO speeds", "spread": "Decay length", "gain settings": "Other settings",
    }  # fmt: skip
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
