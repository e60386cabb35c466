"""Distortion and lateral color of a camera: positions, light, and the sum over wavelengths."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

import photosite as ps
from photosite.camera import channel_transfers, mean_image
from photosite.color.spectrum import integration_weights
from photosite.errors import PhotositeWarning
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import RadialMapping
from photosite.optics.illumination import VeilingGlare
from photosite.optics.point_spread import FieldPsf, PlanePsf, RadialPsf
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor

D200 = ps.load_sensor("nikon-d200")
PITCH_M = 6.05e-6
GRID_NM = np.arange(400.0, 701.0, 20)


@dataclass(frozen=True)
class Distorting(DiffractionLimited):
    """A lens of Gaussian point spreads, which end soon, wider in the red; and of any mapping and glare."""

    curves: RadialMapping | None = None
    glare: VeilingGlare | None = None
    sigma_m: float = 4e-6

    def point_spread(self, distance_m: float) -> RadialPsf:
        def sigma_at(wavelength_nm: float) -> float:
            return self.sigma_m * wavelength_nm / 550

        return RadialPsf(
            otf=lambda f, wavelength_nm: np.exp(-2 * (np.pi * sigma_at(wavelength_nm) * f) ** 2),
            cutoff_per_m=lambda wavelength_nm: 6.5 / (2 * np.pi * sigma_at(wavelength_nm)),
            reach_m=lambda _: 6 * sigma_at(700),
        )

    def mapping(self, distance_m: float) -> RadialMapping | None:
        return self.curves

    @property
    def veiling_glare(self) -> VeilingGlare | None:
        return self.glare


def third_order(k: float, corner_m: float, lateral: float = 0.0) -> RadialMapping:
    """real = ideal (1 + k (ideal / corner)^2), larger by `lateral` at 700 nm and smaller by it at 400 nm."""
    ideal = np.linspace(0.0, 1.3 * corner_m, 27)
    real = ideal * (1 + k * (ideal / corner_m) ** 2)
    if lateral == 0:
        return RadialMapping(np.array([550.0]), ideal, real[None])
    return RadialMapping(np.array([400.0, 700.0]), ideal, np.stack([real * (1 - lateral), real * (1 + lateral)]))


def lens(curves: RadialMapping | None = None, glare: VeilingGlare | None = None) -> Distorting:
    return Distorting(f_number=8, focal_length_mm=50, curves=curves, glare=glare)


def mono(rows: int, cols: int) -> Sensor:
    channels = {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}
    return D200.with_(rows=rows, cols=cols, cfa="mono", channels=channels)


def corner_m(sensor: Sensor) -> float:
    return math.hypot(sensor.array.rows, sensor.array.cols) * PITCH_M / 2


def random_scene(rows: int, cols: int, count: int = 3) -> Scene:
    rng = np.random.default_rng(5)
    weights = np.kron(rng.random((count, rows // 4, cols // 4)), np.ones((4, 4)))
    return Scene(weights.astype(np.float32), 1e14 * rng.random((count, GRID_NM.size)), GRID_NM)


@pytest.mark.parametrize("cells", [1, 3])
def test_mapping_without_distortion(cells: int) -> None:
    sensor, scene = D200.with_(rows=80, cols=120), random_scene(100, 140)
    plain, moved = (
        ps.Camera(lens(curves), sensor, cells_per_pixel=cells).mean_electrons(scene, 0.01)
        for curves in (None, third_order(0.0, corner_m(sensor)))
    )
    assert np.abs(moved - plain).max() < 1e-6 * plain.max()


def test_a_magnification_is_the_limit_of_a_distortion() -> None:
    """A distortion of 1e-5 pixels in the corner takes the general way; rays of both are at most as far apart."""
    sensor, scene = D200.with_(rows=80, cols=120), random_scene(100, 140)
    corner = corner_m(sensor)
    with_magnification, with_distortion = (
        ps.Camera(lens(third_order(k, corner, lateral=0.02)), sensor).mean_electrons(scene, 0.01)
        for k in (0.0, 1e-5 * PITCH_M / corner)
    )
    assert np.abs(with_magnification - with_distortion).max() < 5e-5 * with_distortion.max()
    assert np.abs(with_magnification - ps.Camera(lens(), sensor).mean_electrons(scene, 0.01)).max() > 1.0


def test_mapping_without_distortion_with_a_field_psf() -> None:
    sensor, scene = D200.with_(rows=80, cols=120), random_scene(100, 140)

    @dataclass(frozen=True)
    class Varying(Distorting):
        def point_spread(self, distance_m: float) -> FieldPsf:  # type: ignore[override]
            def gaussian(sigma_m: float) -> PlanePsf:
                return PlanePsf(
                    otf=lambda fy, fx, _: np.exp(-2 * (np.pi * sigma_m) ** 2 * (fy**2 + fx**2)) + 0j,
                    cutoff_per_m=lambda _: 6 / (2 * np.pi * sigma_m),
                    reach_m=lambda _: 4 * sigma_m,
                )

            x = np.array([-0.2e-3, 0.1e-3, 0.4e-3])
            first = np.array([[1.0, 0.5, 0.0], [0.7, 0.2, 0.1]])
            return FieldPsf(
                np.array([-0.2e-3, 0.2e-3]), x, np.stack([first, 1 - first]), (gaussian(4e-6), gaussian(9e-6))
            )

    curves = third_order(0.0, corner_m(sensor))
    plain, moved = (
        ps.Camera(Varying(f_number=8, focal_length_mm=50, curves=c), sensor).mean_electrons(scene, 0.01)
        for c in (None, curves)
    )
    assert np.abs(moved - plain).max() < 1e-6 * plain.max()


@pytest.mark.parametrize(("cells", "limit"), [(1, 0.05), (3, 0.012)])
@pytest.mark.parametrize("k", [-0.06, 0.04])
def test_points_follow_the_mapping(k: float, cells: int, limit: float) -> None:
    """A grid of points one pixel wide on black: their centroids, compared with the cubic.

    The remaining error is that of the cells: a point that is no whole number of cells wide is moved to their centers.
    """
    rows, cols, apart = 240, 320, 40
    sensor = mono(rows, cols)
    weights = np.zeros((1, rows, cols), np.float32)
    weights[0, apart // 2 :: apart, apart // 2 :: apart] = 1
    scene = Scene(weights, np.full((1, GRID_NM.size), 1e15), GRID_NM)
    curves = third_order(k, corner_m(sensor))
    image = ps.Camera(lens(curves), sensor, cells_per_pixel=cells).mean_electrons(scene, 0.1).astype(float)
    worst, moved = 0.0, 0.0
    for r in range(apart // 2, rows, apart):
        for c in range(apart // 2, cols, apart):
            ideal = np.array([r + 0.5 - rows / 2, c + 0.5 - cols / 2])
            real = ideal * (1 + k * (np.hypot(*ideal) * PITCH_M / corner_m(sensor)) ** 2)
            at = real + np.array([rows / 2, cols / 2])
            if not (8 < at[0] < rows - 8 and 8 < at[1] < cols - 8):
                continue
            top, left = (round(float(a)) - 7 for a in at)
            window = image[top : top + 14, left : left + 14]
            y, x = np.mgrid[top : top + 14, left : left + 14] + 0.5
            found = np.array([(window * y).sum(), (window * x).sum()]) / window.sum()
            worst, moved = max(worst, float(np.hypot(*(found - at)))), max(moved, float(np.hypot(*(real - ideal))))
    assert moved > 5
    assert worst < limit


@pytest.mark.parametrize("k", [-0.05, 0.05])
def test_irradiance_is_preserved_and_light_follows_area(k: float) -> None:
    """A uniform square on black keeps its level, and its light is the level times the image's area."""
    sensor, half = mono(200, 200), 60
    weights = np.zeros((1, 200, 200), np.float32)
    weights[0, 100 - half : 100 + half, 100 - half : 100 + half] = 1
    scene = Scene(weights, np.full((1, GRID_NM.size), 1e15), GRID_NM)
    even = ps.Camera(lens(), sensor).mean_electrons(Scene.uniform(np.full(GRID_NM.size, 1e15), GRID_NM), 0.1)[0, 0]
    image = ps.Camera(lens(third_order(k, corner_m(sensor))), sensor).mean_electrons(scene, 0.1)
    np.testing.assert_allclose(image[90:110, 90:110], even, rtol=1e-6)
    t = np.linspace(-half, half, 4001)
    side = half * np.ones_like(t)
    radius = corner_m(sensor) / PITCH_M
    x, y = (a * (1 + k * (t**2 + half**2) / radius**2) for a in (t, side))
    # Four times the area between the axis and one side.
    area = 4 * 0.5 * np.sum(x[1:] * y[:-1] - x[:-1] * y[1:])
    assert image.sum(dtype=np.float64) / even == pytest.approx(area, rel=1e-5)
    assert abs(area / (2 * half) ** 2 - 1) > 0.01


