"""Developed pictures with known colors, and invalid arguments."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from PIL import Image
from raising import raises

from photosite.color.colorimetry import D65_WHITE_XYZ, colour_science, encode_srgb
from photosite.develop.develop import AUTO_EXPOSURE_PERCENTILE, _auto_exposure, develop, save_picture
from photosite.errors import FileError, InputError
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import NAMED, channel_mask, channel_names, plane_names

# A camera's XYZ to R, G, B in the manner of published DNG matrices.
FROM_XYZ = np.array([[0.8367, -0.2248, -0.0981], [-0.3931, 1.1500, 0.2720], [-0.0742, 0.1517, 0.7257]])


def flat_frame(rgb, cfa="rggb", shape=(8, 10), black=1000.0, **more):
    """An even surface of one camera color, in units of the white level, on a 16-bit mosaic."""
    tile = NAMED[cfa]
    signal = sum(v * channel_mask(tile, c, shape) for c, v in zip("RGB", rgb, strict=True))
    dn = np.rint(black + signal * (65535 - black)).astype(np.uint16)
    return RawFrame(dn, bits=16, cfa=tile, black_level_dn=black, **more)


def dng_matrix(cfa):
    """Rows in the order in which the frame names its channels."""
    return FROM_XYZ[["RGB".index(name) for name in channel_names(NAMED[cfa])]]


@pytest.mark.parametrize("cfa", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("xyz", [(0.20, 0.12, 0.05), (0.18, 0.22, 0.40), (0.10, 0.15, 0.08)])
def test_a_known_colour_becomes_its_srgb(cfa, xyz):
    neutral = FROM_XYZ @ D65_WHITE_XYZ
    # Exposed so that white just saturates the camera's most sensitive channel.
    frame = flat_frame(FROM_XYZ @ xyz / neutral.max(), cfa, color_matrix=dng_matrix(cfa))
    wanted = colour_science().XYZ_to_sRGB(np.array(xyz))
    assert wanted.min() > 0.05
    assert wanted.max() < 0.95
    np.testing.assert_allclose(develop(frame, "none", exposure=1), np.broadcast_to(wanted, (8, 10, 3)), atol=2e-4)
    balanced = develop(frame, tuple(neutral[1] / neutral), exposure=1)
    np.testing.assert_allclose(balanced, np.broadcast_to(wanted, (8, 10, 3)), atol=2e-4)
    explicit = develop(flat_frame(FROM_XYZ @ xyz / neutral.max(), cfa), "none", 7 * np.linalg.inv(FROM_XYZ), 1)
    np.testing.assert_allclose(explicit, np.broadcast_to(wanted, (8, 10, 3)), atol=2e-4)


@pytest.mark.parametrize("matrix", [None, np.linalg.inv(FROM_XYZ)])
def test_as_shot_makes_gray_surfaces_gray_whatever_else_is_in_the_frame(matrix):
    """A blue wall with a gray patch: gray world would make the wall gray and the patch yellow."""
    frame = flat_frame((0.2, 0.3, 0.6), shape=(24, 24), metadata={"as_shot_neutral": "1,0.8,0.4"})
    frame.dn[8:16, 8:16] = flat_frame((0.5, 0.4, 0.2), shape=(8, 8)).dn
    patch = develop(frame, color_matrix=matrix, exposure=1)[9:15, 9:15]
    assert np.ptp(patch, axis=-1).max() < 1e-4
    np.testing.assert_allclose(patch, encode_srgb(np.float32([0.5]))[0], atol=1e-4)
    assert np.ptp(develop(frame, "gray-world", matrix)[9:15, 9:15], axis=-1).max() > 0.1
    without = replace(frame, metadata={})
    np.testing.assert_array_equal(develop(without), develop(without, "gray-world"))


@pytest.mark.parametrize("neutral", ["1,0.8", "1,0,0.5", "1,2,0.5", "daylight"])
def test_an_invalid_white_of_the_light(neutral):
    with raises(InputError, "as_shot_neutral", where="metadata", value=neutral):
        develop(flat_frame((0.3, 0.3, 0.3), metadata={"as_shot_neutral": neutral}))


def test_other_channels_than_red_green_blue():
    """Four channels with a matrix give the colors of their patches; without one, gray."""
    cfa = (("R", "W"), ("G", "B"))
    from_xyz = np.vstack([FROM_XYZ[0], FROM_XYZ.sum(axis=0), FROM_XYZ[1:]])
    xyz = np.array([0.20, 0.22, 0.18])
    neutral = from_xyz @ D65_WHITE_XYZ
    signal = from_xyz @ xyz / neutral.max()
    dn = np.rint(60000 * sum(v * channel_mask(cfa, c, (8, 8)) for c, v in zip("RWGB", signal, strict=True)))
    shot = ",".join(str(part) for part in neutral / neutral.max())
    frame = RawFrame(
        dn.astype(np.uint16), 16, cfa, white_level_dn=60000.0, color_matrix=from_xyz, metadata={"as_shot_neutral": shot}
    )
    wanted = colour_science().XYZ_to_sRGB(xyz)
    np.testing.assert_allclose(develop(frame, exposure=1), np.broadcast_to(wanted, (8, 8, 3)), atol=1e-3)
    gray = develop(replace(frame, color_matrix=None, color_matrix_a=None))
    assert np.ptp(gray, axis=-1).max() < 1e-6


def test_infrared_light_is_taken_away_before_the_white_balance():
    """A camera of exact colors, whose R, G and B also see the infrared; foliage is bright there."""
    cfa, share = NAMED["rgb-ir"], 0.4
    to_xyz = np.linalg.inv(FROM_XYZ)
    matrix = np.column_stack([to_xyz, -share * to_xyz.sum(axis=1)])  # of R, G, B and Ir
    white, leaf = np.array([*(FROM_XYZ @ D65_WHITE_XYZ), 0.5]), np.array([*(FROM_XYZ @ [0.15, 0.2, 0.1]), 0.9])
    seen = [np.append(part[:3] + share * part[3], part[3]) for part in (white, leaf)]
    scale = 0.8 / max(map(np.max, seen))
    names = ("R", "G", "B", "Ir")
    order = [names.index(name) for name in plane_names(cfa)]
    signal = dict(zip(names, scale * seen[1], strict=True))
    dn = np.rint(65535 * sum(signal[name] * channel_mask(cfa, name, (16, 16)) for name in names)).astype(np.uint16)
    neutral = ",".join(map(str, (seen[0] / seen[0].max())[order]))
    frame = RawFrame(dn, bits=16, cfa=cfa, metadata={"as_shot_neutral": neutral})
    picture = develop(frame, color_matrix=matrix[:, order], exposure=1 / (scale * seen[0].max()))
    wanted = colour_science().XYZ_to_sRGB(np.array([0.15, 0.2, 0.1]))
    np.testing.assert_allclose(picture, np.broadcast_to(wanted, (16, 16, 3)), atol=2e-3)


@pytest.mark.parametrize("matrix", [None, np.linalg.inv(FROM_XYZ)])
def test_gray_world_makes_an_even_field_gray_whatever_the_matrix(matrix):
    picture = develop(flat_frame((0.61, 0.33, 0.18)), "gray-world", matrix, exposure=0.5)
    assert np.ptp(picture, axis=-1).max() < 1e-4
    # Gains normalized to their least, red's: the field stands at red's 0.61 of white.
    np.testing.assert_allclose(picture, encode_srgb(np.float32([0.305]))[0], atol=1e-4)


def test_exposure_is_a_factor_on_light():
    frame = flat_frame((0.3, 0.3, 0.3))
    for factor in (0.5, 1.0, 2.0):
        wanted = encode_srgb(np.float32([0.3 * factor]))[0]
        np.testing.assert_allclose(develop(frame, "none", exposure=factor), wanted, atol=1e-4)


def test_automatic_exposure_puts_its_percentile_at_white():
    rng = np.random.default_rng(8)
    frame = RawFrame(rng.integers(500, 30000, (100, 100)).astype(np.uint16), bits=16)
    level = np.percentile(frame.dn, 99.5)
    picture = develop(frame)
    assert (picture[..., 0] == 1.0).mean() == pytest.approx(0.005, abs=5e-4)
    np.testing.assert_allclose(picture[..., 1], encode_srgb((frame.dn / level).astype(np.float32)), atol=1e-5)


def test_monochrome_becomes_gray():
    frame = RawFrame(np.array([[100, 600], [1100, 350]], np.uint16), bits=12, black_level_dn=100)
    picture = develop(frame, exposure=3995 / 1000)
    assert picture.shape == (2, 2, 3)
    np.testing.assert_allclose(picture[..., 2], encode_srgb(np.float32([[0, 0.5], [1, 0.25]])), atol=1e-6)
    assert (picture == picture[..., :1]).all()


def test_a_saturated_area_is_white_not_tinted():
    # Tungsten light: red gains little, blue much. The upper half saturates all three channels.
    dim, saturated = flat_frame((0.5, 0.4, 0.2), shape=(20, 20)), np.full((20, 20), 65535, np.uint16)
    saturated[8:] = dim.dn[8:]
    picture = develop(RawFrame(saturated, bits=16, cfa=NAMED["rggb"], black_level_dn=1000.0), exposure=0.9)
    assert np.ptp(picture[:7], axis=-1).max() < 1e-6
    assert np.ptp(picture[10:], axis=-1).max() < 1e-4
    assert picture[0, 0, 0] > picture[15, 0, 0]


def test_the_frame_is_unchanged():
    frame = flat_frame((0.3, 0.4, 0.2))
    before = frame.dn.copy()
    develop(frame)
    assert (frame.dn == before).all()


@pytest.mark.parametrize(
    "arguments",
    [
        {"white_balance": "grey-world"},
        {"white_balance": (1.0, 2.0)},
        {"white_balance": (1.0, -1.0, 2.0)},
        {"exposure": 0.0},
        {"exposure": "automatic"},
        {"color_matrix": np.ones((3, 3))},
        {"color_matrix": np.eye(4)},
    ],
)
def test_invalid_arguments(arguments):
    with raises(InputError, *arguments):
        develop(flat_frame((0.3, 0.4, 0.2)), **arguments)


def test_a_matrix_with_an_impossible_white():
    with raises(InputError, "white would need the camera values", where="color_matrix"):
        develop(flat_frame((0.3, 0.4, 0.2)), color_matrix=-np.eye(3))


def test_frames_that_cannot_be_developed():
    dark = RawFrame(np.full((4, 4), 64, np.uint16), bits=12, cfa=NAMED["rggb"], black_level_dn=64)
    with raises(InputError, "automatic exposure finds no light"):
        develop(dark, "none")
    with raises(InputError, "mean above black"):
        develop(dark)
    mono = RawFrame(np.ones((4, 4), np.uint16), bits=12)
    with raises(InputError, "a monochrome frame has no white balance"):
        develop(mono, (1, 1, 1))
    with raises(InputError, "white_balance", hint="Did you mean 'none'?"):
        develop(mono, "non")


def test_the_folder_does_not_hide_the_public_function():
    code = "import photosite.develop.demosaic, photosite; raise SystemExit(not hasattr(photosite.develop, '__code__'))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(4).random((37, 23, 3), dtype=np.float32)


def test_8_bits_through_pillow(picture: np.ndarray, tmp_path: Path) -> None:
    save_picture(picture, tmp_path / "p.png")
    with Image.open(tmp_path / "p.png") as image:
        assert image.mode == "RGB"
        assert image.info["srgb"] == 0
        np.testing.assert_array_equal(np.asarray(image), np.rint(picture * 255))


def test_16_bits(picture: np.ndarray, tmp_path: Path) -> None:
    """Pillow checks the chunks; it reduces 16-bit color to 8 bits, so imagecodecs decodes the values."""
    save_picture(picture, tmp_path / "p.png", bits=16)
    with Image.open(tmp_path / "p.png") as image:
        image.verify()
        assert image.info["srgb"] == 0
    values = imagecodecs.imagecodecs.png_decode((tmp_path / "p.png").read_bytes())
    assert values.dtype == np.uint16
    np.testing.assert_array_equal(values, np.rint(picture * 65535))


def test_jpeg(tmp_path: Path) -> None:
    even = np.full((37, 23, 3), [0.8, 0.5, 0.2], np.float32)
    save_picture(even, tmp_path / "p.jpg")
    with Image.open(tmp_path / "p.jpg") as image:
        assert (image.format, image.mode, image.size) == ("JPEG", "RGB", (23, 37))
        np.testing.assert_allclose(np.asarray(image), np.rint(even * 255), atol=2)


@pytest.mark.parametrize(
    ("shape", "value", "name", "bits"),
    [
        ((4, 4), 0.5, "p.png", 8),
        ((4, 4, 4), 0.5, "p.png", 8),
        ((0, 4, 3), 0.5, "p.png", 8),
        ((4, 4, 3), 1.5, "p.png", 8),
        ((4, 4, 3), -0.1, "p.png", 8),
        ((4, 4, 3), float("nan"), "p.png", 8),
        ((4, 4, 3), 0.5, "p.gif", 8),
        ((4, 4, 3), 0.5, "p.jpg", 16),
        ((4, 4, 3), 0.5, "p.png", 12),
    ],
)
def test_invalid_pictures_and_paths(shape: tuple[int, ...], value: float, name: str, bits: int, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        save_picture(np.full(shape, value, np.float32), tmp_path / name, bits=bits)
    assert list(tmp_path.iterdir()) == []


def test_missing_folder(picture: np.ndarray, tmp_path: Path) -> None:
    with pytest.raises(FileError):
        save_picture(picture, tmp_path / "nowhere" / "p.png")


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_a_large_picture_is_read_back_exactly(tmp_path: Path, bits: int, noise: float) -> None:
    """It is compressed in bands, whose streams and checksums are joined."""
    ramp = np.linspace(0, 1, 901 * 1100 * 3).reshape(901, 1100, 3)
    picture = (np.random.default_rng(3).random(ramp.shape) * noise + ramp * (1 - noise)).astype(np.float32)
    save_picture(picture, tmp_path / "a.png", bits)
    codes = imagecodecs.png_decode((tmp_path / "a.png").read_bytes())
    assert codes.dtype == np.dtype(f"uint{bits}")
    assert (codes == np.rint(picture * (2**bits - 1))).all()


@pytest.mark.parametrize("values", [1, 3, 200, 99_999, 250_007])
def test_automatic_exposure_is_the_percentile_of_all_pixels(values: int) -> None:
    rng = np.random.default_rng(values)
    for seen in (rng.random(values, np.float32), np.round(5 * rng.random(values, np.float32)) + 1):
        picture = np.repeat(seen[None, :, None], 3, axis=2)
        assert _auto_exposure(picture) == 1 / float(np.percentile(seen, AUTO_EXPOSURE_PERCENTILE))
