"""Sensor files: presets, round trips, and errors with section and line."""

from __future__ import annotations

import csv
import json
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from raising import raises
from ruamel.yaml import YAML

from photosite.errors import FileError, InputError
from photosite.sensor.io.sensor_file import dump_sensor, load_sensor, parse_sensor, preset_names
from photosite.sensor.model import Sensor
from photosite.sensor.quantity import is_number
from photosite.values.uncertain import Measured

D200_TABLE_1 = {
    ("pixel", "width_um"): 6.05,
    ("pixel", "height_um"): 6.05,
    ("pixel", "fill_factor"): 0.9,
    ("pixel", "conversion_gain_uv_per_e"): 30,
    ("pixel", "voltage_swing_v"): 1.08,
    ("pixel", "well_capacity_e"): 36000,
    ("noise", "read_noise_mv"): 0.52,
    ("noise", "dsnu_mv"): 0.55,
    ("noise", "prnu_percent"): 1.126,
    ("noise", "dark_voltage_mv_per_s"): 0,
}
VENDOR_TABLE_1 = {
    ("pixel", "width_um"): 2.2,
    ("pixel", "fill_factor"): 0.5,
    ("noise", "read_noise_mv"): 4.58,
    ("noise", "dsnu_mv"): 6,
    ("noise", "prnu_percent"): 1.7,
    ("noise", "dark_voltage_mv_per_s"): 0,
}


@pytest.mark.parametrize(("preset", "table"), [("nikon-d200", D200_TABLE_1), ("vendor-2.2um", VENDOR_TABLE_1)])
def test_presets_have_the_values_of_the_papers_table_1(preset: str, table: dict[tuple[str, str], float]) -> None:
    sensor = load_sensor(preset)
    for (section, field), value in table.items():
        quantity = getattr(getattr(sensor, section), field)
        assert quantity.value == value
        assert "Table 1" in quantity.source
        assert not quantity.assumed


def test_d200_gain_matches_the_paper() -> None:
    sensor = load_sensor("nikon-d200")
    assert 1 / sensor.system_gain_dn_per_e == pytest.approx(7.98, rel=1e-5)
    assert (sensor.array.rows, sensor.array.cols, sensor.readout.bits) == (2592, 3872, 12)
    assert sensor.array.cfa == (("R", "G"), ("G", "B"))


def test_vendor_presets_mark_assumed_values() -> None:
    vendor, small = load_sensor("vendor-2.2um"), load_sensor("vendor-1.4um")
    assert (vendor.array.rows, vendor.array.cols, vendor.array.cfa[0]) == (1536, 2048, ("G", "B"))
    for sensor in (vendor, small):
        assert sensor.pixel.conversion_gain_uv_per_e.assumed
        assert sensor.pixel.voltage_swing_v.assumed
        assert sensor.pixel.well_capacity_e.assumed
        assert sensor.readout.analog_gain.assumed
    assert small.pixel.width_um.value == 1.4
    assert small.noise.read_noise_mv.value == vendor.noise.read_noise_mv.value


@pytest.mark.parametrize("name", preset_names())
def test_every_value_of_a_preset_has_a_source(name: str) -> None:
    sensor = load_sensor(name)
    for section in (sensor.pixel, sensor.noise, sensor.readout):
        for field in type(section).model_fields:
            quantity = getattr(section, field)
            if isinstance(quantity, Measured) and field in section.model_fields_set:
                assert quantity.source, f"{name}: {field}"
    assert all(channel.source for channel in sensor.channels.values())


def test_d200_spectra_are_the_reference_scaled(d200_sensitivity: Path) -> None:
    with d200_sensitivity.open() as lines:
        rows = list(csv.reader(line for line in lines if not line.startswith("#")))[1:]
    table = {float(row[0]): [float(x) for x in row[1:]] for row in rows}
    sensor = load_sensor("nikon-d200")
    ratios = []
    for column, name in enumerate("RGB"):
        channel = sensor.channels[name]
        assert channel.wavelength_nm == tuple(range(380, 781, 10))
        figures = np.array([table[w][column] for w in channel.wavelength_nm])
        ratios.append(np.array(channel.quantum_efficiency)[figures > 0.1] / figures[figures > 0.1])
    assert np.ptp(np.concatenate(ratios)) < 1e-5


