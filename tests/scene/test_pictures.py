"""Pictures raised to spectra: integrated again they give their colours, and their reflectances can be."""

from __future__ import annotations

import numpy as np
import pytest

from photosite.develop.display import XYZ_FROM_SRGB, encode_srgb
from photosite.errors import InputError
from photosite.metrics.color_difference import delta_e_2000
from photosite.scene.pictures import PICTURE_WAVELENGTH_NM, from_srgb, linear_srgb, srgb_reflectance
from photosite.spectra import energy_from_photons, illuminant, photons_from_energy, xyz


def all_colours() -> np.ndarray:
    """(1, n, 3) 8-bit sRGB: the corners of the cube, a grid in it, and dark ones."""
    steps = np.array([0, 1, 13, 51, 102, 153, 204, 255], np.uint8)
    return np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)


def test_integrated_again_every_colour_of_srgb_is_what_it_was() -> None:
    picture = all_colours()
    scene = from_srgb(picture, "D65", 100.0)
    seen = xyz(np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), scene.basis), scene.wavelength_nm)
    white = xyz(scene.basis.sum(axis=0), scene.wavelength_nm)
    wanted = linear_srgb(picture) @ XYZ_FROM_SRGB.T
    # All of the luminance is looked at but one factor for the whole picture, which the caller sets.
    difference = delta_e_2000(seen / white[1], wanted)
    assert difference.max() < 0.03
    assert scene.mean_luminance_cd_m2() == pytest.approx(100.0, rel=1e-6)


def test_on_a_grid_of_10_nm_the_difference_is_what_the_docstring_says() -> None:
    grid = np.arange(380.0, 781.0, 10.0)
    light = photons_from_energy(illuminant("D65", grid), grid)
    red = xyz(srgb_reflectance(grid)[0] * light, grid) / xyz(light, grid)[1]
    assert delta_e_2000(red, XYZ_FROM_SRGB[:, 0]) == pytest.approx(0.62, abs=0.01)


def test_reflectances_can_be_and_white_takes_nothing_from_the_light() -> None:
    basis = srgb_reflectance()
    assert basis.min() > 0
    np.testing.assert_allclose(basis.sum(axis=0), 1.0, atol=2e-5)  # the table's own precision
    reflectance = linear_srgb(all_colours()).reshape(-1, 3) @ basis
    assert reflectance.min() >= 0
    assert reflectance.max() <= 1 + 2e-5


def test_energy_under_another_light_is_reflectance_times_that_light() -> None:
    picture = np.array([[[255, 0, 64], [17, 200, 90]]], np.uint8)
    scene = from_srgb(picture, "A", 5.0)
    reflectance = linear_srgb(picture) @ srgb_reflectance()
    lamp = illuminant("A", PICTURE_WAVELENGTH_NM)
    for col in range(2):
        energy = energy_from_photons(scene.radiance(0, col), scene.wavelength_nm)
        ratio = energy / (reflectance[0, col] * lamp)
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)
    assert scene.mean_luminance_cd_m2() == pytest.approx(5.0, rel=1e-6)


def test_decoding_undoes_the_display_s_encoding() -> None:
    linear = np.linspace(0.0, 1.0, 300).reshape(10, 10, 3)
    np.testing.assert_allclose(linear_srgb(encode_srgb(linear.astype(np.float32))), linear, atol=2e-6)


def test_integers_of_8_and_16_bits_and_floats_are_one_picture() -> None:
    codes = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    np.testing.assert_allclose(linear_srgb(codes.astype(np.uint16) * 257), linear_srgb(codes), rtol=1e-12)
    np.testing.assert_allclose(linear_srgb(codes / 255.0), linear_srgb(codes), rtol=1e-12)


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((4, 5)), r"\(rows, cols, 3\)"),
        (np.zeros((4, 5, 4), np.uint8), r"\(rows, cols, 3\)"),
        (np.zeros((0, 5, 3), np.uint8), r"\(rows, cols, 3\)"),
        (np.zeros((4, 5, 3), np.int64), "unsigned integers"),
        (np.full((4, 5, 3), 1.01), "from 0 to 1"),
        (np.full((4, 5, 3), np.nan), "from 0 to 1"),
        (np.zeros((4, 5, 3), np.uint8), "black picture"),
    ],
)
def test_pictures_that_cannot_be(picture: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        from_srgb(picture)


def test_wavelengths_beyond_the_table() -> None:
    with pytest.raises(InputError, match="from 380 to 780 nm, not from 370 to 700"):
        srgb_reflectance([370.0, 700.0])
