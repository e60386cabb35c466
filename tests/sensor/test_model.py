"""Derived quantities of the sensor model, and changed copies."""

from __future__ import annotations

import pickle

import pytest
from raising import raises

from photosite.errors import InputError
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor

D200 = load_sensor("nikon-d200")


def test_scales_agree_with_each_other() -> None:
    """0.52 mV / 30 uV = 17.33 e-, / 7.98 = 2.172 DN, and 0.52 mV over mv_per_dn the same."""
    electrons = D200.electrons(D200.noise.read_noise_mv.value)
    assert electrons == pytest.approx(17.3333, abs=1e-4)
    assert electrons * D200.system_gain_dn_per_e == pytest.approx(0.52 / D200.mv_per_dn, rel=1e-12)
    assert 0.52 / D200.mv_per_dn == pytest.approx(2.1721, abs=1e-4)


def test_saturation_is_the_well_or_the_converter() -> None:
    assert D200.saturation_capacity_e == pytest.approx(4095 * 7.98, rel=1e-5)
    assert D200.with_(well_capacity_e=20000).saturation_capacity_e == 20000
    assert D200.with_(black_level_dn=95).saturation_capacity_e == pytest.approx(4000 * 7.98, rel=1e-5)


def test_with_changes_a_copy() -> None:
    other = D200.with_(prnu_percent=2, cfa="mono", channels={"M": {"wavelength_nm": [500], "quantum_efficiency": [1]}})
    assert (D200.noise.prnu_percent.value, other.noise.prnu_percent.value) == (1.126, 2.0)
    assert other.channel_names == ("M",)
    with raises(InputError, "a sensor has no field 'prnu_percnt'", hint="Did you mean 'prnu_percent'?"):
        D200.with_(prnu_percnt=2)
    with raises(InputError, "black_level_dn", where="readout", value=4095.0):
        D200.with_(black_level_dn=4095)


def test_sensors_are_values() -> None:
    assert pickle.loads(pickle.dumps(D200)) == D200
    assert isinstance(D200, Sensor)
    with pytest.raises(Exception, match="frozen"):
        D200.name = "other"  # type: ignore[misc]
