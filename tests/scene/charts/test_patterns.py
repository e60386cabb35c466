"""Plain fields and waves: means over samples, and the luminance."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from photosite.scene import charts
from photosite.scene.charts import coverage

FINE = 60


def test_uniform_has_the_given_luminance() -> None:
    assert charts.uniform("FL2", 7.0).mean_luminance_cd_m2() == pytest.approx(7.0, rel=1e-12)


def test_a_linear_ramp_has_equal_steps_and_a_logarithmic_one_equal_factors() -> None:
    linear = charts.ramp(contrast=100.0, rows=2, cols=40).weights[0, 1].astype(np.float64)
    assert np.diff(linear) == pytest.approx(np.full(39, 0.99 / 40), rel=1e-5)
    logarithmic = charts.ramp(contrast=1e6, logarithmic=True, rows=2, cols=40).weights[0, 1].astype(np.float64)
    assert logarithmic[1:] / logarithmic[:-1] == pytest.approx(np.full(39, 10 ** (6 / 40)), rel=1e-6)


def test_a_logarithmic_ramp_is_the_mean_over_each_sample() -> None:
    """Against 4000 points a sample; the integral of the whole has a closed form, (1 - 1/c) / ln c."""
    line = charts.ramp(contrast=50.0, logarithmic=True, rows=1, cols=5).weights[0, 0]
    points = 50.0 ** ((np.arange(20_000) + 0.5) / 20_000 - 1)
    assert line == pytest.approx(points.reshape(5, 4000).mean(axis=1), rel=1e-6)
    assert line.mean() == pytest.approx((1 - 1 / 50) / math.log(50), rel=1e-6)


def test_a_checkerboard_of_any_size_holds_exact_shares() -> None:
    """Squares of 2.75 samples against 64 x 64 points a sample, whose borders are on quarters: exact too."""
    board = charts.checkerboard(square=2.75, contrast=math.inf, rows=12, cols=17).weights[0]
    fine = 64
    row, col = ((np.arange(count * fine) + 0.5) / fine // 2.75 for count in (12, 17))
    points = ((row[:, None] + col[None, :]) % 2 == 0).reshape(12, fine, 17, fine).mean(axis=(1, 3))
    np.testing.assert_allclose(board, points, rtol=0, atol=1e-6)


def test_discs_cover_the_area_of_circles() -> None:
    """The whole is pi R^2; single samples against 400 x 400 points."""
    fraction = coverage.disc(11, 13, 5.3, 6.9, 3.7)
    assert fraction.sum() == pytest.approx(math.pi * 3.7**2, rel=1e-12)
    fine = 400
    row, col = ((np.arange(count * fine) + 0.5) / fine for count in (11, 13))
    inside = (row[:, None] - 5.3) ** 2 + (col[None, :] - 6.9) ** 2 < 3.7**2
    np.testing.assert_allclose(fraction, inside.reshape(11, fine, 13, fine).mean(axis=(1, 3)), rtol=0, atol=1e-3)
    tiny = coverage.disc(3, 3, 1.5, 1.5, 0.1)
    assert tiny[1, 1] == pytest.approx(math.pi * 0.01, rel=1e-12)
    assert tiny.sum() == pytest.approx(tiny[1, 1], rel=1e-12)


@pytest.mark.parametrize(("pitch", "diameter"), [(16, 5.0), (16, 16.0), (15, 0.4), (15, 15.0)])
def test_points_are_complete_and_on_their_grid(pitch: int, diameter: float) -> None:
    grid = charts.point_grid(pitch=pitch, diameter=diameter, rows=6 * pitch, cols=4 * pitch).weights[0]
    assert grid.sum() == pytest.approx(24 * math.pi * diameter**2 / 4, rel=1e-6)
    assert (grid[: 2 * pitch, :pitch] == grid[pitch : 3 * pitch, pitch : 2 * pitch]).all()
    # Symmetric round the sample in the middle of the field.
    middle = grid[
        3 * pitch - pitch // 2 : 3 * pitch + pitch // 2 + 1, 2 * pitch - pitch // 2 : 2 * pitch + pitch // 2 + 1
    ]
    np.testing.assert_allclose(middle, middle[::-1, ::-1], rtol=0, atol=1e-6)


def test_points_of_one_sample() -> None:
    grid = charts.point_grid(pitch=10, rows=35, cols=41, contrast=100).weights[0]
    assert grid[17, 20] == grid[7, 30] == 1.0
    assert (grid == 1.0).sum() == 3 * 5  # rows 7, 17, 27; columns 0, 10, .. 40
    assert grid.min() == pytest.approx(0.01)


def points(rows: int, cols: int, pattern: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    """Means over samples of a pattern of (down, right) from the center, by 60 x 60 points each."""
    down, right = ((np.arange(count * FINE) + 0.5) / FINE - count / 2 for count in (rows, cols))
    return pattern(down[:, None], right[None, :]).reshape(rows, FINE, cols, FINE).mean(axis=(1, 3))


@pytest.mark.parametrize(("frequency", "direction"), [(0.05, 0.0), (0.31, 90.0), (0.5, 33.0), (0.2, -100.0)])
def test_sinusoids_hold_means(frequency: float, direction: float) -> None:
    wave = charts.sinusoid(frequency=frequency, direction_deg=direction, phase_deg=20, rows=9, cols=14).weights[0]
    turn = math.radians(direction)

    def pattern(down: np.ndarray, right: np.ndarray) -> np.ndarray:
        along = frequency * (right * math.cos(turn) + down * math.sin(turn)) + 20 / 360
        return 0.5 + 0.5 * np.cos(2 * math.pi * along)

    # The midpoint rule's own error: (2 pi f / FINE)^2 / 24 of the wave.
    np.testing.assert_allclose(
        wave, points(9, 14, pattern), rtol=0, atol=(2 * math.pi * frequency / FINE) ** 2 / 24 + 1e-7
    )


@pytest.mark.parametrize(("frequency", "direction"), [(0.05, 0.0), (0.17, 90.0), (0.5, 33.0), (0.2, 1e-3), (0.1, 45.0)])
def test_bars_hold_areas(frequency: float, direction: float) -> None:
    wave = charts.sinusoid(
        frequency=frequency, direction_deg=direction, phase_deg=11, waveform="square", rows=9, cols=14
    ).weights[0]
    turn = math.radians(direction)

    def pattern(down: np.ndarray, right: np.ndarray) -> np.ndarray:
        along = frequency * (right * math.cos(turn) + down * math.sin(turn)) + 11 / 360
        return np.mod(along + 0.25, 1.0) < 0.5

    np.testing.assert_allclose(wave, points(9, 14, pattern), rtol=0, atol=1.01 / FINE)
    assert np.abs(wave - points(9, 14, pattern)).mean() < 0.2 / FINE


def test_vertical_bars_are_a_row_of_the_checkerboard() -> None:
    """Two formulas, one pattern: bars of 3.7 samples."""
    bars = charts.sinusoid(
        frequency=1 / 7.4, waveform="square", phase_deg=-90 + 360 * 30 / 7.4, rows=1, cols=60
    ).weights[0, 0]
    board = charts.checkerboard(square=3.7, contrast=math.inf, rows=1, cols=60).weights[0, 0]
    np.testing.assert_allclose(bars, board, rtol=0, atol=1e-6)


def test_contrast_is_that_of_the_radiance() -> None:
    wave = charts.sinusoid(frequency=0.01, contrast=3.0, rows=1, cols=400).weights[0, 0]
    assert wave.max() / wave.min() == pytest.approx(3.0, rel=2e-3)  # means over samples: 1 - sinc(0.01) = 1.6e-4


def test_a_zone_plate_holds_means() -> None:
    plate = charts.zone_plate(highest=0.5, rows=30, cols=44).weights[0]
    wanted = points(30, 44, lambda down, right: 0.5 + 0.5 * np.cos(2 * math.pi * 0.5 / 44 * (down**2 + right**2)))
    np.testing.assert_allclose(plate, wanted, rtol=0, atol=(2 * math.pi * 0.6 / FINE) ** 2 / 12 + 1e-7)


def test_a_zone_plate_reaches_the_frequency_at_its_border() -> None:
    """Zero crossings near the right border, on the middle row, are 1 / (2 highest) apart."""
    line = charts.zone_plate(highest=0.1, rows=2000, cols=2000).weights[0, 1000, 1800:].astype(np.float64) - 0.5
    crossings = np.nonzero(np.diff(np.sign(line)))[0]
    # The mean frequency over the last tenth of the radius is 0.1 * (0.8 + 1) / 2.
    assert len(crossings) == pytest.approx(2 * 0.09 * 200, abs=1.5)


def test_a_sweep_has_its_frequencies() -> None:
    """Half cycles from the border to x: the integral of lowest (highest / lowest)^(x / cols)."""
    line = charts.frequency_sweep(lowest=0.004, highest=0.2, cols=3000, rows=1).weights[0, 0].astype(np.float64) - 0.5
    for x in (1000, 2000, 3000):
        half_cycles = 2 * 0.004 * 3000 / math.log(50) * (50 ** (x / 3000) - 1)
        assert np.count_nonzero(np.diff(np.sign(line[:x]))) == pytest.approx(half_cycles, abs=1.0)


def test_a_sweep_is_attenuated_by_the_sinc_of_a_sample() -> None:
    line = charts.frequency_sweep(lowest=0.45, highest=0.5, cols=4000, rows=1).weights[0, 0].astype(np.float64) - 0.5
    assert 2 * np.abs(line[:200]).max() == pytest.approx(np.sinc(0.45), rel=2e-3)


@pytest.mark.parametrize("waveform", ["sine", "square"])
def test_siemens_star_holds_means(waveform: str) -> None:
    star = charts.siemens_star(cycles=24, waveform=waveform, patches=False, rows=40, cols=44).weights[0]

    def spokes(down: np.ndarray, right: np.ndarray) -> np.ndarray:
        angle = np.arctan2(right, -down if waveform == "square" else down)
        wave = (
            np.cos(24 * angle) if waveform == "sine" else np.where(np.mod(24 * angle / (2 * math.pi), 1) < 0.5, 1, -1)
        )
        return 0.5 + 0.5 * wave * (np.hypot(down, right) < 0.45 * 40)

    wanted = points(40, 44, spokes)
    radius = np.hypot((np.arange(40) - 19.5)[:, None], (np.arange(44) - 21.5)[None, :])
    border = np.abs(radius - 0.45 * 40) < 0.8  # where a sample's spokes are taken as its mean's
    assert np.abs(star - wanted)[~border].max() < (1.5 / FINE if waveform == "square" else 5e-3)
    assert np.abs(star - wanted)[~border & (radius > 8)].mean() < (0.2 / FINE if waveform == "square" else 2e-4)
    assert np.abs(star - wanted)[border].max() < 0.06
    assert (star[radius > 0.45 * 40 + 0.8] == 0.5).all()


def test_siemens_star_has_the_stated_accuracy() -> None:
    """Samples at all distances from the center, against 200 x 200 Gauss-Legendre points each."""
    star = charts.siemens_star(cycles=144, patches=False, rows=256, cols=256).weights[0]
    nodes, weights = np.polynomial.legendre.leggauss(200)
    for away in (4, 8, 13, 20, 30, 45, 60, 80, 100):
        down, right = away + 0.5 + nodes[:, None] / 2, away // 3 + 0.5 + nodes[None, :] / 2
        wave = (weights / 2) @ np.cos(144 * np.arctan2(right, down)) @ (weights / 2)
        assert star[128 + away, 128 + away // 3] == pytest.approx(0.5 + 0.5 * wave, abs=1e-7), away  # float32


def test_siemens_star_has_its_cycles_round_the_circle() -> None:
    star = charts.siemens_star(cycles=72, rows=256, cols=256).weights[0].astype(np.float64)
    angle = 2 * math.pi * (np.arange(4096) + 0.5) / 4096
    for radius in (30.0, 60.0, 110.0):
        ring = star[(128 + radius * np.cos(angle)).astype(int), (128 + radius * np.sin(angle)).astype(int)]
        spectrum = np.abs(np.fft.rfft(ring - ring.mean()))
        assert spectrum.argmax() == 72


def test_siemens_star_grays_are_equal_steps_outside_the_star() -> None:
    star = charts.siemens_star(contrast=11.0, rows=256, cols=320)
    fraction = (star.weights[0].astype(np.float64) - 1 / 11) / (10 / 11)
    for level, region in enumerate(star.regions):
        inside = fraction[region.r0 : region.r1, region.c0 : region.c1]
        np.testing.assert_allclose(inside, level / 15, rtol=0, atol=1e-6)
        far = math.hypot((region.c0 + region.c1) / 2 - 160, (region.r0 + region.r1) / 2 - 128)
        assert far > 0.45 * 256 + 0.07 * 256 / 2
