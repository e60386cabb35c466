"""Read noise far below a step of the converter: the dark variance depends on the phase of the level."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet

DARK_S = (0.2, 0.5, 1.0, 2.0)


def calibrated(
    gain: float,
    read_dn: float,
    black: float,
    dark_e_per_s: float,
    seed: int,
    dark_s: tuple[float, ...] = DARK_S,
    brightest: float = 0.9,
) -> Calibration:
    """Return the calibration of 8-bit frames up to a fraction of the full scale, with a DSNU of 0.025 DN."""
    rng, shape = np.random.default_rng([seed, 8]), (96, 120)
    response, offset = 1.0 + rng.normal(0.0, 0.008, shape), rng.normal(black, 0.025, shape)
    per_s = brightest * (255.0 - black) / gain / 2.0

    def frame(kind: str, exposure_s: float) -> np.ndarray:
        light = per_s * exposure_s * response if kind == "light" else 0.0
        electrons = rng.poisson(light + dark_e_per_s * exposure_s, shape)
        dn = gain * electrons + offset + rng.normal(0.0, read_dn, shape)
        return np.clip(np.rint(dn), 0, 255).astype(np.uint16)

    taken = [("dark", t, frame("dark", t)) for t in dark_s for _ in range(6)]
    taken += [("light", 0.2 * k, frame("light", 0.2 * k)) for k in range(1, 11) for _ in range(4)]
    return calibrate(FrameSet.from_arrays(taken, bits=8))


@pytest.mark.parametrize("black", [8.0, 8.2, 8.5, 8.8])
@pytest.mark.parametrize("read_dn", [0.05, 0.13, 0.3])
def test_the_gain_s_interval_holds_the_truth(read_dn: float, black: float) -> None:
    """The gain comes from the flat fields: twelve intervals of 4.9 standard uncertainties, far beyond chance."""
    found = calibrated(0.0127, read_dn, black, 20.0, seed=int(100 * read_dn))
    gain = found.system_gain_dn_per_e
    assert abs(gain.value - 0.0127) < 4.9 * gain.standard_uncertainty
    assert gain.standard_uncertainty < 0.008 * 0.0127
    ids = {entry.id for entry in found.diagnostics}
    assert not {"far-pixels", "dark-levels-scatter", "other-offsets", "repeated-frame", "negative-dark-variance"} & ids


def test_the_standard_s_figures_do_not_change_with_the_rounding() -> None:
    """EMVA 1288: the dark frames as they are, for K; at most 0.40 / K as dark noise below 0.24 DN^2."""
    found = calibrated(0.0127, 0.13, 8.5, 20.0, seed=13)
    block, gain = found.emva1288, found.emva1288["K"]
    assert block["sigma_d"].value is None
    assert block["sigma_d"].upper_limit_95 == pytest.approx(0.3958 / gain.value, rel=1e-3)
    assert gain.value != found.system_gain_dn_per_e.value
    hidden = next(entry for entry in found.diagnostics if entry.id == "noise-hidden-by-quantization")
    assert "temporal_dark_noise_e" in hidden.parameters


def test_noise_of_half_a_step_keeps_the_uncertainty_of_sampling() -> None:
    found = calibrated(0.0127, 0.5, 8.3, 20.0, seed=3).system_gain_dn_per_e
    low, high = found.interval_95
    assert low < 0.0127 < high
    assert high - low < 0.03 * 0.0127


def test_dark_current_that_rounding_hides_is_in_the_uncertainty_of_the_responsivity() -> None:
    """Dark frames read 3 DN at all times; their levels rise from 3.03 to 3.19 DN, 0.02 % of the brightest signal."""
    rng, shape, gain, efficiency, seconds = np.random.default_rng(7), (96, 120), 0.03, 0.5, np.linspace(0.025, 0.25, 10)
    offset, light = rng.normal(3.03, 0.03, shape), 1.0 + rng.normal(0.0, 0.002, shape)

    def frame(electrons: float, exposure_s: float) -> np.ndarray:
        charge = rng.poisson(electrons * light + 22.0 * exposure_s, shape) + rng.normal(0.0, 2.0, shape)
        return np.clip(np.rint(offset + gain * charge), 0, 1023).astype(np.uint16)

    taken = [("dark", t, frame(0.0, t), 0.0) for t in seconds for _ in range(2)]
    taken += [("light", t, frame(1.2e5 * t, t), 1.2e5 * t / efficiency) for t in seconds for _ in range(4)]
    found = calibrate(FrameSet.from_arrays(taken, bits=10)).responsivity_dn_per_photon
    low, high = found.interval_95
    assert low < gain * efficiency < high
    assert high - low < 0.005 * gain * efficiency


def test_the_saturation_of_full_wells_with_little_noise_is_not_exact() -> None:
    """Full wells read 455.7 DN with 0.12 DN of noise: 456 DN in 95 % of the numbers, and 455 DN."""
    rng, shape, gain, well = np.random.default_rng(5), (96, 120), 0.03, 15_000.0
    offset = rng.normal(5.7, 0.05, shape)

    def frame(electrons: float) -> np.ndarray:
        charge = np.minimum(rng.poisson(electrons, shape), well)
        return np.clip(np.rint(offset + gain * charge + rng.normal(0.0, 0.11, shape)), 0, 1023).astype(np.uint16)

    taken = [("dark", 0.01, frame(0.0)) for _ in range(8)]
    taken += [("light", 0.01 * k, frame(2000.0 * k)) for k in range(1, 11) for _ in range(6)]
    low, high = calibrate(FrameSet.from_arrays(taken, bits=10)).saturation_dn.interval_95
    assert low < 455.951 < high
    assert high - low < 0.5


def test_noise_that_is_hidden_at_all_exposures_is_hidden_at_zero() -> None:
    """Rounding errors of long dark frames, extrapolated to exposure zero, make the variance there -0.05 +- 0.3 DN2."""
    found = calibrated(0.0249, 0.07, 2.746, 11.0, seed=4, dark_s=(0.83, 0.96, 1.12, 1.3, 1.52, 1.77), brightest=1.2)
    dark_noise_e = (0.24 / found.system_gain_dn_per_e.value**2 + 0.25) ** 0.5 + 0.5
    assert found.dynamic_range_db.value == pytest.approx(
        20.0 * np.log10(found.saturation_capacity_e.value / dark_noise_e), rel=1e-9
    )
