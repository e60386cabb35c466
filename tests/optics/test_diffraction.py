"""The diffraction-limited lens against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from raising import raises
from scipy.special import j1

from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.optics.diffraction import DiffractionLimited

LENS = DiffractionLimited(f_number=2.8, focal_length_mm=4.88)


@pytest.mark.parametrize(("f_number", "wavelength_nm"), [(2.8, 550.0), (8.0, 450.0)])
def test_otf_is_the_transform_of_the_airy_pattern(f_number: float, wavelength_nm: float) -> None:
    """Cosine transform of the line spread function of (2 J1(v) / v)^2, by quadrature, within 1e-4."""
    lens = DiffractionLimited(f_number=f_number, focal_length_mm=50)
    scale_m = wavelength_nm * 1e-9 * lens.working_f_number(math.inf)
    radius = np.linspace(0, 400, 400_001)[1:] * scale_m
    v = math.pi * radius / scale_m
    airy = (2 * j1(v) / v) ** 2 * (math.pi / 4) / scale_m**2  # unit volume
    from scipy.special import j0

    for fraction in (0.1, 0.35, 0.8):
        frequency = fraction / scale_m
        hankel = 2 * math.pi * np.trapezoid(airy * j0(2 * math.pi * frequency * radius) * radius, radius)
        otf = lens.otf(np.array([frequency]), wavelength_nm, math.inf)[0]
        # The pattern is truncated at 400 lambda N, where 2 / (400 pi^2) = 5e-4 of the energy is missing at f = 0; away
        # from 0 the oscillating tail contributes far less.
        assert hankel == pytest.approx(otf, abs=1e-4)


def test_otf_is_one_at_zero_and_zero_beyond_the_cutoff() -> None:
    cutoff = LENS.cutoff_per_m(500.0, 1.2)
    assert LENS.otf(np.array([0.0, cutoff, 2 * cutoff]), 500.0, 1.2) == pytest.approx([1, 0, 0], abs=1e-15)
    assert cutoff == pytest.approx(1 / (500e-9 * 2.8 * (1 + 4.88e-3 / (1.2 - 4.88e-3))), rel=1e-12)


def test_irradiance_of_a_distant_scene_is_that_of_a_disc() -> None:
    """E = pi L sin^2 of the half angle, tan = 1 / 2N."""
    half_angle = math.atan(1 / (2 * 2.8))
    got = LENS.irradiance_per_radiance(np.array([500.0]), math.inf)[0]
    assert got == pytest.approx(math.pi * math.sin(half_angle) ** 2, rel=1e-12)


def test_transmittance_by_number_and_by_wavelength() -> None:
    grid = np.array([400.0, 500.0])
    clear = LENS.irradiance_per_radiance(grid, 1.2)
    half = DiffractionLimited(2.8, 4.88, transmittance=0.5).irradiance_per_radiance(grid, 1.2)
    glass = DiffractionLimited(2.8, 4.88, transmittance=Spectrum(grid, np.array([0.2, 0.8])))
    assert half == pytest.approx(clear / 2)
    assert glass.irradiance_per_radiance(grid, 1.2) == pytest.approx(clear * [0.2, 0.8])


def test_cos4() -> None:
    lens = DiffractionLimited(8, 50, falloff="cos4")
    height = np.array([0.0, 50e-3 * math.tan(math.radians(20))])
    assert lens.relative_illumination(height, math.inf) == pytest.approx([1, math.cos(math.radians(20)) ** 4])
    assert LENS.relative_illumination(height, 1.2) is None


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"f_number": 0}, "f_number"),
        ({"focal_length_mm": -5}, "focal_length_mm"),
        ({"transmittance": 1.2}, "transmittance"),
        ({"falloff": "cos3"}, "falloff"),
    ],
)
def test_invalid_lenses(change: dict[str, float], what: str) -> None:
    with raises(InputError, what):
        DiffractionLimited(**{"f_number": 8, "focal_length_mm": 50, **change})


def test_objects_within_the_focal_length_have_no_image() -> None:
    with raises(InputError, "distance_m"):
        LENS.magnification(0.004)
