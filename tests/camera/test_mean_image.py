"""Images with PSFs of any shape, and with PSFs that vary over the field, compared with closed forms and direct sums."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises
from scipy.special import ndtr

import photosite as ps
from photosite.camera import channel_transfers, mean_image, sampled_otf
from photosite.camera.channel_transfers import reduced_transfers
from photosite.camera.mean_image import apply_relative_illumination
from photosite.engine.transfer import Sampling
from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import FieldPsf, PlanePsf, PointSpread
from photosite.scene.scene import Scene
from photosite.sensor.model import Sensor

Array = NDArray[np.float64]

D200 = ps.load_sensor("nikon-d200")
PITCH_M = 6.05e-6
SIDE_M = PITCH_M * math.sqrt(0.9)
LINE = np.array([550.0])

GRID = np.arange(400.0, 701, 10)


@dataclass(frozen=True)
class Lens(DiffractionLimited):
    """A lens with a given PSF."""

    f_number: float = 8.0
    focal_length_mm: float = 50.0
    given: Any = None

    def point_spread(self, distance_m: float) -> Any:
        return self.given


@dataclass(frozen=True)
class Spot:
    """A Gaussian of light: share, standard deviation, center (down, right)."""

    fraction: float
    sigma_m: float
    y_m: float = 0.0
    x_m: float = 0.0

    def otf(self, fy: Array, fx: Array, wavelength_nm: float) -> NDArray[np.complex128]:
        blur = np.exp(-2 * (math.pi * self.sigma_m) ** 2 * (fy**2 + fx**2))
        return np.asarray(self.fraction * blur * np.exp(-2j * math.pi * (fy * self.y_m + fx * self.x_m)))

    def read(self, dy_m: Array, dx_m: Array, cell_m: float = PITCH_M) -> Array:
        """Return the signal of a photodetector from a cell of radiance 1 that is (dy, dx) above and left of it."""
        return self.fraction * self._line(dy_m - self.y_m, cell_m) * self._line(dx_m - self.x_m, cell_m)

    def _line(self, t: Array, cell_m: float) -> Array:
        """Gaussian, cell and photodetector convolved: differences of the Gaussian's second integral."""

        def twice(x: Array) -> Array:
            z = x / self.sigma_m
            return np.asarray(x * ndtr(z) + self.sigma_m * np.exp(-z * z / 2) / math.sqrt(2 * math.pi))

        outer, inner = (cell_m + SIDE_M) / 2, (cell_m - SIDE_M) / 2
        return (twice(t + outer) - twice(t + inner) - twice(t - inner) + twice(t - outer)) / SIDE_M


def plane(*spots: Spot) -> PlanePsf:
    return PlanePsf(
        otf=lambda fy, fx, w: sum((s.otf(fy, fx, w) for s in spots), np.zeros(1, complex)),
        cutoff_per_m=lambda w: max(1.2 / s.sigma_m for s in spots),
        reach_m=lambda w: max(6 * s.sigma_m + math.hypot(s.y_m, s.x_m) for s in spots),
    )


COMA = (Spot(0.7, 2.5e-6), Spot(0.3, 5e-6, 14e-6, 7e-6))
"""A core, and a flare below and to the right of it."""


def mono(rows: int, cols: int) -> Sensor:
    flat = {"M": {"wavelength_nm": [400, 700], "quantum_efficiency": [0.5, 0.5]}}
    return D200.with_(rows=rows, cols=cols, cfa="mono", channels=flat)


def point(rows: int, cols: int, row: int, col: int) -> Scene:
    weights = np.zeros((1, rows, cols), np.float32)
    weights[0, row, col] = 1
    return Scene(weights, np.array([[1e17]]), LINE)