def by_wavelength(scene: Scene, curves: RadialMapping, sensor: Sensor) -> NDArray[np.float64]:
    """The oracle: every wavelength's image by itself, each with its own mapping."""
    total = np.zeros((sensor.array.rows, sensor.array.cols))
    measure = integration_weights(scene.wavelength_nm)
    for index, wavelength in enumerate(scene.wavelength_nm):
        fraction = np.clip((wavelength - 400) / 300, 0, 1)
        real = curves.real_m[0] + fraction * (curves.real_m[1] - curves.real_m[0])
        one = RadialMapping(np.array([wavelength]), curves.ideal_m, real[None])
        line = replace(scene, basis=scene.basis[:, [index]] * measure[index], wavelength_nm=np.array([wavelength]))
        total += ps.Camera(lens(one), sensor).mean_electrons(line, 0.01)
    return total


def test_lateral_color_equals_the_sum_over_wavelengths() -> None:
    """Red and blue 0.8 pixels apart at the corner, 31 wavelengths on 5 nodes, compared with one warp per wavelength."""
    sensor = D200.with_(rows=60, cols=80)
    rng = np.random.default_rng(6)
    grid = np.arange(400.0, 701.0, 10)
    smooth = np.stack([np.exp(-(((grid - peak) / 60) ** 2)) for peak in (440, 540, 640)])
    weights = np.kron(rng.random((3, 30, 40)), np.ones((2, 2))).astype(np.float32)
    scene = Scene(weights, 1e14 * smooth, grid)
    curves = third_order(-0.02, corner_m(sensor), lateral=8e-3)
    assert len(mean_image.frame_wavelength_nodes(curves, grid, (60, 80), (PITCH_M, PITCH_M))[0]) == 5
    got = ps.Camera(lens(curves), sensor).mean_electrons(scene, 0.01)
    want = by_wavelength(scene, curves, sensor)
    without = ps.Camera(lens(third_order(-0.02, corner_m(sensor))), sensor).mean_electrons(scene, 0.01)
    assert np.abs(got - want).max() < 7e-4 * want.max()
    assert np.abs(without - want).max() > 3e-2 * want.max()


