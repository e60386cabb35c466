"""Tone curves are named, mild bends are not, and a table undoes a known curve."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import FrameSet
from photosite.frames.linearization import LinearizationTable, linearize

K, READ_E, PRNU, BLACK, WHITE = 0.3, 6.0, 0.008, 64.0, 4095.0
SHAPE = (72, 96)


def stack(seed, curve, bits=12):
    """Darks and flats up to 80 % of the converter's range; `curve` maps 0..1 to 0..1."""
    rng = np.random.default_rng(seed)
    response, offset = 1.0 + PRNU * rng.normal(size=SHAPE), BLACK + 0.6 * rng.normal(size=SHAPE)

    def take(kind, exposure_s):
        shots = []
        for _ in range(8):
            electrons = rng.poisson(response * (1.1e5 * exposure_s if kind == "light" else 0.0))
            codes = np.clip(np.rint(offset + K * (electrons + rng.normal(0.0, READ_E, SHAPE))), 0, WHITE)
            dn = np.rint(curve(codes / WHITE) * (2**bits - 1)).astype(np.uint16)
            shots.append((kind, exposure_s, dn))
        return shots

    groups = [take("dark", t) for t in (0.01, 0.1)]
    groups += [take("light", 0.01 * t) for t in (1, 2, 3, 4, 5, 6, 8, 9)]
    return FrameSet.from_arrays([shot for group in groups for shot in group], bits=bits)


def srgb(x):
    return np.where(x < 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def log(x):
    return np.log1p(256 * x) / np.log(257)


CURVES = {"gamma": lambda x: x ** (1 / 2.2), "sRGB": srgb, "square root": np.sqrt, "logarithm": log}


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("name", CURVES)
def test_a_tone_curve_is_named_and_its_figures_withheld(name, bits):
    found = calibrate(stack(1, CURVES[name], bits))
    estimates = found.estimates()
    for parameter in ("system_gain_dn_per_e", "read_noise_e", "prnu_percent"):
        assert estimates[parameter].value is None
        assert estimates[parameter].reason_id == "tone-curve"
    left = {name for name, entry in estimates.items() if entry.value is not None}
    assert not [name for name in left if name.endswith(("_e", "_e_per_s", "_db")) or name.startswith("prnu")]
    assert found.read_noise_dn.value > 0.0
    assert "tone-curve" in limits(found)


@pytest.mark.parametrize("bend", [-0.1, 0.0, 0.05, 0.1])
def test_a_mild_bend_is_no_tone_curve(bend):
    found = calibrate(stack(2, lambda x: x * (1.0 - bend * x)))
    assert found.system_gain_dn_per_e.value is not None
    assert "tone-curve" not in limits(found)


@pytest.mark.parametrize(("seed", "cfa"), [(2, "mono"), (15, "rggb")])
def test_wells_that_saturate_are_no_tone_curve_and_no_digital_gain(virtual, seed, cfa):
    """Saturated flats are quieter than long dark frames, and pixels differ in noise near saturation."""
    sensor = virtual.sensor(seed, cfa=cfa, rows=80, cols=96, limited_by="well")
    frames = virtual.frame_set(sensor, seed, photons_known=cfa == "mono", top=1.15 + 0.15 * ((0.618 * seed) % 1))
    found = calibrate(frames)
    assert not {"tone-curve", "digital-gain"} & set(limits(found))
    assert found.system_gain_dn_per_e.value is not None


def test_a_known_table_undoes_square_root_companding():
    codes = np.arange(4096)
    curve = np.rint(np.sqrt(codes / WHITE) * 1023)
    table = LinearizationTable(np.array([codes[curve <= n][-1] for n in range(1024)], float))
    frames = linearize(stack(3, np.sqrt, bits=10), table)
    assert frames.bits == 12
    found = calibrate(frames)
    for estimate, truth in ((found.system_gain_dn_per_e, K), (found.prnu_percent, 100 * PRNU)):
        low, high = estimate.interval_95
        assert low <= truth <= high
    assert found.system_gain_dn_per_e.standard_uncertainty < 0.03 * K
    assert "decoded-companding" in limits(found)
