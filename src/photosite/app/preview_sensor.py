"""The sensor of a preview: it has the size of the view, without effects that depend on places in the array."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from typing import Any

from photosite.app.kept_scenes import add_kept
from photosite.app.state import PreparedState
from photosite.sensor.model import Sensor


def with_sensor_size(found: PreparedState, rows: int, cols: int, notes: list[str]) -> PreparedState:
    """Return a state with a sensor of another size."""
    return PreparedState(
        found.state, replace(found.camera, sensor=of_size(found.camera.sensor, rows, cols, notes)), found.request
    )


_of_sizes: OrderedDict[tuple[int, int, int], tuple[Sensor, Sensor, list[str]]] = OrderedDict()


def of_size(sensor: Sensor, rows: int, cols: int, notes: list[str]) -> Sensor:
    """Return the sensor with the view's number of pixels; effects that depend on places in the array are left out."""
    key = (id(sensor), rows, cols)
    if key not in _of_sizes:
        left_out: list[str] = []
        add_kept(_of_sizes, key, (sensor, _resized(sensor, rows, cols, left_out), left_out))
    _, found, left_out = _of_sizes[key]
    notes += left_out
    return found


def _resized(sensor: Sensor, rows: int, cols: int, notes: list[str]) -> Sensor:
    changes: dict[str, Any] = {"rows": rows, "cols": cols}
    if sensor.maps is not None:
        changes["maps"] = None
        notes.append("the preview draws the fixed pattern in place of the measured maps")
    if sensor.effects is None:
        return sensor.with_(**changes)
    placed = {name: None for name, section in sensor.effects.stated.items() if section.placed}
    if placed:
        notes.append(f"the preview is without {', '.join(placed).replace('_', ' ')}")
    return sensor.with_(**placed, **changes)
