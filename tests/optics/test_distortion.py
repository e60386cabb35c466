"""Distortion curves against polynomials with known roots, and invalid tables."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

from photosite.errors import InputError
from photosite.optics.distortion import RadialMapping, heights_at, image_height, inverse_scale, wavelength_nodes
from photosite.optics.illumination import VeilingGlare

REACH_M = 15e-3
PIXEL_M = 6e-6


def cubic(k: float, heights: int, colors: tuple[float, ...] = (550.0,), per_color: float = 0.0) -> RadialMapping:
    """real = ideal (1 + k (ideal / 15 mm)^2), times 1 + per_color for every further wavelength."""
    ideal = np.linspace(0.0, REACH_M, heights)
    real = ideal * (1 + k * (ideal / REACH_M) ** 2)
    return RadialMapping(np.array(colors), ideal, np.stack([real * (1 + i * per_color) for i in range(len(colors))]))


@pytest.mark.parametrize("k", [-0.08, 0.05])
def test_third_order_distortion_from_a_few_heights(k: float) -> None:
    ideal = np.linspace(0.0, REACH_M, 1001)
    got = image_height(cubic(k, 5), 550.0)(ideal)
    np.testing.assert_allclose(got, ideal * (1 + k * (ideal / REACH_M) ** 2), atol=1e-9 * REACH_M)


def test_a_fisheye_from_ten_heights() -> None:
    def real(ideal: NDArray[np.float64]) -> NDArray[np.float64]:
        u = ideal / REACH_M
        return np.asarray(REACH_M * np.arctan(u))  # 21 % at the corner, not a polynomial

    table = np.linspace(0.0, REACH_M, 11)
    fine = np.linspace(0.0, REACH_M, 1001)
    got = image_height(RadialMapping(np.array([550.0]), table, real(table)[None]), 550.0)(fine)
    assert np.abs(got - real(fine)).max() < 0.02 * PIXEL_M


def test_the_curve_increases_where_the_spline_would_fold_back() -> None:
    from photosite.optics.distortion import _odd_spline

    ideal, real = np.array([0.0, 1.0, 2.0, 3.0, 4.0]) * 1e-3, np.array([0.0, 1.0, 1.01, 1.02, 3.0]) * 1e-3
    fine = np.linspace(0, 4e-3, 1001)
    assert (np.diff(_odd_spline(ideal, real)(fine)) < 0).any()  # the spline folds back
    curve = image_height(RadialMapping(np.array([550.0]), ideal, real[None]), 550.0)
    assert (np.diff(curve(fine)) > 0).all()
    np.testing.assert_allclose(curve(ideal), real, rtol=1e-12)


@pytest.mark.parametrize("k", [-0.08, 0.05])
def test_inverse_against_the_root_of_the_cubic_equation(k: float) -> None:
    scale, step = inverse_scale(cubic(k, 21), 550.0, 13e-3)
    real = np.sqrt(step * np.arange(1, scale.size))
    assert real[-1] == pytest.approx(13e-3)
    for index in (0, 1, 17, 400, 4000, 4095):
        roots = np.roots([k / REACH_M**2, 0.0, 1.0, -real[index]])
        root = min(r.real for r in roots if abs(r.imag) < 1e-12 and r.real > 0)
        assert scale[index + 1] * real[index] == pytest.approx(root, abs=1e-3 * PIXEL_M)
    assert scale[0] == pytest.approx(1.0, abs=1e-6)


def test_the_curve_is_straight_beyond_the_last_height() -> None:
    mapping = cubic(0.05, 101)
    curve = image_height(mapping, 550.0)
    beyond = curve(np.array([15e-3, 16e-3, 18e-3]))
    assert np.diff(beyond)[1] == pytest.approx(2 * np.diff(beyond)[0], rel=1e-12)
    assert np.diff(beyond)[0] / 1e-3 == pytest.approx(1.15, abs=1e-3)
    scale, _ = inverse_scale(mapping, 550.0, 30e-3)
    assert curve(np.array([scale[-1] * 30e-3]))[0] == pytest.approx(30e-3, rel=1e-8)


def test_heights_are_linear_in_wavelength_and_constant_beyond() -> None:
    mapping = cubic(0.0, 5, (500.0, 600.0), 1e-3)
    assert heights_at(mapping, 525.0)[-1] == pytest.approx(REACH_M * (1 + 0.25e-3), rel=1e-12)
    assert heights_at(mapping, 300.0)[-1] == REACH_M
    assert heights_at(mapping, 900.0)[-1] == pytest.approx(REACH_M * (1 + 1e-3), rel=1e-15)


def test_wavelength_nodes_are_evenly_spaced_in_the_image() -> None:
    """Two pieces of different slope: 6 um from 400 to 500 nm, 1.5 um from 500 to 700 nm; steps of at most 1.5 um."""
    ideal = np.array([0.0, 10e-3])
    real = ideal * np.array([[1.0], [1.0006], [1.00075]])
    mapping = RadialMapping(np.array([400.0, 500.0, 700.0]), ideal, real)
    grid = np.arange(400.0, 701.0, 10)
    nodes, fractions = wavelength_nodes(mapping, grid, 10e-3, 1.5e-6)
    np.testing.assert_allclose(nodes, [400, 441 + 2 / 3, 483 + 1 / 3, 700], atol=1e-6)
    np.testing.assert_allclose(fractions.sum(axis=0), 1.0, atol=1e-12)
    # Four nodes reproduce any cubic of the path length.
    way = np.interp(grid, [400, 500, 700], [0.0, 6.0, 7.5])
    for power in (1, 2, 3):
        np.testing.assert_allclose(np.array([0, 2.5, 5, 7.5]) ** power @ fractions, way**power, atol=1e-9)


def test_fewer_than_four_nodes_use_linear_weights() -> None:
    """6 um, then 1.5 um, in steps of at most 4 um: three nodes."""
    real = np.array([0.0, 10e-3]) * np.array([[1.0], [1.0006], [1.00075]])
    mapping = RadialMapping(np.array([400.0, 500.0, 700.0]), np.array([0.0, 10e-3]), real)
    nodes, fractions = wavelength_nodes(mapping, np.arange(400.0, 701.0, 10), 10e-3, 4e-6)
    np.testing.assert_allclose(nodes, [400, 462.5, 700], atol=1e-6)
    np.testing.assert_allclose(fractions[:, 1], [0.84, 0.16, 0], atol=1e-9)  # 410 nm: 0.6 of 3.75 um
    np.testing.assert_allclose(fractions[:, 20], [0, 0.2, 0.8], atol=1e-9)  # 600 nm: 6.75 um


def test_wavelengths_are_nodes_if_as_many_are_needed() -> None:
    mapping = cubic(0.0, 5, (500.0, 600.0), 1e-2)
    nodes, fractions = wavelength_nodes(mapping, np.array([500.0, 550.0, 600.0]), REACH_M, 1e-6)
    assert nodes.tolist() == [500.0, 550.0, 600.0]
    assert fractions.tolist() == np.eye(3).tolist()


def test_one_wavelength_or_one_curve_needs_one_node() -> None:
    assert wavelength_nodes(cubic(0.1, 5), np.arange(400.0, 701, 10), REACH_M, 1e-6)[1].tolist() == [[1.0] * 31]
    same = cubic(0.1, 5, (500.0, 600.0), 0.0)
    assert wavelength_nodes(same, np.arange(400.0, 701, 10), REACH_M, 1e-6)[0].size == 1


@pytest.mark.parametrize(
    ("wavelength", "ideal", "real", "what"),
    [
        ([550.0], [0.0, 1.0, 2.0], [[0.0, 1.0, 0.9]], "real_m"),
        ([550.0], [0.0, 1.0, 1.0], [[0.0, 1.0, 2.0]], "ideal_m"),
        ([550.0], [0.1, 1.0, 2.0], [[0.0, 1.0, 2.0]], "ideal_m"),
        ([550.0], [0.0, 1.0], [[0.1, 1.0]], "real_m"),
        ([600.0, 500.0], [0.0, 1.0], [[0.0, 1.0], [0.0, 1.0]], "wavelength_nm"),
        ([550.0], [0.0, 1.0], [[0.0, 1.0], [0.0, 1.0]], "real_m"),
        ([550.0], [0.0], [[0.0]], "real_m"),
        ([550.0], [0.0, math.nan], [[0.0, 1.0]], "ideal_m"),
    ],
)
def test_invalid_mappings(wavelength: list[float], ideal: list[float], real: list[list[float]], what: str) -> None:
    with raises(InputError, what):
        RadialMapping(np.array(wavelength), np.array(ideal), np.array(real))


@pytest.mark.parametrize(
    ("fraction", "spread", "what"),
    [(1.0, None, "fraction"), (-0.1, None, "fraction"), (math.nan, None, "fraction"), (0.1, 0.0, "spread_m")],
)
def test_invalid_glare(fraction: float, spread: float | None, what: str) -> None:
    with raises(InputError, what):
        VeilingGlare(fraction, spread)
