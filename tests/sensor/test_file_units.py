"""Units of sensor files: conversion, completeness, contradictions, and files written back in their own units."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.sensor.io.sensor_file import dump_sensor, load_sensor, parse_sensor
from photosite.sensor.quantity import Covariance
from photosite.values.uncertain import Measured

FILE = """\
# My camera, from its data sheet
photosite_sensor: 1
name: Mine # the model
array: {rows: 20, cols: 30, cfa: mono}
pixel:
  pitch_um: 3.45 # square
  full_well_e: {value: 10500, standard_uncertainty: 100}
channels:
  M: {wavelength_nm: [400, 500], quantum_efficiency: [0.5, 0.6]}
noise:
  read_noise_e: {value: 2.40, standard_uncertainty: 0.05, source: "page 3"} # at 0 dB
  dsnu_e: 1.1
  prnu_percent: 0.6
  # at 25 degrees
  dark_current_e_per_s: 1.5
  dark_current_temperature_c: 25
readout:
  bits: 12
  system_gain_dn_per_e: {value: 0.39, standard_uncertainty: 0.004} # K
# the end
"""
K, U_K = 0.39, 0.004


def changed(*pairs: tuple[str, str]) -> str:
    text = FILE
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def in_volts(sensor: ps.Sensor) -> str:
    """The same sensor as a file in the model's units."""
    return dump_sensor(ps.Sensor.model_validate(sensor.model_dump()))


def test_values_of_a_data_sheet() -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    assert sensor.pixel.width_um == sensor.pixel.height_um == Measured(3.45)
    assert sensor.pixel.well_capacity_e == Measured(10500.0, 100.0)
    assert sensor.pixel.fill_factor.value == 1.0
    assert sensor.system_gain_dn_per_e == pytest.approx(K)
    assert sensor.pixel.voltage_swing_v.assumed
    assert not sensor.pixel.conversion_gain_uv_per_e.assumed
    noise = sensor.noise
    volts = [noise.read_noise_mv.value, noise.dsnu_mv.value, noise.dark_voltage_mv_per_s.value]
    assert [sensor.electrons(value) for value in volts] == pytest.approx([2.4, 1.1, 1.5])
    assert noise.dark_current_temperature_c == 25
    assert noise.read_noise_mv.source == "page 3"


def test_uncertainties_in_volts_contain_that_of_the_gain() -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    names = ["read_noise_mv", "dsnu_mv", "conversion_gain_uv_per_e"]
    covariance = sensor.covariance_of(names)
    relative = covariance / np.outer(*[[sensor.measured(name).value for name in names]] * 2)
    gain, own = (U_K / K) ** 2, (0.05 / 2.4) ** 2
    np.testing.assert_allclose(relative, [[own + gain, gain, gain], [gain, gain, gain], [gain, gain, gain]], rtol=1e-9)


@pytest.mark.parametrize(
    "pairs",
    [
        [("read_noise_e: {value: 2.40, standard_uncertainty: 0.05", "read_noise_dn: {value: 0.936")],
        [("system_gain_dn_per_e: {value: 0.39, standard_uncertainty: 0.004}", "system_gain_e_per_dn: 2.5641025641")],
        [("dsnu_e: 1.1", "dsnu_dn: 0.429"), ("dark_current_e_per_s: 1.5", "dark_current_dn_per_s: 0.585")],
        [("full_well_e: {", "conversion_gain_uv_per_e: 40\n  well_capacity_e: {")],
        [("full_well_e: {", "conversion_gain_uv_per_e: 40\n  voltage_swing_v: 0.5\n  full_well_e: {")],
        [("pitch_um: 3.45", "width_um: 3.45\n  height_um: 3.45")],
        [("dsnu_e: 1.1", "dsnu_e: 1.1\n  dsnu_dn: 0.43")],
    ],
)
def test_other_units_give_the_same_sensor(pairs: list[tuple[str, str]]) -> None:
    sensor, other = parse_sensor(FILE, "mine.yaml"), parse_sensor(changed(*pairs), "mine.yaml")
    for each in (sensor, other):
        noise = each.noise
        found = [
            each.system_gain_dn_per_e,
            each.pixel.width_um.value,
            each.saturation_capacity_e,
            *map(each.electrons, (noise.read_noise_mv.value, noise.dsnu_mv.value, noise.dark_voltage_mv_per_s.value)),
        ]
        assert found == pytest.approx([K, 3.45, 4095 / K, 2.4, 1.1, 1.5], rel=1e-9)
    assert parse_sensor(dump_sensor(other.with_(serial="2")), "x").measured("read_noise_mv").value == pytest.approx(
        other.noise.read_noise_mv.value
    )


