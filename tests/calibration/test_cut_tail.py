"""Noisy pixels that reach 0 in dark frames: read noise within its interval, and controls without such pixels.

The same noise is put on a high and on a low black level. Seeds are fixed.
"""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

import photosite as ps
from photosite.frames.frame_set import FrameSet

READ, SHAPE, FRAMES = 3.0, (100, 120), 16


def noise(rng, fraction, amplitude):
    """Dark frames less the black level: normal noise, and pixels of two levels with exponential distances."""
    blinks = rng.random(SHAPE) < fraction
    distance = rng.exponential(amplitude, SHAPE) * blinks
    high = rng.random(SHAPE)
    state = rng.random((FRAMES, *SHAPE)) < high
    return rng.normal(0.0, READ, (FRAMES, *SHAPE)) + distance * (state - high)


def calibrated(frames):
    dn = np.clip(np.rint(frames), 0, 4095).astype(np.uint16)
    return ps.calibrate(FrameSet.from_arrays([("dark", 0.01, frame) for frame in dn], bits=12))


def test_noise_that_is_cut_off_is_estimated():
    frames = noise(np.random.default_rng(1), 1.0, 12.0)  # all pixels, so that there are no defects
    true = np.sqrt(frames.var(axis=0, ddof=1).mean())
    whole, cut = calibrated(frames + 300.0), calibrated(frames + 30.0)
    assert whole.read_noise_dn.value == pytest.approx(true, rel=2e-3)
    lost = calibrated_variance(frames + 30.0) ** 0.5 - true
    assert lost < -0.015 * true
    low, high = cut.read_noise_dn.interval_95
    assert low < true < high
    assert abs(cut.read_noise_dn.value - true) < 0.5 * abs(lost)
    assert "noise-cut-at-zero" in limits(cut)
    assert "noise-cut-at-zero" not in limits(whole)


def calibrated_variance(frames):
    return np.clip(np.rint(frames), 0, 4095).var(axis=0, ddof=1).mean()


def test_zeros_of_other_causes_change_nothing():
    """Dead pixels, the lower tail of normal noise, and dark frames that cosmic rays hit."""
    rng = np.random.default_rng(2)
    frames = rng.normal(12.0, READ, (FRAMES, *SHAPE))
    plain = calibrated(frames).read_noise_dn
    assert 0 < (np.rint(frames) <= 0).mean() < 1e-3
    assert plain.value == pytest.approx(READ, rel=0.01)
    assert plain.standard_uncertainty < 0.003 * READ
    frames = rng.normal(35.0, READ, (FRAMES, *SHAPE))
    frames[:, rng.random(SHAPE) < 1e-3] = -50.0
    rays = rng.random(frames.shape) < 1e-5
    frames[rays] += 1000.0
    dead = calibrated(frames).read_noise_dn
    assert dead.value == pytest.approx(READ, rel=0.01)
    assert dead.standard_uncertainty < 0.003 * READ