def leaves(node: Any, path: str = "") -> dict[str, Any]:
    """Values by their place, for a comparison of numbers within rounding."""
    if isinstance(node, dict):
        return {key: leaf for name, part in node.items() for key, leaf in leaves(part, f"{path}.{name}").items()}
    if isinstance(node, list | tuple):
        return {key: leaf for n, part in enumerate(node) for key, leaf in leaves(part, f"{path}[{n}]").items()}
    return {path: node}


@pytest.mark.parametrize("name", preset_names())
def test_round_trip(name: str, tmp_path: Path) -> None:
    preset = load_sensor(name)
    sensor = preset.with_(
        read_noise_mv=Measured(0.1 + 0.2, 1e-3, "150 darks", assumed=False),
        conversion_gain_uv_per_e=preset.pixel.conversion_gain_uv_per_e,  # the volts of the noise
        frames_sha256=("ab", "cd"),
    )
    sensor.save(tmp_path / "mine.sensor.yaml")
    again = load_sensor(tmp_path / "mine.sensor.yaml")
    found, expected = leaves(again.model_dump()), leaves(sensor.model_dump())
    assert {key: type(leaf) if is_number(leaf) else leaf for key, leaf in found.items()} == {
        key: type(leaf) if is_number(leaf) else leaf for key, leaf in expected.items()
    }
    numbers = [key for key, leaf in expected.items() if is_number(leaf)]
    assert [found[key] for key in numbers] == pytest.approx([expected[key] for key in numbers], rel=1e-5)
    if "pitch_um:" not in dump_sensor(load_sensor(name)):  # in the units of the model, hence without conversion
        assert again == sensor


def test_numbers_with_an_exponent() -> None:
    """YAML 1.1 reads 1e-3 as text; 1.2 does not."""
    text = dump_sensor(load_sensor("nikon-d200")).replace("value: 0.52", "value: 1e-3")
    assert parse_sensor(text, "x.yaml").noise.read_noise_mv.value == 1e-3


WRONG = [
    ("fill_factor:", "fil_factor:", "unknown field 'fil_factor'", "pixel", "fil_factor"),
    ("noise:", "nois:", "unknown field 'nois'", None, "nois"),
    ("value: 0.52,", "valu: 0.52,", "unknown field 'valu'", "noise.read_noise_mv", "read_noise_mv"),
    ("value: 0.52,", "value: -0.52,", "value", "noise.read_noise_mv", "read_noise_mv"),
    ("value: 0.52,", "value: .nan,", "value", "noise.read_noise_mv", "read_noise_mv"),
    ("value: 0.52,", "value: [1],", "value", "noise.read_noise_mv", "read_noise_mv"),
    ("value: 0.9,", "value: 9,", "value", "pixel.fill_factor", "fill_factor"),
    ("value: 1.126,", "value: 40,", "value", "noise.prnu_percent", "prnu_percent"),
    ("bits: 12", "bits: 12.5", "bits", "readout", "bits:"),
    ("bits: 12", "bits: 40", "bits", "readout", "bits:"),
    ("[R, G], [G, B]", "[R, G], [G, X]", "X of array.cfa is missing", "channels", None),
    ("[380, 390,", "[390, 380,", "the entries", "channels.R.wavelength_nm", "wavelength_nm:"),
    ("[380, 390,", "[390,", "quantum_efficiency", "channels.R", "quantum_efficiency:"),
    ("photosite_sensor: 1", "photosite_sensor: 2", "photosite_sensor", None, "photosite_sensor"),
]


@pytest.mark.parametrize(("old", "new", "what", "where", "at"), WRONG)
def test_invalid_fields(old: str, new: str, what: str, where: str | None, at: str | None) -> None:
    source = resources.files("photosite.sensor") / "presets" / "nikon-d200.sensor.yaml"
    lines = source.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if old in line and not line.startswith("#"))
    lines[first] = lines[first].replace(old, new, 1)
    with raises(FileError, what, path="mine.yaml", where=where) as caught:
        parse_sensor("\n".join(lines), "mine.yaml")
    if at is not None:
        assert caught.value.line is not None
        assert at in lines[caught.value.line - 1]