def test_what_the_gain_leaves_open() -> None:
    """Volts are derived from the conversion gain where it is stated; the analog gain where the swing is, too."""
    volts = parse_sensor(changed(("full_well_e:", "conversion_gain_uv_per_e: 40\n  full_well_e:")), "x").pixel
    assert volts.voltage_swing_v.value == pytest.approx(40e-6 * 4096 / K)
    gain = ("system_gain_dn_per_e: {value: 0.39, standard_uncertainty: 0.004}", "black_level_dn: 64")
    swing = ("full_well_e:", "conversion_gain_uv_per_e: 40\n  voltage_swing_v: 0.5\n  full_well_e:")
    assert parse_sensor(changed(gain, swing), "x").system_gain_dn_per_e == pytest.approx(40e-6 * 4096 / 0.5)
    both = ("full_well_e:", "conversion_gain_uv_per_e: 40\n  voltage_swing_v: 0.5\n  full_well_e:")
    assert parse_sensor(changed(both), "x").readout.analog_gain.value == pytest.approx(K * 0.5 / (40e-6 * 4096))


@pytest.mark.parametrize(
    ("old", "new", "what", "where", "at"),
    [
        ("  dsnu_e: 1.1\n", "", "DSNU is missing", "noise", "noise:"),
        ("  full_well_e: {value: 10500, standard_uncertainty: 100}\n", "", "full well is missing", "pixel", "pixel:"),
        ("  system_gain_dn_per_e: {value: 0.39,", "  analog_gain: {value: 1,", "gain is incomplete", "pixel", "pixel:"),
        ("dsnu_e: 1.1", "dsnu_e: 1.1\n  dsnu_dn: 0.70", "dsnu_dn", "noise", "dsnu_dn"),
        ("pitch_um: 3.45", "pitch_um: 3.45\n  width_um: 3.40", "pitch_um", "pixel", "pitch_um"),
        ("  bits: 12", "  bits: 12\n  system_gain_e_per_dn: 2.70", "system_gain_e_per_dn", "readout", "system_gain_e"),
        ("dsnu_e: 1.1", "dsnu_e: -1.1", "value", "noise.dsnu_e", "dsnu_e"),
        ("dsnu_e: 1.1", "dsnu_mv: 0.1", "dsnu_mv", "noise", "dsnu_mv"),
        ("dsnu_e: 1.1", "dsnu_f: 1.1", "unknown field 'dsnu_f'", "noise", "dsnu_f"),
    ],
)
def test_missing_and_contradicting_values(old: str, new: str, what: str, where: str, at: str) -> None:
    text = changed((old, new))
    with raises(FileError, what, path="mine.yaml", where=where) as caught:
        parse_sensor(text, "mine.yaml")
    assert at in text.splitlines()[(caught.value.line or 0) - 1]


def test_values_agree_to_their_digits() -> None:
    exact = ("{value: 0.39, standard_uncertainty: 0.004}", "0.390")
    parse_sensor(changed(exact, ("dsnu_e: 1.1", "dsnu_e: 1.1\n  dsnu_dn: 0.41")), "x")  # 0.429 +- 0.020 +- 0.005
    with raises(FileError, "dsnu_dn") as caught:
        parse_sensor(changed(exact, ("dsnu_e: 1.1", "dsnu_e: 1.100\n  dsnu_dn: 0.41")), "mine.yaml")
    assert "dsnu_e (line 12)" in str(caught.value)


def test_whole_numbers_do_not_hide_contradictions() -> None:
    """100 uV/e- at 12 bits, a swing of 1 V and a gain of 1 are 0.41 DN per electron, not 0.50."""
    text = changed(
        ("full_well_e:", "conversion_gain_uv_per_e: 100\n  voltage_swing_v: 1\n  full_well_e:"),
        ("{value: 0.39, standard_uncertainty: 0.004}", "0.50\n  analog_gain: 1"),
    )
    with raises(FileError, "system_gain_dn_per_e", value=0.5, where="readout", path="mine.yaml"):
        parse_sensor(text, "mine.yaml")
    assert parse_sensor(text.replace("0.50", "0.41"), "x").system_gain_dn_per_e == pytest.approx(0.4096)


