"""OpenEXR: pictures of red, green and blue as spectra."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from raising import raises

import photosite as ps
from photosite.color.colorimetry import luminance_cd_m2, xyz
from photosite.errors import FileError
from photosite.scene.io.formats import read_scene
from photosite.scene.scene import Scene

OpenEXR = pytest.importorskip("OpenEXR")


def picture(path: Path, rgb: np.ndarray, **head: object) -> Path:
    channels = {name: np.ascontiguousarray(rgb[..., k], np.float32) for k, name in enumerate("RGB")}
    OpenEXR.File(head, channels).write(str(path))
    return path


def some_picture() -> np.ndarray:
    """Six decades."""
    rgb = np.random.default_rng(3).uniform(0.2, 1, (4, 6, 3))
    return rgb * 10.0 ** np.linspace(-3, 3, 6)[:, None]


def linear_srgb_of(scene: Scene) -> np.ndarray:
    """Tristimulus values times the inverse of sRGB's primaries, IEC 61966-2-1."""
    to_rgb = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
    radiance = np.tensordot(scene.weights, scene.basis, axes=(0, 0))
    return xyz(radiance, scene.wavelength_nm) @ to_rgb.T


def test_picture_keeps_its_range_and_its_white_luminance(tmp_path: Path) -> None:
    rgb = some_picture()
    scene = read_scene(picture(tmp_path / "a.exr", rgb, whiteLuminance=200.0))
    assert_allclose(scene.weights, np.moveaxis(rgb, 2, 0), rtol=1e-6)
    # The matrix has four decimals, and the spectra shift colors slightly: 1 % of the brightest channel.
    assert (np.abs(linear_srgb_of(scene) - 200 * rgb) < 0.01 * 200 * rgb.max(axis=2, keepdims=True)).all()
    white = read_scene(picture(tmp_path / "b.exr", np.ones((2, 2, 3)), whiteLuminance=200.0))
    assert luminance_cd_m2(white.radiance(0, 0), white.wavelength_nm) == pytest.approx(200, rel=1e-9)
    assert scene.reflectance is None


def test_picture_at_a_luminance_under_a_light(tmp_path: Path) -> None:
    file = picture(tmp_path / "a.exr", some_picture())
    scene = read_scene(file, illuminant="A", mean_luminance_cd_m2=7.5, distance_m=3, width_m=2)
    assert scene.mean_luminance_cd_m2() == pytest.approx(7.5)
    assert (scene.distance_m, scene.width_m) == (3, 2)
    white = Scene.uniform(scene.basis.sum(axis=0), scene.wavelength_nm)
    lamp = ps.charts.uniform("A", white.mean_luminance_cd_m2(), wavelength_nm=scene.wavelength_nm)
    assert_allclose(white.basis, lamp.basis, rtol=1e-4)  # the table of the three sums to 1 within 1e-5


def test_other_primaries_are_converted(tmp_path: Path) -> None:
    """Linear Rec. 2020 of colors inside sRGB; the matrix is of Rec. ITU-R BT.2087-0."""
    from_709 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
    rgb = np.random.default_rng(4).uniform(0.1, 1, (4, 6, 3))
    wide = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    file = picture(tmp_path / "a.exr", rgb @ from_709.T, chromaticities=wide, whiteLuminance=1.0)
    assert_allclose(read_scene(file).weights, np.moveaxis(rgb, 2, 0), atol=2e-4)


def test_white_of_other_primaries_stays_white(tmp_path: Path) -> None:
    """ACES' white is D60."""
    aces = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    file = picture(tmp_path / "a.exr", np.full((2, 2, 3), 0.5), chromaticities=aces, whiteLuminance=1.0)
    assert_allclose(read_scene(file).weights, 0.5, atol=1e-4)


def test_colors_outside_srgb_are_an_error_or_set_to_zero(tmp_path: Path) -> None:
    rgb = np.full((2, 3, 3), 0.5)
    rgb[1, 1] = 0.5, -0.2, 0.5
    file = picture(tmp_path / "a.exr", rgb, whiteLuminance=1.0)
    with pytest.raises(FileError) as caught:
        read_scene(file)
    assert caught.value.arguments == {"negative": "zero"}
    assert read_scene(file, negative="zero").weights[:, 1, 1].tolist() == [0.5, 0, 0.5]


def test_nan_is_an_error_or_zero_and_infinite_values_are_an_error(tmp_path: Path) -> None:
    rgb = np.full((2, 3, 3), 0.5)
    rgb[1, 1, 2] = np.nan
    file = picture(tmp_path / "a.exr", rgb, whiteLuminance=1.0)
    with pytest.raises(FileError) as caught:
        read_scene(file)
    assert caught.value.arguments == {"no_data": "zero"}
    assert read_scene(file, no_data="zero").weights[:, 1].T.tolist() == [[0.5] * 3, [0.0] * 3, [0.5] * 3]
    rgb[0, 0] = np.inf
    for options in ({}, {"no_data": "zero"}, {"negative": "zero"}):
        with raises(FileError, "has infinite values"):
            read_scene(picture(tmp_path / "b.exr", rgb, whiteLuminance=1.0), **options)


def test_small_negative_values_are_rounding_relative_to_their_own_pixel(tmp_path: Path) -> None:
    """A bright sun in the picture does not enlarge the tolerance of a dark pixel."""
    rgb = np.full((2, 3, 3), 0.5)
    rgb[1, 1] = 0.5, -4e-4, 0.5
    assert read_scene(picture(tmp_path / "a.exr", rgb, whiteLuminance=1.0)).weights[1, 1, 1] == 0
    rgb[0, 0], rgb[1, 1] = 1e4, (0.5, -0.01, 0.5)
    with pytest.raises(FileError):
        read_scene(picture(tmp_path / "b.exr", rgb, whiteLuminance=1.0))


def test_invalid_primaries(tmp_path: Path) -> None:
    for values in ((0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3127, 0.329), (0.64, 0.0, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)):
        file = picture(tmp_path / "a.exr", np.ones((2, 2, 3)), chromaticities=values, whiteLuminance=1.0)
        with pytest.raises(FileError) as caught:
            read_scene(file)
        assert caught.value.where == "chromaticities"


def test_a_luminance_picture_is_an_error(tmp_path: Path) -> None:
    OpenEXR.File({}, {"Y": np.ones((3, 4), np.float32)}).write(str(tmp_path / "y.exr"))
    with pytest.raises(FileError) as caught:
        read_scene(tmp_path / "y.exr", mean_luminance_cd_m2=1)
    assert "picture of luminance" in caught.value.what
