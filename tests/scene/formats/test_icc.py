"""ICC profiles are known by what they say, and not by their names; LittleCMS sees the same colours in them."""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from photosite.errors import FileError
from photosite.scene.io.files import read_scene
from photosite.scene.io.icc import RgbSpace, space_of_profile
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
def test_littlecms_sees_the_same_colours(profile: Profile, colorants: str, curve: str) -> None:
    """To a step of its 8 bits of sRGB and a little, where sRGB has the colour."""
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
    """1024 entries, as HP's and Microsoft's profile has them, and 16 bits of each."""
    light = linear_srgb_of(np.repeat(np.linspace(0, 1, 1024)[None, :, None], 3, axis=2), "sRGB", linear=False)[0, :, 0]
    table = b"curv\0\0\0\0" + struct.pack(">I", 1024) + np.round(65535 * light).astype(">u2").tobytes()
    assert space_of_profile(HERE, profile(curve=table)) == RgbSpace("sRGB")
    assert space_of_profile(HERE, SRGB.tobytes()) == RgbSpace("sRGB")


@pytest.mark.parametrize("kind", [1, 2, 4])
def test_every_kind_of_parametric_curve(profile: Profile, kind: int) -> None:
    """Kinds 1 and 2 as a straight line from 0, kind 4 as sRGB's whole."""
    values = {1: (1, 1, 0), 2: (1, 1, 0, 0), 4: (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045, 0, 0)}[kind]
    curve = struct.pack(f">4sIHH{len(values)}i", b"para", 0, kind, 0, *(round(65536 * value) for value in values))
    assert space_of_profile(HERE, profile(curve=curve)) == RgbSpace("sRGB", kind != 4)
    lifted = (1, 1, 0, 0.1) if kind == 2 else (1, 1, -0.1) if kind == 1 else (*values[:5], 0.1, 0.1)
    curve = struct.pack(f">4sIHH{len(lifted)}i", b"para", 0, kind, 0, *(round(65536 * value) for value in lifted))
    with pytest.raises(FileError, match="tone curves are not"):
        space_of_profile(HERE, profile(curve=curve))


def test_a_linear_picture_is_light(tmp_path: Path, profile: Profile) -> None:
    """Codes in the ratio of 50 to 188 are light in that ratio, whatever the profile is called."""
    codes = np.full((4, 6, 3), 188, np.uint8)
    codes[:, :3] = 50
    file = tmp_path / "a.png"
    Image.fromarray(codes).save(file, icc_profile=profile("sRGB-elle-V2-g10.icc", "sRGB", "linear"))
    weights = read_scene(file, mean_luminance_cd_m2=10).weights
    assert weights[1, 0, 0] / weights[1, 0, 5] == pytest.approx(50 / 188, rel=1e-6)


def refused(profile: Profile) -> list[tuple[bytes, str]]:
    good = profile("Mine")
    many = b"curv\0\0\0\0\xff\xff\xff\xff"
    return [
        (profile("sRGB", "sRGB", "gamma 2.2"), "'sRGB', whose colours are those of sRGB and whose tone curves are not"),
        (profile("Mine", "Adobe RGB", "sRGB"), "whose colours are those of Adobe RGB and whose tone"),
        (good.replace(b"rXYZ", b"bXYZ", 1), "no matrix of red, green and blue"),
        (profile("Mine", extra={b"A2B0": b"mft2"}), "'Mine', which is no matrix"),
        (profile("Mine", extra={b"cicp": b"cicp\0\0\0\0\x09\x10\0\1"}), "of an HDR picture"),
        (profile("sRGB", extra={b"gXYZ": b"XYZ " + bytes(16)}), "'sRGB', whose red, green and blue are of no known"),
        (profile(curve=many), "its rTRC is cut off"),
        (profile(curve=b"sngf" + bytes(20)), "no curve in its rTRC"),
        (profile(curve=b"para\0\0\0\0\0\7\0\0"), "an unknown kind 7"),
        (profile(curve=b"para\0\0\0\0\0\1\0\0" + bytes(12)), "a curve of no slope"),
        (good[:-40], "it is cut off"),
        (good[:140], "it is cut off"),
        (b"nothing", "no profile has such a head"),
        (good.replace(b"RGB ", b"CMYK"), "no matrix of red"),
    ]


@pytest.mark.parametrize("number", range(14))
def test_what_is_not_known_is_one_line(profile: Profile, number: int) -> None:
    made, message = refused(profile)[number]
    with pytest.raises(FileError, match=message) as caught:
        space_of_profile(HERE, made)
    assert "\n" not in str(caught.value)


def test_no_bytes_of_a_profile_make_it_stumble(profile: Profile) -> None:
    rng = np.random.default_rng(1)
    for made in (profile("Mine"), profile("Mine", curve="linear"), SRGB.tobytes()):
        for _ in range(300):
            spoilt = bytearray(made)
            for at in rng.integers(36, len(spoilt), 3):
                spoilt[at] = rng.integers(256)
            with contextlib.suppress(FileError):
                space_of_profile(HERE, bytes(spoilt[: rng.integers(1, len(spoilt) * 4)]))
