"""Signal-to-noise ratio: points against the law of the simulated frames, and the model against its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.photon_transfer.snr import SnrCurve
from photosite.frames.frame_set import FrameSet
from photosite.values.uncertain import Missing, Uncertain

K, READ_DN, BLACK = 0.4, 2.5, 100.0
ELECTRONS = np.geomspace(40, 4000, 9)


def frames(photons: bool, seed: int = 11):
    """A sensor with quantum efficiency 0.5: two frames per level, and darks at every exposure time."""
    rng = np.random.default_rng(seed)
    listed = []
    for electrons in ELECTRONS:
        exposure = electrons / 1e5
        for kind, mean in (("dark", 0.0), ("light", electrons)):
            signal = K * rng.poisson(mean, (2, 96, 96)) + rng.normal(BLACK, READ_DN, (2, 96, 96))
            counts = (2.0 * mean,) if photons else ()
            listed += [(kind, exposure, np.rint(dn).astype(np.uint16), *counts) for dn in signal]
    return FrameSet.from_arrays(listed, bits=12)


@pytest.fixture(scope="module", params=[True, False], ids=["photons", "electrons"])
def curve(request: pytest.FixtureRequest) -> SnrCurve:
    found = calibrate(frames(request.param)).snr["M"]
    assert isinstance(found, SnrCurve)
    assert found.photons is request.param
    return found


def truth(curve: SnrCurve) -> np.ndarray:
    electrons = ELECTRONS
    return electrons / np.sqrt(electrons + (READ_DN**2 + 1 / 12) / K**2)


def test_points_follow_the_law_within_their_uncertainty(curve: SnrCurve) -> None:
    """Nine normal deviates: one beyond 4 in 1 of 1800 runs; their chi square beyond 30 in 1 of 2300."""
    deviation = (curve.snr - truth(curve)) / curve.snr_uncertainty
    assert len(deviation) == len(ELECTRONS)
    assert np.abs(deviation).max() < 4.0
    assert 1.0 < np.sum(deviation**2) < 30.0


def test_the_band_of_the_model_contains_the_law(curve: SnrCurve) -> None:
    light = 2.0 * ELECTRONS if curve.photons else ELECTRONS
    model, uncertainty = curve.model(light)
    assert np.all(np.abs(model - truth(curve)) < 4.0 * uncertainty)
    assert np.all(uncertainty < 0.01 * model)


@pytest.mark.parametrize("photons", [True, False])
def test_band_is_first_order_propagation_of_three_independent_inputs(photons: bool) -> None:
    none = np.array([])
    inputs = {"response_dn": Uncertain.of(0.2, 2e-3), "gain_dn_per_e": Uncertain.of(0.4, 8e-3)}
    inputs["dark_variance_dn2"] = Uncertain.of(6.0, 0.3)
    if not photons:
        inputs["response_dn"] = inputs["gain_dn_per_e"]
    curve = SnrCurve(none, none, none, none.astype(bool), photons, **inputs)
    x = np.array([3.0, 100.0, 1e4])
    snr, uncertainty = curve.model(x)
    step, squares = 1e-6, np.zeros(3)
    for name in inputs if photons else ("gain_dn_per_e", "dark_variance_dn2"):
        known = inputs[name]
        moved = replace(curve, **{name: Uncertain(known.value * (1 + step))})
        squares += ((moved.model(x)[0] - snr) / (known.value * step) * known.standard_uncertainty) ** 2
    assert uncertainty == pytest.approx(np.sqrt(squares), rel=1e-4)


def test_a_negative_noise_variance_gives_no_ratio() -> None:
    none, one = np.array([]), Uncertain(1.0)
    curve = SnrCurve(none, none, none, none.astype(bool), True, one, one, Uncertain.of(-5.0, 1.0))
    snr, _ = curve.model([4.0, 6.0])
    assert np.isnan(snr[0])
    assert snr[1] == 6.0


def test_one_frame_per_level_gives_a_reason() -> None:
    rng = np.random.default_rng(2)

    def shot(mean: float) -> np.ndarray:
        return np.rint(rng.normal(64 + mean, 3.0, (32, 32))).astype(np.uint16)

    listed = [("dark", 0.01, shot(0)) for _ in range(3)] + [("light", t, shot(1e4 * t)) for t in (0.01, 0.02, 0.03)]
    found = calibrate(FrameSet.from_arrays(listed, bits=12)).snr["M"]
    assert isinstance(found, Missing)
    assert found.id == "single-flat-fields"
