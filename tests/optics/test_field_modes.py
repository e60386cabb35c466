"""Blur that varies over the field: a few modes against the point spread of each point, through the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

import photosite as ps
from photosite.studies.bench.captures import BASE, SPACING_UM, WAVELENGTH_NM, comatic_design, comatic_psf

RANKS = (1, 4, 12)
ROWS, COLS = 48, 80


@dataclass(frozen=True, eq=False)
class FirstModes:
    """The first modes of a design, which are its own at that rank."""

    design: ps.optics.LensDesign
    rank: int

    def point_spread(self, base, distance_m, focus_distance_m):
        whole = self.design.point_spread(base, distance_m, focus_distance_m)
        return replace(whole, weights=whole.weights[: self.rank], modes=whole.modes[: self.rank])


@pytest.fixture(scope="module")
def frames() -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Two points by their own point spreads, and by the first modes of the design, by rank."""
    chip = ps.load_sensor("vendor-2.2um")
    sensor = chip.with_(rows=ROWS, cols=COLS, cfa=(("G",),), channels={"G": chip.channels["G"]})
    pitch_um = sensor.pixel.width_um.value
    edge_mm = math.hypot(ROWS, COLS) / 2 * pitch_um * 1e-3
    design = comatic_design(edge_mm, rank=max(RANKS), detail_um=pitch_um)

    def frame(weights, blur):
        scene = ps.Scene(
            weights=weights[None].astype(np.float32),
            basis=np.array([[1e19]]),
            wavelength_nm=np.array([WAVELENGTH_NM]),
            distance_m=10.0,
        )
        return ps.Camera(ps.Lens(BASE, blur=blur), sensor).mean_electrons(scene, 1.0).astype(np.float64)

    every, direct = np.zeros((ROWS, COLS)), np.zeros((ROWS, COLS))
    for row, col in ((14, 36), (34, 43)):
        y, x = (row + 0.5 - ROWS / 2) * pitch_um * 1e-3, (col + 0.5 - COLS / 2) * pitch_um * 1e-3
        own = comatic_psf(math.hypot(y, x) / edge_mm, math.atan2(y, x))
        one = np.zeros((ROWS, COLS))
        one[row, col] = every[row, col] = 1.0
        alone = ps.optics.LensDesign(np.array([WAVELENGTH_NM]), own[None, None], SPACING_UM, np.zeros(1), np.zeros(1))
        direct += frame(one, alone)
    return direct, {rank: frame(every, FirstModes(design, rank)) for rank in RANKS}


def test_on_axis_the_point_spread_is_that_of_a_perfect_lens() -> None:
    """Five values against the Airy pattern (2 J1(v) / v)^2."""
    from scipy.special import j1

    psf = comatic_psf(0.0, 0.0)
    radius = np.array([1, 2, 3, 5, 8]) * SPACING_UM
    v = math.pi * radius / (WAVELENGTH_NM * 1e-3 * BASE.f_number)
    got = psf[30, [31, 32, 33, 35, 38]] / psf[30, 30]
    np.testing.assert_allclose(got, (2 * j1(v) / v) ** 2, atol=2e-3)  # a pupil of 96 squares


def test_the_tail_of_coma_points_outwards() -> None:
    axis = np.arange(-30, 31)
    for azimuth in (0.0, 1.0, 2.5, -2.0):
        psf = comatic_psf(1.0, azimuth)
        peak = np.unravel_index(int(psf.argmax()), psf.shape)
        tail = np.array([(psf.sum(axis=1) @ axis) + 30 - peak[0], (psf.sum(axis=0) @ axis) + 30 - peak[1]])
        along = tail @ [math.sin(azimuth), math.cos(azimuth)]
        assert along > 0.9 * math.hypot(*tail) > 0.3


def test_modes_through_the_camera_equal_direct_application(frames) -> None:
    direct, by_rank = frames
    errors = [np.linalg.norm(frame - direct) / np.linalg.norm(direct) for frame in by_rank.values()]
    assert errors[0] > 0.1  # one mode is another lens
    assert errors[1] < errors[0]
    assert errors[2] < 0.005  # interpolation between heights and nodes remains
    assert by_rank[12].sum() == pytest.approx(direct.sum(), rel=1e-4)


def test_pixel_blur_reduces_the_number_of_modes() -> None:
    sharp, blurred = (comatic_design(0.2, nodes=9, heights=5, detail_um=detail) for detail in (None, 6.0))
    assert len(blurred.low_rank.modes) < len(sharp.low_rank.modes)
    assert blurred.low_rank.relative_error <= 0.01
    light = blurred.low_rank.modes.sum(axis=(1, 2, 3))
    np.testing.assert_allclose(blurred.low_rank.weights.T @ light, 1.0, atol=1e-12)
