"""Values derived from a sensor file have the same uncertainty as those derived by the calibration."""

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.errors import InputError
from photosite.sensor.io.sensor_file import load_sensor
from photosite.values.uncertain import Measured


@pytest.fixture(scope="module")
def calibration(virtual):
    """The voltage swing is known to 1 %, the largest uncertainty, which all voltages share."""
    sensor = virtual.sensor(3, rows=64, cols=80, limited_by="well")
    swing = sensor.pixel.voltage_swing_v.value
    known = sensor.with_(voltage_swing_v=Measured(swing, 0.01 * swing))
    return calibrate(virtual.frame_set(sensor, 3), known)


def propagated(sensor, function, names):
    """Propagate to first order by central differences, from the file's values and covariance alone."""
    values = np.array([sensor.measured(name).value for name in names])
    gradient = []
    for k, value in enumerate(values):
        step = 1e-5 * value
        ends = []
        for sign in (1, -1):
            moved = values.copy()
            moved[k] += sign * step
            ends.append(function(sensor.with_(**dict(zip(names, moved.tolist(), strict=True)))))
        gradient.append((ends[0] - ends[1]) / (2 * step))
    gradient = np.array(gradient)
    return float(np.sqrt(gradient @ sensor.covariance_of(names) @ gradient))


@pytest.mark.parametrize(
    ("parameter", "derived", "names"),
    [
        (
            "system_gain_dn_per_e",
            lambda s: s.system_gain_dn_per_e,
            ["conversion_gain_uv_per_e", "voltage_swing_v", "analog_gain"],
        ),
        (
            "read_noise_e",
            lambda s: s.electrons(s.noise.read_noise_mv.value),
            ["read_noise_mv", "conversion_gain_uv_per_e"],
        ),
        ("dsnu_dn", lambda s: s.noise.dsnu_mv.value / s.mv_per_dn, ["dsnu_mv", "voltage_swing_v"]),
        (
            "dark_current_e_per_s",
            lambda s: s.electrons(s.noise.dark_voltage_mv_per_s.value),
            ["dark_voltage_mv_per_s", "conversion_gain_uv_per_e"],
        ),
        (
            "saturation_dn",
            lambda s: s.readout.black_level_dn.value + s.pixel.well_capacity_e.value * s.system_gain_dn_per_e,
            ["black_level_dn", "well_capacity_e", "conversion_gain_uv_per_e", "voltage_swing_v"],
        ),
    ],
)
def test_values_derived_from_the_file_have_the_same_uncertainty(calibration, tmp_path, parameter, derived, names):
    calibration.sensor.save(tmp_path / "mine.sensor.yaml")
    sensor = load_sensor(tmp_path / "mine.sensor.yaml")
    direct = getattr(calibration, parameter)
    assert derived(sensor) == pytest.approx(direct.value, rel=1e-9)
    assert propagated(sensor, derived, names) == pytest.approx(direct.standard_uncertainty, rel=2e-3)
    alone = propagated(sensor.with_(covariance=None), derived, names)
    assert alone > 1.2 * direct.standard_uncertainty  # the correlations matter


def test_the_calibration_has_the_covariance_of_all_its_parameters(calibration):
    joint = calibration.covariance
    for name in ("read_noise_e", "prnu_percent", "quantum_efficiency_percent"):
        u = getattr(calibration, name).standard_uncertainty
        assert joint.among([name])[0, 0] == pytest.approx(u**2)
    gain, volts = "system_gain_dn_per_e", "conversion_gain_uv_per_e"
    assert joint.among([gain, volts])[0, 1] > 0.0
    scale = np.sqrt(np.diag(joint.matrix)) + 1e-300
    assert np.linalg.eigvalsh(joint.matrix / np.outer(scale, scale)).min() > -1e-9
    with pytest.raises(InputError):
        joint.among(["prnu"])
