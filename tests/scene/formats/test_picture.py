"""Pictures from files: their colours in the space that they say, or refused; light of any range."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from photosite.errors import FileError, InputError
from photosite.scene.charts import macbeth
from photosite.scene.io.files import read_scene
from photosite.scene.io.pillow import check_size
from photosite.scene.pictures import from_rgb, from_srgb

RNG = np.random.default_rng(8)
CODES = RNG.integers(0, 256, (9, 13, 3)).astype(np.uint8)


def saved(path: Path, codes: np.ndarray, **how: object) -> Path:
    Image.fromarray(codes).save(path, **how)  # type: ignore[arg-type]
    return path


def test_a_png_is_its_codes(tmp_path: Path) -> None:
    scene = read_scene(saved(tmp_path / "a.png", CODES), mean_luminance_cd_m2=12.0, illuminant="A", width_m=0.4)
    wanted = from_srgb(CODES, "A", 12.0)
    np.testing.assert_array_equal(scene.weights, wanted.weights)
    np.testing.assert_allclose(scene.basis, wanted.basis, rtol=1e-12)
    assert (scene.name, scene.width_m) == ("a", 0.4)
    assert scene.reflectance is not None


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_a_tiff_is_its_codes(tmp_path: Path, bits: int, planar: str) -> None:
    codes = CODES if bits == 8 else (CODES.astype(np.uint16) * 256 + 77).astype(np.uint16)
    values = codes if planar == "contig" else np.moveaxis(codes, 2, 0)
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="rgb", planarconfig=planar, compression="zlib")
    scene = read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=12.0, illuminant="A")
    np.testing.assert_array_equal(scene.weights, from_srgb(codes, "A", 12.0).weights)


def test_tiffs_that_photosite_does_not_know(tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    tifffile.imwrite(file, CODES.astype(np.float32), photometric="rgb")
    with pytest.raises(FileError, match="float32, which may be light or codes"):
        read_scene(file, mean_luminance_cd_m2=1)
    tifffile.imwrite(file, np.stack([CODES, CODES]), photometric="rgb")
    with pytest.raises(FileError, match="has 2 pages in colours"):
        read_scene(file, mean_luminance_cd_m2=1)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_tiff_is_turned_as_a_png_is(tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    scenes = [
        read_scene(saved(tmp_path / f"a.{end}", CODES, exif=exif), mean_luminance_cd_m2=40) for end in ("png", "tif")
    ]
    np.testing.assert_array_equal(scenes[1].weights, scenes[0].weights)
    assert scenes[1].shape == ((9, 13) if orientation < 5 else (13, 9))


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "I;16"])
def test_a_tiff_is_what_a_png_is(tmp_path: Path, mode: str) -> None:
    """Grey, a palette, opacity that hides nothing: one picture, one scene."""
    deep = Image.fromarray(CODES[:, :, 0].astype(np.uint16) * 257)
    image = deep if mode == "I;16" else Image.fromarray(CODES).convert(mode)
    for end in ("png", "tif"):
        image.save(tmp_path / f"a.{end}")
    scenes = [read_scene(tmp_path / f"a.{end}", mean_luminance_cd_m2=40) for end in ("png", "tif")]
    np.testing.assert_allclose(scenes[1].weights, scenes[0].weights, atol=1e-7)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_tiff_whose_white_is_zero(tmp_path: Path, dtype: type[np.unsignedinteger]) -> None:
    grey = CODES[:, :, 0].astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", np.iinfo(dtype).max - grey, photometric="miniswhite")
    wanted = from_srgb(np.repeat(grey[:, :, None], 3, axis=2))
    np.testing.assert_array_equal(read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=40).weights, wanted.weights)


def test_a_tiff_one_sees_through(tmp_path: Path) -> None:
    for codes, kind in ((np.dstack([CODES, CODES[:, :, :1]]), "rgb"), (CODES[:, :, :2], "minisblack")):
        tifffile.imwrite(tmp_path / "a.tif", codes, photometric=kind, extrasamples=["unassalpha"])
        with pytest.raises(FileError, match="transparent in places"):
            read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=1)


def test_a_lone_grey_page_of_which_one_says_more_is_a_band(tmp_path: Path) -> None:
    saved(tmp_path / "a.tif", CODES[:, :, 0])
    with pytest.raises(FileError, match="wavelength"):
        read_scene(tmp_path / "a.tif", units="W/sr/m2/nm")


@pytest.mark.parametrize(("mode", "form"), [("CMYK", "CMYK"), ("LAB", "Lab"), ("YCbCr", "YCbCr")])
def test_tiffs_in_other_colours(tmp_path: Path, mode: str, form: str) -> None:
    image = Image.new("LAB", (6, 5)) if mode == "LAB" else Image.fromarray(CODES).convert(mode)
    image.save(tmp_path / "a.tif")
    with pytest.raises(FileError, match=f"colours in the form {form}"):
        read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=1)


def test_a_tiff_packed_as_jpeg_needs_another_package(tmp_path: Path) -> None:
    Image.fromarray(CODES).save(tmp_path / "a.tif", compression="jpeg")
    with pytest.raises(FileError, match=r"without compression|form YCbCr"):
        read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=1)


def tags(**said: object) -> list[tuple[int, int, int, tuple[int, ...], bool]]:
    """TIFF's words about colours: pairs of numerators and denominators."""
    known = {"white": (318, 5), "primaries": (319, 5), "curve": (301, 3)}
    parts = []
    for name, values in said.items():
        code, kind = known[name]
        numbers = [int(v) for x in values for v in ((round(1e4 * x), 10_000) if kind == 5 else (x,))]  # type: ignore[attr-defined]
        parts.append((code, kind, len(values), tuple(numbers), True))  # type: ignore[arg-type]
    return parts


