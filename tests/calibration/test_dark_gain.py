"""The system gain from dark frames alone: coverage, false alarms, and dark currents that are not shot noise alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

import photosite as ps
from photosite.frames.frame_set import FrameSet

GAIN, READ_E, BLACK = 0.5, 3.0, 100.0
SHAPE = (96, 96)


def dark_set(
    seed: int, rate_e: float = 20.0, hot: float = 0.02, blinking: float = 0.0, frames: int = 12, moved_dn: float = 0.0
) -> FrameSet:
    """Return dark frames of 0.05 and 1 s.

    The dark current is log-normal with a fraction of `hot` pixels of 3 to 30 times as much. In a fifth of the pixels it
    is larger by the fraction `blinking` in half of the frames. The black level of the long frames is moved.
    """
    rng = np.random.default_rng(seed)
    rate = rate_e * rng.lognormal(0.0, 0.5, SHAPE)
    warm = rng.random(SHAPE) < hot
    rate[warm] *= rng.uniform(3.0, 30.0, int(warm.sum()))
    offset, read = BLACK + rng.normal(0.0, 3.0, SHAPE), READ_E * rng.lognormal(0.0, 0.3, SHAPE)
    jumps = blinking * rate * (rng.random(SHAPE) < 0.2)
    taken = []
    for exposure_s, moved in ((0.05, 0.0), (1.0, moved_dn)):
        high = rng.random((frames, *SHAPE)) < 0.5
        signal = rng.poisson((rate + jumps * high) * exposure_s) + read * rng.normal(size=(frames, *SHAPE))
        dn = np.rint(offset + moved + GAIN * signal).astype(np.uint16)
        taken += [("dark", exposure_s, each) for each in dn]
    return FrameSet.from_arrays(taken, bits=12)


def test_gain_and_electrons_come_from_dark_frames() -> None:
    """The read noise in electrons follows, and the diagnostic names the source with the size."""
    found = ps.calibrate(dark_set(2))
    gain, read = found.system_gain_dn_per_e, found.read_noise_e
    assert abs(gain.value - GAIN) < 3.9 * gain.standard_uncertainty
    assert gain.standard_uncertainty < 0.04 * GAIN
    assert abs(read.value - READ_E * math.exp(0.3**2)) < 3.9 * read.standard_uncertainty + 0.02 * READ_E
    (source,) = (entry for entry in found.diagnostics if entry.id == "gain-from-dark-frames")
    assert source.size == pytest.approx(gain.standard_uncertainty / gain.value)
    assert found.prnu_percent.reason_id == "no-flat-fields"
    assert found.emva1288["K"].value is None  # the standard's is that of flat fields


def test_intervals_hold_and_clean_chips_raise_no_alarm() -> None:
    """Of 60 chips, at least 50 intervals hold (fewer by chance: 1 in 2000), and no gain is withheld (1 in 500 each)."""
    entries = [ps.calibrate(dark_set(100 + k)).system_gain_dn_per_e for k in range(60)]
    assert sum(entry.value is None for entry in entries) <= 1
    known = [entry for entry in entries if entry.value is not None]
    held = sum(entry.interval_95[0] <= GAIN <= entry.interval_95[1] for entry in known)
    assert held >= 50
    z = np.array([(entry.value - GAIN) / entry.standard_uncertainty for entry in known])
    assert abs(z.mean()) < 3.5 / math.sqrt(len(z))
    assert 0.7 < z.std() < 1.35


def test_a_black_level_that_moves_with_the_exposure_time_does_no_harm() -> None:
    """With 40 DN more in the long frames, four times their dark signal: the gain is right, and the means contradict."""
    still, moved = (ps.calibrate(dark_set(2, moved_dn=dn)) for dn in (0.0, 40.0))
    for found in (still, moved):
        gain = found.system_gain_dn_per_e
        assert abs(gain.value - GAIN) < 3.9 * gain.standard_uncertainty < 0.2 * GAIN
    assert still.dark_current_e_per_s.value is not None
    assert moved.dark_current_e_per_s.value is None


def test_blinking_dark_currents_give_no_gain() -> None:
    found = ps.calibrate(dark_set(3, blinking=0.3))
    assert found.system_gain_dn_per_e.reason_id == "excess-dark-noise"


@pytest.mark.parametrize(
    "settings",
    [{"rate_e": 0.3, "hot": 0.0}, {"frames": 3}, {"rate_e": 0.0}],
    ids=["too little dark current", "three frames", "no dark current"],
)
def test_dark_frames_that_show_too_little_give_no_gain(settings: dict[str, float]) -> None:
    found = ps.calibrate(dark_set(4, **settings))
    assert found.system_gain_dn_per_e.reason_id == "no-flat-fields"
    assert "gain-from-dark-frames" not in {entry.id for entry in found.diagnostics}
