"""ICC profiles: known spaces whatever their names, and any other by LittleCMS."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from icc_profiles import COLORANTS, fixed, written
from PIL import Image, ImageCms

from photosite.errors import FileError
from photosite.scene.io.color_space import RgbSpace, space_of_profile
from photosite.scene.io.formats import read_scene
from photosite.scene.picture_colors import display_values, linear_srgb_of

Profile = Callable[..., bytes]
HERE = Path("a.png")
CODES = np.random.default_rng(3).integers(70, 186, (12, 15, 3)).astype(np.uint8)
SPACES = [
    ("sRGB", "sRGB"),
    ("Display P3", "sRGB"),
    ("Adobe RGB", "Adobe RGB"),
    ("ProPhoto RGB", "ProPhoto RGB"),
    ("BT.2020", "BT.2020"),
]
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))


@pytest.mark.parametrize(("colorants", "curve"), SPACES)
def test_a_profile_is_its_colorants_and_curves(profile: Profile, colorants: str, curve: str) -> None:
    assert space_of_profile(HERE, profile("My monitor", colorants, curve)) == RgbSpace(colorants)
    for line in ("linear", "linear, of gamma 1"):
        assert space_of_profile(HERE, profile("sRGB-elle-V2-g10.icc", colorants, line)) == RgbSpace(colorants, True)


@pytest.mark.parametrize(("colorants", "curve"), [*SPACES, ("sRGB", "linear"), ("Adobe RGB", "linear")])
def test_littlecms_makes_the_same_colors(profile: Profile, colorants: str, curve: str) -> None:
    """To 0.75 steps of 8 bits of sRGB, where sRGB has the color."""
    made = profile("", colorants, curve)
    source = ImageCms.ImageCmsProfile(io.BytesIO(made))
    image = ImageCms.profileToProfile(Image.fromarray(CODES), source, SRGB, renderingIntent=1)
    space = space_of_profile(HERE, made)
    own = linear_srgb_of(display_values(CODES), space.name, linear=space.linear)
    inside = ((own > 0.003) & (own < 1)).all(axis=2)
    assert inside.mean() > 0.5
    seen = linear_srgb_of(display_values(np.asarray(image)), "sRGB", linear=False)
    step = 2.3 / 255  # of sRGB's curve at white
    assert np.abs(own - seen)[inside].max() < 0.75 * step


def test_a_table_for_a_curve(profile: Profile) -> None:
    """1024 entries of 16 bits, as in HP's and Microsoft's profile."""
    light = linear_srgb_of(np.repeat(np.linspace(0, 1, 1024)[None, :, None], 3, axis=2), "sRGB", linear=False)[0, :, 0]
    table = b"curv\0\0\0\0" + struct.pack(">I", 1024) + np.round(65535 * light).astype(">u2").tobytes()
    assert space_of_profile(HERE, profile(curve=table)) == RgbSpace("sRGB")
    assert space_of_profile(HERE, SRGB.tobytes()) == RgbSpace("sRGB")


@pytest.mark.parametrize("kind", [1, 2, 4])
def test_every_kind_of_parametric_curve(profile: Profile, kind: int) -> None:
    """Kinds 1 and 2 as a straight line from 0, kind 4 as sRGB's whole curve."""
    values = {1: (1, 1, 0), 2: (1, 1, 0, 0), 4: (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045, 0, 0)}[kind]
    curve = struct.pack(f">4sIHH{len(values)}i", b"para", 0, kind, 0, *(round(65536 * value) for value in values))
    assert space_of_profile(HERE, profile(curve=curve)) == RgbSpace("sRGB", kind != 4)


@pytest.mark.parametrize(("colorants", "curve"), [("sRGB", "gamma 2.2"), ("Adobe RGB", "sRGB"), ("BT.2020", "linear")])
def test_other_curves_and_colorants_are_transformed(profile: Profile, colorants: str, curve: str) -> None:
    """Against the matrix of the profile's own numbers, with the colorants of BT.2020 moved."""
    extra = {b"rXYZ": b"XYZ \0\0\0\0" + fixed(0.60, 0.30, 0.01)} if colorants == "BT.2020" else {}
    made = profile("My monitor", colorants, curve, extra)
    space = space_of_profile(HERE, made)
    assert (space.linear, space.profile) == (True, made)
    own = linear_srgb_of(space.decoded(CODES).astype(np.float64), space.name, linear=True)
    values = CODES / 255.0
    light = {"gamma 2.2": values**2.2, "linear": values, "sRGB": linear_srgb_of(values, "sRGB", linear=False)}[curve]
    matrix = np.array(COLORANTS[colorants]).reshape(3, 3).T
    if extra:
        matrix[:, 0] = 0.60, 0.30, 0.01
    srgb = np.array(COLORANTS["sRGB"]).reshape(3, 3).T
    np.testing.assert_allclose(own, light @ matrix.T @ np.linalg.inv(srgb).T, atol=1e-3)


