"""Frame sets that show only some parameters: the others are missing, each with its reason."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameGroup, FrameSet, FrameSource
from photosite.frames.frame_settings import Kind
from photosite.values.estimate import Estimate

SHAPE = (96, 128)
GAIN, READ_DN, BLACK_DN, DSNU_DN = 0.3, 1.8, 64.0, 0.6
DARK_DN_PER_S, LIGHT_E_PER_S = 9.0, 1.5e5


def measured(
    dark_s: tuple[float, ...], light_s: tuple[float, ...] = (), frames: int = 8, black_dn: float = BLACK_DN
) -> Calibration:
    rng = np.random.default_rng(5)
    offset = black_dn + DSNU_DN * rng.normal(size=SHAPE)

    def group(kind: Kind, exposure_s: float) -> FrameGroup:
        electrons = exposure_s * (DARK_DN_PER_S / GAIN + (LIGHT_E_PER_S if kind == "light" else 0.0))
        sources = []
        for i in range(frames):
            dn = offset + GAIN * rng.poisson(electrons, SHAPE) + READ_DN * rng.normal(size=SHAPE)
            sources.append(FrameSource(f"{kind} {exposure_s:g} {i}", partial(np.array, np.uint16(dn.clip(0) + 0.5))))
        return FrameGroup(kind, exposure_s, tuple(sources))

    groups = [*(group("dark", t) for t in dark_s), *(group("light", t) for t in light_s)]
    return calibrate(FrameSet(tuple(groups), rows=SHAPE[0], cols=SHAPE[1], bits=12))


def holds(estimate: Estimate, truth: float) -> None:
    # 3.5 standard uncertainties: 5 in 10 000 by chance. They are below a tenth of the value.
    assert estimate.value == pytest.approx(truth, abs=3.5 * estimate.standard_uncertainty)
    assert estimate.standard_uncertainty < 0.1 * truth


def missing(calibration: Calibration, *names: str) -> None:
    for name in names:
        estimate = getattr(calibration, name)
        assert estimate.value is None, name
        assert estimate.reason, name


def test_dark_frames_of_one_exposure() -> None:
    calibration = measured((0.01,))
    holds(calibration.read_noise_dn, READ_DN)
    holds(calibration.dsnu_dn, DSNU_DN)
    holds(calibration.black_level_dn, BLACK_DN + 0.09)
    missing(
        calibration, "dark_current_dn_per_s", "dcnu_percent", "system_gain_dn_per_e", "prnu_percent", "read_noise_e"
    )


def test_clipped_dark_frames_of_one_exposure() -> None:
    calibration = measured((0.01,), black_dn=1.0)
    holds(calibration.read_noise_dn, READ_DN)
    holds(calibration.black_level_dn, 1.09)


def test_dark_frames_of_several_exposures() -> None:
    calibration = measured((0.01, 0.1, 1.0))
    holds(calibration.dark_current_dn_per_s, DARK_DN_PER_S)
    holds(calibration.read_noise_dn, READ_DN)
    missing(calibration, "dark_current_e_per_s", "system_gain_dn_per_e")


@pytest.mark.parametrize(("frames", "largest"), [(2, 0.02), (8, 0.007)])
def test_bias_frames_and_one_level_of_light(frames: int, largest: float) -> None:
    """The two-point method: K is the difference of the variances over the difference of the means."""
    calibration = measured((0.01,), (0.04,), frames)
    holds(calibration.system_gain_dn_per_e, GAIN)
    assert calibration.system_gain_dn_per_e.standard_uncertainty < largest * GAIN
    holds(calibration.read_noise_e, READ_DN / GAIN)
    missing(calibration, "prnu_percent", "saturation_dn", "linearity_error_percent", "dark_current_dn_per_s")
    assert any("one level of light" in warning for warning in calibration.warnings)
