"""Glow is found in maps of the dark current with its place and size; gradients and hot pixels are not taken for it."""

import numpy as np
import pytest

from photosite.calibration.effects.glow import find_glow
from photosite.sensor.effects.glow import Glow
from photosite.sensor.io.sensor_file import load_sensor
from photosite.values.uncertain import Uncertain

SENSOR = load_sensor("nikon-d200")

SHAPE = 64, 80


def dark_map(rng, glow=None, tilt=0.0):
    """DN/s of a log-normal dark current with noise, 0.2 % hot pixels, and a gain of 0.5 DN per electron."""
    rate = 2.0 * np.exp(rng.normal(0.0, 0.4, SHAPE)) + rng.normal(0.0, 1.0, SHAPE) + tilt * np.linspace(-1, 1, SHAPE[1])
    hot = rng.random(SHAPE) < 0.002
    rate[hot] += rng.gamma(2.0, 50.0, int(hot.sum()))
    return rate if glow is None else rate + 0.5 * glow.map(*SHAPE)


@pytest.mark.parametrize("tilt", [0.0, 0.8])
def test_maps_without_glow_have_none(tilt):
    rng = np.random.default_rng(1)
    for _ in range(8):
        found = find_glow(dark_map(rng, tilt=tilt), Uncertain(0.5))
        assert found.places == ()
        assert found.peak_e_per_s.reason_id == "effect-not-seen"
        assert found.section(SENSOR, "") == {"glow": None}


@pytest.mark.parametrize(
    "glow",
    [
        Glow(places=("left",), peak_e_per_s=12, decay_pixels=12),
        Glow(places=("top_left", "bottom_right"), peak_e_per_s=20, decay_pixels=14),
    ],
    ids=["edge", "corners"],
)
def test_place_peak_and_decay_are_found(glow):
    """Intervals of 8 maps: both miss in at most two, by chance in 6 % of such tests' seeds."""
    rng = np.random.default_rng(2)
    misses = 0
    for _ in range(8):
        found = find_glow(dark_map(rng, glow), Uncertain(0.5))
        assert set(found.places) == set(glow.places)
        for entry, true in ((found.peak_e_per_s, glow.peak_e_per_s), (found.decay_pixels, glow.decay_pixels)):
            low, high = entry.interval_95
            misses += not low <= true <= high
            assert abs(entry.value - true) < 4.5 * entry.standard_uncertainty
            assert entry.standard_uncertainty < 0.1 * true
    assert misses <= 3


def test_a_glow_whose_place_is_unclear_has_no_size():
    rng = np.random.default_rng(5)
    weak = Glow(places=("left", "right", "top_left"), peak_e_per_s=0.8, decay_pixels=30)
    found = [find_glow(dark_map(rng, weak), Uncertain(0.5)) for _ in range(6)]
    unclear = [entry for entry in found if entry.places and entry.peak_e_per_s.value is None]
    assert unclear
    assert all(" or " in entry.peak_e_per_s.reason and entry.section(SENSOR, "") == {} for entry in unclear)


def test_small_chips_have_no_map():
    assert find_glow(np.ones((20, 90)), Uncertain(0.5)) is None


@pytest.mark.slow
def test_intervals_cover():
    """200 maps with glow from one place, 200 without: 90 % is 3.2 binomial sigma below 95 %."""
    rng = np.random.default_rng(11)
    inside, errors = [], []
    for _ in range(200):
        place = str(
            rng.choice(["left", "right", "top", "bottom", "top_left", "top_right", "bottom_left", "bottom_right"])
        )
        glow = Glow(places=(place,), peak_e_per_s=float(rng.uniform(4, 30)), decay_pixels=float(rng.uniform(6, 16)))
        found = find_glow(dark_map(rng, glow), Uncertain(0.5))
        assert found.places == glow.places
        if found.peak_e_per_s.value is None:
            continue
        pairs = ((found.peak_e_per_s, glow.peak_e_per_s), (found.decay_pixels, glow.decay_pixels))
        inside.append([entry.interval_95[0] <= true <= entry.interval_95[1] for entry, true in pairs])
        errors.append([(entry.value - true) / entry.standard_uncertainty for entry, true in pairs])
    assert len(inside) > 195
    assert (np.mean(inside, axis=0) > 0.9).all()
    assert np.abs(np.mean(errors, axis=0)).max() < 0.3
    assert not any(find_glow(dark_map(rng), Uncertain(0.5)).places for _ in range(200))
