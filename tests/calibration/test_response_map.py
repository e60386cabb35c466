"""The response map: which flat fields it uses, and correction for dark current and channels."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from photosite.calibration.chip_maps.response_map import ResponseMap, light_groups_in_range
from photosite.frames.frame_set import FrameSet

TILE = np.array([[0, 1], [1, 2]])


def test_responses_are_relative_to_the_channels_mean_without_dark_current() -> None:
    """Slopes of 1000, 300 and 500 DN/s with PRNU, and a dark current of up to half of them."""
    rng = np.random.default_rng(1)
    mean = np.array([1000.0, 300.0, 500.0])[np.tile(TILE, (20, 30))]
    prnu = rng.normal(0, 0.02, mean.shape)
    for k in range(3):
        chosen = np.tile(TILE, (20, 30)) == k
        prnu[chosen] -= prnu[chosen].mean()
    dark = rng.uniform(0, 150, mean.shape).astype(np.float32)
    slopes = (mean * (1 + prnu) + dark).astype(np.float32)
    of_dark = np.full(mean.shape, 4.0, np.float32)
    response = ResponseMap(slopes, np.array([9.0, 9.0, 9.0]), np.ones(3))
    value, uncertainty = response.relative(dark, of_dark, TILE)
    np.testing.assert_allclose(value, prnu, atol=2e-6)
    np.testing.assert_allclose(uncertainty, 5.0 / mean, rtol=1e-5)  # 3 and 4 DN/s


def test_dark_current_on_a_photon_axis() -> None:
    slopes = np.array([[2.0, 2.5]], np.float32)
    dark = np.array([[0.0, 100.0]], np.float32)
    response = ResponseMap(slopes, np.zeros(1), np.array([0.005]))
    value, _ = response.relative(dark, np.zeros((1, 1), np.float32), np.zeros((1, 1), np.int64))
    np.testing.assert_allclose(value, 0.0, atol=1e-7)


def channel(*used: int) -> Any:
    """Return the part of a channel that tells its linear range: which of four levels are used."""
    inside = np.isin(np.arange(4), used)
    levels = SimpleNamespace(group=np.arange(4), x=np.array([0.1, 0.2, 0.3, 0.4]), trusted=np.ones(4, np.bool_))
    return SimpleNamespace(levels=levels, used=inside)


def flats():
    dn = np.zeros((2, 2), np.uint16)
    return FrameSet.from_arrays(
        [("dark", 0.1, dn), *(("light", t, dn) for t in (0.1, 0.2, 0.3, 0.4))], bits=12, cfa=(("R", "G"), ("G", "B"))
    )


def test_flat_fields_in_any_channels_linear_range_are_used() -> None:
    needed = light_groups_in_range(flats(), [channel(0, 1, 2), channel(0, 1), channel(0, 1, 2)])
    assert [group.exposure_s for group in needed] == pytest.approx([0.1, 0.2, 0.3])


def test_no_response_if_a_channel_has_fewer_than_two_levels() -> None:
    assert light_groups_in_range(flats(), [channel(0, 1, 2), channel(0), channel(0, 1, 2)]) == ()
    assert light_groups_in_range(flats(), []) == ()
