"""Every mosaic is calibrated channel by channel: virtual sensors with hidden truth, one of each tile."""

import dataclasses

import pytest

from photosite.calibration.calibrate import calibrate
from photosite.studies.conditions import FEW, FULL, condition
from photosite.studies.coverage import compare
from photosite.studies.truth import measured_truth
from photosite.studies.virtual_lab import virtual_lab
from photosite.values.cfa import NAMED, channel_names

EFFICIENCY = {"M": 0.5, "R": 0.35, "G": 0.5, "B": 0.3, "W": 0.7, "C": 0.7, "Y": 0.6, "Cy": 0.5, "Ir": 0.15, "P": 0.25}
TILES = [name for name in NAMED if name not in ("bggr", "gbrg", "grbg")]


def outcomes(tile, *, protocol, stacked=False, **size):
    names = channel_names(tile)
    channels = {
        name: {
            "wavelength_nm": (380.0, 780.0),
            "quantum_efficiency": (EFFICIENCY[name.rstrip("0123456789")] * (1 + 0.02 * k),) * 2,
        }
        for k, name in enumerate(names)
    }
    family = dataclasses.replace(condition("bright-cfa-12"), protocol=protocol)
    sensor = family.sensor(3).with_(cfa=tile, channels=channels, stacked=stacked, **size)
    lab = virtual_lab(sensor, protocol, level=2.4, seed=3)
    calibration = calibrate(lab.frame_set())
    found = compare(calibration, measured_truth(lab, calibration))
    return {name: outcome for name, outcome in found.items() if not isinstance(outcome, str)}


def check(found):
    for name in ("system_gain_dn_per_e", "read_noise_dn", "prnu_percent", "black_level_dn", "dark_current_e_per_s"):
        assert abs(found[name].error) < 4 * found[name].standard_uncertainty
    missed = [name for name, outcome in found.items() if not outcome.covered]
    assert len(missed) <= 0.15 * len(found), missed


def test_polarization_with_few_frames():
    check(outcomes(NAMED["polarization"], protocol=FEW, rows=32, cols=40))


@pytest.mark.slow
@pytest.mark.parametrize("name", TILES)
def test_every_tile(name):
    check(outcomes(NAMED[name], protocol=FULL, rows=96, cols=120))


@pytest.mark.slow
def test_stacked_channels():
    check(outcomes((("B", "G", "R"),), protocol=FULL, rows=72, cols=216, stacked=True))
