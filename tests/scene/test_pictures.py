"""Pictures as spectra: they keep their colors, and their reflectances are valid."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import XYZ_FROM_SRGB, delta_e_2000, encode_srgb, luminance_cd_m2, xyz
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import energy_from_photons, photons_from_energy
from photosite.errors import InputError
from photosite.scene.picture_colors import SPACES, display_values, linear_srgb_of
from photosite.scene.pictures import PICTURE_WAVELENGTH_NM, Method, from_hdr, from_rgb, srgb_reflectance
from photosite.scene.scene import Scene


def all_colors() -> np.ndarray:
    """(1, n, 3) 8-bit sRGB: the corners of the cube, a grid in it, and dark ones."""
    steps = np.array([0, 1, 13, 51, 102, 153, 204, 255], np.uint8)
    return np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)


CHECKER = np.array(
    [
        *[(115, 82, 68), (194, 150, 130), (98, 122, 157), (87, 108, 67), (133, 128, 177), (103, 189, 170)],
        *[(214, 126, 44), (80, 91, 166), (193, 90, 99), (94, 60, 108), (157, 188, 64), (224, 163, 46)],
        *[(56, 61, 150), (70, 148, 73), (175, 54, 60), (231, 199, 31), (187, 86, 149), (8, 133, 161)],
        *[(243, 243, 242), (200, 200, 200), (160, 160, 160), (122, 122, 121), (85, 85, 85), (52, 52, 52)],
    ],
    np.uint8,
)[None]
"""The ColorChecker in 8-bit sRGB, as published by X-Rite."""


def even_grid() -> np.ndarray:
    """(1, 729, 3): nine even steps of each of sRGB's values."""
    steps = np.linspace(0.0, 1.0, 9)
    return np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)


def linear_srgb(picture: np.ndarray) -> np.ndarray:
    return linear_srgb_of(display_values(picture), "sRGB", linear=False)


def differences(scene: Scene, linear: np.ndarray) -> np.ndarray:
    """CIEDE2000 of a scene's colors from linear sRGB; one factor for the whole picture is the caller's luminance."""
    seen = xyz(np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), scene.basis), scene.wavelength_nm)
    wanted = linear @ XYZ_FROM_SRGB.T
    return delta_e_2000(seen * wanted[..., 1].mean() / seen[..., 1].mean(), wanted)


@pytest.mark.parametrize("method", ["mallett-yuksel", "jakob-hanika"])
@pytest.mark.parametrize("picture", [CHECKER, even_grid(), all_colors()], ids=["checker", "grid", "dark too"])
def test_both_methods_keep_the_colors(method: Method, picture: np.ndarray) -> None:
    scene = from_rgb(picture, "D65", 100.0, method=method)
    assert differences(scene, linear_srgb(picture)).max() < 0.03
    assert scene.mean_luminance_cd_m2() == pytest.approx(100.0, rel=1e-6)


def test_smooth_reflectances_are_valid_and_within_the_tolerance() -> None:
    picture = even_grid()
    finest = from_rgb(picture, method="jakob-hanika", tolerance=1e-6)
    assert finest.reflectance is not None
    truth = np.einsum("kij,kl->ijl", finest.weights.astype(np.float64), finest.reflectance)
    assert truth.min() > -1e-5  # by the reduction: the sigmoids are above 0 (tests of sigmoid)
    assert truth.max() < 1 + 1e-5
    for tolerance in (1e-2, 1e-3):
        scene = from_rgb(picture, method="jakob-hanika", tolerance=tolerance)
        assert scene.reflectance is not None
        again = np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), scene.reflectance)
        error = np.sqrt(((again - truth) ** 2).mean() / (truth**2).mean())
        assert error < tolerance
        assert scene.relative_error == pytest.approx(error, rel=1e-2)
        assert len(scene.basis) < len(finest.basis)
        assert differences(scene, linear_srgb(picture)).max() < 0.03  # colors are not affected


