"""Planes in depth: light, opacity, and invalid planes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import InputError
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene

GRID_NM = np.arange(400.0, 701.0, 50)


def scene(distance_m: float, width_m: float | None = None, rows: int = 4, cols: int = 6) -> Scene:
    weights = np.random.default_rng(1).random((2, rows, cols)).astype(np.float32)
    basis = np.stack([np.full(GRID_NM.size, 1e14), GRID_NM * 1e11])
    return Scene(weights, basis, GRID_NM, distance_m, width_m)


def test_the_public_names() -> None:
    assert ps.scenes.Planes is Planes
    assert ps.scenes.Plane is Plane


def test_a_plane_with_a_width_ends_in_a_dark_border_of_one_sample() -> None:
    plain = scene(1.0, 0.3)
    light = Plane(plain, np.full((4, 6), 0.5)).light(ends=True)
    assert light.shape == (6, 8)
    np.testing.assert_array_equal(light.weights[:, 1:-1, 1:-1], plain.weights * np.float32(0.5))
    assert light.weights.sum() == pytest.approx(0.5 * plain.weights.sum(), rel=1e-6)
    assert light.width_m == pytest.approx(0.3 * 8 / 6, rel=1e-15)  # samples keep their size
    cover = Plane(plain).cover(True, np.ones(GRID_NM.size), GRID_NM)
    assert cover.weights[0].sum() == 24
    assert cover.shape == (6, 8)


def test_a_plane_without_a_width_and_the_farthest_plane_do_not_end() -> None:
    assert Plane(scene(1.0)).light(ends=True).shape == (4, 6)
    assert Plane(scene(1.0, 0.3)).light(ends=False).shape == (4, 6)


def test_mean_radiance_is_weighted_by_opacity() -> None:
    plain = scene(1.0)
    alpha = np.zeros((4, 6))
    alpha[1, 2] = 0.25
    np.testing.assert_allclose(Plane(plain, alpha).mean_radiance(), plain.radiance(1, 2) * 0.25 / 24, rtol=1e-6)
    np.testing.assert_allclose(
        Plane(plain).mean_radiance(), plain.weights.mean(axis=(1, 2), dtype=np.float64) @ plain.basis, rtol=1e-6
    )


@pytest.mark.parametrize("bad", [-0.1, 1.5, math.nan, 255.0])
def test_an_opacity_outside_0_to_1_is_an_error(bad: float) -> None:
    alpha = np.ones((4, 6))
    alpha[2, 3] = bad
    with pytest.raises(InputError) as caught:
        Plane(scene(1.0), alpha)
    assert (caught.value.what, caught.value.expected) == ("alpha", "from 0 to 1")


def test_an_opacity_of_another_shape_is_an_error() -> None:
    with pytest.raises(InputError) as caught:
        Plane(scene(1.0), np.ones((6, 4)))
    assert (caught.value.what, caught.value.value) == ("alpha", (6, 4))


def test_planes_out_of_order_are_an_error() -> None:
    with pytest.raises(InputError) as caught:
        Planes((scene(1.0), scene(3.0), scene(2.0)))
    assert (caught.value.what, caught.value.value) == ("planes", (3.0, 2.0))
    assert len(Planes((scene(1.0), scene(1.0))).planes) == 2


@pytest.mark.parametrize("planes", [(), scene(1.0), (scene(1.0), "far"), 3])
def test_invalid_planes(planes: object) -> None:
    with raises(InputError, "planes"):
        Planes(planes)  # type: ignore[arg-type]
