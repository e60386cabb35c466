"""The dark current from the variance, compared with that from the mean."""

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import frame_set_from_arrays

GAIN, READ_E, DARK_E_PER_S = 0.8, 5.0, 300.0


def frames_of(seed, *, clamped=False):
    """Darks of 0.1 to 1 s and flats; black level clamping subtracts the mean of the dark charge."""
    rng = np.random.default_rng(seed)
    shape = (48, 64)

    def frame(electrons, off_e=0.0):
        charge = rng.poisson(electrons, shape) - off_e + rng.normal(0.0, READ_E, shape)
        return np.clip(np.round(120.0 + GAIN * charge), 0, 4095).astype(np.uint16)

    frames = []
    for t in np.linspace(0.1, 1.0, 8):
        dark = DARK_E_PER_S * t
        frames += [("dark", t, frame(dark, dark if clamped else 0.0)) for _ in range(4)]
    for t in np.linspace(0.1, 1.0, 6):
        dark = DARK_E_PER_S * t
        frames += [("light", t, frame(4000.0 * t + dark, dark if clamped else 0.0)) for _ in range(2)]
    return frame_set_from_arrays(frames, bits=12)


def test_the_dark_current_from_the_variance_is_right():
    """30 chips: 28.5 intervals of 95 % contain the truth on average, 24 or fewer once in 3000 runs. The mean error is
    within four standard errors."""
    inside, errors = 0, []
    for seed in range(30):
        estimate = calibrate(frames_of(seed)).dark_current_from_variance_e_per_s
        low, high = estimate.interval_95
        inside += low < DARK_E_PER_S < high
        errors.append((estimate.value - DARK_E_PER_S) / estimate.standard_uncertainty)
    assert inside > 24
    assert abs(np.mean(errors)) < 4.0 / np.sqrt(30)


def test_both_agree_without_clamping():
    calibration = calibrate(frames_of(100))
    low, high = calibration.dark_current_e_per_s.interval_95
    assert low < DARK_E_PER_S < high
    assert not any("and from the variance" in warning for warning in calibration.warnings)


def test_a_clamped_black_level_gives_a_warning():
    calibration = calibrate(frames_of(101, clamped=True))
    assert calibration.dark_current_e_per_s.value == pytest.approx(0.0, abs=5.0)
    low, high = calibration.dark_current_from_variance_e_per_s.interval_95
    assert low < DARK_E_PER_S < high
    assert any("and from the variance" in warning for warning in calibration.warnings)
