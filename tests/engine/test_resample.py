"""Warped means compared with clipped polygons, plain resampling and conservation of light."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from photosite.engine.resample import Corners, Warp, mean_along_rows, mean_of_rows, overlap, warped_means

PITCH_M = 1e-6
ONE = np.ones((1, 1), np.float32)
Point = tuple[float, float]


def corners_of(
    rows: int, cols: int, shape: tuple[int, int], step: tuple[float, float], axis: tuple[float, float], k: float = 0.0
) -> Corners:
    """Return cells around the axis, one per pixel, that see distance (1 + k r^2 / R^2), R being the corner's."""
    y_m, x_m = ((np.arange(n + 1) - n / 2) * PITCH_M for n in (rows, cols))
    squared = np.linspace(0, y_m[-1] ** 2 + x_m[-1] ** 2, 257)
    warp = Warp(1 + k * squared / squared[-1], float(squared[1]), (PITCH_M, PITCH_M))
    return Corners(warp, y_m, x_m, axis, (step[0] / PITCH_M, step[1] / PITCH_M), shape)


def warped(values: NDArray[np.float32], corners: Corners) -> NDArray[np.float32]:
    rows = corners.y_m.size - 1
    first, last = corners.span(0, rows)
    return warped_rows(values[None, first:last], ONE, first, corners, 0, rows)[0]


def warped_rows(
    values: NDArray[np.float32], mixes: NDArray[np.float32], first: int, corners: Corners, begin: int, end: int
) -> NDArray[np.float32]:
    out = np.empty((len(mixes), end - begin, corners.x_m.size - 1), np.float32)
    warped_means(values, mixes, first, corners, begin, out)
    return out


def looked_at(corners: Corners) -> NDArray[np.float64]:
    """Return (rows + 1, cols + 1, 2) x and y in the map, by the formula."""
    y, x = np.meshgrid(corners.y_m, corners.x_m, indexing="ij")
    nodes = np.arange(corners.warp.scale.size) * corners.warp.step_m2
    scale = np.interp(y**2 + x**2, nodes, corners.warp.scale)
    return np.stack(
        [corners.axis[1] + scale * x * corners.per_m[1], corners.axis[0] + scale * y * corners.per_m[0]], axis=-1
    )


def area(polygon: list[Point]) -> float:
    return 0.5 * sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(polygon, polygon[1:] + polygon[:1], strict=True))


def clipped(polygon: list[Point], axis: int, limit: float, above: bool) -> list[Point]:
    """Return the part of a polygon on one side of a line (Sutherland and Hodgman)."""
    kept: list[Point] = []
    for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        inside = [(point[axis] >= limit) == above for point in (p, q)]
        if inside[0]:
            kept.append(p)
        if inside[0] != inside[1]:
            t = (limit - p[axis]) / (q[axis] - p[axis])
            kept.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
    return kept


def mean_by_clipping(values: NDArray[np.float32], quadrilateral: list[Point]) -> float:
    total = 0.0
    x, y = ([point[axis] for point in quadrilateral] for axis in (0, 1))
    for row in range(int(np.floor(min(y))), int(np.floor(max(y))) + 1):
        for col in range(int(np.floor(min(x))), int(np.floor(max(x))) + 1):
            part = clipped(clipped(quadrilateral, 1, row, True), 1, row + 1, False)
            part = clipped(clipped(part, 0, col, True), 0, col + 1, False) if part else part
            inside = min(max(row, 0), values.shape[0] - 1), min(max(col, 0), values.shape[1] - 1)
            total += area(part) * float(values[inside]) if part else 0.0
    return total / area(quadrilateral)


