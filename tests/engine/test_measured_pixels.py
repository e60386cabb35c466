"""The kernel of measured chips against one pixel at a time in plain Python, and against the drawn chip's kernel."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from photosite.engine.measured_pixels import BLINKING, LINES, blink, expose_measured, line_deviates
from photosite.engine.philox import key_from_seed, philox4x32
from photosite.engine.pixels import EXPOSURE, expose
from photosite.engine.variates import normal, poisson, uniform

ROWS, COLS, CHIP_COLS = 3, 1300, 5000
CORNER = (70, 333)
KEY = key_from_seed(2**40 + 17)
FRAME = np.uint32(9)
WELL, GAIN, MAP_GAIN, BLACK, WHITE, EXPOSURE_S, LINE_VARIANCE = 30000.0, 0.4, 0.5, 200.0, 16383.0, 0.7, 0.3
SCALARS = (LINE_VARIANCE, MAP_GAIN, EXPOSURE_S, WELL, GAIN, BLACK, WHITE, CORNER, CHIP_COLS, FRAME, *KEY)


def maps():
    """Means from 0 to beyond the well; responses, dark rates and noise variances below 0 among the others."""
    rng = np.random.default_rng(4)
    levels = np.array([0, 1e-3, 0.5, 4.0, 9.99, 10.0, 17.0, 40.0, 900.0, 29900.0, 60000.0])
    photo = rng.choice(levels, (ROWS, COLS)).astype(np.float32)
    prnu = rng.normal(-0.2, 0.6, (ROWS, COLS)).astype(np.float32)
    offset = rng.normal(0, 20, (ROWS, COLS)).astype(np.float32)
    dark = rng.normal(0.5, 1, (ROWS, COLS)).astype(np.float32)
    read = rng.normal(2, 2, (ROWS, COLS)).astype(np.float32)
    return photo, prnu, offset, dark, read, rng.normal(0, 1, ROWS), rng.normal(0, 1, COLS)


def slow_pixel(r, c, photo, prnu, offset, dark, read, row, column, state=None):
    """The noise model, a line each; `state` is (amplitude, high fraction, noise) of a blinking pixel."""
    pixel = np.uint32((r + CORNER[0]) * CHIP_COLS + c + CORNER[1])
    rate = float(dark[r, c])
    mean = float(photo[r, c]) * max(1 + float(prnu[r, c]), 0) + max(rate, 0) * (EXPOSURE_S / MAP_GAIN)
    e = min(poisson(mean, pixel, FRAME, EXPOSURE, *KEY), WELL)
    level = float(offset[r, c]) + min(rate, 0) * EXPOSURE_S + row[r] + column[c]
    spread = float(read[r, c])
    if state is not None:
        amplitude, fraction, spread = state
        high = uniform(philox4x32(pixel, FRAME, BLINKING, np.uint32(0), *KEY)[0]) < fraction
        level += amplitude * (high - fraction)
    noise = math.sqrt(max(math.copysign(spread**2, spread) - LINE_VARIANCE, 0))
    z = normal(philox4x32(pixel, FRAME, EXPOSURE, np.uint32(0), *KEY)[2])
    return min(max(math.floor(e * GAIN + (level + noise * z) * GAIN / MAP_GAIN + BLACK + 0.5), 0), WHITE)


def differing(got, slow):
    """Numbers that differ, and by how much at most: another order of additions may round another way at a border."""
    difference = np.abs(got.astype(int) - slow)
    return np.count_nonzero(difference), difference.max()


def test_every_pixel_is_what_the_model_says() -> None:
    given = maps()
    got = expose_measured(*given, *SCALARS)
    slow = np.array([[slow_pixel(r, c, *given) for c in range(COLS)] for r in range(ROWS)])
    count, most = differing(got, slow)
    assert count <= 2
    assert most <= 1


def test_blinking_pixels_are_written_anew() -> None:
    given = maps()
    got = expose_measured(*given, *SCALARS)
    before = got.copy()
    place = np.array([[0, 5], [1, 700], [2, 1299], [2, 3]])
    states = np.array([[30.0, 0.5, 2.0], [80.0, 0.1, 1.0], [-12.0, 0.9, 0.2], [50.0, 0.5, 3.0]])
    blink(got, place, *(np.ascontiguousarray(s) for s in states.T), *given[:4], *given[5:], *SCALARS)
    listed = {tuple(p): tuple(s) for p, s in zip(place.tolist(), states, strict=True)}
    for (r, c), state in listed.items():
        assert got[r, c] == slow_pixel(r, c, *given, state=state)
    others = np.ones(got.shape, bool)
    others[tuple(place.T)] = False
    assert (got[others] == before[others]).all()


def test_a_measured_chip_with_a_drawn_ones_maps_gives_its_frame() -> None:
    rng = np.random.default_rng(5)
    photo = rng.uniform(0, 3000, (ROWS, COLS)).astype(np.float32)
    prnu = rng.integers(-9000, 9000, (ROWS, COLS)).astype(np.int16)
    offset = rng.integers(-9000, 9000, (ROWS, COLS)).astype(np.int16)
    dark = rng.random((ROWS, COLS)).astype(np.float32)
    drawn = expose(
        photo, prnu, 1e-5, offset, 2e-3, dark, EXPOSURE_S, WELL, 12.5, GAIN, BLACK, WHITE,
        CORNER, CHIP_COLS, FRAME, *KEY,
    )  # fmt: skip
    measured = expose_measured(
        photo, (prnu * 1e-5).astype(np.float32), (offset * 2e-3 * GAIN).astype(np.float32),
        (dark * GAIN).astype(np.float32), np.full(photo.shape, 12.5 * GAIN, np.float32), np.zeros(ROWS), np.zeros(COLS),
        0.0, GAIN, EXPOSURE_S, WELL, GAIN, BLACK, WHITE, CORNER, CHIP_COLS, FRAME, *KEY,
    )  # fmt: skip
    count, most = differing(measured, drawn)
    assert count <= 3  # 32-bit maps move a number by 1e-7 of it, and a border between two lies within that of few
    assert most <= 1


def test_lines_are_normal_and_their_own() -> None:
    """Kolmogorov-Smirnov at 1e-4, correlation within 4 sigma: false alarms 3e-4 in all."""
    rows, columns = (line_deviates(0, 20_000, word, FRAME, *KEY) for word in (0, 1))
    assert stats.kstest(rows, "norm").pvalue > 1e-4
    assert stats.kstest(columns, "norm").pvalue > 1e-4
    assert abs(np.corrcoef(rows, columns)[0, 1]) < 4 / np.sqrt(20_000)
    assert (line_deviates(100, 50, 0, FRAME, *KEY) == rows[100:150]).all()
    assert (line_deviates(0, 100, 0, np.uint32(10), *KEY) != rows[:100]).all()


@pytest.mark.parametrize("use", [BLINKING, LINES])
def test_no_use_of_random_blocks_is_given_twice(use) -> None:
    from photosite.engine import runs

    assert use not in (runs.EXPOSURE, runs.FIXED_PATTERN)
    assert BLINKING != LINES
