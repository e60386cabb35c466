"""`photosite sensors`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import photosite as ps
from photosite.sensor.io.sensor_file import preset_names


def test_lists_every_preset(photosite: Any) -> None:
    assert set(photosite("sensors", "--json").json["sensors"]) == set(preset_names())
    lines = photosite("sensors").out.splitlines()
    assert len(lines) == 1 + len(preset_names())


def test_list_is_what_no_subcommand_does(photosite: Any) -> None:
    assert photosite("sensors", "list").out == photosite("sensors").out != ""
    assert photosite("sensors", "list", "--json").json == photosite("sensors", "--json").json


def test_show_is_a_sensor_file(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "again.sensor.yaml"
    file.write_text(photosite("sensors", "show", "nikon-d200").out, encoding="utf-8")
    assert ps.load_sensor(file) == ps.load_sensor("nikon-d200")
    assert photosite("sensors", "show", file, "--json").json["pixel"]["width_um"]["value"] == 6.05


def test_schema_names_the_fields(photosite: Any) -> None:
    schema = json.loads(photosite("sensors", "schema").out)
    assert {"array", "pixel", "channels", "noise", "readout"} <= set(schema["required"])
    assert "fill_factor" in schema["$defs"]["Pixel"]["properties"]


def test_check(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.sensor.yaml"
    assert photosite("sensors", "export", "vendor-2.2um", "-o", file, "--json").json["sensor"] == str(file)
    checked = photosite("sensors", "check", file, "--json").json
    assert "pixel.conversion_gain_uv_per_e" in checked["assumed"]
    assert "pixel.fill_factor" not in checked["assumed"]


def test_export_overwrites_nothing(photosite: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.sensor.yaml"
    file.write_text("mine", encoding="utf-8")
    refused = photosite("sensors", "export", "nikon-d200", "-o", file)
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert file.read_text(encoding="utf-8") == "mine"