def test_a_profile_of_tables_is_transformed(profile: Profile) -> None:
    """A lookup table of 33 nodes to XYZ, in which light is the square of the code."""
    made = profile("A scanner", extra={b"A2B0": squares_table()}, without=b"TRC")
    space = space_of_profile(HERE, made)
    assert space.profile == made
    own = linear_srgb_of(space.decoded(CODES).astype(np.float64), space.name, linear=True)
    srgb = np.array(COLORANTS["sRGB"]).reshape(3, 3).T
    xyz = np.stack([CODES[..., k] / 255.0 for k in range(3)], axis=-1) ** 2 * _D50
    np.testing.assert_allclose(own, xyz @ np.linalg.inv(srgb).T, atol=4e-3)


_D50 = np.array([0.9642, 1.0, 0.8249])


def squares_table(nodes: int = 33) -> bytes:
    """lut16Type (ICC.1:2022, 10.10): 3 channels in and out; PCS XYZ is in units of 32768/65535."""
    steps = (np.arange(nodes) / (nodes - 1)) ** 2
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1) * _D50
    codes = np.round(grid * 32768).astype(">u2").tobytes()
    identity = np.array([0, 65535], ">u2").tobytes() * 3
    head = b"mft2\0\0\0\0" + bytes([3, 3, nodes, 0]) + fixed(1, 0, 0, 0, 1, 0, 0, 0, 1) + struct.pack(">HH", 2, 2)
    return head + identity + codes + identity


def test_a_picture_with_a_profile_of_tables_is_read(tmp_path: Path, profile: Profile) -> None:
    """A gray ramp: light is the square of the code, by the table's interpolation."""
    ramp = np.repeat(np.linspace(50, 255, 18).astype(np.uint8)[None, :, None], 3, axis=2)
    file = tmp_path / "a.png"
    Image.fromarray(np.repeat(ramp, 4, axis=0)).save(
        file, icc_profile=profile("A scanner", extra={b"A2B0": squares_table()}, without=b"TRC")
    )
    weights = read_scene(file, mean_luminance_cd_m2=10).weights[1, 0]
    np.testing.assert_allclose(weights / weights[-1], (ramp[0, :, 0] / 255.0) ** 2, atol=3e-3)


def test_a_linear_picture_is_light(tmp_path: Path, profile: Profile) -> None:
    """Codes in the ratio of 50 to 188 are light in that ratio, whatever the profile's name."""
    codes = np.full((4, 6, 3), 188, np.uint8)
    codes[:, :3] = 50
    file = tmp_path / "a.png"
    Image.fromarray(codes).save(file, icc_profile=profile("sRGB-elle-V2-g10.icc", "sRGB", "linear"))
    weights = read_scene(file, mean_luminance_cd_m2=10).weights
    assert weights[1, 0, 0] / weights[1, 0, 5] == pytest.approx(50 / 188, rel=1e-6)


def invalid(profile: Profile) -> dict[str, bytes]:
    good = profile("Mine")
    return {
        "no colorant": good.replace(b"rXYZ", b"bXYZ", 1),
        "an empty table": profile("Mine", extra={b"A2B0": b"mft2"}),
        "HDR": profile("Mine", extra={b"cicp": b"cicp\0\0\0\0\x09\x10\0\1"}),
        "a curve that is too long": profile(curve=b"curv\0\0\0\0\xff\xff\xff\xff"),
        "no curve": profile(curve=b"sngf" + bytes(20)),
        "an unknown curve": profile(curve=b"para\0\0\0\0\0\7\0\0"),
        "a curve of no slope": profile(curve=b"para\0\0\0\0\0\1\0\0" + bytes(12)),
        "truncated": good[:-40],
        "truncated in its table": good[:140],
        "no profile": b"nothing",
        "CMYK": good.replace(b"RGB ", b"CMYK"),
    }


@pytest.mark.parametrize("name", invalid(written))
def test_invalid_profiles_are_an_error(name: str) -> None:
    with pytest.raises(FileError) as caught:
        space_of_profile(HERE, invalid(written)[name])
    assert "ICC profile" in caught.value.what
    assert "\n" not in str(caught.value)


def test_damaged_profiles_are_used_or_an_error(profile: Profile) -> None:
    rng = np.random.default_rng(1)
    for made in (profile("Mine"), profile("Mine", curve="linear"), SRGB.tobytes()):
        for _ in range(300):
            damaged = bytearray(made)
            for at in rng.integers(36, len(damaged), 3):
                damaged[at] = rng.integers(256)
            with contextlib.suppress(FileError):
                space = space_of_profile(HERE, bytes(damaged[: rng.integers(1, len(damaged) * 4)]))
                assert np.isfinite(space.decoded(CODES)).all()
