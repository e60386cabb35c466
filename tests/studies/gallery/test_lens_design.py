"""Coma that grows over the field: a few modes against each point's own spread, through the camera."""

from __future__ import annotations

import math

import numpy as np
import pytest

from photosite.studies.gallery.lens_design import (
    BASE,
    SPACING_UM,
    WAVELENGTH_NM,
    comatic_design,
    comatic_psf,
    compare_with_direct,
)


def test_on_axis_the_synthetic_lens_is_the_perfect_one() -> None:
    """The pattern's values at 5 places against (2 J1(v) / v)^2."""
    from scipy.special import j1

    psf = comatic_psf(0.0, 0.0)
    radius = np.array([1, 2, 3, 5, 8]) * SPACING_UM
    v = math.pi * radius / (WAVELENGTH_NM * 1e-3 * BASE.f_number)
    got = psf[30, [31, 32, 33, 35, 38]] / psf[30, 30]
    np.testing.assert_allclose(got, (2 * j1(v) / v) ** 2, atol=2e-3)  # a pupil of 96 squares


def test_the_tail_points_outwards_wherever_the_point_is() -> None:
    axis = np.arange(-30, 31)
    for azimuth in (0.0, 1.0, 2.5, -2.0):
        psf = comatic_psf(1.0, azimuth)
        peak = np.unravel_index(int(psf.argmax()), psf.shape)
        tail = np.array([(psf.sum(axis=1) @ axis) + 30 - peak[0], (psf.sum(axis=0) @ axis) + 30 - peak[1]])
        along = tail @ [math.sin(azimuth), math.cos(azimuth)]
        assert along > 0.9 * math.hypot(*tail) > 0.3


def test_modes_through_the_camera_meet_direct_application() -> None:
    found = compare_with_direct(48, 80, points=(2, 1), ranks=(1, 4, 12))
    assert found.of_frames[0] > 0.1  # one mode is another lens
    assert (np.diff(found.of_frames) < 0).all()
    assert found.of_frames[2] < 0.005  # what interpolation between heights and nodes leaves
    assert found.chosen < 12
    assert np.linalg.norm(found.summed - found.direct) < 0.01 * np.linalg.norm(found.direct)
    # Light is kept: what the frame's border cut is the same.
    assert found.summed.sum() == pytest.approx(found.direct.sum(), rel=1e-4)


def test_fewer_modes_do_when_pixels_blur() -> None:
    sharp, blurred = (comatic_design(0.2, nodes=9, heights=5, detail_um=detail) for detail in (None, 6.0))
    assert len(blurred.low_rank.modes) < len(sharp.low_rank.modes)
    assert blurred.low_rank.relative_error <= 0.01
    light = blurred.low_rank.modes.sum(axis=(1, 2, 3))
    np.testing.assert_allclose(blurred.low_rank.weights.T @ light, 1.0, atol=1e-12)
