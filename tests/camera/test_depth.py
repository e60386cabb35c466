"""Planes in depth compared with occlusion in focus, and with rays through every part of a thin lens's pupil."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.special import j1

import photosite as ps
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import RadialPsf
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor

D200 = ps.load_sensor("nikon-d200")
PITCH_M = 6.05e-6
GRID_NM = np.arange(400.0, 701.0, 50)
WHITE = np.full((1, GRID_NM.size), 1e15)
FINEST_M = 0.35 * PITCH_M
"""Sigma of the blur of a plane in focus."""
CELLS = 3


@dataclass(frozen=True)
class ThinLens(DiffractionLimited):
    """Geometrical optics: a disc for defocused points, and a small Gaussian for all points."""

    focus_m: float = 2.0

    def magnification(self, distance_m: float) -> float:
        return self.image_m / distance_m

    @property
    def image_m(self) -> float:
        focal_m = self.focal_length_mm * 1e-3
        return focal_m * self.focus_m / (self.focus_m - focal_m)

    def irradiance_per_radiance(self, wavelength_nm: NDArray[np.float64], distance_m: float) -> NDArray[np.float64]:
        return super().irradiance_per_radiance(wavelength_nm, self.focus_m)

    def radius_m(self, distance_m: float) -> float:
        """Return the signed radius of the disc: the shift to the right of light through the pupil's right edge."""
        pupil_m = self.focal_length_mm * 1e-3 / self.f_number / 2
        return pupil_m * self.image_m * (1 / self.focus_m - 1 / distance_m)

    def point_spread(self, distance_m: float) -> RadialPsf:
        radius_m = abs(self.radius_m(distance_m))

        def otf(f: NDArray[np.float64], _: float) -> NDArray[np.float64]:
            u = 2 * np.pi * radius_m * np.asarray(f, np.float64)
            disc = np.divide(2 * j1(u), u, out=np.ones_like(u), where=u > 1e-9)
            return np.asarray(disc * np.exp(-2 * (np.pi * FINEST_M * f) ** 2))

        return RadialPsf(
            otf=otf, cutoff_per_m=lambda _: 6.5 / (2 * np.pi * FINEST_M), reach_m=lambda _: radius_m + 6 * FINEST_M
        )


LENS = ThinLens(f_number=2.8, focal_length_mm=50)


def mono(rows: int, cols: int) -> Sensor:
    channels = {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}
    return D200.with_(rows=rows, cols=cols, cfa="mono", channels=channels)


ROWS, COLS = 12, 96
SENSOR = mono(ROWS, COLS)
CAMERA = ps.Camera(LENS, SENSOR, cells_per_pixel=CELLS)
FULL = float(CAMERA.mean_electrons(Scene.uniform(WHITE[0], GRID_NM, 2.0), 1.0)[0, 0])


def striped(values: NDArray[np.float64], distance_m: float, basis: NDArray[np.float64] = WHITE) -> Scene:
    """Vertical stripes, each a cell wide in the image; wider than the frame, so that no border shows."""
    width_m = values.size / CELLS * PITCH_M / LENS.magnification(distance_m)
    weights = np.broadcast_to(values.astype(np.float32), (1, CELLS * ROWS * 8, values.size))
    return Scene(weights, basis, GRID_NM, distance_m, width_m)


def line(planes: Planes) -> NDArray[np.float64]:
    """Return the middle row, relative to a uniform field."""
    return CAMERA.mean_electrons(planes, 1.0)[ROWS // 2].astype(np.float64) / FULL


SAMPLES = 2 * CELLS * COLS
FINE = 20
"""Places in a sample at which rays are traced."""


def traced(
    planes: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]], rays: int = 401
) -> NDArray[np.float64]:
    """The reference: the sum over parts of the pupil of the planes that each part sees, near over far.

    Planes are (distance, radiance, alpha), near to far, as `striped` has them.
    """
    edges = np.linspace(-1, 1, rays + 1)
    u = (edges[1:] + edges[:-1]) / 2
    chord = np.sqrt(1 - u**2)  # of the round pupil, seen from the side
    place = (np.arange(SAMPLES * FINE) + 0.5) / FINE - SAMPLES / 2  # in samples from the axis
    image = np.zeros(place.size)
    for position, weight in zip(u, chord / chord.sum(), strict=True):
        picture = np.zeros(place.size)
        for distance, radiance, alpha in reversed(planes):
            moved = place - position * LENS.radius_m(distance) / PITCH_M * CELLS
            at = np.clip(np.floor(moved + SAMPLES / 2).astype(int), 0, SAMPLES - 1)
            picture = alpha[at] * radiance[at] + (1 - alpha[at]) * picture
        image += weight * picture
    image = gaussian_filter1d(image, FINEST_M / PITCH_M * CELLS * FINE, mode="nearest", truncate=8)
    side = math.sqrt(SENSOR.pixel.fill_factor.value) * CELLS  # of the photodetector, in samples
    total = np.concatenate([[0.0], np.cumsum(image)]) / FINE
    borders = np.arange(total.size) / FINE - SAMPLES / 2
    middle = (np.arange(COLS) + 0.5 - COLS / 2) * CELLS
    low, high = (np.interp(middle + sign * side / 2, borders, total) for sign in (-1, 1))
    return (high - low) / side


