"""Correlations in sensor files: round trip and validation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.sensor.quantity import Covariance
from photosite.values.uncertain import Measured

NAMES = ("read_noise_mv", "conversion_gain_uv_per_e", "voltage_swing_v")
CORRELATION = ((1.0, 0.25, -0.5), (0.25, 1.0, 0.125), (-0.5, 0.125, 1.0))


@pytest.fixture
def sensor() -> ps.Sensor:
    return ps.load_sensor("nikon-d200").with_(
        read_noise_mv=Measured(0.52, 0.01),
        conversion_gain_uv_per_e=Measured(30.0, 0.2),
        voltage_swing_v=Measured(1.08, 0.02),
        covariance=Covariance(names=NAMES, correlation=CORRELATION),
    )


def test_round_trip(sensor: ps.Sensor, tmp_path: Path) -> None:
    sensor.save(tmp_path / "mine.sensor.yaml")
    again = ps.load_sensor(tmp_path / "mine.sensor.yaml")
    assert again == sensor
    u = np.array([0.01, 0.2, 0.02])
    np.testing.assert_allclose(again.covariance_of(NAMES), np.array(CORRELATION) * np.outer(u, u), rtol=1e-15)
    assert again.covariance_of(["read_noise_mv", "dsnu_mv"])[0, 1] == 0.0


def test_sensors_without_correlations(tmp_path: Path) -> None:
    plain = ps.load_sensor("nikon-d200")
    plain.save(tmp_path / "plain.sensor.yaml")
    assert "covariance" not in (tmp_path / "plain.sensor.yaml").read_text()
    assert plain.covariance_of(["read_noise_mv"]).tolist() == [[0.0]]


def test_a_changed_value_is_independent(sensor: ps.Sensor) -> None:
    changed = sensor.with_(read_noise_mv=Measured(0.6, 0.03))
    assert changed.covariance is not None
    assert changed.covariance.names == NAMES[1:]
    assert changed.covariance_of(NAMES)[0].tolist() == pytest.approx([0.0009, 0.0, 0.0])
    assert changed.with_(voltage_swing_v=1.0).covariance is None
    assert sensor.with_(serial="8").covariance == sensor.covariance


def test_schema() -> None:
    schema = ps.Sensor.model_json_schema()
    assert set(schema["$defs"]["Covariance"]["properties"]) == {"names", "correlation"}
    assert "covariance" not in schema["required"]


@pytest.mark.parametrize(
    ("names", "correlation", "what"),
    [
        ("[read_noise_mv, dsnu_mv]", "[[1, 0.5]]", "correlation"),
        ("[read_noise_mv, dsnu_mv]", "[[1, 0.5], [0.4, 1]]", "correlation"),
        ("[read_noise_mv, dsnu_mv]", "[[2, 0.5], [0.5, 1]]", "correlation"),
        ("[read_noise_mv, dsnu_mv]", "[[0.5, 0.5], [0.5, 1]]", "correlation"),
        ("[read_noise_mv, dsnu_mv]", "[[1, .nan], [.nan, 1]]", "correlation"),
        ("[read_noise_mv, dsnu_mv]", "[[1, x], [x, 1]]", "correlation[0][1]"),
        ("[read_noise_mv, read_noise_mv]", "[[1, 0], [0, 1]]", "names"),
        ("[read_noise_mv]", "[[1]]", "names"),
        ("[read_noise_mv, dsnu]", "[[1, 0], [0, 1]]", "a sensor has no value 'dsnu'"),
        ("[read_noise_mv, bits]", "[[1, 0], [0, 1]]", "a sensor has no value 'bits'"),
        ("[read_noise_mv, dsnu_mv, prnu_percent]", "[[1, .9, .9], [.9, 1, -.9], [.9, -.9, 1]]", "correlation"),
        ("[read_noise_mv, dsnu_mv]\n  matrix: 1", "[[1, 0], [0, 1]]", "unknown field 'matrix'"),
    ],
)
def test_invalid_correlations(tmp_path: Path, names: str, correlation: str, what: str) -> None:
    file = tmp_path / "mine.sensor.yaml"
    ps.load_sensor("vendor-2.2um").save(file)
    file.write_text(file.read_text() + f"covariance:\n  names: {names}\n  correlation: {correlation}\n")
    with raises(FileError, what):
        ps.load_sensor(file)


def test_unknown_values(sensor: ps.Sensor) -> None:
    with raises(InputError, "a sensor has no value 'rows'"):
        sensor.covariance_of(["rows"])
