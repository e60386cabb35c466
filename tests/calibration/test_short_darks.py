"""Dark frames of one short time and long flat fields: PRNU contains the spread of a dark current that none shows."""

from __future__ import annotations

import numpy as np

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import FrameSet


def named(dark_s: tuple[float, ...]) -> tuple[str, ...]:
    """Return what the diagnostic of short dark frames concerns: flat fields to 1 s, 400 e-/s of dark current."""
    rng, shape = np.random.default_rng(9), (96, 128)
    dark = 400.0 * np.exp(rng.normal(0.0, 0.4, shape))

    def frame(electrons: float, exposure_s: float) -> np.ndarray:
        charge = rng.poisson(electrons * exposure_s + dark * exposure_s)
        return np.rint(64.0 + 0.4 * (charge + rng.normal(0.0, 5.0, shape))).astype(np.uint16)

    taken = [("dark", t, frame(0.0, t)) for t in dark_s for _ in range(6)]
    taken += [("light", 0.1 * k, frame(7000.0, 0.1 * k)) for k in range(1, 11) for _ in range(4)]
    found = calibrate(FrameSet.from_arrays(taken, bits=12))
    assert found.prnu_percent.value is not None
    return next(entry.parameters for entry in found.diagnostics if entry.id == "short-dark-exposures")


def test_dark_frames_of_one_time_name_prnu() -> None:
    assert "prnu_percent" in named((0.01,))


def test_dark_frames_of_two_times_show_the_dark_current() -> None:
    assert "prnu_percent" not in named((0.01, 0.5))
