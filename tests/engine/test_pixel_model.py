"""The CPU kernels of the pixel model, compared with one pixel at a time in plain Python."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from photosite.engine import random_numbers
from photosite.engine.jit import compiled, read_only
from photosite.engine.pixel_model import (
    BlinkingPixels,
    DrawnConstants,
    DrawnMaps,
    Exposure,
    MeasuredMaps,
    drawn_pixel,
    expose_blinking,
    expose_drawn,
    expose_measured,
    expose_pixel,
    line_deviates,
    pixel_number,
)
from photosite.engine.random_numbers import BLINKING, EXPOSURE, key_from_seed, normal, philox4x32, poisson, uniform

KEY = key_from_seed(2**40 + 17)
FRAME = np.uint32(9)
SHARED = Exposure(0.7, 30000.0, 0.4, 200.0, 16383.0, 70, 333, 5000, FRAME, *KEY)
READ_E = 12.5
CONSTANTS = DrawnConstants(1e-5, 2e-3, READ_E)
MAP_GAIN, LINE_VARIANCE = 0.5, 0.3
LEVELS = np.array([0, 1e-3, 0.5, 4.0, 9.99, 10.0, 11.0, 17.0, 40.0, 900.0, 29900.0, 60000.0])
"""Mean electrons from 0 to beyond the well capacity, so that every branch is taken."""


def drawn_maps(rng: np.random.Generator, shape: tuple[int, int]) -> DrawnMaps:
    """Maps of a chip, or of one value for all pixels, and of the lines of a frame of a shape at its place."""
    chip = shape if shape == (1, 1) else (SHARED.first_row + shape[0], SHARED.chip_cols)
    prnu, offset = (rng.integers(-9000, 9000, chip).astype(np.int16) for _ in range(2))
    dark, lines = rng.random(chip).astype(np.float32), [rng.normal(0.0, 3.0, length) for length in shape]
    return DrawnMaps(*map(read_only, (prnu, offset, dark, *lines)))


def at_frame(values: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """The part of a map of the chip in a frame."""
    if values.shape == (1, 1):
        return np.broadcast_to(values, shape)
    r, c = SHARED.first_row, SHARED.first_col
    return values[r : r + shape[0], c : c + shape[1]]


def line_dn(r: int, c: int, maps: DrawnMaps) -> float:
    """The offset of a pixel's row and column; an array of one value is that of all lines."""
    return float(maps.row_dn[r % len(maps.row_dn)] + maps.column_dn[c % len(maps.column_dn)])


def drawn_in_python(r: int, c: int, photo: NDArray[np.float32], maps: DrawnMaps) -> int:
    """The digital number of a drawn chip's pixel by the equations."""
    prnu, offset, dark = (at_frame(m, photo.shape)[r, c] for m in maps[:3])
    number = np.uint32(pixel_number(r, c, SHARED))
    mean = float(photo[r, c]) * (1 + int(prnu) * 1e-5) + float(dark) * SHARED.exposure_s
    electrons = min(poisson(mean, number, FRAME, EXPOSURE, *KEY), SHARED.well_capacity_e) + int(offset) * 2e-3
    z = normal(philox4x32(number, FRAME, EXPOSURE, np.uint32(0), *KEY)[2])
    dn = math.floor((electrons + READ_E * z) * SHARED.gain_dn_per_e + line_dn(r, c, maps) + SHARED.black_level_dn + 0.5)
    return int(min(max(dn, 0), SHARED.white_level_dn))


@pytest.mark.parametrize("constant", [False, True])
def test_drawn_chip_matches_the_equations_and_single_pixels(constant: bool) -> None:
    rng = np.random.default_rng(4)
    photo = read_only(rng.choice(LEVELS, (2, 2100)).astype(np.float32))
    maps = drawn_maps(rng, (1, 1) if constant else photo.shape)
    frame = expose_drawn(photo, maps, CONSTANTS, SHARED)
    prnu, offset, dark = (at_frame(m, photo.shape) for m in maps[:3])
    for r, c in np.ndindex(photo.shape):
        assert frame[r, c] == drawn_in_python(r, c, photo, maps), (r, c)
    for r, c in np.ndindex(2, 300):
        pixel = drawn_pixel(prnu[r, c], offset[r, c], dark[r, c], line_dn(r, c, maps), CONSTANTS, SHARED)
        assert frame[r, c] == expose_pixel(float(photo[r, c]), pixel, r, c, SHARED)


