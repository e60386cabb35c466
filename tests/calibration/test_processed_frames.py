"""Frames that were averaged, binned or had a dark frame subtracted in the camera."""

import numpy as np
import pytest
from tests.helpers.diagnosed import limits

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import FrameSet

K, READ_E, BLACK = 0.3, 6.0, 64.0
SHAPE = (72, 96)
LEVELS = (0.1, 0.2, 0.3, 0.5, 1, 2, 3, 4, 6, 8, 10)


def stack(seed, process=lambda one, kind: one(), bits=12, shape=SHAPE, levels=LEVELS):
    """Darks and flats; `process` makes a frame of the camera's single frames."""
    rng = np.random.default_rng(seed)
    response, offset = 1.0 + 0.008 * rng.normal(size=shape), BLACK + 0.6 * rng.normal(size=shape)

    def take(kind, exposure_s):
        def one():
            electrons = rng.poisson(response * (1.5e5 * exposure_s if kind == "light" else 0.0))
            return np.clip(np.rint(offset + K * (electrons + rng.normal(0.0, READ_E, shape))), 0, 4095)

        frames = [np.clip(np.rint(process(one, kind)), 0, 2**bits - 1).astype(np.uint16) for _ in range(8)]
        return [(kind, exposure_s, dn) for dn in frames]

    groups = [take("dark", t) for t in (0.01, 0.1)] + [take("light", 0.01 * t) for t in levels]
    return FrameSet.from_arrays([shot for group in groups for shot in group], bits=bits)


def mean_of(kind, number):
    return lambda one, now: np.mean([one() for _ in range(number)], axis=0) if now == kind else one()


@pytest.mark.parametrize(("kind", "number", "ratio"), [("dark", 4, 4.0), ("dark", 2, 2.0), ("light", 4, 0.25)])
def test_averaged_frames_beside_single_ones_are_named(kind, number, ratio):
    found = calibrate(stack(1, mean_of(kind, number)))
    assert found.system_gain_dn_per_e.value is None
    assert found.system_gain_dn_per_e.reason_id == "different-modes"
    assert limits(found)["different-modes"] == pytest.approx(ratio, rel=0.15)


def test_sums_of_frames_are_named():
    found = calibrate(stack(2, lambda one, kind: one() + one() + one() + one(), bits=14))
    assert limits(found)["summed-codes"] == 4
    for estimate, truth in ((found.system_gain_dn_per_e, K), (found.read_noise_e, 2.0 * READ_E)):
        low, high = estimate.interval_95
        assert low <= truth <= high


def test_a_dark_frame_that_was_subtracted_in_the_camera_leaves_no_pattern():
    frames = stack(3, lambda one, kind: one() - one() + BLACK, shape=(160, 192), levels=(1, 2, 4))
    subtracted = calibrate(frames)
    assert "no-fixed-pattern" in limits(subtracted)


@pytest.mark.slow
def test_clean_stacks_are_not_reported():
    found = {id for seed in range(100) for id in limits(calibrate(stack(seed)))}
    assert not found & {"different-modes", "no-fixed-pattern"}
