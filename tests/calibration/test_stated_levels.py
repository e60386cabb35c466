"""Stated levels against pixels: told where they are far apart, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from photosite.calibration.calibrate import calibrate
from photosite.frames.frame_set import frame_set_from_arrays


def measurement():
    rng = np.random.default_rng(3)
    frames = [
        (kind, t, np.round(rng.normal(level, noise, (24, 32))).astype(np.uint16))
        for kind, t, level, noise in (
            ("dark", 0.01, 64, 2),
            ("dark", 0.02, 64, 2),
            ("light", 0.01, 500, 15),
            ("light", 0.02, 936, 21),
        )
        for _ in range(4)
    ]
    return frame_set_from_arrays(frames, bits=12)


def told(frames, about):
    return [line for line in calibrate(frames).warnings if about in line]


@pytest.mark.parametrize(("stated", "expected"), [(None, 0), (64.0, 0), (61.0, 0), (58.0, 1), (70.0, 1), (0.0, 1)])
def test_a_black_level_far_from_the_darks(stated, expected):
    """Far is a thousandth of the range, 4 DN of 12 bits."""
    lines = told(replace(measurement(), black_level_dn=stated), "the black level is stated")
    assert len(lines) == expected
    if lines:
        assert f"stated as {stated:g} DN, and the dark frames at 0.01 s read 6" in lines[0]


@pytest.mark.parametrize(("stated", "expected"), [(None, 0), (4095.0, 0), (936.0, 0), (900.0, 1)])
def test_a_white_level_below_the_lights(stated, expected):
    assert len(told(replace(measurement(), white_level_dn=stated), "the white level is stated")) == expected
