"""A calibration that the report's tests share."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.calibration.result import Calibration
from photosite.frames.frame_set import FrameSet


@pytest.fixture(scope="session")
def darks_only() -> Calibration:
    """A calibration from dark frames only, of one channel."""
    rng = np.random.default_rng(3)
    darks = np.rint(rng.normal(64.0, 2.0, (2, 6, 24, 32))).astype(np.uint16)
    frames = [("dark", t, dn) for t, stack in zip((0.01, 1.0), darks, strict=True) for dn in stack]
    return calibrate(FrameSet.from_arrays(frames, bits=12))
