"""The run-wise pixel kernel against one pixel at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from photosite.engine.philox import key_from_seed, philox4x32
from photosite.engine.pixels import EXPOSURE, expose, expose_pixel
from photosite.engine.variates import normal, poisson

ROWS, COLS, CHIP_COLS = 3, 2100, 5000
CORNER = (70, 333)
KEY = key_from_seed(2**40 + 17)
FRAME = np.uint32(9)
WELL, READ, GAIN, BLACK, WHITE, EXPOSURE_S = 30000.0, 12.5, 0.4, 200.0, 16383.0, 0.7


@pytest.mark.parametrize("even", [False, True])
def test_runs_give_what_single_pixels_give(even: bool) -> None:
    """Means from 0 to beyond the well, so that every branch is met; every pixel equal to the scalar way."""
    rng = np.random.default_rng(4)
    mean = rng.choice(
        np.array([0, 1e-3, 0.5, 4.0, 9.99, 10.0, 11.0, 17.0, 40.0, 900.0, 29900.0, 60000.0]), (ROWS, COLS)
    ).astype(np.float32)
    shape = (1, 1) if even else (ROWS, COLS)
    prnu = rng.integers(-9000, 9000, shape).astype(np.int16)
    offset = rng.integers(-9000, 9000, shape).astype(np.int16)
    dark = rng.random(shape).astype(np.float32)
    got = expose(
        mean, prnu, 1e-5, offset, 2e-3, dark, EXPOSURE_S, WELL, READ, GAIN, BLACK, WHITE, CORNER, CHIP_COLS, FRAME, *KEY
    )
    prnu, offset, dark = (np.broadcast_to(m, (ROWS, COLS)) for m in (prnu, offset, dark))
    for r in range(ROWS):
        for c in range(COLS):
            pixel = np.uint32((r + CORNER[0]) * CHIP_COLS + c + CORNER[1])
            mu = float(mean[r, c]) * (1 + int(prnu[r, c]) * 1e-5) + float(dark[r, c]) * EXPOSURE_S
            e = min(poisson(mu, pixel, FRAME, EXPOSURE, *KEY), WELL) + int(offset[r, c]) * 2e-3
            word = philox4x32(pixel, FRAME, EXPOSURE, np.uint32(0), *KEY)[2]
            dn = math.floor((e + READ * normal(word)) * GAIN + BLACK + 0.5)
            assert got[r, c] == min(max(dn, 0), WHITE), (r, c, mu)


@pytest.mark.parametrize("well", [WELL, math.inf])
@pytest.mark.parametrize("mean", [1e16, 9e18, 1e19, 1e30, 3e38])
def test_light_of_any_strength_is_white(mean: float, well: float) -> None:
    """Counts and digital numbers beyond 2^63, where whole numbers would turn negative, and the frame black."""
    zero, dark = np.zeros((1, 1), np.int16), np.zeros((1, 1), np.float32)
    light = np.full((2, 3000), mean, np.float32)
    scalars = (1.0, well, READ, 40.0, BLACK, 5000.0)
    got = expose(light, zero, 0.0, zero, 0.0, dark, *scalars, (0, 0), 3000, FRAME, *KEY)
    assert (got == 5000).all()
    one = (light[0, 0], zero[0, 0], 0.0, zero[0, 0], 0.0, dark[0, 0], *scalars)
    assert all(expose_pixel(*one, pixel, FRAME, *KEY) == 5000 for pixel in range(200))