def some_colors(count: int = 400) -> np.ndarray:
    """(1, n, 3): random ones, and the corners of sRGB."""
    drawn = np.random.default_rng(29).integers(0, 256, (count, 3))
    corners = np.stack(np.meshgrid(*[[0, 255]] * 3), axis=-1).reshape(-1, 3)
    return np.concatenate([drawn, corners]).astype(np.uint8)[None]


def differences_at_1_nm(scene: Scene, picture: np.ndarray) -> np.ndarray:
    """CIEDE2000 by colour-science's own tables, reflectances in straight lines between the scene's wavelengths."""
    import colour

    shape = colour.SpectralShape(380, 780, 1)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    light = colour.SDS_ILLUMINANTS["D65"].copy().align(shape).values
    assert scene.reflectance is not None
    basis = np.stack([np.interp(shape.range(), scene.wavelength_nm, row) for row in scene.reflectance])
    seen = np.einsum("kij,kl->ijl", scene.weights.astype(np.float64), basis * light @ observer)
    return delta_e_2000(seen / (light @ observer[:, 1]), linear_srgb(picture) @ XYZ_FROM_SRGB.T)


@pytest.mark.parametrize(
    ("method", "fine", "interpolated"), [("mallett-yuksel", 0.08, 0.08), ("jakob-hanika", 0.04, 0.17)]
)
def test_color_differences_at_1_nm_agree_with_the_docs(method: Method, fine: float, interpolated: float) -> None:
    picture = some_colors()
    scene = from_rgb(picture, method=method, wavelength_nm=np.arange(380.0, 781.0))
    assert 0.5 * fine < differences_at_1_nm(scene, picture).max() < fine
    assert 0.5 * interpolated < differences_at_1_nm(from_rgb(picture, method=method), picture).max() < interpolated


def test_range_of_reduced_reflectances_agrees_with_the_docs() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (40, 60, 3)).astype(np.uint8)
    for tolerance, beyond in ((1e-3, 0.04), (1e-2, 0.14)):
        scene = from_rgb(picture, method="jakob-hanika", tolerance=tolerance)
        assert scene.reflectance is not None
        values = np.einsum("kij,kl->ijl", scene.weights, scene.reflectance)
        assert -beyond < values.min() < 0
        assert 1 < values.max() < 1 + beyond


def test_the_error_weights_colors_by_their_frequency() -> None:
    """One rare color beside a thousand of another: the error is that of the whole picture."""
    picture = np.concatenate([np.tile(CHECKER[:, :1], (1, 1000, 1)), CHECKER], axis=1)
    truth, scene = (from_rgb(picture, method="jakob-hanika", tolerance=t) for t in (1e-6, 3e-2))
    assert truth.reflectance is not None
    assert scene.reflectance is not None
    off = np.einsum("kij,kl->ijl", scene.weights, scene.reflectance)
    off -= (whole := np.einsum("kij,kl->ijl", truth.weights, truth.reflectance))
    assert scene.relative_error == pytest.approx(np.sqrt((off**2).mean() / (whole**2).mean()), rel=1e-2)


def test_linear_values_are_light() -> None:
    linear = linear_srgb(CHECKER)
    as_light, as_codes = from_rgb(linear, linear=True), from_rgb(CHECKER)
    np.testing.assert_allclose(as_light.weights, as_codes.weights, atol=1e-7)


@pytest.mark.parametrize("space", ["Display P3", "Adobe RGB", "BT.2020", "ProPhoto RGB"])
def test_other_spaces_by_way_of_their_own_matrices(space: str) -> None:
    """Colors of sRGB, encoded in the space by colour-science, are the scene that sRGB gives."""
    import colour

    wide = colour.RGB_to_RGB(
        linear_srgb(CHECKER), "sRGB", SPACES[space], chromatic_adaptation_transform="Bradford", apply_cctf_encoding=True
    )
    plain, found = from_rgb(CHECKER), from_rgb(wide, space=space)
    np.testing.assert_allclose(found.weights, plain.weights, atol=6e-4)  # rounded matrices