def test_one_node_per_wavelength_is_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mean_image, "_STEP_PIXELS", 1e-3)
    monkeypatch.setattr(channel_transfers, "_TOLERANCE_WITH_NODES", 5e-6)
    sensor, scene = D200.with_(rows=60, cols=80), random_scene(60, 80)
    curves = third_order(-0.02, corner_m(sensor), lateral=8e-3)
    got = ps.Camera(lens(curves), sensor).mean_electrons(scene, 0.01)
    want = by_wavelength(scene, curves, sensor)
    assert np.abs(got - want).max() < 1e-5 * want.max()


def test_uniform_scene_of_many_samples_stays_uniform() -> None:
    sensor = D200.with_(rows=60, cols=80)
    scene = Scene(np.ones((1, 30, 40), np.float32), np.full((1, GRID_NM.size), 1e15), GRID_NM)
    even = ps.Camera(lens(), sensor).mean_electrons(Scene.uniform(scene.basis[0], GRID_NM), 0.01)
    curves = third_order(0.1, corner_m(sensor), lateral=5e-3)
    np.testing.assert_allclose(ps.Camera(lens(curves), sensor).mean_electrons(scene, 0.01), even, rtol=1e-5)


@pytest.mark.parametrize("k", [-0.08, 0.05])
def test_regions_are_inside_their_patches(k: float) -> None:
    sensor = D200.with_(rows=264, cols=392)
    chart = ps.charts.macbeth(wavelength_nm=np.arange(380, 781, 40))
    camera = ps.Camera(lens(third_order(k, corner_m(sensor), lateral=2e-3)), sensor)
    image, plain = camera.mean_electrons(chart, 0.01), ps.Camera(lens(), sensor)
    asked = {region.name: region for region in plain.image_regions(chart)}
    truth = plain.mean_electrons(chart, 0.01)
    for region in camera.image_regions(chart):
        straight = asked[region.name]
        for name in ((1, 0), (0, 1), (0, 0), (1, 1)):
            patch = np.s_[region.r0 : region.r1, region.c0 : region.c1]
            sites = np.zeros(image.shape, bool)
            sites[name[0] :: 2, name[1] :: 2] = True
            values = image[patch][sites[patch]]
            middle = np.s_[straight.r0 + 6 : straight.r1 - 6, straight.c0 + 6 : straight.c1 - 6]
            wanted = truth[middle][sites[middle]].mean()
            np.testing.assert_allclose(values, wanted, atol=0.03 * image.max())
    if k < 0:
        outer = next(r for r in camera.image_regions(chart) if r.name == chart.regions[0].name)
        assert outer.r0 > asked[outer.name].r0 + 3  # barrel: the corner's patch moves inwards


def test_frame_beyond_the_table_is_a_warning() -> None:
    sensor, scene = mono(60, 80), random_scene(60, 80, 1)
    short = RadialMapping(np.array([550.0]), np.array([0.0, 0.1e-3]), np.array([[0.0, 0.1e-3]]))
    with pytest.warns(PhotositeWarning, match=r"known up to an image height of 0.1 mm, .* corner is at 0.3025 mm"):
        ps.Camera(lens(short), sensor).mean_electrons(scene, 0.01)


def test_glare_is_applied_after_the_image() -> None:
    sensor, scene = mono(60, 80), random_scene(60, 80, 1)
    plain = ps.Camera(lens(), sensor).mean_electrons(scene, 0.01)
    glare = ps.Camera(lens(glare=VeilingGlare(0.1)), sensor).mean_electrons(scene, 0.01)
    np.testing.assert_allclose(glare, 0.9 * plain + 0.1 * plain.mean(dtype=np.float64), rtol=1e-5)


def test_no_mapping_needs_no_warp(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    plain = mean_image.mosaic_of_layers
    monkeypatch.setattr(
        mean_image, "mosaic_of_layers", lambda layers, *rest: seen.extend(layers) or plain(layers, *rest)
    )
    ps.Camera(lens(), mono(30, 40)).mean_electrons(random_scene(60, 80, 1), 0.01)
    assert [view.warp for layer in seen for view in layer.views] == [None]
