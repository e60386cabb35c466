"""Smooth reflectances from colors: against colour-science's own Jakob and Hanika."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import XYZ_FROM_SRGB, color_matching_functions, colour_science
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import integration_weights
from photosite.errors import InputError
from photosite.scene.sigmoid import sigmoid_coefficients, sigmoid_reflectance

GRID = np.arange(380.0, 781.0, 5.0)


def weights() -> np.ndarray:
    values = color_matching_functions(GRID) * integration_weights(GRID) * illuminant("D65", GRID)
    return values / values[1].sum()


def test_the_sigmoid_is_that_of_the_paper() -> None:
    """colour-science evaluates c0 w^2 + c1 w + c2 on wavelengths w in nm; ours is that parabola in (w - 570) / 210."""
    from colour.recovery import sd_Jakob2019

    ours = np.array([3.1, -2.2, 0.7])
    scale, shift = 1 / 210, -570 / 210
    theirs = [
        ours[0] * scale**2,
        2 * ours[0] * scale * shift + ours[1] * scale,
        ours[0] * shift**2 + ours[1] * shift + ours[2],
    ]
    shape = colour_science().SpectralShape(380, 780, 5)
    expected = sd_Jakob2019(np.array(theirs), shape).values
    np.testing.assert_allclose(sigmoid_reflectance(ours, GRID), expected, atol=1e-12)


def test_coefficients_of_known_reflectances_are_found() -> None:
    """Three coefficients follow from three tristimulus values."""
    rng = np.random.default_rng(4)
    true = rng.normal(0.0, [4.0, 2.0, 1.0], (200, 3))
    reflectance = sigmoid_reflectance(true, GRID)
    found = sigmoid_reflectance(sigmoid_coefficients(reflectance @ weights().T, weights(), GRID), GRID)
    assert (
        np.abs((found - reflectance) @ weights().T).max() < 1.2e-5
    )  # the fraction of gray, 1e-5, and the solver's 1e-6
    assert np.quantile(np.abs(found - reflectance).max(axis=1), 0.9) < 1e-2


@pytest.mark.parametrize("rgb", [(0.2, 0.4, 0.1), (0.6, 0.3, 0.3), (0.05, 0.1, 0.3)])
def test_reflectances_are_those_that_colour_science_finds(rgb: tuple[float, ...]) -> None:
    """Its optimizer stops at an invisible color difference, so its spectra differ slightly."""
    colour = colour_science()
    from colour.recovery import XYZ_to_sd_Jakob2019

    tristimulus = XYZ_FROM_SRGB @ np.array(rgb)
    theirs = XYZ_to_sd_Jakob2019(tristimulus).align(colour.SpectralShape(380, 780, 5)).values
    ours = sigmoid_reflectance(sigmoid_coefficients(tristimulus[None], weights(), GRID), GRID)[0]
    assert np.abs(ours - theirs).max() < 0.01


def test_every_srgb_color_has_a_valid_reflectance() -> None:
    steps = np.linspace(0.0, 1.0, 9) ** 2.2
    linear = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    wanted = linear @ XYZ_FROM_SRGB.T * (weights().sum(axis=1) / XYZ_FROM_SRGB.sum(axis=1))
    reflectance = sigmoid_reflectance(sigmoid_coefficients(wanted, weights(), GRID), GRID)
    assert reflectance.min() >= 0
    assert reflectance.max() <= 1
    assert np.abs(reflectance @ weights().T - wanted).max() < 1.2e-5
    bends = np.diff(np.sign(np.diff(reflectance, axis=1)), axis=1) != 0
    assert (bends[:, 1:-1].sum(axis=1) <= 1).all()  # one maximum or minimum


def test_colors_that_no_surface_has() -> None:
    with raises(InputError, "1 colors are brighter"):
        sigmoid_coefficients([[0.2, 0.2, 0.2], [0.9, 0.1, 0.0]], weights(), GRID)
