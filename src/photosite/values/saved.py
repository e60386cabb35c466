"""How values write themselves: the one place where they name the writers of their file formats."""

from __future__ import annotations

from os import PathLike
from pkgutil import resolve_name
from typing import Any

_WRITERS = {
    "DiffractionLimited": "photosite.optics.io.optics_file:write_optics",
    "Lens": "photosite.optics.io.optics_file:write_optics",
    "MeasuredChip": "photosite.sensor.io.sensor_file:write_maps",
    "RawFrame": "photosite.frames.io.formats:write_raw",
    "Scene": "photosite.scene.io.formats:write_scene",
    "Sensor": "photosite.sensor.io.sensor_file:write_sensor",
}
"""Function that writes a type, by the name of the type: module:function."""


def write(value: object, path: str | PathLike[str], *options: Any) -> Any:
    """Write a value to a file; raise as its writer does."""
    writer = next(_WRITERS[base.__name__] for base in type(value).__mro__ if base.__name__ in _WRITERS)
    return resolve_name(writer)(value, path, *options)
