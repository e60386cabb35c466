"""Low-rank sums of PSFs over the field: energy, error, rotation, OTFs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import (
    FieldPsf,
    PlanePsf,
    RotatablePsf,
    encircled_radius,
    resampled,
    sample_positions,
    sampled_otf,
)

Array = NDArray[np.float64]
BASE = DiffractionLimited(f_number=4, focal_length_mm=50)
SPACING_UM = 0.5
WAVES = np.array([450.0, 550.0, 650.0])


def blob(y_um: float, x_um: float, sigma_um: float, count: int = 41, spacing_um: float = SPACING_UM) -> Array:
    axis = sample_positions(count, spacing_um)
    return np.asarray(np.exp(-((axis[:, None] - y_um) ** 2 + (axis - x_um) ** 2) / (2 * sigma_um**2)))


def comet(angle_rad: float, length_um: float, count: int = 41) -> Array:
    """A spot with a tail at an angle from right towards down."""
    tail = sum(
        blob(t * length_um * math.sin(angle_rad), t * length_um * math.cos(angle_rad), 0.8 + 0.4 * t, count)
        for t in (0.0, 0.25, 0.5, 0.75, 1.0)
    )
    return np.asarray(tail)


def design(**changes: object) -> LensDesign:
    """Outward tails that grow with height and wavelength, at points to the right of the axis."""
    height = np.linspace(0, 10, 6)
    psf = np.stack([[comet(0.0, 0.5 * h * w / 550) for w in WAVES] for h in height])
    return LensDesign(WAVES, psf, SPACING_UM, np.zeros(6), height, **changes)  # type: ignore[arg-type]


def test_every_node_has_unit_energy() -> None:
    spread = design(nodes=7).point_spread(BASE, 2.0, None)
    assert isinstance(spread, FieldPsf)
    zero = np.zeros(1)
    for wavelength in (400.0, 450.0, 512.0, 650.0):
        light = sum(w * m.otf(zero, zero, wavelength)[0] for w, m in zip(spread.weights, spread.modes, strict=True))
        np.testing.assert_allclose(light, 1.0, atol=1e-12)


@pytest.mark.parametrize("rank", [1, 2, 5])
def test_energy_is_conserved_at_any_rank_between_nodes(rank: int) -> None:
    spread = design(rank=rank, nodes=5).point_spread(BASE, 2.0, None)
    assert isinstance(spread, FieldPsf)
    assert len(spread.modes) == rank
    dc = np.array([mode.otf(np.zeros(1), np.zeros(1), 550.0)[0] for mode in spread.modes])
    middle = 0.5 * (spread.weights[:, 1, 3] + spread.weights[:, 2, 3])
    assert abs(dc @ middle - 1) < 1e-12


def test_stated_error_is_the_svd_error() -> None:
    lens = design(tolerance=0.02, nodes=7)
    exact = lens.node_psfs()
    found = lens.low_rank
    summed = np.tensordot(found.weights.T, found.modes, axes=1)
    error = np.linalg.norm(summed - exact) / np.linalg.norm(exact)
    assert error == pytest.approx(found.relative_error, rel=1e-6)
    assert error <= 0.02 < found.error_by_rank[len(found.modes) - 2]
    centered = (exact - exact.mean(axis=0)).reshape(len(exact), -1)
    values = np.linalg.svd(centered, compute_uv=False)
    for rank in (1, 3, 7):
        expected = math.sqrt((values[rank - 1 :] ** 2).sum()) / np.linalg.norm(exact)
        assert found.error_by_rank[rank - 1] == pytest.approx(expected, rel=1e-6)


def test_nodes_hold_psfs_rotated_to_their_azimuth() -> None:
    lens = design(nodes=11)
    nodes = lens.node_psfs().reshape(11, 11, 3, 41, 41)
    axis = np.linspace(-10, 10, 11)
    for row, col in ((5, 10), (0, 5), (10, 5), (2, 8), (9, 1), (5, 5), (6, 4)):
        y, x = axis[row], axis[col]
        h, angle = math.hypot(y, x), math.atan2(y, x)
        low = min(math.floor(h / 2), 5)
        fraction = min(h / 2, 5) - low
        direct = (1 - fraction) * np.stack([_unit(comet(angle, low * w / 550)) for w in WAVES])
        direct += fraction * np.stack([_unit(comet(angle, min(low + 1, 5) * w / 550)) for w in WAVES])
        # Truncation of the 5.9 um tail by the 20 um square, and the spline error.
        np.testing.assert_allclose(nodes[row, col], direct, atol=8e-4 * direct.max())


def _unit(samples: Array) -> Array:
    return samples / samples.sum()


@pytest.mark.parametrize("count", [40, 41])
def test_rotation_within_the_spline_error(count: int) -> None:
    turned = RotatablePsf(blob(1.5, 4.0, 1.2, count))
    for angle in (0.0, 0.3, math.pi / 2, 2.0, -math.pi, 5.0):
        y, x = math.sin(angle) * 4 + math.cos(angle) * 1.5, math.cos(angle) * 4 - math.sin(angle) * 1.5
        np.testing.assert_allclose(turned.rotated(angle), blob(y, x, 1.2, count), atol=3e-5)


def test_a_critically_sampled_airy_pattern_can_be_rotated() -> None:
    """Sampled at half a period of its cutoff, as FFT PSFs are; rotation leaves it unchanged."""
    from scipy.special import j1

    axis = sample_positions(63, 0.5)
    r = math.pi * np.maximum(np.hypot(axis[:, None], axis), 1e-9)
    airy = (2 * j1(r) / r) ** 2
    got = RotatablePsf(airy).rotated(0.6)
    inside = np.hypot(axis[:, None], axis) < 10
    assert np.abs(got / got.sum() - airy / airy.sum())[inside].max() < 2e-3 * airy.max() / airy.sum()


def test_otf_of_a_gaussian_is_a_gaussian() -> None:
    sigma = 1.2e-6
    samples = blob(1.0, -2.0, 1.2)
    fy, fx = np.linspace(-3e5, 3e5, 9)[:, None], np.linspace(-2e5, 4e5, 7)[None, :]
    expected = np.exp(-2 * (math.pi * sigma) ** 2 * (fy**2 + fx**2) - 2j * math.pi * (fy * 1e-6 - fx * 2e-6))
    got = sampled_otf(samples / samples.sum(), SPACING_UM * 1e-6, fy, fx)
    np.testing.assert_allclose(got, expected, atol=1e-9)
    flat = sampled_otf(samples / samples.sum(), SPACING_UM * 1e-6, *np.broadcast_arrays(fy, fx))
    np.testing.assert_allclose(flat, got, atol=1e-12)
    beyond = sampled_otf(samples, SPACING_UM * 1e-6, np.array([1.01e6]), np.zeros(1))
    assert beyond[0] == 0  # half the sampling frequency is 1e6 / m


def test_resampling_a_band_limited_psf_is_exact() -> None:
    coarse = blob(0.7, -1.1, 1.2, 44, 0.6)
    fine = resampled(coarse, (22, 22), 0.6, 91, 0.25)
    np.testing.assert_allclose(fine / fine.sum(), _unit(blob(0.7, -1.1, 1.2, 91, 0.25)), atol=1e-7)
    assert fine.sum() == pytest.approx(coarse.sum(), rel=1e-6)
    moved = resampled(coarse, (20, 23), 0.6, 91, 0.25)
    np.testing.assert_allclose(_unit(moved), _unit(blob(0.7 + 1.2, -1.1 - 0.6, 1.2, 91, 0.25)), atol=1e-7)


def test_encircled_radius_of_a_gaussian() -> None:
    radius = encircled_radius(blob(0, 0, 2.0, 81, 0.25), 0.25, 0.995)
    assert radius == pytest.approx(2.0 * math.sqrt(-2 * math.log(0.005)), abs=0.25)


def test_a_grid_need_not_be_symmetric_nor_sorted() -> None:
    y, x = (a.ravel() for a in np.meshgrid([3.0, -3.0, 0.0], [-5.0, 5.0], indexing="ij"))
    psf = np.stack([[blob(0, 0, 1 + 0.1 * k)] for k in range(6)])
    lens = LensDesign(np.array([550.0]), psf, SPACING_UM, y, x, symmetric=False, rank=6)
    spread = lens.point_spread(BASE, 2.0, None)
    assert isinstance(spread, FieldPsf)
    np.testing.assert_allclose(spread.y_m, [-3e-3, 0, 3e-3], rtol=1e-15)
    np.testing.assert_allclose(spread.x_m, [-5e-3, 5e-3], rtol=1e-15)
    f = np.array([2e5])
    for k in range(6):
        p, q = int(np.searchsorted([-3, 0, 3], y[k])), int(np.searchsorted([-5, 5], x[k]))
        got = sum(w[p, q] * m.otf(f, 0 * f, 550.0)[0] for w, m in zip(spread.weights, spread.modes, strict=True))
        assert got == pytest.approx(math.exp(-2 * (math.pi * (1 + 0.1 * k) * 0.2) ** 2), abs=1e-9)


def test_field_angles_become_heights_at_the_image_distance() -> None:
    lens = design(unit="deg", nodes=3)
    near, far = lens.point_spread(BASE, 0.2, None), lens.point_spread(BASE, math.inf, None)
    assert isinstance(near, FieldPsf)
    assert isinstance(far, FieldPsf)
    assert far.x_m[-1] == pytest.approx(0.05 * math.tan(math.radians(10)), rel=1e-12)
    assert near.x_m[-1] == pytest.approx(far.x_m[-1] * (1 + BASE.magnification(0.2)), rel=1e-12)


def test_one_field_point_gives_a_plane_psf() -> None:
    lens = LensDesign(np.array([550.0]), blob(0, 0, 1.2)[None, None], SPACING_UM, np.zeros(1), np.zeros(1))
    spread = lens.point_spread(BASE, 2.0, None)
    assert isinstance(spread, PlanePsf)
    assert spread.otf(np.zeros(1), np.array([1e5]), 700.0)[0] == pytest.approx(
        math.exp(-2 * (math.pi * 0.12) ** 2), abs=1e-9
    )


def test_psf_is_linear_between_wavelengths_with_the_diffraction_cutoff() -> None:
    spread = design(rank=2, nodes=3).point_spread(BASE, math.inf, None)
    assert isinstance(spread, FieldPsf)
    mode = spread.modes[0]
    f = np.array([1.5e5])
    a, b, middle = (mode.otf(0 * f, f, w)[0] for w in (450.0, 550.0, 475.0))
    assert middle == pytest.approx(0.75 * a + 0.25 * b, abs=1e-14)
    assert mode.cutoff_per_m(550.0) == pytest.approx(1.25 / (550e-9 * 4))
    fine = LensDesign(np.array([550.0]), blob(0, 0, 0.1, 41)[None, None], SPACING_UM, np.zeros(1), np.zeros(1))
    assert fine.point_spread(BASE, math.inf, None).cutoff_per_m(550.0) == pytest.approx(math.sqrt(0.5) / 0.5e-6)  # type: ignore[union-attr]


def test_objects_out_of_focus_are_rejected() -> None:
    lens = design(nodes=3)
    assert isinstance(lens.point_spread(BASE, 2.0, 2.0), FieldPsf)
    assert isinstance(lens.point_spread(BASE, 2.01, 2.0), FieldPsf)  # 0.1 waves
    with raises(InputError, "distance_m"):
        lens.point_spread(BASE, 3.0, 2.0)


PSF = np.ones((2, 1, 5, 5))
WAVE = np.array([550.0])
TWO = np.array([0.0, 5.0])


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: LensDesign(WAVE, PSF[0], 0.5, TWO, TWO), "psf"),
        (lambda: LensDesign(WAVE, PSF, 0.5, TWO, TWO[:1]), "psf"),
        (lambda: LensDesign(WAVE, PSF, 0.0, 0 * TWO, TWO), "spacing_um"),
        (lambda: LensDesign(WAVE, -PSF, 0.5, 0 * TWO, TWO), "psf"),
        (lambda: LensDesign(WAVE, PSF * math.nan, 0.5, 0 * TWO, TWO), "psf"),
        (lambda: LensDesign(WAVE, PSF - 1.5 * np.eye(5), 0.5, 0 * TWO, TWO), "psf"),
        (lambda: LensDesign(WAVE, PSF, 0.5, TWO, -TWO, unit="deg", symmetric=False), "2 field points on 2 rows"),
        (lambda: LensDesign(WAVE, PSF, 0.5, TWO + 1, np.array([3.0, 0.0])), "field points of a symmetric lens"),
        (lambda: LensDesign(WAVE, PSF, 0.5, 0 * TWO, 0 * TWO), "field points of a symmetric lens"),
        (lambda: LensDesign(WAVE, PSF, 0.5, 0 * TWO, TWO, tolerance=0), "tolerance"),
        (lambda: LensDesign(WAVE, PSF, 0.5, 0 * TWO, TWO, rank=82), "rank"),
        (lambda: LensDesign(WAVE, PSF, 0.5, 0 * TWO, 20 * TWO, unit="deg"), "field_x"),
        (lambda: LensDesign(WAVE, PSF, 0.5, 0 * TWO, TWO, nodes=2), "nodes"),
    ],
)
def test_invalid_designs(make: Callable[[], object], what: str) -> None:
    with raises(InputError, what):
        make()