@pytest.mark.parametrize("content", ["", "- 1\n"])
def test_files_of_another_kind(content: str) -> None:
    with raises(FileError, "is not a sensor file"):
        parse_sensor(content, "x.yaml")


def test_missing_field_and_missing_file(tmp_path: Path) -> None:
    text = "\n".join(line for line in dump_sensor(load_sensor("nikon-d200")).splitlines() if "bits:" not in line)
    with raises(FileError, "field 'bits' is missing", where="readout"):
        parse_sensor(text, "x.yaml")
    with pytest.raises(FileError):
        load_sensor(tmp_path / "none.yaml")


@pytest.mark.parametrize("name", ["nikon-d300", ""])
def test_unknown_presets(name: str) -> None:
    with raises(InputError, "sensor", value=name):
        load_sensor(name)


def test_schema_describes_the_file() -> None:
    schema = json.loads(json.dumps(Sensor.model_json_schema()))
    validator = jsonschema.Draft202012Validator(schema)
    validator.check_schema(schema)
    for name in preset_names():
        assert not list(validator.iter_errors(YAML(typ="safe").load(dump_sensor(load_sensor(name))))), name
    for section, field in (("noise", "dsnu_e"), ("readout", "system_gain_e_per_dn"), ("pixel", "pitch_um")):
        incomplete = YAML(typ="safe").load(dump_sensor(load_sensor("sony-imx174")))
        del incomplete[section][field]
        assert list(validator.iter_errors(incomplete)), field
    assert set(schema["required"]) == {"name", "array", "pixel", "channels", "noise", "readout"}
    assert schema["$defs"]["Noise"]["properties"]["read_noise_mv"]["anyOf"][0] == {"type": "number"}


@pytest.mark.parametrize("name", preset_names())
def test_assumed_values_of_presets_are_marked(name: str) -> None:
    sensor = load_sensor(name)
    entries = [entry for section in (sensor.pixel, sensor.noise, sensor.readout) for _, entry in section]
    for entry in (*entries, *sensor.channels.values()):
        source = getattr(entry, "source", None) or ""
        assert entry.assumed if source.startswith("assum") else True, source  # type: ignore[union-attr]
    assert sensor.provenance.source


PUBLISHED = [
    ("sony-imx174", None, {"electrons_per_dn": 8.16, "read_noise_e": 6.83, "saturation_e": 32691}),
    ("google-pixel-4a", 55, {"saturation_e": (1023 - 64) * 0.44875e-3 / (1023 * 0.44875e-3 / 6000), "read_noise_e": 5}),
    ("raspberry-pi-hq", 1, {"electrons_per_dn": 1 / 0.47, "read_noise_e": 1.53 / 0.47, "saturation_e": 8180}),
    ("raspberry-pi-hq", 16, {"electrons_per_dn": 1 / 7.52, "read_noise_e": 1.53}),
    ("sony-imx571", None, {"electrons_per_dn": 0.76, "saturation_e": 50000}),
    ("sony-a7r2", 100, {"electrons_per_dn": 1 / 0.315, "read_noise_e": 1.413 / 0.315}),
    ("sony-a7r2", 640, {"electrons_per_dn": 1 / (6.35 * 0.315), "read_noise_e": 2.418 / (6.35 * 0.315)}),
]


@pytest.mark.parametrize(("name", "setting", "published"), PUBLISHED)
def test_presets_have_the_published_figures(name: str, setting: float | None, published: dict[str, float]) -> None:
    sensor = load_sensor(name)
    sensor = sensor if setting is None else sensor.at_gain_setting(setting)
    found = {
        "electrons_per_dn": 1.0 / sensor.system_gain_dn_per_e,
        "read_noise_e": sensor.electrons(sensor.noise.read_noise_mv.value),
        "saturation_e": sensor.saturation_capacity_e,
    }
    assert {key: found[key] for key in published} == pytest.approx(published, rel=0.015)
