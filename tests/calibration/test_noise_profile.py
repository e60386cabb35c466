"""A calibration as a noise profile: closed forms, and the true values within the uncertainty."""

from __future__ import annotations

import dataclasses

import pytest

import photosite as ps
from photosite.calibration.export.noise_profile import calibration_noise_profile
from photosite.errors import CalibrationError
from photosite.sensor.noise_profile import sensor_noise_profile
from photosite.values.estimate import Estimate


@pytest.fixture(scope="module", params=["mono", "rggb"])
def measured(request, virtual):
    sensor = virtual.sensor(6, rows=64, cols=96, cfa=request.param)
    return sensor, ps.calibrate(virtual.frame_set(sensor, 6, dark_frames=12, stack=8, repeats=4))


def test_closed_forms(measured):
    _, calibration = measured
    profile = calibration_noise_profile(calibration, 100.0)
    span = 4095 - calibration.black_level_dn.value
    assert profile.gain_setting == 100.0
    for index, parameters in enumerate(calibration.channels.values() or [calibration]):
        assert profile.slope[index].value == pytest.approx(calibration.system_gain_dn_per_e.value / span, rel=1e-14)
        variance = parameters.read_noise_dn.value**2 + parameters.dsnu_dn.value**2 + 1 / 12
        assert profile.offset[index].value == pytest.approx(variance / span**2, rel=1e-14)


def test_truth_within_its_uncertainty(measured):
    """4.5 standard uncertainties, 8 figures: a false alarm in about 10^4 runs."""
    sensor, calibration = measured
    profile, true = calibration_noise_profile(calibration), sensor_noise_profile(sensor)
    assert profile.channels == true.channels
    for name in ("slope", "offset"):
        for found, expected in zip(getattr(profile, name), getattr(true, name), strict=True):
            assert 0 < found.standard_uncertainty < 0.2 * expected.value
            assert abs(found.value - expected.value) < 4.5 * found.standard_uncertainty


def test_missing_gain_is_an_error(measured):
    _, calibration = measured
    blind = dataclasses.replace(calibration, system_gain_dn_per_e=Estimate(reason="no light frames"))
    with pytest.raises(CalibrationError) as caught:
        calibration_noise_profile(blind)
    assert "system_gain_dn_per_e" in caught.value.what
    assert "no light frames" in caught.value.what
