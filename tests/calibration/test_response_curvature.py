"""A curved response is found and separated from non-linear light; straight responses pass."""

from dataclasses import replace

import numpy as np
import pytest

from photosite.calibration.photon_transfer.channel import ResponseCurvature, find_curvature, gain_with_curvature
from photosite.calibration.photon_transfer.photon_transfer import LightLevels, fit_gain, fit_response
from photosite.values.uncertain import Missing, Source, Uncertain

GAIN, EFFICIENCY, PIXELS = 0.3, 0.5, 10_000


def light_levels(rng, *, response=0.0, lamp=0.0, levels=20):
    """Levels of a camera with the signal K e (1 + response e / top), under a lamp with a curvature of its own."""
    photons = np.linspace(0.05, 1.0, levels) * 20_000.0
    electrons = EFFICIENCY * photons * (1.0 + lamp * photons / photons[-1])
    share = response * electrons / electrons[-1]
    signal = GAIN * electrons * (1.0 + share)
    shot = GAIN**2 * electrons * (1.0 + 2.0 * share) ** 2
    of_signal, of_shot = shot / PIXELS, 2.0 * shot**2 / PIXELS
    everything = dict.fromkeys(LightLevels.__dataclass_fields__)
    return LightLevels(
        **everything
        | {
            "abscissa": "photons_per_pixel",
            "x": photons,
            "exposure_s": photons / 1e6,
            "signal": rng.normal(signal, np.sqrt(of_signal)),
            "signal_covariance": np.diag(of_signal),
            "shot": rng.normal(shot, np.sqrt(of_shot)),
            "shot_covariance": np.diag(of_shot),
            "noise": shot,
            "noise_uncertainty": np.sqrt(of_shot),
            "dark_share": np.zeros((levels, 1)),
            "dark_noise": (Uncertain(0.0),),
        }
    )


def found(levels):
    return find_curvature(levels, np.ones(len(levels.x), np.bool_), Source())


@pytest.mark.parametrize("response", [-0.04, 0.03])
def test_slopes_at_zero_light_are_found(response):
    """To 4 standard errors of the line; those of the parabola are larger."""
    levels = light_levels(np.random.default_rng(1), response=response)
    use = [np.ones(len(levels.x), np.bool_)]
    line, curvature = fit_gain([levels], use), found(levels)
    gain = float(line.parameters[0]) * (1.0 + curvature.gain)
    assert gain == pytest.approx(GAIN, abs=4.0 * float(np.sqrt(line.covariance[0, 0])))
    assert abs(float(line.parameters[0]) / GAIN - 1.0) > 0.5 * abs(response)
    responsivity = float(fit_response(levels, use[0]).parameters[0]) * (1.0 + curvature.responsivity)
    assert responsivity == pytest.approx(GAIN * EFFICIENCY, rel=2e-3)
    assert curvature.contrast(levels.x[-1]) == pytest.approx((1 + 2 * response) / (1 + response) - 1, rel=0.1)


def test_straight_responses_pass():
    """One of 1000 may be reported as curved: of 300, more than three are once in 3000."""
    rng = np.random.default_rng(2)
    assert sum(found(light_levels(rng)) is not None for _ in range(300)) <= 3


def test_non_linear_light_does_not_change_the_gain():
    """The signal is curved against the stated light, but the variance is proportional to it: lamp or shutter."""
    curvature = found(light_levels(np.random.default_rng(3), lamp=-0.04))
    assert curvature.gain == 0.0
    assert curvature.contrast(10_000.0) == 0.0
    assert abs(curvature.responsivity) > 0.01


def test_the_curvature_widens_the_uncertainty_and_cancels_in_ratios():
    curvature = ResponseCurvature(0.03, 0.01, -1e-6, Source())
    gain = curvature.widen(Uncertain.of(0.3, 1e-4), curvature.gain)
    responsivity = curvature.widen(Uncertain(0.15), curvature.responsivity)
    assert gain.value == 0.3
    assert gain.relative == pytest.approx(0.03, rel=1e-3)
    assert (responsivity / gain).relative == pytest.approx(0.02, rel=1e-3)
    assert gain_with_curvature(Missing("no"), []) == Missing("no")
    assert gain_with_curvature(Uncertain(0.3), []) == Uncertain(0.3)


@pytest.mark.parametrize("lights", [1, 2, 4])
def test_few_different_levels_show_no_curvature(lights):
    """Twenty levels at few different amounts of light do not determine a parabola."""
    levels = light_levels(np.random.default_rng(5), response=-0.04)
    x = 20_000.0 * (1.0 + np.arange(20) % lights) * (1.0 + 1e-14 * np.arange(20))
    assert found(replace(levels, x=x)) is None


def test_few_levels_show_no_curvature():
    assert found(light_levels(np.random.default_rng(4), response=-0.04, levels=4)) is None