@pytest.mark.parametrize("read_e", [0.0, 0.3, READ_E])
@pytest.mark.parametrize("gain", [0.05, 0.5, 6.0])
def test_frames_of_many_levels_have_the_numbers_of_single_pixels(gain: float, read_e: float) -> None:
    """The shape and the rows of a run differ between the two frames, and the second has few pixels in its last run."""
    rng = np.random.default_rng(6)
    shared = SHARED._replace(gain_dn_per_e=gain, white_level_dn=65535.0)
    for shape in ((40, 301), (2, 4500)):
        levels = np.exp(rng.uniform(-4, 13, shape))
        photo = read_only(np.where(rng.random(shape) < 0.2, rng.choice(LEVELS, shape), levels).astype(np.float32))
        maps, constants = drawn_maps(rng, shape), DrawnConstants(1e-5, 2e-3, read_e)
        expected = single_pixels(photo, *(at_frame(m, shape) for m in maps[:3]), *maps[3:], constants, shared)
        np.testing.assert_array_equal(expose_drawn(photo, maps, constants, shared), expected)


@compiled()
def single_pixels(
    photo: Any, prnu: Any, offset: Any, dark: Any, row_dn: Any, column_dn: Any, constants: Any, shared: Any
) -> Any:
    """Return a frame, each pixel by the scalar functions."""
    out = np.empty(photo.shape, np.uint16)
    for r in range(photo.shape[0]):
        for c in range(photo.shape[1]):
            pixel = drawn_pixel(prnu[r, c], offset[r, c], dark[r, c], row_dn[r] + column_dn[c], constants, shared)
            out[r, c] = expose_pixel(float(photo[r, c]), pixel, r, c, shared)
    return out


@pytest.mark.parametrize("well", [30000.0, math.inf])
@pytest.mark.parametrize("mean", [1e16, 9e18, 1e19, 1e30, 3e38])
def test_very_bright_light_is_white(mean: float, well: float) -> None:
    """Counts and digital numbers beyond 2^63 must not overflow to black."""
    zero = read_only(np.zeros((1, 1), np.int16))
    none = read_only(np.zeros(1))
    maps = DrawnMaps(zero, zero, read_only(np.zeros((1, 1), np.float32)), none, none)
    constants = DrawnConstants(0.0, 0.0, READ_E)
    shared = Exposure(1.0, well, 40.0, 200.0, 5000.0, 0, 0, 3000, FRAME, *KEY)
    photo = read_only(np.full((2, 3000), mean, np.float32))
    assert (expose_drawn(photo, maps, constants, shared) == 5000).all()
    pixel = drawn_pixel(zero[0, 0], zero[0, 0], np.float32(0), 0.0, constants, shared)
    assert all(expose_pixel(float(photo[0, 0]), pixel, 0, i, shared) == 5000 for i in range(200))


def measured_maps(shape: tuple[int, int] = (3, 1300)) -> tuple[NDArray[np.float32], MeasuredMaps]:
    """Light and maps, with some responses, dark rates and noise variances below 0."""
    rng = np.random.default_rng(4)
    photo = read_only(rng.choice(LEVELS, shape).astype(np.float32))
    prnu, offset, dark, read = (
        read_only(rng.normal(center, spread, shape).astype(np.float32))
        for center, spread in ((-0.2, 0.6), (0, 20), (0.5, 1), (2, 2))
    )
    lines = rng.normal(0, 1, shape[0]), rng.normal(0, 1, shape[1])
    ratio = read_only(rng.uniform(0.6, 1.7, shape).astype(np.float32))
    return photo, MeasuredMaps(prnu, offset, dark, read, ratio, *lines, LINE_VARIANCE, MAP_GAIN)


