"""Polarizers measured from virtual sensors with hidden truth."""

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.calibration.light.polarizers import measure_polarizers, with_polarizers
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.assumed_channels import assumed_channels
from photosite.sensor.readout import digital_numbers
from photosite.values.cfa import NAMED, channel_mask

CFA = NAMED["polarization"]
NAMES = ("P90", "P45", "P135", "P0")
ANGLES = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
SENSOR = ps.load_sensor("sony-imx174").with_(
    rows=12, cols=16, cfa=CFA, channels=assumed_channels(NAMES, 0.6), black_level_dn=64, prnu_percent=1.0
)


def frames(sensor, truth, seed, angle_deg=None, count=4):
    """Frames of polarized light; without an angle, dark frames."""
    mean = np.zeros((12, 16), np.float32)
    for name, (own_deg, ratio) in truth.items():
        if angle_deg is not None:
            along = np.cos(np.radians(angle_deg - own_deg)) ** 2
            mean[channel_mask(CFA, name, mean.shape)] = 20000 * (along + (1 - along) / ratio)
    found = [digital_numbers(sensor, mean, 0.01, seed=seed, frame=k) for k in range(count)]
    return [RawFrame(dn, bits=12, cfa=CFA, black_level_dn=64) for dn in found]


def drawn(number):
    """Angles within 2 degrees of the nominal ones, extinction ratios from 2 to 600."""
    rng = np.random.default_rng([7, number])
    return {name: (float(name[1:]) + rng.uniform(-2, 2), 2 * 300 ** rng.random()) for name in NAMES}


@pytest.mark.parametrize(
    ("sensors", "least", "most"), [(6, 0.8, 1.0), pytest.param(200, 0.93, 0.97, marks=pytest.mark.slow)]
)
def test_intervals_cover_the_truth(sensors, least, most):
    """Sensors of four polarizers each: 95 % of the intervals cover, within what their number explains."""
    covered = {"angle": [], "extinction": []}
    errors = {"angle": [], "extinction": []}
    for number in range(sensors):
        truth, sensor = drawn(number), SENSOR.with_(serial=str(number))
        flats = {angle: frames(sensor, truth, 1000 * number + int(angle), angle) for angle in ANGLES}
        found = measure_polarizers(flats, frames(sensor, truth, 1000 * number + 999, count=16))
        for name, (angle_deg, ratio) in truth.items():
            one = found[name]
            off = (one.angle_deg.value - angle_deg + 90) % 180 - 90
            errors["angle"].append(off / one.angle_deg.standard_uncertainty)
            errors["extinction"].append((one.leakage.value - 1 / ratio) / one.leakage.standard_uncertainty)
            low, high = one.extinction_ratio_95
            covered["angle"].append(abs(errors["angle"][-1]) < 1.96)
            covered["extinction"].append(low <= ratio <= high)
    for what, hits in covered.items():
        assert least < np.mean(hits) <= most, what
        assert abs(np.mean(errors[what])) < (0.2 if sensors == 200 else 0.8), what


def test_a_sensor_file_takes_the_polarizers():
    truth = {"P90": (91.0, 300.0), "P45": (44.0, 9.0), "P135": (135.0, 30.0), "P0": (179.5, 2.0)}
    found = measure_polarizers({angle: frames(SENSOR, truth, int(angle), angle) for angle in ANGLES})
    channels = with_polarizers(SENSOR, found).channels
    for name, (angle_deg, ratio) in truth.items():
        assert channels[name].polarization_angle_deg == pytest.approx(angle_deg, abs=0.5)
        assert channels[name].extinction_ratio == pytest.approx(ratio, rel=0.02 + ratio / 1000)


def test_frames_that_cannot_be_used():
    truth = drawn(1)
    flats = {angle: frames(SENSOR, truth, int(angle), angle) for angle in (0.0, 45.0, 90.0)}
    with raises(InputError, "flats", value=[0.0, 90.0, 180.0]):
        measure_polarizers({0.0: flats[0.0], 90.0: flats[90.0], 180.0: flats[0.0]})
    with raises(InputError, "frames", value=1):
        measure_polarizers(flats | {45.0: flats[45.0][:1]})
    white = [RawFrame(np.full((12, 16), 4095, np.uint16), bits=12, cfa=CFA)] * 2
    with raises(InputError, "frames", value=4095.0):
        measure_polarizers(flats | {45.0: white})
    with raises(InputError, "flats", expected="brighter than the darks"):
        measure_polarizers({angle: frames(SENSOR, truth, int(angle)) for angle in (0.0, 45.0, 90.0)}, flats[45.0])
