"""Dark frames of one short time and long flat fields, whose slopes contain the spread of a hidden dark current."""

from __future__ import annotations

import numpy as np
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet

LIGHT_E_PER_S, DARK_E_PER_S, PRNU = 7000.0, 400.0, 0.015


def measured(dark_s: tuple[float, ...], top_s: float = 1.0, *, dark_e_per_s: float = DARK_E_PER_S) -> Calibration:
    """Calibrate dark frames of some times and flat fields to `top_s`, which saturate above 0.54 s.

    The dark current spreads by 42 %, by a factor of 1.6 more than the response where it is 400 e-/s.
    """
    rng, shape = np.random.default_rng(9), (96, 128)
    dark = dark_e_per_s * np.exp(rng.normal(-0.08, 0.4, shape))
    response = LIGHT_E_PER_S * (1.0 + PRNU * rng.normal(size=shape))

    def frame(electrons: np.ndarray | float, exposure_s: float) -> np.ndarray:
        charge = rng.poisson((electrons + dark) * exposure_s) + rng.normal(0.0, 5.0, shape)
        return np.clip(np.rint(64.0 + 0.4 * charge), 0, 4095).astype(np.uint16)

    taken = [("dark", t, frame(0.0, t)) for t in dark_s for _ in range(6)]
    taken += [("light", top_s * k / 10, frame(response, top_s * k / 10)) for k in range(1, 11) for _ in range(4)]
    return calibrate(FrameSet.from_arrays(taken, bits=12))


def named(calibration: Calibration) -> tuple[str, ...]:
    """Return what the diagnostic of short dark frames concerns."""
    return next(entry.parameters for entry in calibration.diagnostics if entry.id == "short-dark-exposures")


def test_prnu_contains_the_spread_of_a_dark_current_that_one_dark_time_leaves_open() -> None:
    """Without it PRNU is 2.7 % for 1.5 %, 90 of its uncertainties too large."""
    found = measured((0.1,))
    low, high = found.prnu_percent.interval_95
    assert low < 100.0 * PRNU < high
    assert found.prnu_percent.standard_uncertainty > 0.1
    assert "prnu_percent" in named(found)


def test_prnu1288_contains_it_and_the_block_of_the_standard_does_not() -> None:
    found = measured((0.1,), 2.0)
    for name in ("prnu1288_percent", "prnu1288_pixel_percent", "prnu1288_unfiltered_percent"):
        low, high = found.estimates()[name].interval_95
        assert low < 100.0 * PRNU < high
    for symbol in ("PRNU1288", "PRNU1288_pixel", "PRNU1288_unfiltered"):
        assert found.emva1288[symbol].interval_95[0] > 150.0 * PRNU


def test_prnu_is_withheld_where_dark_frames_are_too_short_to_show_a_dark_current() -> None:
    found = measured((0.01,))
    assert found.prnu_percent.reason_id == "unknown-dark-current"
    assert limits(found)["short-dark-exposures"] == 1.0
    assert "prnu_percent" in named(found)


def test_a_dark_current_that_cannot_matter_leaves_prnu_as_it_is() -> None:
    """Dark frames of half the longest time; without a dark current the uncertainty is 0.7 % of PRNU (12 288 pixels)."""
    prnu = measured((0.5,), dark_e_per_s=0.0).prnu_percent
    assert abs(prnu.value - 100.0 * PRNU) < 3.0 * prnu.standard_uncertainty
    assert prnu.standard_uncertainty < 0.0075 * prnu.value


def test_dark_frames_of_two_times_show_the_dark_current() -> None:
    found = measured((0.01, 0.5))
    low, high = found.prnu_percent.interval_95
    assert low < 100.0 * PRNU < high
    assert "prnu_percent" not in named(found)
