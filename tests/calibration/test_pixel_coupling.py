"""Interpixel capacitance and electron multiplication: measured in virtual frames with a hidden truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import convolve
from tests.calibration.test_noise_covariance import BAYER, MONOCHROME, runs
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.calibrate import calibrate
from photosite.calibration.effects.em_gain import measure_em_gain
from photosite.calibration.photon_transfer.noise_covariance import noise_covariances
from photosite.calibration.photon_transfer.pixel_coupling import fit_coupling
from photosite.calibration.result import Calibration
from photosite.errors import CalibrationError
from photosite.sensor.effects.interpixel_capacitance import InterpixelCapacitance
from photosite.studies.conditions import condition
from photosite.studies.protocol import ShootingProtocol, Step
from photosite.studies.virtual_lab import nominal_sensor, virtual_lab

PROTOCOL = ShootingProtocol(
    "small", (Step("dark", 0.001, 8), Step("dark", 0.1, 4), *(Step("light", 0.01 * k, 4) for k in range(1, 9)))
)
SENSOR = condition("bright-mono-12").sensor(0).with_(rows=96, cols=128)


@pytest.mark.parametrize("tile", [MONOCHROME, BAYER], ids=["mono", "bayer"])
@pytest.mark.parametrize(("side", "corner"), [(0.0, 0.0), (0.015, 0.002), (0.03, 0.0)])
def test_fit_to_plain_frames(tile: np.ndarray, side: float, corner: float) -> None:
    rng = np.random.default_rng(6)
    kernel = InterpixelCapacitance(coupling_percent=100 * side, diagonal_percent=100 * corner).kernel()
    light, dark = (noise_covariances(runs(rng, level, charge=kernel), tile) for level in (2000.0, 0.0))
    shot = [a - b for a, b in zip(light, dark, strict=True)]
    found = fit_coupling(shot, tile, [1000.0] * len(shot), seen=True)
    for fraction, truth in ((found.side, side), (found.corner, corner)):
        assert abs(fraction.value - truth) < 4.0 * fraction.standard_uncertainty
        assert fraction.standard_uncertainty < 0.002


def test_unequal_colors() -> None:
    """The charge that a dim color receives from a bright one is in proportion to that of the bright one."""
    rng = np.random.default_rng(7)
    levels = np.tile([[500.0, 2000.0], [2000.0, 1000.0]], (80, 80))
    kernel = InterpixelCapacitance(coupling_percent=2.0)
    frames = [convolve(rng.poisson(levels).astype(float), kernel.kernel(), mode="wrap") for _ in range(24)]
    shot = noise_covariances([[np.rint(8.0 * frame).astype(np.uint16) for frame in frames]], BAYER)
    mean = convolve(levels, kernel.kernel(), mode="wrap")
    found = fit_coupling(shot, BAYER, [mean[0, 0], mean[0, 1], mean[1, 1]], seen=True)
    assert found.side.standard_uncertainty < 5e-4
    assert abs(found.side.value - 0.02) < 4.0 * found.side.standard_uncertainty
    assert abs(found.corner.value) < 4.0 * found.corner.standard_uncertainty


def measured(true: ps.Sensor, level: float = 0.7, **options: Any) -> Calibration:
    return calibrate(virtual_lab(true, PROTOCOL, level=level, seed=1, photons_known=True).frame_set(), **options)


def test_independent_pixels_have_no_coupling() -> None:
    found = measured(SENSOR)
    low, high = found.interpixel_coupling_percent.interval_95 or (1.0, 0.0)
    assert low < 0.0 < high
    assert found.sensor.effects is None
    assert "correlated-noise" not in limits(found)


def test_multiplication_gain_and_excess_noise() -> None:
    em_gain = {"gain": 20.0, "stages": 200}
    plain = SENSOR.with_(bits=16, system_gain_dn_per_e=1.0, read_noise_e=5, dsnu_e=1, well_capacity_e=30000)
    register = plain.with_(em_gain=em_gain)
    unity = measured(plain)
    multiplied = measured(register, level=0.03, sensor=nominal_sensor(register).with_(em_gain=em_gain))
    found = measure_em_gain(unity, multiplied)
    assert register.effects is not None
    assert register.effects.em_gain is not None
    factor = register.effects.em_gain.excess_noise_factor
    for entry, truth in ((found.gain, 20.0), (found.excess_noise_factor, factor), (found.read_noise_e, 0.25)):
        assert entry.value is not None
        assert entry.standard_uncertainty is not None
        assert abs(entry.value - truth) < 3.5 * entry.standard_uncertainty
        assert entry.standard_uncertainty < 0.05 * truth
    assert limits(multiplied)["stated-em-gain"] == factor
    assert "stated-em-gain" not in limits(unity)
    with pytest.raises(CalibrationError) as caught:
        measure_em_gain(calibrate(virtual_lab(plain, PROTOCOL, seed=1).frame_set()), multiplied)
    assert caught.value.id == "no-em-gain"


@pytest.mark.slow
@pytest.mark.parametrize("number", [13, 21])
def test_neighbors_of_another_color_that_saturate_do_not_bend_the_response(number):
    """The well of green pixels is full at levels that are linear for the others, which contain their charge."""
    lab = condition("coupled-cfa-12").lab(number)
    found = calibrate(lab.frame_set())
    assert not found.response_curve
    low, high = found.system_gain_dn_per_e.interval_95
    assert low < lab.camera.sensor.system_gain_dn_per_e < high
