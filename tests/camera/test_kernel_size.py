"""Point spreads that cover too many cells are refused, or said, before anything is computed."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import photosite as ps
from photosite.camera.channel_transfers import reduced_transfers
from photosite.camera.kernel_size import check_reach, kernel_size
from photosite.engine.transfer import Sampling
from photosite.errors import InputError, PhotositeWarning
from photosite.optics.point_spread import PlanePsf, RadialPsf

CELLS = Sampling((6e-6, 6e-6), (5e-6, 5e-6), 1, (0.0, 0.0))
WAVELENGTHS = np.array([500.0, 600.0])


def untouchable(*_: object) -> np.ndarray:
    raise AssertionError("a transfer function was computed")


@pytest.mark.parametrize(
    ("make", "reach_m", "cells"),
    [(PlanePsf, 7e-3, 2335), (RadialPsf, 60e-3, 20002)],
)
def test_too_large_spread_is_an_error_before_its_otf_is_computed(make: type, reach_m: float, cells: int) -> None:
    spread = make(untouchable, lambda _: 1e5, lambda _: reach_m)
    with pytest.raises(InputError) as caught:
        reduced_transfers(spread, np.ones((1, 1, 2)), WAVELENGTHS, CELLS)
    assert (caught.value.value, caught.value.where) == (cells, f"point spread of {2e3 * reach_m:g} mm")


def test_slow_spread_is_a_warning_before_its_otf_is_computed() -> None:
    spread = PlanePsf(untouchable, lambda _: 1e5, lambda _: 3e-3)
    with (
        pytest.warns(PhotositeWarning, match="over 1002 cells .* may take minutes"),
        pytest.raises(AssertionError, match="was computed"),
    ):
        reduced_transfers(spread, np.ones((1, 1, 2)), WAVELENGTHS, CELLS)


def test_usual_sizes_give_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert kernel_size(1e-3, CELLS) == 343  # 335.3 cells or more: 343 = 7 x 7 x 7
        assert kernel_size(1e-6, CELLS) == 75  # the first odd size from 65 on with a fast transform
        check_reach(48e-3, CELLS)


def test_absurd_wavefront_is_a_warning() -> None:
    """50 um of coma instead of 50 nm."""
    lens = ps.Lens(ps.DiffractionLimited(2.8, 50), ps.Wavefront({8: 50000}))
    reach_m = max(lens.point_spread(1.2).reach_m(w) for w in (400.0, 550.0, 700.0))
    with pytest.warns(PhotositeWarning, match="may take minutes"):
        kernel_size(reach_m, CELLS)
