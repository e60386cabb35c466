"""Read noise far below a step of the converter: the dark variance depends on the phase of the level."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet

DARK_S = (0.2, 0.5, 1.0, 2.0)


def calibrated(gain: float, read_dn: float, black: float, dark_e_per_s: float, seed: int) -> Calibration:
    """Return the calibration of 8-bit frames up to 0.9 of the full scale, with a DSNU of 0.025 DN."""
    rng, shape = np.random.default_rng([seed, 8]), (96, 120)
    response, offset = 1.0 + rng.normal(0.0, 0.008, shape), rng.normal(black, 0.025, shape)
    per_s = 0.9 * (255.0 - black) / gain / 2.0

    def frame(kind: str, exposure_s: float) -> np.ndarray:
        light = per_s * exposure_s * response if kind == "light" else 0.0
        electrons = rng.poisson(light + dark_e_per_s * exposure_s, shape)
        dn = gain * electrons + offset + rng.normal(0.0, read_dn, shape)
        return np.clip(np.rint(dn), 0, 255).astype(np.uint16)

    taken = [("dark", t, frame("dark", t)) for t in DARK_S for _ in range(6)]
    taken += [("light", 0.2 * k, frame("light", 0.2 * k)) for k in range(1, 11) for _ in range(4)]
    return calibrate(FrameSet.from_arrays(taken, bits=8))


@pytest.mark.parametrize("black", [8.0, 8.2, 8.5, 8.8])
@pytest.mark.parametrize("read_dn", [0.05, 0.13, 0.3])
def test_the_gain_s_interval_holds_the_truth(read_dn: float, black: float) -> None:
    """The bounds of the error, 0.25 DN^2, count as a standard uncertainty: none of 12 intervals should miss."""
    found = calibrated(0.0127, read_dn, black, 20.0, seed=int(100 * read_dn))
    low, high = found.system_gain_dn_per_e.interval_95
    assert low < 0.0127 < high
    assert high - low < 0.8 * 0.0127
    ids = {entry.id for entry in found.diagnostics}
    assert not {"far-pixels", "dark-levels-scatter", "other-offsets"} & ids


def test_noise_of_half_a_step_keeps_the_uncertainty_of_sampling() -> None:
    found = calibrated(0.0127, 0.5, 8.3, 20.0, seed=3).system_gain_dn_per_e
    low, high = found.interval_95
    assert low < 0.0127 < high
    assert high - low < 0.03 * 0.0127
