"""Sensor files: YAML, and the presets."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from photosite.errors import InputError
from photosite.files.atomic import atomic_path
from photosite.files.yaml import check_version, dump_yaml, parse_yaml, read_yaml, validated
from photosite.sensor.io.maps_file import copy_maps
from photosite.sensor.model import Maps, Sensor

_SUFFIX = ".sensor.yaml"


def preset_names() -> tuple[str, ...]:
    """Return the names of the built-in sensors.

    Examples
    --------
    >>> preset_names()
    ('nikon-d200', 'vendor-1.4um', 'vendor-2.2um')
    """
    folder = resources.files("photosite.sensor") / "presets"
    return tuple(sorted(f.name.removesuffix(_SUFFIX) for f in folder.iterdir() if f.name.endswith(_SUFFIX)))


def load_sensor(name_or_path: str | PathLike[str]) -> Sensor:
    """Load a sensor from a preset or a sensor file.

    Parameters
    ----------
    name_or_path
        A preset's name, or the path of a YAML file. A name with the suffix .yaml or .yml or with a separator is a path.

    Raises
    ------
    InputError
        If there is no such preset.
    FileError
        If the file is missing, is not YAML, or is not a valid sensor file; with the line.

    Examples
    --------
    >>> load_sensor("nikon-d200").pixel.width_um.value
    6.05
    """
    text = fspath(name_or_path)
    path = Path(text)
    is_path = not isinstance(name_or_path, str) or path.suffix in (".yaml", ".yml") or path.name != text
    if text and (is_path or path.exists()):
        return _sensor_from(read_yaml(path, "a sensor file"), path)
    names = preset_names()
    if text not in names:
        expected = "a preset or a file with the suffix .yaml"
        raise InputError("sensor", value=text, expected=expected, hint=f"Presets are {', '.join(names)}")
    return _load_preset(text)


@lru_cache(maxsize=8)
def _load_preset(name: str) -> Sensor:
    file = resources.files("photosite.sensor") / "presets" / f"{name}{_SUFFIX}"
    return parse_sensor(file.read_text(encoding="utf-8"), f"{name}{_SUFFIX}")


def parse_sensor(content: str, path: str | PathLike[str]) -> Sensor:
    """Return the sensor of a sensor file's text; a `FileError` names the path and the line."""
    return _sensor_from(parse_yaml(content, path), path)


def _sensor_from(data: Any, path: str | PathLike[str]) -> Sensor:
    check_version(path, data, "photosite_sensor")
    sensor: Sensor = validated(Sensor, data, path)
    if sensor.maps is None:
        return sensor
    # An absolute path, so that the sensor can be saved elsewhere.
    full = Path(path).absolute().parent / sensor.maps.file
    return sensor.model_copy(update={"maps": Maps(file=fspath(full), sha256=sensor.maps.sha256)})


def write_sensor(sensor: Sensor, path: str | PathLike[str]) -> None:
    """Write a sensor file, with the maps of a measured chip beside it.

    Raises
    ------
    FileError
        If it cannot be written, or its maps are missing or changed.
    """
    if sensor.maps is not None:
        sensor = sensor.model_copy(update={"maps": copy_maps(sensor.maps, Path(path))})
    with atomic_path(path) as temporary:
        temporary.write_text(dump_sensor(sensor), encoding="utf-8")


def dump_sensor(sensor: Sensor) -> str:
    """Return a sensor file's text; `parse_sensor` returns the same sensor."""
    return dump_yaml(sensor.model_dump(mode="json", exclude_none=True))