def test_tiffs_that_say_their_colours_by_numbers(tmp_path: Path, profile: Profile) -> None:
    file = tmp_path / "a.tif"
    curve = [round(65535 * (x / 12.92 if x < 0.04045 else ((x + 0.055) / 1.055) ** 2.4)) for x in np.arange(256) / 255]
    srgb = tags(white=(0.3127, 0.329), primaries=(0.64, 0.33, 0.3, 0.6, 0.15, 0.06), curve=curve)
    for extra in (srgb, tags(curve=curve * 3)):
        tifffile.imwrite(file, CODES, photometric="rgb", extratags=extra)
        np.testing.assert_array_equal(read_scene(file, mean_luminance_cd_m2=40).weights, from_srgb(CODES).weights)
    for extra, message in (
        (tags(white=(0.3457, 0.3585)), "another white"),
        (tags(primaries=(0.64, 0.33, 0.21, 0.71, 0.15, 0.06)), "of other primaries"),
        (tags(curve=[257 * code for code in range(256)]), "TransferFunction"),
    ):
        tifffile.imwrite(file, CODES, photometric="rgb", extratags=extra)
        with pytest.raises(FileError, match=message):
            read_scene(file, mean_luminance_cd_m2=40)
    tifffile.imwrite(file, CODES, photometric="rgb", iccprofile=profile("My monitor", curve="gamma 2.2"))
    with pytest.raises(FileError, match="profile 'My monitor'"):
        read_scene(file, mean_luminance_cd_m2=1)


@pytest.mark.parametrize("end", ["jpg", "png", "tif"])
def test_what_cameras_write_for_adobe_rgb(tmp_path: Path, end: str) -> None:
    codes = np.full((8, 16, 3), 130, np.uint8)
    codes[:, 8:] = 150, 120, 110
    plain = saved(tmp_path / f"plain.{end}", codes)
    if end == "tif":
        file = tiff_with_color_space(tmp_path / "adobe.tif", codes, 2)
    else:
        exif = Image.Exif()
        exif[0x0112] = 1
        exif.get_ifd(0x8769)[0xA001] = 2
        file = saved(tmp_path / f"adobe.{end}", codes, exif=exif)
    scenes = [read_scene(one, mean_luminance_cd_m2=40) for one in (file, plain)]
    assert np.abs(scenes[0].weights - scenes[1].weights).max() > 0.01
    if end != "jpg":
        np.testing.assert_array_equal(scenes[0].weights, from_rgb(codes, space="Adobe RGB").weights)


def test_a_tiff_of_unknown_colours(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="not sRGB, and not what they are"):
        read_scene(tiff_with_color_space(tmp_path / "a.tif", CODES, 0xFFFF), mean_luminance_cd_m2=1)