def random_scene(rows: int, cols: int, seed: int = 1, count: int = 5) -> Scene:
    rng = np.random.default_rng(seed)
    grid = np.arange(380.0, 781.0, 20)
    weights = np.kron(rng.random((count, rows // 4, cols // 4)), np.ones((4, 4)))
    return Scene(weights.astype(np.float32), 1e14 * rng.random((count, grid.size)), grid)


def as_plane(lens: DiffractionLimited) -> PlanePsf:
    """Return a radial PSF as a plane PSF."""
    radial = lens.point_spread(1.2)
    return PlanePsf(
        lambda fy, fx, w: radial.otf(np.hypot(fy, fx), w).astype(complex), radial.cutoff_per_m, radial.reach_m
    )


def even_electrons(sensor: Sensor, lens: Any) -> float:
    return float(ps.Camera(lens, sensor).mean_electrons(Scene.uniform([1e17], LINE), 0.01)[0, 0])


@pytest.mark.parametrize("f_number", [2.8, 8.0])
@pytest.mark.parametrize("cells", [1, 3])
def test_diffraction_as_radial_or_plane_psf_is_the_same(f_number: float, cells: int) -> None:
    """Within 1e-5 of full scale, far from the end of the padding."""
    lens = DiffractionLimited(f_number, 50)
    scene = random_scene(96, 128)
    tiled = Scene(np.tile(scene.weights, (1, 5, 5)), scene.basis, scene.wavelength_nm)
    sensor = D200.with_(rows=480, cols=640)
    middle = np.s_[192:288, 256:384]
    known = ps.Camera(lens, sensor, cells_per_pixel=cells).mean_electrons(tiled, 1 / 30)[middle]
    given = Lens(f_number, given=as_plane(lens))
    unknown = ps.Camera(given, sensor, cells_per_pixel=cells).mean_electrons(tiled, 1 / 30)[middle]
    assert np.abs(known - unknown).max() < 3e-6 * known.max()


def test_cone_of_diffraction_is_found_with_smooth_blur() -> None:
    """1 for a circular pupil, with or without defocus; 0 for a Gaussian, which has no cone."""
    radial = DiffractionLimited(8, 50).point_spread(1.2)
    exact = as_plane(DiffractionLimited(8, 50))
    blurred = PlanePsf(
        lambda fy, fx, w: radial.otf(np.hypot(fy, fx), w) * Spot(1, 20e-6, 5e-6).otf(fy, fx, w),
        radial.cutoff_per_m,
        radial.reach_m,
    )
    assert sampled_otf._cone(exact, 550.0) == pytest.approx(1, abs=1e-6)
    assert sampled_otf._cone(blurred, 550.0) == pytest.approx(1, abs=2e-2)
    assert sampled_otf._cone(plane(*COMA), 550.0) == pytest.approx(0, abs=2e-2)


def comatic(scale: float) -> Any:
    """A flare that grows with wavelength, after diffraction: (fy, fx, wavelength) -> factor of its transfer."""
    return lambda fy, fx, w: (
        Spot(0.7, 1e-6).otf(fy, fx, w) + Spot(0.3, 4e-6, 8e-6 * w / 550 * scale, -5e-6 * w / 550 * scale).otf(fy, fx, w)
    )


@pytest.mark.parametrize("f_number", [pytest.param(2.8, marks=pytest.mark.slow), 8.0])
def test_asymmetric_psf_equals_the_sum_over_wavelengths(f_number: float) -> None:
    """Compared with one transform pair per wavelength in double precision, with all folded terms: within 1e-5."""
    lens, flare = DiffractionLimited(f_number, 50), comatic(1.0)
    exact = as_plane(lens)
    spread = PlanePsf(
        lambda fy, fx, w: exact.otf(fy, fx, w) * flare(fy, fx, w),
        exact.cutoff_per_m,
        lambda w: 60e-6 + exact.reach_m(w),
    )
    scene = random_scene(48, 64)
    rows, cols = scene.shape
    fy, fx = np.fft.fftfreq(rows, PITCH_M)[:, None], np.fft.fftfreq(cols, PITCH_M)[None, :]
    images = {name: np.zeros((rows, cols)) for name in "RGB"}
    for index, wavelength in enumerate(scene.wavelength_nm):
        radiance = np.tensordot(scene.basis[:, index], scene.weights.astype(np.float64), axes=1)
        transfer = np.zeros((rows, cols), complex)
        for m in range(-5, 6):
            for n in range(-5, 6):
                y, x = fy + m / PITCH_M, fx + n / PITCH_M
                box = np.sinc(y * SIDE_M) * np.sinc(x * SIDE_M) * np.sinc(y * PITCH_M) * np.sinc(x * PITCH_M)
                transfer += spread.otf(y, x, wavelength) * box
        irradiance = np.fft.ifft2(np.fft.fft2(radiance) * transfer).real
        irradiance *= lens.irradiance_per_radiance(np.array([wavelength]), 1.2)
        width = 10.0 if index in (0, scene.wavelength_nm.size - 1) else 20.0
        for name, image in images.items():
            image += irradiance * D200.channels[name].quantum_efficiency_at([wavelength]) * width * SIDE_M**2 / 30
    oracle = np.empty((rows, cols))
    for (r, c), name in {(0, 0): "R", (0, 1): "G", (1, 0): "G", (1, 1): "B"}.items():
        oracle[r::2, c::2] = images[name][r::2, c::2]

    tiled = Scene(np.tile(scene.weights, (1, 9, 9)), scene.basis, scene.wavelength_nm)
    camera = ps.Camera(Lens(f_number, given=spread), D200.with_(rows=9 * rows, cols=9 * cols))
    ours = camera.mean_electrons(tiled, 1 / 30)[4 * rows : 5 * rows, 4 * cols : 5 * cols]
    assert np.abs(ours - oracle).max() < 1e-5 * oracle.max()


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("spots", [(Spot(1, 4e-6),), COMA, (Spot(1, 2e-6, 31e-6, -18e-6),)])
def test_image_of_a_point_is_the_psf_times_photodetector_and_cell(spots: tuple[Spot, ...], cells: int) -> None:
    """The closed form within 1e-6 of its peak, in the right orientation: positive is down and right.

    The sample is as large as a pixel, whatever the cells.
    """
    rows, cols, row, col = 33, 40, 14, 19
    lens, sensor = Lens(given=plane(*spots)), mono(rows, cols)
    got = ps.Camera(lens, sensor, cells_per_pixel=cells).mean_electrons(point(rows, cols, row, col), 0.01)
    dy, dx = (np.arange(rows) - row)[:, None] * PITCH_M, (np.arange(cols) - col)[None, :] * PITCH_M
    expected = sum(spot.read(dy, dx) for spot in spots)
    assert np.abs(got / even_electrons(sensor, lens) - expected).max() < 2e-6 * expected.max()


@pytest.mark.parametrize("spots", [(Spot(1, 4e-6),), COMA])
def test_light_is_conserved_to_a_millionth(spots: tuple[Spot, ...]) -> None:
    sensor, lens = mono(40, 44), Lens(given=plane(*spots))
    got = ps.Camera(lens, sensor).mean_electrons(point(40, 44, 19, 21), 0.01)
    assert got.sum(dtype=np.float64) == pytest.approx(even_electrons(sensor, lens), rel=1e-6)


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("f_number", [2.8, 8.0])
def test_kernels_and_cones_add_up_to_all_light(f_number: float, cells: int) -> None:
    """The operator itself, to 1e-9, for diffraction with a flare."""
    exact, flare = as_plane(DiffractionLimited(f_number, 50)), comatic(1.0)
    spread = PlanePsf(lambda fy, fx, w: exact.otf(fy, fx, w) * flare(fy, fx, w), exact.cutoff_per_m, exact.reach_m)
    sampling = Sampling((PITCH_M, PITCH_M), (SIDE_M, SIDE_M), cells)
    coupling = np.random.default_rng(1).random((3, 2, 4))
    (reduced,) = reduced_transfers(spread, coupling, np.array([450.0, 500, 550, 600]), sampling)
    assert reduced.transfer.radial is not None
    assert reduced.transfer.kernels is not None
    light = reduced.transfer.kernels.sum(axis=(2, 3)) + reduced.transfer.radial.table[:, :, 0]
    assert light @ reduced.mixing[:, 0] == pytest.approx(coupling.sum(axis=2), rel=1e-9)


@pytest.mark.parametrize("reach_m", [7e-3, math.inf, math.nan])
def test_spread_larger_than_any_frame_is_an_error(reach_m: float) -> None:
    """Micrometers instead of millimeters, for example."""
    whole = plane(*COMA)
    given = PlanePsf(whole.otf, whole.cutoff_per_m, lambda w: reach_m)
    with pytest.raises(InputError, match="number of cells over which the lens spreads a point"):
        ps.Camera(Lens(given=given), mono(20, 20)).mean_electrons(point(20, 20, 5, 5), 0.01)


def test_uniform_scene_stays_uniform() -> None:
    lens, sensor = Lens(given=plane(*COMA)), D200.with_(rows=40, cols=60)
    grid = np.arange(400.0, 701, 50)
    structured = Scene(np.ones((1, 5, 7), np.float32), np.full((1, 7), 1e15), grid)
    got = ps.Camera(lens, sensor).mean_electrons(structured, 0.01)
    even = ps.Camera(lens, sensor).mean_electrons(Scene.uniform(np.full(7, 1e15), grid), 0.01)
    assert got == pytest.approx(even, rel=2e-6)


def test_psfs_are_linear_between_known_wavelengths() -> None:
    """One spot at 500 nm, another at 600 nm: three quarters of the first at 525 nm, the first alone at 450 nm."""
    first, second = Spot(1, 3e-6, 10e-6), Spot(1, 5e-6, 0, -12e-6)
    whole = plane(first, second)
    given = PlanePsf(
        lambda fy, fx, w: {500.0: first, 600.0: second}[w].otf(fy, fx, w),
        whole.cutoff_per_m,
        whole.reach_m,
        np.array([500.0, 600.0]),
    )
    sensor = mono(21, 23)
    dy, dx = (np.arange(21) - 10)[:, None] * PITCH_M, (np.arange(23) - 11)[None, :] * PITCH_M
    for wavelength, fraction in ((525.0, 0.75), (450.0, 1.0), (700.0, 0.0)):
        scene = Scene(point(21, 23, 10, 11).weights, np.array([[1e17]]), np.array([wavelength]))
        lens = Lens(given=given)
        got = ps.Camera(lens, sensor).mean_electrons(scene, 0.01)
        even = ps.Camera(lens, sensor).mean_electrons(Scene.uniform([1e17], [wavelength]), 0.01)[0, 0]
        expected = fraction * first.read(dy, dx) + (1 - fraction) * second.read(dy, dx)
        assert np.abs(got / even - expected).max() < 2e-6 * expected.max()


@pytest.mark.parametrize("cells", [1, 3])
def test_low_pass_filter_splits_a_point_into_four(cells: int) -> None:
    """The kernel is the mean of four, each shifted by half the split, on both axes."""
    split = (4.1e-6, 5.3e-6)
    sampling = Sampling((PITCH_M, PITCH_M), (SIDE_M, SIDE_M), cells, split)
    (reduced,) = reduced_transfers(plane(Spot(1, 3e-6)), np.ones((1, 1, 1)), LINE, sampling)
    assert reduced.transfer.kernels is not None
    kernel = reduced.transfer.kernels[0, 0] * reduced.mixing[0, 0, 0]
    shift = (np.arange(len(kernel)) - len(kernel) // 2) * PITCH_M / cells
    spots = [Spot(0.25, 3e-6, v * split[0] / 2, h * split[1] / 2) for v in (-1, 1) for h in (-1, 1)]
    expected = sum(spot.read(shift[:, None], shift[None, :], PITCH_M / cells) for spot in spots)
    assert np.abs(kernel - expected).max() < 1e-6 * expected.max()


# Spreads that differ over the field.

ROWS, COLS = 24, 30
NODES_Y_M, NODES_X_M = np.array([-60e-6, 5e-6, 80e-6]), np.array([-100e-6, -20e-6, 30e-6, 75e-6])
"""Neither even nor centered, and the outer ones within the frame's padding."""


def spots_at(y_m: float, x_m: float) -> tuple[Spot, Spot]:
    """A core, and a flare that points away from the axis and grows with the distance from it."""
    return Spot(0.75, 2.5e-6 + 0.01 * abs(x_m)), Spot(0.25, 4e-6, 0.15 * y_m, 0.15 * x_m)


def full_rank() -> FieldPsf:
    """Return one mode per node, whose weight is 1 there and 0 at other nodes."""
    count = NODES_Y_M.size * NODES_X_M.size
    weights = np.eye(count).reshape(count, NODES_Y_M.size, NODES_X_M.size)
    modes = tuple(plane(*spots_at(y, x)) for y in NODES_Y_M for x in NODES_X_M)
    return FieldPsf(NODES_Y_M, NODES_X_M, weights, modes)


def hats(nodes: Array, at: float) -> Array:
    return np.array([np.interp(at, nodes, unit) for unit in np.eye(nodes.size)])


def applied_directly(radiance: Array, cells: int = 1) -> Array:
    """Sum over samples, each with its own PSF, interpolated between the four nodes around it.

    Beyond the frame the scene goes on with its border samples, as far as any flare reaches.
    """
    margin = 16
    wide = np.pad(radiance, margin, mode="edge")
    total = np.zeros((ROWS, COLS))
    pixel_y = ((np.arange(ROWS) + 0.5 - ROWS / 2) * PITCH_M)[:, None]
    pixel_x = ((np.arange(COLS) + 0.5 - COLS / 2) * PITCH_M)[None, :]
    offsets = (np.arange(cells) - (cells - 1) / 2) / cells
    for r, c in np.argwhere(wide):
        light = wide[r, c]
        for down in offsets:
            for right in offsets:
                y = (r - margin + 0.5 + down - ROWS / 2) * PITCH_M
                x = (c - margin + 0.5 + right - COLS / 2) * PITCH_M
                fraction = np.outer(hats(NODES_Y_M, y), hats(NODES_X_M, x))
                for p, q in np.argwhere(fraction):
                    for spot in spots_at(NODES_Y_M[p], NODES_X_M[q]):
                        total += light * fraction[p, q] * spot.read(pixel_y - y, pixel_x - x, PITCH_M / cells)
    return total


def measured(spread: PointSpread, radiance: Array, cells: int = 1) -> Array:
    """Electrons relative to those of radiance 1 everywhere."""
    lens, sensor = Lens(given=spread), mono(ROWS, COLS)
    scene = Scene(radiance[None].astype(np.float32), np.array([[1e17]]), LINE)
    got = ps.Camera(lens, sensor, cells_per_pixel=cells).mean_electrons(scene, 0.01)
    return np.asarray(got / even_electrons(sensor, lens), np.float64)


def test_field_psf_equals_direct_convolution() -> None:
    radiance = np.random.default_rng(3).random((ROWS, COLS))
    expected = applied_directly(radiance)
    got = measured(full_rank(), radiance)
    assert np.abs(got - expected).max() < 1e-5 * expected.max()
    one = measured(plane(*spots_at(0.0, 0.0)), radiance)
    assert np.abs(one - expected).max() > 1e-2 * expected.max()  # and the field matters


@pytest.mark.parametrize(("row", "col", "cells"), [(2, 3, 1), (12, 15, 1), (21, 27, 1), (5, 26, 3)])
def test_field_psf_at_points_over_the_field(row: int, col: int, cells: int) -> None:
    radiance = np.zeros((ROWS, COLS))
    radiance[row, col] = 1
    expected = applied_directly(radiance, cells)
    assert np.abs(measured(full_rank(), radiance, cells) - expected).max() < 1e-5 * expected.max()


@pytest.mark.parametrize("factor", [0.5, 2])
def test_scenes_coarser_and_finer_than_the_cells(factor: float) -> None:
    """Resampled on the cells first: samples larger than a pixel, and several samples per pixel."""
    rng = np.random.default_rng(4)
    twice = np.ones((2, 2))
    if factor < 1:
        scene = rng.random((ROWS // 2, COLS // 2))
        cells = np.kron(scene, twice)
    else:
        scene = np.kron(rng.random((ROWS, COLS)), twice)
        scene[2:-2, 2:-2] = rng.random((2 * ROWS - 4, 2 * COLS - 4))  # the border is what goes on beyond the frame
        cells = scene.reshape(ROWS, 2, COLS, 2).mean(axis=(1, 3))
    assert np.abs(measured(full_rank(), scene) - measured(full_rank(), cells)).max() < 1e-6


def wider_in_red(spread: PlanePsf) -> PlanePsf:
    """In proportion to wavelength, as diffraction is: at every wavelength another spread."""
    return PlanePsf(
        lambda fy, fx, w: spread.otf(fy * (w / 550), fx * (w / 550), w),
        lambda w: spread.cutoff_per_m(w) * 550 / w,
        lambda w: spread.reach_m(w) * w / 550,
    )


def test_frame_that_sees_part_of_the_field_needs_few_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine nodes of 121 lie around the frame: ten modes replace all, and the image is the same."""
    axis = np.arange(-10, 11) * 2.0
    heights_mm, colors = np.linspace(0, 5, 6), np.array([450.0, 600.0])
    coma = [[np.hypot(2.5 + h + w, axis[:, None]) + np.hypot(h, axis - 2 * h) for w in (0, 1)] for h in heights_mm]
    psf = np.exp(-(np.array(coma) ** 2) / 50)
    design = LensDesign(colors, psf, 2.0, np.zeros(6), heights_mm, tolerance=1e-4)
    optics = ps.Lens(ps.DiffractionLimited(f_number=4, focal_length_mm=50), blur=design)
    camera = ps.Camera(optics, D200.with_(rows=40, cols=60))
    chart = ps.charts.macbeth(wavelength_nm=np.arange(400, 701, 20))
    few = camera.mean_electrons(chart, 1 / 3)
    modes = [
        len(part.modes) for part in (optics.point_spread(chart.distance_m), mean_image._spread_on_frame(camera, 1.2))
    ]
    assert modes[0] > 20
    assert modes[1] == 10
    monkeypatch.setattr(mean_image, "_spread_on_frame", lambda camera, at_m: camera.optics.point_spread(at_m))
    assert np.abs(few - camera.mean_electrons(chart, 1 / 3)).max() < 1e-5 * few.max()


def test_reduction_of_maps_and_modes_is_within_tolerance(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chart of 24 spectra and a lens of four modes, with few terms and with all 96: within 1e-5 of full scale."""
    nodes = np.array([-90e-6, 90e-6])
    modes = tuple(wider_in_red(plane(*spots_at(y, x))) for y in nodes for x in nodes)
    lens = Lens(given=FieldPsf(nodes, nodes, np.eye(4).reshape(4, 2, 2), modes))
    camera = ps.Camera(lens, D200.with_(rows=40, cols=60))
    terms: list[int] = []
    plain = channel_transfers._terms

    def counted(*arguments: Any) -> Any:
        terms.append(len((found := plain(*arguments))[1]))
        return found

    monkeypatch.setattr(channel_transfers, "_terms", counted)
    chart = ps.charts.macbeth(wavelength_nm=np.arange(380, 781, 20))
    combined = camera.mean_electrons(chart, 1 / 3)
    monkeypatch.setattr(channel_transfers, "TOLERANCE", 0.0)
    apart = camera.mean_electrons(chart, 1 / 3)
    assert 12 < terms[0] < 48  # more than channels times parts: the tolerance decides
    assert max(terms) == 96
    assert np.abs(combined - apart).max() < 1e-5 * apart.max()


def rare_colours() -> np.ndarray:
    """Return a scene of smooth spectra with few points of narrow spectra on black."""
    rng = np.random.default_rng(0)
    wide = np.exp(-(((GRID - 600) / 120) ** 2)), np.exp(-(((GRID - 520) / 60) ** 2))
    radiance = rng.uniform(0.2, 1, (200, 300, 1)) * wide[0] + rng.uniform(0, 0.3, (200, 300, 1)) * wide[1]
    radiance[80:120] = 0
    for k in range(12):
        radiance[100, 20 + 22 * k] = np.exp(-(((GRID - 410 - 22 * k) / 8) ** 2))
    return 1e15 * radiance


@pytest.fixture
def camera() -> ps.Camera:
    sensor = ps.load_sensor("nikon-d200").with_(rows=200, cols=300)
    return ps.Camera(ps.DiffractionLimited(f_number=2, focal_length_mm=50), sensor)


def test_negative_values_within_the_reduction_error_become_0(camera: ps.Camera) -> None:
    whole = camera.mean_electrons(ps.Scene.from_radiance(rare_colours(), GRID, tolerance=1e-6), 0.1)
    scene = ps.Scene.from_radiance(rare_colours(), GRID, tolerance=1e-2)
    again = np.einsum("kij,kl->ijl", scene.weights[:, 90:110], scene.basis)
    assert again.min() < -1e13  # there is something below 0 to be dealt with
    mean = camera.mean_electrons(scene, 0.1)
    assert mean.min() == 0.0
    assert np.sqrt(((mean - whole) ** 2).mean() / (whole**2).mean()) < 2 * scene.relative_error


def test_negative_light_beyond_the_reduction_error_is_an_error(camera: ps.Camera) -> None:
    weights = np.ones((1, 200, 300), np.float32)
    weights[0, :20] = -0.1
    scene = ps.Scene(weights, np.full((1, GRID.size), 1e15), GRID, relative_error=1e-3)
    with raises(InputError, "the scene's radiance is negative"):
        camera.mean_electrons(scene, 0.1)


@pytest.mark.parametrize("shape", [(601, 7), (600, 8), (1, 5), (3, 1)])
def test_relative_illumination_is_that_of_each_pixel(shape: tuple[int, int]) -> None:
    """A quarter of the frame is computed, in strips; the rest is its mirror image."""
    sensor = ps.load_sensor("nikon-d200").with_(rows=shape[0], cols=shape[1])
    optics = ps.DiffractionLimited(f_number=8, focal_length_mm=1, falloff="cos4")
    mosaic = np.random.default_rng(1).uniform(1, 2, shape).astype(np.float32)
    y_m, x_m = ((np.arange(n) + 0.5 - n / 2) * sensor.pixel.width_um.value * 1e-6 for n in shape)
    falloff = optics.relative_illumination(np.hypot(y_m[:, None], x_m), 1.2)
    assert falloff is not None
    expected = mosaic * falloff.astype(np.float32)
    apply_relative_illumination(mosaic, ps.Camera(optics, sensor), 1.2)
    np.testing.assert_array_equal(mosaic, expected)
