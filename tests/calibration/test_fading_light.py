"""A lamp that fades: within one level as a sweep of its own, and slowly under uneven light."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.calibration.photon_transfer import photon_transfer
from photosite.frames.frame_set import FrameSet

GAIN, READ_E, PRNU, SHAPE = 0.25, 5.0, 0.01, (96, 128)


class Chip:
    """A chip in plain NumPy, under light that falls off towards one side."""

    def __init__(self, seed: int, fall_off: float = 0.0) -> None:
        self.rng = np.random.default_rng(seed)
        self.response = 1.0 + self.rng.normal(0.0, PRNU, SHAPE)
        self.response *= 1.0 - fall_off * np.linspace(0.0, 1.0, SHAPE[1])
        self.offset = 100.0 + self.rng.normal(0.0, 0.5, SHAPE)

    def frame(self, electrons: float) -> np.ndarray:
        signal = self.rng.poisson(electrons * self.response) + self.rng.normal(0.0, READ_E, SHAPE)
        return np.clip(np.rint(self.offset + GAIN * signal), 0, 4095).astype(np.uint16)


def frame_set(chip: Chip, lights: dict[float, np.ndarray]) -> FrameSet:
    """Return dark frames of each exposure time, and flat fields of these electrons in this order."""
    frames = [("dark", t, chip.frame(0.0)) for t in lights for _ in range(20)]
    frames += [("light", t, chip.frame(e)) for t, electrons in lights.items() for e in electrons]
    return FrameSet.from_arrays(frames, bits=12)


@pytest.mark.parametrize(("frames", "dimmest"), [(40, 600.0), (41, 3000.0), (12, 6000.0)])
def test_a_fading_lamp_is_a_sweep(frames: int, dimmest: float) -> None:
    """Gain, read noise and PRNU within 3.9 standard uncertainties (1 in 10 000), and no frame is left out."""
    chip = Chip(frames)
    found = ps.calibrate(frame_set(chip, {0.01: np.geomspace(12_000.0, dimmest, frames)}))
    for name, truth in (("system_gain_dn_per_e", GAIN), ("read_noise_e", READ_E), ("prnu_percent", 100.0 * PRNU)):
        entry = getattr(found, name)
        assert abs(entry.value - truth) < 3.9 * entry.standard_uncertainty + (name[0] == "p") * 100 * PRNU / 150, name
    assert found.system_gain_dn_per_e.standard_uncertainty < 0.04 * GAIN
    assert found.frame_count == 20 + frames
    (note,) = (entry for entry in found.diagnostics if entry.id == "fading-light")
    assert note.size == pytest.approx(12_000.0 / dimmest, rel=0.02)
    assert found.linear_range["M"].abscissa == "signal_dn"


@pytest.mark.parametrize("turned", [False, True], ids=["rising", "in any order"])
def test_steps_of_a_lamp_are_levels(turned: bool) -> None:
    """Nine levels of five frames in one list without names: an odd number, so that pairs would straddle the steps."""
    levels = np.geomspace(1500.0, 12_000.0, 9)
    levels = np.random.default_rng(4).permutation(levels) if turned else levels
    found = ps.calibrate(frame_set(Chip(7), {0.01: np.repeat(levels, 5)}))
    gain = found.system_gain_dn_per_e
    assert abs(gain.value - GAIN) < 3.9 * gain.standard_uncertainty < 0.15 * GAIN
    assert "are taken as 9 levels" in next(entry.text for entry in found.diagnostics if entry.id == "fading-light")
    assert found.frame_count == 65


def test_a_few_dark_frames_in_a_row_are_no_level() -> None:
    """A lamp that was off for three frames has two levels, of which one is left out as before."""
    electrons = np.full(20, 9000.0)
    electrons[5:8] = 800.0
    found = ps.calibrate(frame_set(Chip(8), {0.01: electrons}))
    assert [entry.id for entry in found.diagnostics if entry.severity == "left out"] == ["outlier-frame"] * 3


def test_intervals_hold() -> None:
    """Of 40 chips, 33 intervals or more hold: fewer by chance in 1 of 4000."""
    electrons = np.geomspace(10_000.0, 1000.0, 16)
    found = [ps.calibrate(frame_set(Chip(100 + k), {0.01: electrons})).system_gain_dn_per_e for k in range(40)]
    assert sum(entry.interval_95[0] <= GAIN <= entry.interval_95[1] for entry in found) >= 33
    z = [(entry.value - GAIN) / entry.standard_uncertainty for entry in found]
    assert abs(np.mean(z)) < 3.9 / np.sqrt(40)


@pytest.mark.parametrize(
    "lights",
    [
        {0.01: np.full(20, 9000.0)},
        {0.01: np.random.default_rng(3).uniform(7000.0, 10_000.0, 20)},
        {0.01: np.geomspace(9000.0, 3000.0, 20), 0.02: np.geomspace(9500.0, 9000.0, 20)},
        {0.01: np.geomspace(9000.0, 8000.0, 20)},
    ],
    ids=["steady", "random", "two times", "narrow"],
)
def test_other_light_is_not_divided(lights: dict[float, np.ndarray]) -> None:
    found = ps.calibrate(frame_set(Chip(1), lights))
    assert "fading-light" not in limits(found)


def test_a_black_frame_among_those_of_a_narrow_fade_is_left_out() -> None:
    electrons = np.geomspace(9000.0, 6500.0, 20)
    electrons[7] = 0.0
    found = ps.calibrate(frame_set(Chip(2), {0.01: electrons}))
    assert [entry.id for entry in found.diagnostics if entry.severity == "left out"] == ["outlier-frame"]


def slow_drift(seed: int) -> ps.Calibration:
    """Five exposure times, at each of which the light falls by a fifth, under light that falls off by two thirds."""
    chip = Chip(seed, fall_off=0.67)
    return ps.calibrate(frame_set(chip, {t: 8e5 * t * np.linspace(1.1, 0.9, 20) for t in np.linspace(0.003, 0.015, 5)}))


def test_a_slow_drift_of_uneven_light_does_not_raise_the_gain(monkeypatch: pytest.MonkeyPatch) -> None:
    """The drift leaves the square of 6 % of the spread of the light in the variances, more than the shot noise."""
    gain = slow_drift(5).system_gain_dn_per_e
    assert abs(gain.value - GAIN) < 3.9 * gain.standard_uncertainty < 0.15 * GAIN
    monkeypatch.setattr(photon_transfer, "_uneven_shifts", lambda levels, signal: 0.0)
    without = slow_drift(5).system_gain_dn_per_e
    assert without.value is None or without.value > 1.2 * GAIN


def test_checkpoints_are_of_the_divided_level(tmp_path) -> None:
    """The folder is empty afterwards, and the result is that without it."""
    frames = frame_set(Chip(6), {0.01: np.geomspace(12_000.0, 1200.0, 16)})
    found, again = ps.calibrate(frames), ps.calibrate(frames, checkpoint=tmp_path / "sums")
    assert again.system_gain_dn_per_e == found.system_gain_dn_per_e
    assert not (tmp_path / "sums").exists()