def tiff_with_color_space(path: Path, codes: np.ndarray, value: int) -> Path:
    """EXIF's directory of one entry behind all else; the tag that says where is another's until it is renamed."""
    tifffile.imwrite(path, codes, photometric="rgb", byteorder="<", extratags=[(65000, 4, 1, 77, True)])
    whole = path.read_bytes()
    here = whole.replace(struct.pack("<HHII", 65000, 4, 1, 77), struct.pack("<HHII", 34665, 4, 1, len(whole)))
    path.write_bytes(here + struct.pack("<HHHIII", 1, 0xA001, 3, 1, value, 0))
    return path


def test_a_profile_that_cannot_be_unpacked_is_not_passed_over(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="profile that cannot be decompressed"):
        read_scene(png_with_chunk(tmp_path / "a.png", b"iCCP", b"P3\0\0" + b"not deflate"), mean_luminance_cd_m2=1)


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_large_pictures_are_read(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow's own limit, here of 20 pixels, is none."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    assert read_scene(saved(tmp_path / name, CODES), mean_luminance_cd_m2=1).shape == (9, 13)


def test_pictures_too_large_for_their_files(tmp_path: Path) -> None:
    """A JPEG's size, in its head, made 60 000 x 60 000; and sizes alone."""
    whole = saved(tmp_path / "a.jpg", CODES).read_bytes()
    at = whole.index(b"\xff\xc0") + 5
    (tmp_path / "a.jpg").write_bytes(whole[:at] + struct.pack(">HH", 60_000, 60_000) + whole[at + 4 :])
    with pytest.raises(FileError, match=r"60000 x 60000 pixels, in \d+ bytes; above 100 megapixels"):
        read_scene(tmp_path / "a.jpg", mean_luminance_cd_m2=1)
    file = tmp_path / "sparse"
    with file.open("wb") as stream:
        stream.truncate(20_000_000)
    check_size(file, 16_000, 12_000)
    check_size(file, 60_000, 60_000)
    with pytest.raises(FileError, match="up to 4 gigapixels"):
        check_size(file, 70_000, 60_000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n", "truncated: it ends after 8 bytes"),
        (b"hello", "neither PNG's nor JPEG's"),
    ],
)
def test_files_that_are_no_pictures(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(FileError, match=message):
        read_scene(tmp_path / "a.png", mean_luminance_cd_m2=1)


def test_the_first_bytes_tell_whatever_the_name(tmp_path: Path) -> None:
    file = saved(tmp_path / "a.png", CODES).rename(tmp_path / "a.scan")
    assert read_scene(file, mean_luminance_cd_m2=1).shape == (9, 13)


def test_a_jpeg_is_turned_as_it_says(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was held upright
    flat = np.full((8, 16, 3), 200, np.uint8)
    scene = read_scene(saved(tmp_path / "a.jpg", flat, exif=exif, quality=95), mean_luminance_cd_m2=1)
    assert scene.shape == (16, 8)


def test_greys_palettes_and_opaque_alpha_are_colours(tmp_path: Path) -> None:
    grey = CODES[:, :, 0]
    wanted = from_srgb(np.repeat(grey[:, :, None], 3, axis=2)).weights
    deep = Image.fromarray(grey.astype(np.uint16) * 257)
    deep.save(tmp_path / "deep.png")
    Image.fromarray(grey).convert("P").save(tmp_path / "p.png")
    alpha = np.dstack([grey, grey, grey, np.full_like(grey, 255)])
    for file in (
        saved(tmp_path / "l.png", grey),
        tmp_path / "deep.png",
        tmp_path / "p.png",
        saved(tmp_path / "alpha.png", alpha),
    ):
        np.testing.assert_allclose(read_scene(file, mean_luminance_cd_m2=40).weights, wanted, atol=1e-7)


Profile = Callable[..., bytes]


def test_colours_that_srgb_lacks_are_clipped_if_one_says_so(tmp_path: Path, profile: Profile) -> None:
    """Display P3, whose green is beyond sRGB's."""
    codes = np.full((5, 7, 3), 120, np.uint8)
    codes[0, 0] = 0, 255, 0
    file = saved(tmp_path / "wide.png", codes, icc_profile=profile("", "Display P3"))
    with pytest.raises(FileError, match=r"1 of 35 pixels have colours that sRGB lacks; ask for out_of_gamut='clip'"):
        read_scene(file, mean_luminance_cd_m2=40)
    clipped = read_scene(file, mean_luminance_cd_m2=40, out_of_gamut="clip")
    wanted = from_rgb(codes, space="Display P3", out_of_gamut="clip")
    np.testing.assert_array_equal(clipped.weights, wanted.weights)
    np.testing.assert_array_equal(clipped.weights[[0, 2], 0, 0], 0)
    macbeth(mean_luminance_cd_m2=40).save(tmp_path / "chart.h5")
    with pytest.raises(FileError, match="out_of_gamut is about the colours of a display picture"):
        read_scene(tmp_path / "chart.h5", out_of_gamut="clip")
    with pytest.raises(InputError, match="out_of_gamut is 'refuse' or 'clip', not 'cut'"):
        read_scene(file, out_of_gamut="cut")


def test_profiles_that_are_known_are_read_in_their_space(tmp_path: Path, profile: Profile) -> None:
    codes = np.clip(CODES, 90, 160)
    plain = read_scene(
        saved(tmp_path / "s.png", codes, icc_profile=profile("GIMP built-in sRGB")), mean_luminance_cd_m2=40
    )
    np.testing.assert_array_equal(plain.weights, from_srgb(codes).weights)
    wide = read_scene(saved(tmp_path / "p.png", codes, icc_profile=profile("", "Display P3")), mean_luminance_cd_m2=40)
    np.testing.assert_array_equal(wide.weights, from_rgb(codes, space="Display P3").weights)
    assert np.abs(wide.weights - plain.weights).max() > 1e-3


def png_with_chunk(path: Path, name: bytes, content: bytes) -> Path:
    """A PNG with one more chunk before its pixels."""
    plain = saved(path, CODES).read_bytes()
    chunk = struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))
    path.write_bytes(plain[:33] + chunk + plain[33:])
    return path


