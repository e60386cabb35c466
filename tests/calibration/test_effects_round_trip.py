"""Effects of a drawn sensor are measured, written into the sensor file, and simulated again."""

import numpy as np

from photosite.calibration.calibrate import calibrate
from photosite.sensor.io.sensor_file import dump_sensor, parse_sensor
from photosite.studies.coverage import CONDITIONS


def test_measured_curve_is_that_of_the_sensor() -> None:
    """The deviation at all charges within 4 standard uncertainties, which are small against the bend."""
    lab = CONDITIONS["curve-mono-12"].lab(1)
    true = lab.camera.sensor
    measured = parse_sensor(dump_sensor(calibrate(lab.frame_set()).sensor), "measured.sensor.yaml")
    assert true.effects is not None
    assert measured.effects is not None
    drawn, found = true.effects.response_curve, measured.effects.response_curve
    assert drawn is not None
    assert found is not None
    assert found.charge_e is not None
    charge = np.array(found.charge_e[1:])
    charge = charge[charge < 0.95 * true.saturation_capacity_e]
    well = true.pixel.well_capacity_e.value
    expected = 100 * (drawn.signal_e(charge, well) / charge - 1)
    seen = 100 * (found.signal_e(charge, measured.pixel.well_capacity_e.value) / charge - 1)
    uncertainty = np.array(found.standard_uncertainty_percent[1 : charge.size + 1])
    assert (np.abs(seen - expected) < 4 * uncertainty).all()
    assert uncertainty[-1] < 0.5 * abs(expected[-1])


def test_straight_response_has_no_curve() -> None:
    lab = CONDITIONS["bright-mono-12"].lab(4)
    assert calibrate(lab.frame_set()).sensor.effects is None


def test_readout_channels_are_measured_and_leave_prnu() -> None:
    lab = CONDITIONS["channels-mono-12"].lab(1)
    true = lab.camera.sensor
    measured = calibrate(lab.frame_set()).sensor
    assert true.effects is not None
    assert measured.effects is not None
    drawn, found = true.effects.readout_channels, measured.effects.readout_channels
    assert drawn is not None
    assert found is not None
    assert found.relative_gain is not None
    assert (found.arrangement, found.shape) == ("tile", (1, 2))
    spread = found.relative_gain[0][0].standard_uncertainty
    assert np.abs(found.tables()[0] - drawn.tables()[0]).max() < 4 * spread
    prnu, expected = measured.noise.prnu_percent, true.noise.prnu_percent.value
    assert abs(prnu.value - expected) < 4 * prnu.standard_uncertainty