def texture(seed: int) -> NDArray[np.float64]:
    return np.repeat(np.random.default_rng(seed).random(SAMPLES // 12), 12)


def half(fraction: float = 0.5) -> NDArray[np.float64]:
    return (np.arange(SAMPLES) < fraction * SAMPLES).astype(float)


ONES = np.ones(SAMPLES)


def compared(planes: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Return layers minus rays, relative to full scale."""
    ours = Planes(
        tuple(
            Plane(striped(radiance, distance), np.broadcast_to(alpha, (CELLS * ROWS * 8, SAMPLES)))
            for distance, radiance, alpha in planes
        )
    )
    return line(ours) - traced(planes)


def largest(error: NDArray[np.float64]) -> float:
    return float(np.abs(error).max())


def test_single_plane_matches_ray_tracing() -> None:
    for distance in (1.0, 2.0, 4.0):
        assert largest(compared([(distance, texture(1), ONES)])) < 2e-4


def test_edge_in_front_of_a_uniform_plane() -> None:
    for near, far in ((1.0, 4.0), (1.0, 2.0), (2.0, 4.0), (2.0, 2.0), (1.9, 1.95)):
        assert largest(compared([(near, texture(1), half()), (far, 0.3 * ONES, ONES)])) < 2e-4


def test_two_half_planes_in_focus() -> None:
    """In focus, dark beside bright: near over far, then the smallest blur; exact one pixel from the edge."""
    near, far = Plane(striped(ONES, 2.0), np.tile(half(), (CELLS * ROWS * 8, 1))), striped(0.25 * ONES, 2.0)
    got = line(Planes((near, far)))
    np.testing.assert_allclose(got[: COLS // 2 - 3], 1.0, atol=1e-5)
    np.testing.assert_allclose(got[COLS // 2 + 3 :], 0.25, atol=1e-5)
    assert got[COLS // 2 - 1] + got[COLS // 2] == pytest.approx(1.25, abs=1e-5)


@pytest.mark.parametrize(("near", "far"), [(1.0, 2.0), (2.0, 4.0)])
def test_one_of_two_planes_in_focus(near: float, far: float) -> None:
    assert largest(compared([(near, texture(1), half()), (far, texture(2), ONES)])) < 1.2e-3


def test_errors_of_linear_layers() -> None:
    """As docs/theory/depth.md states, relative to full scale, at single pixels near the edge."""
    both = compared([(1.0, texture(1), half()), (4.0, texture(2), ONES)])
    assert 0.05 < largest(both) < 0.11
    # The edge of what is behind falls on the edge before it: rays see none of its light, or all of it.
    coincident = compared([(1.0, 0 * ONES, half()), (4.0, half(), ONES)])
    assert 0.2 < largest(coincident) < 0.25


@pytest.mark.parametrize(
    ("near", "middle", "far", "limit"), [(2.0, 2.0, 2.0, 2e-4), (1.999, 2.0, 2.001, 2e-3), (1.0, 1.002, 1.004, 2.5e-3)]
)
def test_planes_blurred_alike(near: float, middle: float, far: float, limit: float) -> None:
    """In focus, or defocused equally: structure behind structure, edges on edges."""
    planes = [(near, texture(1), half(0.45)), (middle, texture(3), half(0.5)), (far, texture(2) * half(0.5), ONES)]
    assert largest(compared(planes)) < limit


def test_overlapping_planes_occlude_once() -> None:
    """Two planes in focus that overlap, in front of a blurred uniform plane."""
    planes = [(2.0, texture(1), 0.6 * half(0.45)), (2.0, texture(3), 0.5 * half(0.5)), (4.0, 0.7 * ONES, ONES)]
    assert largest(compared(planes)) < 2e-4


def test_lens_with_everything_in_focus() -> None:
    """The built-in lens has every plane in focus: planes are one scene of the nearest samples, color by color."""
    sensor = D200.with_(rows=64, cols=96)
    camera = ps.Camera(DiffractionLimited(f_number=4, focal_length_mm=50), sensor)
    near, far = colored(1, 2.0), colored(2, 2.0)
    alpha = np.kron(np.random.default_rng(5).random((32, 48)) > 0.5, np.ones((2, 2)))
    painted = Scene(
        np.concatenate([near.weights * alpha, far.weights * (1 - alpha)]).astype(np.float32),
        np.concatenate([near.basis, far.basis]),
        GRID_NM,
        2.0,
    )
    want = camera.mean_electrons(painted, 0.1)
    got = camera.mean_electrons(Planes((Plane(near, alpha), far)), 0.1)
    assert np.abs(got - want).max() < 1e-5 * want.max()


@pytest.mark.parametrize("cells", [1, 3])
def test_uniform_planes_stay_uniform(cells: int) -> None:
    """The same radiance at three distances, with edges: uniform to 1e-5, at the edges too."""
    sensor = D200.with_(rows=64, cols=96)
    rng = np.random.default_rng(7)
    basis = (1e14 * (1 + np.sin(GRID_NM / 60)))[None]
    alpha = np.kron(rng.random((8, 12)).round(1), np.ones((16, 16)))
    planes = [
        Plane(Scene(np.ones((1, 128, 192), np.float32), basis, GRID_NM, distance, width), opacity)
        for distance, width, opacity in ((1.0, 0.008, alpha), (1.7, None, alpha[::-1]), (4.0, None, None))
    ]
    lens = ThinLens(f_number=2.8, focal_length_mm=50)
    stack = ps.Camera(lens, sensor, cells_per_pixel=cells).mean_electrons(Planes(tuple(planes)), 0.1)
    even = ps.Camera(lens, sensor).mean_electrons(Scene.uniform(basis[0], GRID_NM, 4.0), 0.1)
    np.testing.assert_allclose(stack, even, rtol=1e-5)


def colored(seed: int, distance_m: float, width_m: float | None = None) -> Scene:
    rng = np.random.default_rng(seed)
    weights = np.kron(rng.random((3, 16, 24)), np.ones((4, 4))).astype(np.float32)
    return Scene(weights, 1e14 * rng.random((3, GRID_NM.size)), GRID_NM, distance_m, width_m)


def test_single_plane_is_its_scene_and_a_transparent_plane_changes_nothing() -> None:
    camera = ps.Camera(LENS, D200.with_(rows=64, cols=96))
    far = colored(1, 4.0)
    alone = camera.mean_electrons(far, 0.1)
    assert (camera.mean_electrons(Planes((far,)), 0.1) == alone).all()
    nothing = Plane(colored(2, 1.0), np.zeros((64, 96)))
    assert (camera.mean_electrons(Planes((nothing, far)), 0.1) == alone).all()


def test_opacity_divides_the_light() -> None:
    camera = ps.Camera(LENS, D200.with_(rows=64, cols=96))
    near, far = colored(1, 1.0), colored(2, 4.0)
    images = [camera.mean_electrons(scene, 0.1) for scene in (near, far)]
    for fraction in (1.0, 0.3):
        mixed = camera.mean_electrons(Planes((Plane(near, np.full((64, 96), fraction)), far)), 0.1)
        want = fraction * images[0] + (1 - fraction) * images[1]
        np.testing.assert_allclose(mixed, want, atol=1e-5 * want.max())


def test_black_plane_and_dark_background() -> None:
    camera = ps.Camera(LENS, D200.with_(rows=64, cols=96))
    black = replace(colored(1, 1.0), basis=np.zeros((3, GRID_NM.size)))
    wall = colored(2, 4.0)
    hidden = camera.mean_electrons(Planes((black, wall)), 0.1)
    assert hidden.max() < 5e-6 * camera.mean_electrons(wall, 0.1).max()
    near = colored(3, 1.0)
    dark = replace(black, distance_m=4.0)
    np.testing.assert_array_equal(camera.mean_electrons(Planes((near, dark)), 0.1), camera.mean_electrons(near, 0.1))


def test_position_and_border_of_a_plane() -> None:
    """A square post 20 pixels wide in the image: its light is its area, and what is behind loses as much."""
    lens = replace(LENS, f_number=11)
    camera = ps.Camera(lens, mono(64, 96))
    full = camera.mean_electrons(Scene.uniform(WHITE[0], GRID_NM, 2.0), 1.0)[0, 0]
    wall = Scene(np.ones((1, 8, 12), np.float32), 0.4 * WHITE, GRID_NM, 4.0)
    for distance in (1.0, 2.0):
        width_m = 20 * PITCH_M / lens.magnification(distance)
        post = Scene(np.ones((1, 5, 5), np.float32), WHITE, GRID_NM, distance, width_m)
        image = camera.mean_electrons(Planes((post, wall)), 1.0).astype(np.float64) / full
        assert image.sum() == pytest.approx(0.4 * 64 * 96 + 0.6 * 400, rel=1e-5)
    assert image[32 - 7 : 32 + 7, 48 - 7 : 48 + 7].min() > 1 - 1e-5  # in focus: opaque inside
    assert image[:, : 48 - 14].max() < 0.4 + 1e-5


def test_captures_streams_and_regions_of_planes() -> None:
    camera = ps.Camera(LENS, D200.with_(rows=132, cols=196))
    chart = replace(ps.charts.macbeth(), distance_m=3.0)
    post = Scene(np.ones((1, 5, 5), np.float32), WHITE, GRID_NM, 1.0, 1e-3)
    planes = Planes((post, chart))
    raw = camera.capture(planes, 0.01, seed=3)
    (streamed,) = camera.stream(planes, 0.01, seed=3)
    assert (raw.dn == streamed.dn).all()
    assert camera.image_regions(planes) == camera.image_regions(chart)
