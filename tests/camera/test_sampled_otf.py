"""Sampling of transfer functions: limits of the spread, and refinement of a table that oscillates between nodes."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.special import j1

import photosite as ps
from photosite.camera.sampled_otf import FREQUENCY_NODES, kernel_size, refined, sample_otf
from photosite.engine.transfer import RadialTransfer, Sampling
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.point_spread import PlanePsf, RadialPsf

CELLS = Sampling((6e-6, 6e-6), (5e-6, 5e-6), 1, (0.0, 0.0))
WAVELENGTHS = np.array([500.0, 600.0])


def untouchable(*_: object) -> np.ndarray:
    raise AssertionError("a transfer function was computed")


@pytest.mark.parametrize(("make", "reach_m", "cells"), [(PlanePsf, 7e-3, 2335), (RadialPsf, 60e-3, 20002)])
def test_too_large_spread_is_an_error_before_its_otf_is_computed(make: type, reach_m: float, cells: int) -> None:
    spread = make(untouchable, lambda _: 1e5, lambda _: reach_m)
    with pytest.raises(InputError) as caught:
        sample_otf(spread, WAVELENGTHS, CELLS)
    assert (caught.value.value, caught.value.where) == (cells, f"point spread of {2e3 * reach_m:g} mm")


def test_slow_spread_is_a_warning_before_its_otf_is_computed() -> None:
    spread = PlanePsf(untouchable, lambda _: 1e5, lambda _: 3e-3)
    with (
        pytest.warns(PhotositeWarning, match="over 1002 cells .* may take minutes"),
        pytest.raises(AssertionError, match="was computed"),
    ):
        sample_otf(spread, WAVELENGTHS, CELLS)


def test_usual_sizes_give_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert kernel_size(1e-3, CELLS) == 343  # 335.3 cells or more: 343 = 7 x 7 x 7
        assert kernel_size(1e-6, CELLS) == 75  # the first odd size from 65 on with a fast transform
        sample_otf(RadialPsf(lambda f, _: np.zeros_like(f), lambda _: 1e5, lambda _: 48e-3), WAVELENGTHS, CELLS)


def test_absurd_wavefront_is_a_warning() -> None:
    """50 um of coma instead of 50 nm."""
    lens = ps.Lens(ps.DiffractionLimited(2.8, 50), ps.optics.Wavefront({8: 50000}))
    reach_m = max(lens.point_spread(1.2).reach_m(w) for w in (400.0, 550.0, 700.0))
    with pytest.warns(PhotositeWarning, match="may take minutes"):
        kernel_size(reach_m, CELLS)


def disc(frequency_per_m: np.ndarray, radius_m: float) -> np.ndarray:
    u = 2 * np.pi * radius_m * frequency_per_m
    return np.divide(2 * j1(u), u, out=np.ones_like(u), where=u > 0)


@pytest.mark.parametrize(("radius_m", "limit"), [(100e-6, 1.1e-5), (260e-6, 6e-5)])
def test_wide_disc_is_accurate_between_nodes(radius_m: float, limit: float) -> None:
    """Discs of 17 and 43 pixels radius of 6 um, cutoff 900 cycles/mm: lines between 4097 nodes err by 6e-4 and 4e-3."""
    nodes = np.linspace(0.0, 9e5, FREQUENCY_NODES)
    fine = refined(RadialTransfer(disc(nodes, radius_m)[None, None], float(nodes[1])))
    at = np.linspace(0.0, 1e5, 100_003)
    found = np.interp(at / fine.step_per_m, np.arange(fine.table.shape[2]), fine.table[0, 0])
    assert np.abs(found - disc(at, radius_m)).max() < limit


def test_diffraction_needs_no_refinement() -> None:
    lens = DiffractionLimited(f_number=8, focal_length_mm=50)
    nodes = np.linspace(0.0, lens.cutoff_per_m(550.0, 1.2), FREQUENCY_NODES)
    table = lens.otf(nodes, 550.0, 1.2)[None, None]
    assert refined(RadialTransfer(table, float(nodes[1]))).table is table
