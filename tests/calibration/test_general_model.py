"""The general model against closed forms: a linear camera, and one with a curved response."""

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.photon_transfer.general_model import local_slopes
from photosite.frames.frame_set import FrameSet
from photosite.values.uncertain import Missing

READ_DN, GAIN = 3.0, 0.5


def frames_of(signal, exposures, seed, *, photons_per_s=None, slope=None):
    """Pairs of 100 x 100 flats and darks, with read noise and shot noise."""
    rng = np.random.default_rng(seed)
    noisy = []

    def frame(mean, electrons, gain):
        shot = rng.poisson(electrons, (100, 100)) - electrons
        return np.clip(np.round(100.0 + mean + gain * shot + rng.normal(0, READ_DN, (100, 100))), 0, 4095)

    for t in exposures:
        for _ in range(2):
            noisy.append(("dark", t, frame(0.0, 0.0, 0.0).astype(np.uint16), 0.0 if photons_per_s else None))
            light = photons_per_s * t if photons_per_s else None
            gain = GAIN if slope is None else GAIN * slope(t)
            noisy.append(("light", t, frame(signal(t), 20_000.0 * t, gain).astype(np.uint16), light))
    return FrameSet.from_arrays([entry if entry[3] is not None else entry[:3] for entry in noisy], bits=12)


def test_slopes_are_exact_on_a_parabola_of_uneven_steps():
    x = np.array([0.1, 0.5, 0.6, 2.0, 3.5])
    np.testing.assert_allclose(local_slopes(x) @ (3.0 - 2.0 * x + 4.0 * x**2), -2.0 + 8.0 * x, rtol=1e-12)


@pytest.mark.parametrize("photons_per_s", [None, 40_000.0])
def test_a_linear_camera_has_the_linear_model_s_figures(photons_per_s):
    """Threshold: H R = sigma(H). With sigma^2 = s^2 + 1/12 + K R H, R in DN per unit of light, that is
    H = (K + sqrt(K^2 + 4 s^2)) / (2 R)."""
    calibration = calibrate(frames_of(lambda t: 1e4 * t, np.linspace(0.02, 0.5, 25), 1, photons_per_s=photons_per_s))
    assert calibration.model == ("linear" if photons_per_s else "general")
    found = calibration.general["M"]
    response = 1e4 if photons_per_s is None else 1e4 / photons_per_s
    s2 = READ_DN**2 + 1 / 12
    expected = (GAIN + np.sqrt(GAIN**2 + 4.0 * s2)) / (2.0 * response)
    # Two frames of 10 000 pixels give a variance to 1.4 %; that of the first level and of the dark add 0.7 % each.
    assert found.threshold.value == pytest.approx(expected, rel=0.04)
    x = found.x
    ideal = x * response / np.sqrt(s2 + GAIN * response * x)
    there = np.isfinite(found.snr)
    error = (found.snr - ideal)[there] / found.snr_uncertainty[there]
    # The parabola of the last level includes the first clipped one. For the 18 others, 1.5 occurs once in 50 000.
    assert np.sqrt(np.mean(error[:-1] ** 2)) < 1.5
    assert there[x * response < 3800.0].all()
    entries = calibration.to_dict()
    assert entries["model"] == calibration.model
    assert entries["general"]["M"]["threshold"]["value"] == found.threshold.value


def test_a_curved_response_keeps_the_ratio_of_the_electrons():
    """y = 1e4 t (1 - t / 3): a smaller local slope reduces signal and noise alike, and the input ratio stays that of
    the electrons, t r / sqrt(s^2 / g^2 + t r), r electrons per second and g DN per electron there."""
    exposures = np.linspace(0.02, 0.8, 40)

    def slope(t):
        return 1.0 - 2.0 * t / 3.0

    calibration = calibrate(frames_of(lambda t: 1e4 * t * (1.0 - t / 3.0), exposures, 2, slope=slope))
    found = calibration.general["M"]
    t = found.x
    inner = found.signal_dn < 3500.0
    # Two frames give the mean to 0.005 sigma: with steps of 0.02 s that is at most 0.5 % of a slope.
    np.testing.assert_allclose(found.slope[inner], 1e4 * slope(t)[inner], rtol=0.02)
    ideal = 20_000.0 * t / np.sqrt((READ_DN**2 + 1 / 12) / (GAIN * slope(t)) ** 2 + 20_000.0 * t)
    np.testing.assert_allclose(found.snr[inner], ideal[inner], rtol=0.04)


def test_too_few_levels_give_a_reason():
    calibration = calibrate(frames_of(lambda t: 1e4 * t, [0.1, 0.2], 3))
    assert isinstance(calibration.general["M"], Missing)
    assert calibration.general["M"].reason.startswith("2 light levels")