@pytest.mark.parametrize("k", [-0.25, 0.0, 0.4])
@pytest.mark.parametrize("step", [(0.07, 0.05), (0.4, 0.6), (1.0, 1.0), (0.9, 1.1), (2.7, 3.3)])
def test_means_equal_those_of_clipped_quadrilaterals(k: float, step: tuple[float, float]) -> None:
    """The map ends inside the grid on two sides; its border samples repeat beyond."""
    shape = (int(9 * step[0]) + 3, int(12 * step[1]) + 3)
    values = np.random.default_rng(3).random(shape).astype(np.float32)
    corners = corners_of(10, 14, shape, step, (shape[0] / 2 - 1.3, shape[1] / 2 + 0.4), k)
    got, at = warped(values, corners), looked_at(corners)
    for r in range(10):
        for c in range(14):
            quadrilateral = [tuple(at[i, j]) for i, j in ((r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c))]
            assert got[r, c] == pytest.approx(mean_by_clipping(values, quadrilateral), abs=2e-6)  # type: ignore[arg-type]


@pytest.mark.parametrize("step", [0.03, 0.5, 1.0, 1.37, 4.0])
def test_identity_warp_equals_plain_resampling(step: float) -> None:
    values = np.random.default_rng(1).random((50, 70)).astype(np.float32)
    axis = (25.3, 34.1)
    got = warped(values, corners_of(40, 60, (50, 70), (step, step), axis))
    down = overlap(40, axis[0] - 20 * step, step, 50)
    across = overlap(60, axis[1] - 30 * step, step, 70)
    first, last = down.span(0, 40)
    wide, want = np.empty((last - first, 60), np.float32), np.empty((40, 60), np.float32)
    mean_along_rows(values[first:last], across, wide)
    mean_of_rows(wide, down, np.arange(40), first, want)
    np.testing.assert_allclose(got, want, atol=1e-6)


def test_light_is_conserved() -> None:
    """A patch inside the view: means times areas sum to the patch's light."""
    values = np.zeros((60, 80), np.float32)
    values[20:41, 25:52] = np.random.default_rng(2).random((21, 27))
    corners = corners_of(70, 90, (60, 80), (0.83, 0.91), (30.0, 40.0), -0.1)
    at = looked_at(corners)
    diagonals = at[1:, 1:] - at[:-1, :-1], at[1:, :-1] - at[:-1, 1:]
    areas = 0.5 * (diagonals[0][..., 0] * diagonals[1][..., 1] - diagonals[0][..., 1] * diagonals[1][..., 0])
    light = (warped(values, corners).astype(np.float64) * areas).sum()
    assert light == pytest.approx(values.sum(dtype=np.float64), rel=1e-6)


def test_strips_are_parts_of_the_whole() -> None:
    values = np.random.default_rng(4).random((40, 50)).astype(np.float32)
    corners = corners_of(100, 120, (40, 50), (0.37, 0.37), (20.0, 25.0), 0.3)
    whole = warped(values, corners)
    for begin, end in ((0, 17), (17, 18), (18, 51), (51, 100)):
        first, last = corners.span(begin, end)
        (part,) = warped_rows(values[None, first:last], ONE, first, corners, begin, end)
        assert (part == whole[begin:end]).all()


def test_uniform_map_stays_uniform() -> None:
    values = np.full((30, 40), 0.7, np.float32)
    got = warped(values, corners_of(50, 60, (30, 40), (0.6, 0.6), (15.0, 20.0), -0.3))
    np.testing.assert_allclose(got, np.float32(0.7), rtol=2e-7)


@pytest.mark.parametrize("k", [0.0, 0.15])
def test_several_maps_equal_single_maps(k: float) -> None:
    values = np.random.default_rng(8).random((4, 23, 31)).astype(np.float32)
    corners = corners_of(40, 52, (23, 31), (0.52, 0.6), (11.2, 15.7), k)
    first, last = corners.span(7, 33)
    got = warped_rows(values[:, first:last], np.eye(len(values), dtype=np.float32), first, corners, 7, 33)
    alone = np.stack([warped(one, corners) for one in values])
    assert (got == alone[:, 7:33]).all()
