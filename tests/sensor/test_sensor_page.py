"""The page on sensor files: its example loads, and its tables are those of the schema."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

import photosite as ps
from photosite.sensor.io.sensor_file import dump_sensor, parse_sensor
from photosite.sensor.quantity import Quantity

PAGE = (Path(__file__).parents[2] / "docs" / "formats" / "sensor.md").read_text(encoding="utf-8")
SCHEMA = ps.Sensor.model_json_schema()
GAINS = {"conversion_gain_uv_per_e", "voltage_swing_v", "system_gain_dn_per_e", "system_gain_e_per_dn"}


def rows_of(schema: dict[str, Any]) -> list[str]:
    """The rows of a table of fields."""
    schema = schema if "properties" in schema else next(part for part in schema["anyOf"] if "properties" in part)
    choices = {name for group in schema.get("allOf", ()) for choice in group["anyOf"] for name in choice["required"]}
    rows = []
    for name, field in schema["properties"].items():
        default = field.get("default")
        required = name in schema.get("required", ())
        text = "required" if required else "one of" if name in choices | GAINS else ""
        if not text and default is not None and default != [] and not isinstance(default, dict):
            text = f"`{default:g}`" if isinstance(default, float) else f"`{json.dumps(default)}`"
        unit = "" if field["unit"] == "none" else field["unit"]
        rows.append(f"| `{name}` | {unit} | {text} | {field['description']} |")
    return rows


@pytest.mark.parametrize("name", ["", "Quantity", *SCHEMA["$defs"]])
def test_tables_are_those_of_the_schema(name: str) -> None:
    schema = SCHEMA["$defs"].get(name) or (Quantity.model_json_schema() if name else SCHEMA)
    assert "\n".join(rows_of(schema)) in PAGE


def test_example_is_a_sensor_file() -> None:
    example = next(
        block for block in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if "photosite_sensor: 1" in block
    )
    sensor = parse_sensor(example, "example.sensor.yaml")
    assert sensor.electrons(sensor.noise.read_noise_mv.value) == pytest.approx(2.4)
    assert dump_sensor(sensor) == example
    assert "read_noise_e: {value: 1.2," in dump_sensor(sensor.with_(read_noise_e=ps.Measured(1.2, 0.1)))
