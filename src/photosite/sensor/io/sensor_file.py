"""Sensor files: YAML in, YAML out, and the presets that ship."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from importlib import resources
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.atomic import atomic_path
from photosite.files.yaml import dump_yaml, line_of, parse_yaml, read_yaml
from photosite.sensor.covariance import Covariance
from photosite.sensor.model import Array, Channel, Maps, Noise, Pixel, Provenance, Readout, Sensor
from photosite.sensor.optical_stack import AngularResponse, Crosstalk, LowPassFilter, OpticalStack, Transmittance

_SUFFIX = ".sensor.yaml"
_SECTIONS: dict[str, type[BaseModel]] = {
    "array": Array,
    "pixel": Pixel,
    "noise": Noise,
    "readout": Readout,
    "optical_stack": OpticalStack,
    "provenance": Provenance,
    "maps": Maps,
    "covariance": Covariance,
}
_STACK: dict[str, type[BaseModel]] = {
    "infrared_filter": Transmittance,
    "cover_glass": Transmittance,
    "low_pass_filter": LowPassFilter,
    "angular_response": AngularResponse,
    "crosstalk": Crosstalk,
}


def preset_names() -> tuple[str, ...]:
    """The sensors that ship with photosite, by name.

    Examples
    --------
    >>> preset_names()
    ('nikon-d200', 'vendor-1.4um', 'vendor-2.2um')
    """
    folder = resources.files("photosite.sensor") / "presets"
    return tuple(sorted(f.name.removesuffix(_SUFFIX) for f in folder.iterdir() if f.name.endswith(_SUFFIX)))


def load_sensor(name_or_path: str | PathLike[str]) -> Sensor:
    """A sensor from a preset's name or a sensor file.

    Parameters
    ----------
    name_or_path
        A preset's name, or the path of a YAML file. What ends in .yaml or .yml or holds a separator is a path.

    Raises
    ------
    InputError
        If there is no such preset.
    FileError
        If the file is missing, is not YAML, or does not describe a sensor; with the line.

    Examples
    --------
    >>> load_sensor("nikon-d200").pixel.width_um.value
    6.05
    """
    text = fspath(name_or_path)
    if not text:
        raise InputError(f"a sensor needs a name, and this one is empty; presets are: {', '.join(preset_names())}")
    path = Path(text)
    if (
        isinstance(name_or_path, str)
        and path.suffix not in (".yaml", ".yml")
        and path.name == text
        and not path.exists()
    ):
        names = preset_names()
        if text not in names:
            raise InputError(f"unknown sensor '{text}'; presets are: {', '.join(names)}; a file's name ends in .yaml")
        return _load_preset(text)
    return _sensor_of(read_yaml(path, "a sensor file"), path)


@lru_cache(maxsize=8)
def _load_preset(name: str) -> Sensor:
    file = resources.files("photosite.sensor") / "presets" / f"{name}{_SUFFIX}"
    return parse_sensor(file.read_text(encoding="utf-8"), f"{name}{_SUFFIX}")


def parse_sensor(content: str, path: str | PathLike[str]) -> Sensor:
    """A sensor from a sensor file's text; `path` is what errors call it.

    Raises
    ------
    FileError
        If the text is not YAML or does not describe a sensor; with the line.
    """
    return _sensor_of(parse_yaml(content, path), path)


def _sensor_of(data: Any, path: str | PathLike[str]) -> Sensor:
    if not isinstance(data, dict):
        raise FileError(path, "does not describe a sensor: expected 'photosite_sensor: 1' and the sensor's fields")
    if data.get("photosite_sensor") != 1:
        raise FileError(
            path,
            f"expected 'photosite_sensor: 1' (the file format's version), got {data.get('photosite_sensor')!r}",
            _line(data, ("photosite_sensor",)),
        )
    try:
        sensor = Sensor.model_validate(data)
    except ValidationError as error:
        # A misspelt field is also a missing one; the misspelling is what helps.
        found = error.errors()
        first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
        raise FileError(path, _explain(first), _line(data, first["loc"])) from None
    if sensor.maps is None:
        return sensor
    # Absolute from here on, so that a sensor may be handed around and saved elsewhere; a folder's name stays as given.
    full = Path(path).absolute().parent / sensor.maps.file
    return sensor.model_copy(update={"maps": Maps(file=fspath(full), sha256=sensor.maps.sha256)})


def _explain(error: Any) -> str:
    *parents, last = error["loc"] or ("the file",)
    section = ".".join(str(part) for part in parents)
    match error["type"]:
        case "extra_forbidden":
            known = list(_home(parents).model_fields)
            where = f"in {section}" if section else "at the top"
            return f"unknown field '{last}' {where}; {did_you_mean(str(last), known)}"
        case "missing":
            return f"field '{last}' is missing" + (f" from {section}" if section else "")
    message = str(error["msg"]).removeprefix("Value error, ")
    place = ".".join(str(part) for part in error["loc"])
    return f"{place}: {message}" if place else message


def _home(parents: Sequence[str | int]) -> type[BaseModel]:
    """The model of a section of the file."""
    if not parents:
        return Sensor
    if parents[0] == "optical_stack" and len(parents) > 1:
        return _STACK[str(parents[1])]
    return Channel if parents[0] == "channels" else _SECTIONS[str(parents[0])]


def _line(data: Any, location: Sequence[str | int]) -> int | None:
    """Line of the deepest part of the location that the file has."""
    line: int | None = None
    for part in location:
        if (found := line_of(data, part)) is None:
            break
        line = found
        data = data[part]
    return line


def write_sensor(sensor: Sensor, path: str | PathLike[str]) -> None:
    """Write a sensor file, whole or not at all. A measured chip's maps go with it: first a copy of them, then the file.

    Raises
    ------
    FileError
        If it cannot be written, or the maps it names are missing or changed.
    """
    if sensor.maps is not None:
        from photosite.sensor.io.maps_file import copy_maps

        sensor = sensor.model_copy(update={"maps": copy_maps(sensor.maps, Path(path))})
    with atomic_path(path) as temporary:
        temporary.write_text(dump_sensor(sensor), encoding="utf-8")


def dump_sensor(sensor: Sensor) -> str:
    """A sensor file's text; `parse_sensor` gives the same sensor back.

    Examples
    --------
    >>> sensor = load_sensor("vendor-2.2um")
    >>> parse_sensor(dump_sensor(sensor), "again.yaml") == sensor
    True
    """
    # Provenance's hashes and whatever nobody set stay out: the file says what is known.
    return dump_yaml(sensor.model_dump(mode="json", exclude_none=True))