def measured_in_python(r: int, c: int, photo: Any, maps: MeasuredMaps, state: Any = None) -> int:
    """The digital number of a measured chip's pixel; `state` is (amplitude, high fraction, noise) of a blinking one."""
    number = np.uint32(pixel_number(r, c, SHARED))
    rate = float(maps.dark_rate_dn_per_s[r, c])
    mean = float(photo[r, c]) * max(1 + float(maps.prnu[r, c]), 0) + max(rate, 0) * (SHARED.exposure_s / MAP_GAIN)
    electrons = min(poisson(mean, number, FRAME, EXPOSURE, *KEY), SHARED.well_capacity_e)
    level = float(maps.offset_dn[r, c]) + min(rate, 0) * SHARED.exposure_s + maps.row_dn[r] + maps.column_dn[c]
    spread = float(maps.read_noise_dn[r, c])
    if state is not None:
        amplitude, fraction, spread = state
        high = uniform(philox4x32(number, FRAME, BLINKING, np.uint32(0), *KEY)[0]) < fraction
        level += amplitude * (high - fraction)
    noise = math.sqrt(max(math.copysign(spread**2, spread) - LINE_VARIANCE, 0))
    z = normal(philox4x32(number, FRAME, EXPOSURE, np.uint32(0), *KEY)[2])
    gain = SHARED.gain_dn_per_e
    dn = math.floor(
        electrons * gain * float(maps.gain_ratio[r, c])
        + (level + noise * z) * gain / MAP_GAIN
        + SHARED.black_level_dn
        + 0.5
    )
    return int(min(max(dn, 0), SHARED.white_level_dn))


def assert_nearly_equal(frame: NDArray[np.uint16], expected: Any, most: int) -> None:
    """A few pixels may differ by 1 DN: another order of additions may round to the other side of a border."""
    difference = np.abs(frame.astype(int) - expected)
    assert np.count_nonzero(difference) <= most
    assert difference.max() <= 1


def test_measured_chip_matches_the_equations() -> None:
    photo, maps = measured_maps()
    expected = [[measured_in_python(r, c, photo, maps) for c in range(photo.shape[1])] for r in range(3)]
    assert_nearly_equal(expose_measured(photo, maps, SHARED), np.array(expected), 2)


def test_blinking_pixels_match_the_equations_and_leave_others_alone() -> None:
    photo, maps = measured_maps()
    frame = expose_measured(photo, maps, SHARED)
    before = frame.copy()
    place = np.array([[0, 5], [1, 700], [2, 1299], [2, 3]])
    states = np.array([[30.0, 0.5, 2.0], [80.0, 0.1, 1.0], [-12.0, 0.9, 0.2], [50.0, 0.5, 3.0]])
    blinking = BlinkingPixels(place, *(np.ascontiguousarray(column) for column in states.T))
    expose_blinking(frame, blinking, photo, maps, SHARED)
    for (r, c), state in zip(place.tolist(), states, strict=True):
        assert frame[r, c] == measured_in_python(r, c, photo, maps, state)
    others = np.ones(frame.shape, bool)
    others[tuple(place.T)] = False
    assert (frame[others] == before[others]).all()


def test_measured_chip_with_a_drawn_chips_maps_gives_its_frame() -> None:
    rng = np.random.default_rng(5)
    photo = read_only(rng.uniform(0, 3000, (3, 1300)).astype(np.float32))
    drawn = drawn_maps(rng, photo.shape)
    gain = SHARED.gain_dn_per_e
    prnu, offset, dark = (at_frame(m, photo.shape) for m in drawn[:3])
    maps = [prnu * 1e-5, offset * 2e-3 * gain, dark * gain]
    maps += [np.full(photo.shape, READ_E * gain), np.ones((1, 1))]
    measured = MeasuredMaps(*(read_only(m.astype(np.float32)) for m in maps), drawn.row_dn, drawn.column_dn, 0.0, gain)
    # 32-bit maps shift a number by 1e-7 of itself.
    assert_nearly_equal(
        expose_measured(photo, measured, SHARED), expose_drawn(photo, drawn, CONSTANTS, SHARED).astype(int), 3
    )


def test_line_deviates_are_normal_and_independent() -> None:
    """Kolmogorov-Smirnov at 1e-4, correlation within 4 sigma: false alarms 3e-4 in all."""
    rows, columns = (line_deviates(0, 20_000, random_numbers.LINES, word, FRAME, *KEY) for word in (0, 1))
    assert stats.kstest(rows, "norm").pvalue > 1e-4
    assert stats.kstest(columns, "norm").pvalue > 1e-4
    assert abs(np.corrcoef(rows, columns)[0, 1]) < 4 / np.sqrt(20_000)
    assert (line_deviates(100, 50, random_numbers.LINES, 0, FRAME, *KEY) == rows[100:150]).all()
    assert (line_deviates(0, 100, random_numbers.LINES, 0, np.uint32(10), *KEY) != rows[:100]).all()


def test_uses_of_random_words_are_distinct() -> None:
    uses = [random_numbers.EXPOSURE, random_numbers.FIXED_PATTERN, random_numbers.BLINKING, random_numbers.LINES]
    assert [int(use) for use in uses] == [0, 1, 2, 3]
