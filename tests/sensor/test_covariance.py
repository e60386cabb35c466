"""Correlations in sensor files: what is written comes back, and what cannot be is refused with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.sensor.covariance import Covariance
from photosite.values.measured import Measured

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


def test_a_sensor_without_one_stays_without(tmp_path: Path) -> None:
    plain = ps.load_sensor("nikon-d200")
    plain.save(tmp_path / "plain.sensor.yaml")
    assert "covariance" not in (tmp_path / "plain.sensor.yaml").read_text()
    assert plain.covariance_of(["read_noise_mv"]).tolist() == [[0.0]]


def test_a_value_that_is_changed_is_independent(sensor: ps.Sensor) -> None:
    changed = sensor.with_(read_noise_mv=Measured(0.6, 0.03))
    assert changed.covariance is not None
    assert changed.covariance.names == NAMES[1:]
    assert changed.covariance_of(NAMES)[0].tolist() == pytest.approx([0.0009, 0.0, 0.0])
    assert changed.with_(voltage_swing_v=1.0).covariance is None
    assert sensor.with_(serial="8").covariance == sensor.covariance


def test_the_schema_has_it() -> None:
    schema = ps.Sensor.model_json_schema()
    assert set(schema["$defs"]["Covariance"]["properties"]) == {"names", "correlation"}
    assert "covariance" not in schema["required"]


@pytest.mark.parametrize(
    ("names", "correlation", "said"),
    [
        ("[read_noise_mv, dsnu_mv]", "[[1, 0.5]]", "2 rows of 2 numbers"),
        ("[read_noise_mv, dsnu_mv]", "[[1, 0.5], [0.4, 1]]", "symmetric"),
        ("[read_noise_mv, dsnu_mv]", "[[2, 0.5], [0.5, 1]]", "from -1 to 1"),
        ("[read_noise_mv, dsnu_mv]", "[[0.5, 0.5], [0.5, 1]]", "1 on its diagonal"),
        ("[read_noise_mv, dsnu_mv]", "[[1, .nan], [.nan, 1]]", "from -1 to 1"),
        ("[read_noise_mv, dsnu_mv]", "[[1, x], [x, 1]]", "valid number"),
        ("[read_noise_mv, read_noise_mv]", "[[1, 0], [0, 1]]", "two different fields"),
        ("[read_noise_mv]", "[[1]]", "two different fields"),
        ("[read_noise_mv, dsnu]", "[[1, 0], [0, 1]]", "did you mean 'dsnu_mv'"),
        ("[read_noise_mv, bits]", "[[1, 0], [0, 1]]", "no value 'bits'"),
        ("[read_noise_mv, dsnu_mv, prnu_percent]", "[[1, .9, .9], [.9, 1, -.9], [.9, -.9, 1]]", "cannot be together"),
        ("[read_noise_mv, dsnu_mv]\n  matrix: 1", "[[1, 0], [0, 1]]", "unknown field 'matrix' in covariance"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, names: str, correlation: str, said: str) -> None:
    file = tmp_path / "mine.sensor.yaml"
    ps.load_sensor("vendor-2.2um").save(file)
    file.write_text(file.read_text() + f"covariance:\n  names: {names}\n  correlation: {correlation}\n")
    with pytest.raises(FileError, match=said) as error:
        ps.load_sensor(file)
    assert str(error.value).count("\n") == 0


def test_an_unknown_value_is_refused(sensor: ps.Sensor) -> None:
    with pytest.raises(InputError, match="no value 'rows'"):
        sensor.covariance_of(["rows"])