def uncalibrated(path: Path) -> Path:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 0xFFFF
    return saved(path, CODES, exif=exif)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda p: saved(p / "a.png", CODES, icc_profile=b"nothing"), "ICC profile that cannot be read"),
        (lambda p: png_with_chunk(p / "a.png", b"gAMA", struct.pack(">I", 100_000)), "to the power of 1; save"),
        (lambda p: png_with_chunk(p / "a.png", b"cICP", b"\x09\x10\0\x01"), "cICP"),
        (lambda p: uncalibrated(p / "a.jpg"), "not sRGB, and not what they are"),
        (lambda p: saved(p / "a.png", np.dstack([CODES, CODES[:, :, :1]])), "transparent in places"),
        (lambda p: saved(p / "a.png", np.zeros((4, 4, 3), np.uint8)), "black picture"),
    ],
)
def test_pictures_that_say_what_photosite_does_not_know(tmp_path: Path, make: object, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read_scene(make(tmp_path), mean_luminance_cd_m2=1.0)  # type: ignore[operator]


def test_cmyk_is_refused(tmp_path: Path) -> None:
    Image.fromarray(CODES).convert("CMYK").save(tmp_path / "a.jpg")
    with pytest.raises(FileError, match="in the form CMYK"):
        read_scene(tmp_path / "a.jpg", mean_luminance_cd_m2=1.0)


def test_what_must_be_said_and_what_must_not(tmp_path: Path) -> None:
    file = saved(tmp_path / "a.png", CODES)
    with pytest.raises(FileError, match="how bright its scene is"):
        read_scene(file)
    with pytest.raises(FileError, match="have no units"):
        read_scene(file, units="W/sr/m2/nm", mean_luminance_cd_m2=1)


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_damaged_pictures_are_one_line(tmp_path: Path, name: str) -> None:
    whole = saved(tmp_path / name, CODES).read_bytes()
    for count in (20, 60, len(whole) // 2, len(whole) - 30):
        (tmp_path / name).write_bytes(whole[:count])
        with pytest.raises(FileError) as caught:
            read_scene(tmp_path / name, mean_luminance_cd_m2=1)
        assert "\n" not in str(caught.value)


def test_rows_that_are_not_there_are_not_made_up(tmp_path: Path) -> None:
    """Pillow reads them as black."""
    whole = saved(tmp_path / "a.png", CODES).read_bytes()
    head = b"IHDR" + struct.pack(">II", 13, 10) + whole[24:29]
    (tmp_path / "a.png").write_bytes(whole[:12] + head + struct.pack(">I", zlib.crc32(head)) + whole[33:])
    with pytest.raises(FileError, match="360 bytes of image data, 400 expected"):
        read_scene(tmp_path / "a.png", mean_luminance_cd_m2=1)