def test_unchanged_files_are_written_as_they_were(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(FILE)
    load_sensor(tmp_path / "a.yaml").save(tmp_path / "b.yaml")
    assert (tmp_path / "b.yaml").read_text() == FILE
    preset = load_sensor("nikon-d200")
    assert dump_sensor(preset).startswith("# The Nikon D200 of Farrell")


def test_changed_files_keep_units_and_comments() -> None:
    sensor = parse_sensor(FILE, "mine.yaml")
    quiet = sensor.with_(read_noise_e=Measured(1.2, 0.01, "measured"), black_level_dn=64)
    lines = dump_sensor(quiet).splitlines()
    before = FILE.splitlines()
    assert [line for line in lines if line not in before] == [
        "  read_noise_e: {value: 1.2, standard_uncertainty: 0.01, source: measured}  # at 0 dB",
        "  black_level_dn: 64.0",
    ]
    assert [line for line in before if line not in lines] == [before[10]]
    again = parse_sensor("\n".join(lines), "x")
    assert again.measured("read_noise_mv").value == pytest.approx(quiet.measured("read_noise_mv").value, rel=1e-9)


def test_pixels_that_are_no_longer_square() -> None:
    sensor = parse_sensor(FILE, "mine.yaml").with_(height_um=6.9)
    again = parse_sensor(dump_sensor(sensor), "x")
    assert (again.pixel.width_um.value, again.pixel.height_um.value) == (3.45, 6.9)
    assert "pitch_um" not in dump_sensor(sensor)


def test_correlations_in_both_units() -> None:
    """A read noise that was measured in volts is correlated with the system gain when it is written in electrons."""
    sensor = parse_sensor(FILE, "mine.yaml")
    names = ("read_noise_mv", "conversion_gain_uv_per_e")
    measured = sensor.with_(
        read_noise_mv=Measured(0.23, 0.002),
        conversion_gain_uv_per_e=Measured(95.0, 1.0),
        covariance=Covariance(names=names, correlation=((1.0, 0.3), (0.3, 1.0))),
    )
    again = parse_sensor(dump_sensor(measured), "x")
    np.testing.assert_allclose(again.covariance_of(names), measured.covariance_of(names), rtol=1e-5)
    electrons = 0.23 / 0.095
    variance = (0.002 / 0.23) ** 2 + (1 / 95) ** 2 - 2 * 0.3 * (0.002 / 0.23) * (1 / 95)
    written = f"read_noise_e: {{value: {electrons:.12g}, standard_uncertainty: {electrons * variance**0.5:.6g}}}"
    assert written in dump_sensor(measured)


def test_changes_in_other_units() -> None:
    d200 = ps.load_sensor("nikon-d200")
    changed_ = d200.with_(read_noise_e=10, pitch_um=5, system_gain_e_per_dn=4)
    assert changed_.electrons(changed_.noise.read_noise_mv.value) == pytest.approx(10)
    assert (changed_.pixel.width_um.value, changed_.pixel.height_um.value) == (5, 5)
    assert changed_.system_gain_dn_per_e == pytest.approx(0.25)
    assert changed_.pixel.conversion_gain_uv_per_e == d200.pixel.conversion_gain_uv_per_e
    by_gain = ps.load_sensor("sony-imx174")  # no volts
    with raises(InputError, "read_noise_mv", where="noise", value=0.2):
        by_gain.with_(read_noise_mv=0.2)
    assert by_gain.with_(read_noise_mv=0, dsnu_mv=0).noise.read_noise_mv.value == 0
    in_volts = by_gain.with_(read_noise_mv=0.2, conversion_gain_uv_per_e=50)
    assert in_volts.electrons(in_volts.noise.read_noise_mv.value) == pytest.approx(4)
    with raises(InputError, "a sensor has no field 'read_noise_el'"):
        d200.with_(read_noise_el=1)


def test_schema_describes_every_field() -> None:
    """Every property has a description, a unit and an example, and the examples are valid."""
    schema = json.loads(json.dumps(ps.Sensor.model_json_schema()))
    found: dict[str, dict[str, object]] = {}

    def walk(node: object, path: str) -> None:
        if isinstance(node, dict):
            for name, field in node.get("properties", {}).items() if node.get("type") == "object" else ():
                found[f"{path}.{name}"] = field
            for key, part in node.items():
                walk(part, f"{path}.{key}")
        elif isinstance(node, list):
            for part in node:
                walk(part, path)

    walk(schema, "")
    assert {path.rpartition(".")[2] for path in found} >= {"read_noise_mv", "read_noise_e", "pitch_um", "split_x_um"}
    for path, field in found.items():
        assert field.get("description"), path
        assert field.get("unit"), path
        assert field.get("examples"), path
    example = {name: field["examples"][0] for name, field in schema["properties"].items() if name not in ("maps",)}
    example["optical_stack"], example["covariance"] = None, None
    assert ps.Sensor.model_validate(example).pixel.width_um.value == 3.45