def test_white_is_white_in_every_space() -> None:
    for space in SPACES:
        assert linear_srgb_of(np.ones((1, 1, 3)), space, linear=False) == pytest.approx(np.ones((1, 1, 3)), abs=1e-7)
        from_rgb(np.full((2, 2, 3), 255, np.uint8), space=space)


def test_colors_outside_srgb() -> None:
    picture = np.array([[[0.0, 1.0, 0.0], [0.5, 0.5, 0.5], [0.6, 0.3, 0.3], [0.1, 0.75, 0.1]]])
    both = {"out_of_gamut": "clip", "method": "jakob-hanika"}
    with raises(InputError, "2 of 4 pixels", arguments=both):
        from_rgb(picture, space="Display P3")
    clipped = from_rgb(picture, space="Display P3", out_of_gamut="clip")
    assert clipped.weights.min() == 0.0
    assert clipped.weights.max() <= 1.0
    # One that a surface can have is raised unchanged by the smooth method.
    scene = from_rgb(picture[:, 1:], space="Display P3", method="jakob-hanika")
    linear = linear_srgb_of(picture[:, 1:], "Display P3", linear=False)
    assert linear.min() < -0.01
    assert differences(scene, linear).max() < 0.1
    with raises(InputError, "1 colors are brighter"):
        from_rgb(picture, space="BT.2020", method="jakob-hanika")


def test_rounding_outside_0_to_1_is_accepted() -> None:
    """By 1e-6; by more if they are to be clipped, linear or encoded."""
    picture = np.full((2, 3, 3), 0.5)
    picture[0, 0], picture[1, 1] = 1.0000001, -0.0000001
    assert from_rgb(picture).weights[:, 0, 0] == pytest.approx(1.0)
    picture[0, 0], picture[1, 1] = 1.3, -0.2
    for linear in (False, True):
        scene = from_rgb(picture, linear=linear, out_of_gamut="clip")
        np.testing.assert_array_equal(scene.weights, from_rgb(np.clip(picture, 0, 1), linear=linear).weights)


def test_light_outside_srgb_is_clipped_on_request() -> None:
    picture = np.full((2, 3, 3), 7.0)
    picture[1, 2] = 5.0, -0.5, 2.0
    with pytest.raises(InputError, match="1 of 6 pixels have colors outside sRGB") as caught:
        from_hdr(picture, 1.0)
    assert caught.value.arguments == {"out_of_gamut": "clip"}
    clipped = from_hdr(picture, 1.0, out_of_gamut="clip")
    np.testing.assert_array_equal(clipped.weights, np.moveaxis(np.clip(picture, 0, None), 2, 0))


def test_light_keeps_its_range_and_white_its_luminance() -> None:
    """Six decades and more, to float32's rounding."""
    levels = 10.0 ** np.linspace(-4, 6, 41)
    picture = np.stack([levels, levels, levels], axis=-1)[None]
    scene = from_hdr(picture, 80.0)
    seen = luminance_cd_m2(scene.weights[:, 0].T.astype(np.float64) @ scene.basis, scene.wavelength_nm)
    np.testing.assert_allclose(seen, 80.0 * levels, rtol=1e-6)
    assert scene.reflectance is None
    by_mean = from_hdr(picture, mean_luminance_cd_m2=5.0)
    assert by_mean.mean_luminance_cd_m2() == pytest.approx(5.0, rel=1e-6)


