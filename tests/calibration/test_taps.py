"""Halves and quadrants of different gain or offset are found; fixed patterns and shading are not taken for them."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.spatial.periodic_structure import find_taps
from photosite.frames.frame_set import FrameSet

QUADRANTS = np.array([[1.0, -1.0], [-1.0, 1.0]])


def frame(rng, *, shape=(72, 96), pixel=0.01, column=0.0, row=0.0, shading=0.0, center=0.0):
    rows, cols = (np.linspace(-1.0, 1.0, length) for length in shape)
    fall = -shading * np.add.outer((rows - center) ** 2, (cols - center) ** 2)
    values = 1.0 + fall + pixel * rng.normal(size=shape) + column * rng.normal(size=shape[1])
    return values + row * rng.normal(size=(shape[0], 1))


def stepped(values, level):
    """The frame with (2, 2) levels of its quadrants added."""
    rows, cols = values.shape
    return values + np.repeat(np.repeat(level, rows // 2, axis=0), cols // 2, axis=1)


@pytest.mark.parametrize(
    "pattern",
    [{}, {"column": 0.01}, {"row": 0.01, "column": 0.003}, {"shading": 0.3}, {"shading": 0.3, "center": 0.4}],
    ids=str,
)
def test_patterns_without_a_step(pattern):
    rng = np.random.default_rng(1)
    for _ in range(40):
        assert find_taps(frame(rng, **pattern)) is None
        assert find_taps(frame(rng, **pattern), dark=True) is None


@pytest.mark.parametrize(
    ("sign", "names"),
    [
        (np.array([[-1.0, 1.0], [-1.0, 1.0]]), ["left", "right"]),
        (np.array([[1.0, 1.0], [-1.0, -1.0]]), ["top", "bottom"]),
        (QUADRANTS, ["top left", "top right", "bottom left", "bottom right"]),
    ],
)
def test_taps_are_named_with_their_levels(sign, names):
    rng = np.random.default_rng(2)
    for size in rng.uniform(0.01, 0.03, 5):
        taps = find_taps(stepped(frame(rng, column=0.001, shading=0.1), 0.5 * size * sign))
        assert taps is not None
        assert list(taps.named) == names
        assert taps.step == pytest.approx(size, abs=5.0 * taps.uncertainty)


def test_small_steps_of_a_clean_chip_are_found():
    rng = np.random.default_rng(3)
    level = 0.5 * 0.004 * np.array([[-1.0, 1.0], [-1.0, 1.0]])
    found = [find_taps(stepped(frame(rng, shape=(192, 240), pixel=0.008), level)) for _ in range(20)]
    assert sum(taps is not None for taps in found) >= 19


def test_waves_are_no_taps():
    rng = np.random.default_rng(6)
    for phase in np.linspace(0.0, 6.0, 12):
        wave = 0.01 * np.sin(2.0 * np.pi * np.arange(96) / 13.0 + phase)
        assert find_taps(frame(rng, pixel=0.002) + wave) is None


def test_a_step_elsewhere_is_no_tap():
    rng = np.random.default_rng(4)
    values = frame(rng)
    values[:, 30:] += 0.02
    assert find_taps(values) is None


def stack(gain, offset_dn):
    """Flats and darks of a chip with a right half of another gain and offset."""
    rng = np.random.default_rng(5)
    shape = (64, 96)
    right = (np.arange(96) >= 48).astype(float)
    response, offset = 1.0 + 0.01 * rng.normal(size=shape), 64.0 + 0.6 * rng.normal(size=shape)

    def take(kind, exposure_s, electrons):
        e = rng.poisson(electrons * response, (6, *shape)) * (1.0 + gain * right)
        dn = np.clip(np.rint(offset + offset_dn * right + 0.3 * e + rng.normal(0.0, 2.0, e.shape)), 0, 4095)
        frames = dn.astype(np.uint16)
        return [(kind, exposure_s, dn) for dn in frames]

    darks = [take("dark", t, 0.0) for t in (0.01, 0.1)]
    lights = [take("light", t, 1e5 * t) for t in (0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1)]
    return FrameSet.from_arrays([shot for group in (*darks, *lights) for shot in group], bits=12)


def test_a_calibration_names_taps_with_their_size():
    found = [entry for entry in calibrate(stack(0.02, 1.0)).diagnostics if entry.id == "steps-between-taps"]
    assert {entry.parameters[0][:4] for entry in found} == {"dsnu", "prnu"}
    assert sorted(entry.size for entry in found) == pytest.approx([0.02, 1.0], rel=0.25)
    assert "steps-between-taps" not in limits(calibrate(stack(0.0, 0.0)))


def test_the_system_gain_of_taps_with_other_gains_is_named():
    """Gains of 0.3 and 0.42 DN/e-: variance over signal is 2.8 % above their mean."""
    found = calibrate(stack(0.4, 0.0))
    (entry,) = (entry for entry in found.diagnostics if entry.id == "steps-between-taps")
    assert "system_gain_dn_per_e" in entry.parameters
    assert "the system gain is 2.8 % above the mean of the taps'" in entry.text
    assert found.system_gain_dn_per_e.value / 0.36 == pytest.approx(1.0278, rel=0.01)


def test_a_calibration_returns_gain_and_offset_of_the_taps():
    """Within 4 standard uncertainties; the right half has 1.02 of the gain of the left one, and 1 DN more."""
    channels = calibrate(stack(0.02, 1.0)).readout_channels
    assert channels.arrangement == "blocks"
    gain, offset = channels.tables()
    spread = channels.relative_gain[0][0].standard_uncertainty, channels.offset_e[0][0].standard_uncertainty
    assert gain[:, 1] / gain[:, 0] == pytest.approx([1.02, 1.02], abs=4 * spread[0])
    assert offset[:, 1] - offset[:, 0] == pytest.approx([1 / 0.3, 1 / 0.3], abs=4 * spread[1])
    assert max(spread[0] / 0.02, spread[1] * 0.3) < 0.3
    assert calibrate(stack(0.0, 0.0)).readout_channels is None
