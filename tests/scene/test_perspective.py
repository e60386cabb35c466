"""Charts in perspective: the map against a pinhole camera, the scene against random points of the chart."""

from dataclasses import replace

import numpy as np
from raising import raises

from photosite.errors import InputError
from photosite.scene.charts import MACBETH_NAMES, macbeth, macbeth_regions
from photosite.scene.placement import Homography, check_corners, field_corners, in_perspective, seen_patches

CORNERS = ((12.0, 30.0), (4.0, 214.0), (146.0, 200.0), (120.0, 10.0))
SHAPE = (160, 230)


def camera(points, distance=900.0, focal=700.0):
    """Image points of a tilted plane through a pinhole."""
    turn = np.deg2rad([20.0, -15.0])
    about_x = np.array([[1, 0, 0], [0, np.cos(turn[0]), -np.sin(turn[0])], [0, np.sin(turn[0]), np.cos(turn[0])]])
    about_y = np.array([[np.cos(turn[1]), 0, np.sin(turn[1])], [0, 1, 0], [-np.sin(turn[1]), 0, np.cos(turn[1])]])
    space = np.column_stack([points[:, 1], points[:, 0], np.zeros(len(points))]) @ (about_x @ about_y).T
    depth = space[:, 2] + distance
    return np.column_stack([focal * space[:, 1] / depth, focal * space[:, 0] / depth])


def test_four_points_of_a_pinhole_camera_give_all_others():
    rng = np.random.default_rng(1)
    plane = rng.uniform(-200, 200, (40, 2))
    square = np.array([(-200, -200), (-200, 200), (200, 200), (200, -200)], float)
    view = Homography.between(square, camera(square))
    np.testing.assert_allclose(view(plane), camera(plane), atol=1e-9)
    np.testing.assert_allclose(view.inverse(camera(plane)), plane, atol=1e-8)


def test_more_points_than_four_average_their_errors():
    rng = np.random.default_rng(2)
    plane = rng.uniform(-200, 200, (60, 2))
    seen = camera(plane) + rng.normal(0, 0.5, plane.shape)
    best = Homography.between(plane, seen)
    off = best(plane) - camera(plane)
    # 120 coordinates and 8 parameters: the error of the fitted ones is 0.5 sqrt(8 / 120) = 0.13.
    assert np.sqrt(np.mean(off**2)) < 0.25


def test_invalid_points():
    with raises(InputError, "target", value=(3, 2)):
        Homography.between(np.zeros((3, 2)), np.zeros((3, 2)))
    line = [(0, 0), (1, 1), (2, 2), (3, 3)]
    with raises(InputError, "source"):
        Homography.between(line, line)


def test_regions_of_a_chart_that_faces_the_camera():
    # The whole frame at three pixels a sample; a region is 20/28 of a patch's side.
    chart = macbeth()
    corners = tuple((3 * row, 3 * col) for row, col in field_corners(chart))
    for quad, region in zip(seen_patches(chart, corners, 20 / 28), macbeth_regions(396, 588), strict=True):
        assert quad.name == region.name
        rows, cols = np.nonzero(quad.inside())
        wanted = np.mgrid[region.r0 : region.r1, region.c0 : region.c1].reshape(2, -1)
        np.testing.assert_array_equal([rows + quad.r0, cols + quad.c0], wanted)


def test_the_scene_agrees_with_random_points_of_the_chart():
    chart = macbeth("D65", 100)
    scene = in_perspective(chart, CORNERS, SHAPE)
    back = Homography.between(CORNERS, field_corners(chart))
    samples = np.array(scene.shape)
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(400):
        r, c = rng.integers(0, scene.shape[0]), rng.integers(0, scene.shape[1])
        # The scene is centered on the frame and scaled evenly to cover it.
        step = min(samples / SHAPE)
        parts = (np.array([r, c]) + rng.uniform(0, 1, (400, 2)) - (samples - np.array(SHAPE) * step) / 2) / step
        at = np.floor(back(parts)).astype(int)
        on = ((at >= 0) & (at < chart.shape)).all(axis=1)
        weights = np.zeros((400, 24))
        weights[on] = chart.weights[:, at[on, 0], at[on, 1]].T
        # 16 points on a grid of a sample against 400 at random: borders to 1 in 4 of a side at the worst.
        assert np.abs(weights.mean(axis=0) - scene.weights[:, r, c]).max() < 0.3
        wrong += int(np.abs(weights.mean(axis=0) - scene.weights[:, r, c]).max() > 0.12)
    assert wrong < 20
    np.testing.assert_array_equal(scene.basis, chart.basis)


def test_the_inner_part_of_every_patch_is_of_one_color():
    chart = macbeth()
    scene = in_perspective(chart, CORNERS, SHAPE)
    step = min(np.array(scene.shape) / SHAPE)
    shift = (np.array(scene.shape) - np.array(SHAPE) * step) / 2
    for k, quad in enumerate(seen_patches(chart, CORNERS, 0.7)):
        assert quad.name == MACBETH_NAMES[k]
        for point in quad.corners:
            row, col = np.floor(np.array(point) * step + shift).astype(int)
            assert scene.weights[k, row, col] == 1.0


def test_invalid_corners():
    chart = macbeth()
    with raises(InputError, "corners", value=(4.0, 231.0)):
        in_perspective(chart, ((12, 30), (4, 231), (146, 200), (120, 10)), SHAPE)
    with raises(InputError, "corners"):
        in_perspective(chart, (CORNERS[0], CORNERS[2], CORNERS[1], CORNERS[3]), SHAPE)
    with raises(InputError, "inner", value=1.5):
        seen_patches(chart, CORNERS, 1.5)
    with raises(InputError, "chart"):
        in_perspective(replace(chart, weights=chart.weights * 0.5), CORNERS, SHAPE)


def test_corners_outside_by_rounding_are_on_the_border():
    beyond = ((-1e-9, -1e-9), (-1e-9, 230 + 1e-9), (160 + 1e-9, 230 + 1e-9), (160 + 1e-9, -1e-9))
    check_corners(beyond, SHAPE)
    on = ((0.0, 0.0), (0.0, 230.0), (160.0, 230.0), (160.0, 0.0))
    pair = (in_perspective(macbeth(), corners, SHAPE) for corners in (beyond, on))
    one, other = (scene.weights for scene in pair)
    np.testing.assert_allclose(one, other, atol=1e-6)
    with raises(InputError, "corners", value=(-1e-05, 0.0)):
        check_corners(((-1e-5, 0.0), *on[1:]), SHAPE)