def test_light_has_its_colors() -> None:
    linear = linear_srgb(CHECKER) * 1e4
    assert differences(from_hdr(linear, 1.0), linear / 1e4).max() < 0.03


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (lambda: from_hdr(np.ones((2, 2, 3))), "a picture of light needs one luminance"),
        (lambda: from_hdr(np.ones((2, 2, 3)), 1.0, mean_luminance_cd_m2=2.0), "a picture of light needs one luminance"),
        (lambda: from_hdr(np.ones((2, 2, 3), np.uint8), 1.0), "picture"),
        (lambda: from_hdr(-np.ones((2, 2, 3)), 1.0), "4 of 4 pixels"),
        (lambda: from_hdr(-np.ones((2, 2, 3)), 1.0, out_of_gamut="clip"), "a black picture"),
        (lambda: from_hdr(np.full((2, 2, 3), np.inf), 1.0), "picture"),
        (lambda: from_hdr(np.zeros((2, 2, 3)), 1.0), "a black picture"),
        (lambda: from_hdr(np.full((2, 2, 3), 1e39), 1.0), "picture"),
        (lambda: from_hdr(np.ones((2, 2, 3)), -1.0), "white_luminance_cd_m2"),
        (lambda: from_hdr(np.eye(3)[None], 1.0, space="Display P3"), "2 of 3 pixels"),
        (lambda: from_rgb(np.ones((2, 2, 3)), space="sRGBB"), "space"),
        (lambda: from_rgb(np.ones((2, 2, 3)), space=None), "space"),  # type: ignore[arg-type]
        (lambda: from_rgb(np.full((2, 2, 3), np.inf), out_of_gamut="clip"), "picture"),
        (lambda: from_rgb(np.full((2, 2, 3), 1.5)), "picture"),
        (lambda: from_rgb(np.ones((2, 2, 3)), method="jakob-hanica"), "method"),
        (lambda: from_rgb(np.ones((2, 2, 3)), out_of_gamut="cut"), "out_of_gamut"),
        (lambda: from_rgb(np.ones((2, 2, 3)), method="jakob-hanika", tolerance=0), "tolerance"),
        (lambda: from_rgb(np.ones((2, 2, 3)), method="jakob-hanika", wavelength_nm=[300, 500]), "wavelength_nm"),
    ],
)
def test_invalid_arguments(call: object, what: str) -> None:
    with raises(InputError, what):
        call()  # type: ignore[operator]


def test_difference_on_a_10_nm_grid_agrees_with_the_docstring() -> None:
    grid = np.arange(380.0, 781.0, 10.0)
    light = photons_from_energy(illuminant("D65", grid), grid)
    red = xyz(srgb_reflectance(grid)[0] * light, grid) / xyz(light, grid)[1]
    assert delta_e_2000(red, XYZ_FROM_SRGB[:, 0]) == pytest.approx(0.62, abs=0.01)


def test_reflectances_are_valid_and_white_reflects_all_light() -> None:
    basis = srgb_reflectance()
    assert basis.min() > 0
    np.testing.assert_allclose(basis.sum(axis=0), 1.0, atol=2e-5)  # the table's own precision
    reflectance = linear_srgb(all_colors()).reshape(-1, 3) @ basis
    assert reflectance.min() >= 0
    assert reflectance.max() <= 1 + 2e-5


def test_energy_under_another_light_is_reflectance_times_that_light() -> None:
    picture = np.array([[[255, 0, 64], [17, 200, 90]]], np.uint8)
    scene = from_rgb(picture, "A", 5.0)
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
    ("picture", "what"),
    [
        (np.zeros((4, 5)), "picture"),
        (np.zeros((4, 5, 4), np.uint8), "picture"),
        (np.zeros((0, 5, 3), np.uint8), "picture"),
        (np.zeros((4, 5, 3), np.int64), "picture"),
        (np.full((4, 5, 3), 1.01), "picture"),
        (np.full((4, 5, 3), np.nan), "picture"),
        (np.zeros((4, 5, 3), np.uint8), "a black picture"),
    ],
)
def test_invalid_pictures(picture: np.ndarray, what: str) -> None:
    with raises(InputError, what):
        from_rgb(picture)


def test_wavelengths_outside_the_table() -> None:
    with raises(InputError, "wavelength_nm", value=(370.0, 700.0)):
        srgb_reflectance([370.0, 700.0])
