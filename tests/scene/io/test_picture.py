"""Display pictures from PNG, JPEG and TIFF: color spaces, orientation, opacity, compression, invalid files."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image
from raising import raises

from photosite.errors import FileError, InputError
from photosite.scene.charts import macbeth
from photosite.scene.io.formats import read_scene
from photosite.scene.io.picture import TRANSPARENT, check_size
from photosite.scene.pictures import from_rgb

Profile = Callable[..., bytes]
RNG = np.random.default_rng(8)
CODES = RNG.integers(0, 256, (9, 13, 3)).astype(np.uint8)


def error_of(path: Path, **options: Any) -> FileError:
    with pytest.raises(FileError) as caught:
        read_scene(path, **({"mean_luminance_cd_m2": 1.0} | options))
    assert caught.value.path == str(path)
    assert "\n" not in str(caught.value)
    return caught.value


def saved(path: Path, codes: np.ndarray, **how: object) -> Path:
    Image.fromarray(codes).save(path, **how)  # type: ignore[arg-type]
    return path


def test_a_png_is_its_codes(tmp_path: Path) -> None:
    scene = read_scene(saved(tmp_path / "a.png", CODES), mean_luminance_cd_m2=12.0, illuminant="A", width_m=0.4)
    wanted = from_rgb(CODES, "A", 12.0)
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
    np.testing.assert_array_equal(scene.weights, from_rgb(codes, "A", 12.0).weights)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    "how",
    [
        {"compression": "lzw"},
        {"compression": "lzw", "predictor": True},
        {"compression": "zlib", "predictor": True, "rowsperstrip": 4},
        {"compression": "packbits"},
        {"compression": "zstd", "tile": (16, 16)},
    ],
)
def test_a_compressed_tiff_is_its_codes(tmp_path: Path, bits: int, how: dict[str, Any]) -> None:
    codes = CODES if bits == 8 else (CODES.astype(np.uint16) * 256 + 77).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", codes, photometric="rgb", **how)
    scene = read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=12.0, illuminant="A")
    np.testing.assert_array_equal(scene.weights, from_rgb(codes, "A", 12.0).weights)


@pytest.mark.parametrize("bits", [8, 16])
def test_a_tiff_of_lossless_jpeg_is_its_codes(tmp_path: Path, bits: int) -> None:
    """Gray, as scanners write it: compression 7 with frames of type SOF3."""
    gray = CODES[:, :, 0] if bits == 8 else (CODES[:, :, 0].astype(np.uint16) * 256 + 77).astype(np.uint16)
    strip = imagecodecs.ljpeg_encode(gray, bitspersample=bits)
    tifffile.imwrite(
        tmp_path / "a.tif", iter([strip]), shape=gray.shape, dtype=gray.dtype, photometric="minisblack", compression=7
    )
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["BitsPerSample"].overwrite(bits)
    wanted = from_rgb(np.repeat(gray[:, :, None], 3, axis=2))
    np.testing.assert_array_equal(read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=40).weights, wanted.weights)


def test_a_tiff_of_jpeg_is_what_pillow_reads(tmp_path: Path) -> None:
    Image.fromarray(CODES).save(tmp_path / "a.tif", compression="jpeg", quality=95)
    with Image.open(tmp_path / "a.tif") as image:
        wanted = from_rgb(np.asarray(image))
    weights = read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=40).weights
    np.testing.assert_allclose(weights, wanted.weights, atol=0.02)


def test_tiffs_of_floats_or_several_pages_are_an_error(tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    tifffile.imwrite(file, CODES.astype(np.float32), photometric="rgb")
    assert error_of(file).value == "float32"
    tifffile.imwrite(file, np.stack([CODES, CODES]), photometric="rgb")
    assert error_of(file).what == "has 2 pages in color"


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_tiff_is_oriented_as_a_png_is(tmp_path: Path, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    scenes = [
        read_scene(saved(tmp_path / f"a.{end}", CODES, exif=exif), mean_luminance_cd_m2=40) for end in ("png", "tif")
    ]
    np.testing.assert_array_equal(scenes[1].weights, scenes[0].weights)
    assert scenes[1].shape == ((9, 13) if orientation < 5 else (13, 9))


@pytest.mark.parametrize("mode", ["L", "LA", "P", "RGB", "RGBA", "I;16"])
def test_a_tiff_is_what_a_png_is(tmp_path: Path, mode: str) -> None:
    """Gray, a palette, full opacity: one picture, one scene."""
    deep = Image.fromarray(CODES[:, :, 0].astype(np.uint16) * 257)
    image = deep if mode == "I;16" else Image.fromarray(CODES).convert(mode)
    for end in ("png", "tif"):
        image.save(tmp_path / f"a.{end}")
    scenes = [read_scene(tmp_path / f"a.{end}", mean_luminance_cd_m2=40) for end in ("png", "tif")]
    np.testing.assert_allclose(scenes[1].weights, scenes[0].weights, atol=1e-7)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_tiff_whose_white_is_zero(tmp_path: Path, dtype: type[np.unsignedinteger]) -> None:
    gray = CODES[:, :, 0].astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", np.iinfo(dtype).max - gray, photometric="miniswhite")
    wanted = from_rgb(np.repeat(gray[:, :, None], 3, axis=2))
    np.testing.assert_array_equal(read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=40).weights, wanted.weights)


def test_a_transparent_tiff_is_an_error(tmp_path: Path) -> None:
    for codes, kind in ((np.dstack([CODES, CODES[:, :, :1]]), "rgb"), (CODES[:, :, :2], "minisblack")):
        tifffile.imwrite(tmp_path / "a.tif", codes, photometric=kind, extrasamples=["unassalpha"])
        assert error_of(tmp_path / "a.tif").what == TRANSPARENT


def test_a_single_gray_page_with_units_is_a_band(tmp_path: Path) -> None:
    saved(tmp_path / "a.tif", CODES[:, :, 0])
    assert "wavelength" in error_of(tmp_path / "a.tif", mean_luminance_cd_m2=None, units="W/sr/m2/nm").what


@pytest.mark.parametrize(("mode", "form"), [("CMYK", "CMYK"), ("LAB", "Lab"), ("YCbCr", "YCbCr")])
def test_tiffs_in_other_colors(tmp_path: Path, mode: str, form: str) -> None:
    image = Image.new("LAB", (6, 5)) if mode == "LAB" else Image.fromarray(CODES).convert(mode)
    image.save(tmp_path / "a.tif")
    assert (error_of(tmp_path / "a.tif").what, error_of(tmp_path / "a.tif").value) == ("colors", form)


def tags(**stated: object) -> list[tuple[int, int, int, tuple[int, ...], bool]]:
    """TIFF's tags of color: pairs of numerators and denominators."""
    known = {"white": (318, 5), "primaries": (319, 5), "curve": (301, 3)}
    parts = []
    for name, values in stated.items():
        code, kind = known[name]
        numbers = [int(v) for x in values for v in ((round(1e4 * x), 10_000) if kind == 5 else (x,))]  # type: ignore[attr-defined]
        parts.append((code, kind, len(values), tuple(numbers), True))  # type: ignore[arg-type]
    return parts


def test_color_tags_of_tiff(tmp_path: Path, profile: Profile) -> None:
    file = tmp_path / "a.tif"
    curve = [round(65535 * (x / 12.92 if x < 0.04045 else ((x + 0.055) / 1.055) ** 2.4)) for x in np.arange(256) / 255]
    srgb = tags(white=(0.3127, 0.329), primaries=(0.64, 0.33, 0.3, 0.6, 0.15, 0.06), curve=curve)
    for extra in (srgb, tags(curve=curve * 3)):
        tifffile.imwrite(file, CODES, photometric="rgb", extratags=extra)
        np.testing.assert_array_equal(read_scene(file, mean_luminance_cd_m2=40).weights, from_rgb(CODES).weights)
    for extra, about in (
        (tags(white=(0.3457, 0.3585)), "primaries and white"),
        (tags(primaries=(0.64, 0.33, 0.21, 0.71, 0.15, 0.06)), "primaries and white"),
        (tags(curve=[257 * code for code in range(256)]), "TransferFunction"),
    ):
        tifffile.imwrite(file, CODES, photometric="rgb", extratags=extra)
        assert about in error_of(file).what


def test_the_icc_profile_of_a_tiff_is_used(tmp_path: Path, profile: Profile) -> None:
    """A gamma of 2.2, unlike the known curves."""
    tifffile.imwrite(tmp_path / "a.tif", CODES, photometric="rgb", iccprofile=profile("My monitor", curve="gamma 2.2"))
    weights = read_scene(tmp_path / "a.tif", mean_luminance_cd_m2=40).weights
    wanted = from_rgb((CODES / 255.0) ** 2.2, linear=True)
    np.testing.assert_allclose(weights, wanted.weights, atol=5e-4)


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


def test_a_tiff_of_an_unknown_color_space(tmp_path: Path) -> None:
    assert "not sRGB" in error_of(tiff_with_color_space(tmp_path / "a.tif", CODES, 0xFFFF)).what


def tiff_with_color_space(path: Path, codes: np.ndarray, value: int) -> Path:
    """Append EXIF's directory of one entry; the tag with its offset is written under another number and renamed."""
    tifffile.imwrite(path, codes, photometric="rgb", byteorder="<", extratags=[(65000, 4, 1, 77, True)])
    whole = path.read_bytes()
    here = whole.replace(struct.pack("<HHII", 65000, 4, 1, 77), struct.pack("<HHII", 34665, 4, 1, len(whole)))
    path.write_bytes(here + struct.pack("<HHHIII", 1, 0xA001, 3, 1, value, 0))
    return path


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_large_pictures_are_read(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow's own limit, here of 20 pixels, does not apply."""
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)
    assert read_scene(saved(tmp_path / name, CODES), mean_luminance_cd_m2=1).shape == (9, 13)


def test_pictures_too_large_for_their_files(tmp_path: Path) -> None:
    """A JPEG whose header states 60 000 x 60 000; and sizes alone."""
    whole = saved(tmp_path / "a.jpg", CODES).read_bytes()
    at = whole.index(b"\xff\xc0") + 5
    (tmp_path / "a.jpg").write_bytes(whole[:at] + struct.pack(">HH", 60_000, 60_000) + whole[at + 4 :])
    error = error_of(tmp_path / "a.jpg")
    assert error.what == "size"
    assert str(error.value).startswith("60000 x 60000 pixels")
    file = tmp_path / "sparse"
    with file.open("wb") as stream:
        stream.truncate(20_000_000)
    check_size(file, 16_000, 12_000)
    check_size(file, 60_000, 60_000)
    with pytest.raises(FileError) as caught:
        check_size(file, 70_000, 60_000)
    assert caught.value.expected == "at most 4 gigapixels"


@pytest.mark.parametrize(
    ("content", "about"), [(b"", "is empty"), (b"\x89PNG\r\n\x1a\n", "truncated"), (b"hello", "is not a PNG or JPEG")]
)
def test_files_that_are_not_pictures(tmp_path: Path, content: bytes, about: str) -> None:
    (tmp_path / "a.png").write_bytes(content)
    assert about in error_of(tmp_path / "a.png").what


def test_the_content_decides_whatever_the_name(tmp_path: Path) -> None:
    file = saved(tmp_path / "a.png", CODES).rename(tmp_path / "a.scan")
    assert read_scene(file, mean_luminance_cd_m2=1).shape == (9, 13)


def test_a_jpeg_is_oriented_by_exif(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # the camera was held upright
    flat = np.full((8, 16, 3), 200, np.uint8)
    scene = read_scene(saved(tmp_path / "a.jpg", flat, exif=exif, quality=95), mean_luminance_cd_m2=1)
    assert scene.shape == (16, 8)


def test_grays_palettes_and_opaque_alpha_are_colors(tmp_path: Path) -> None:
    gray = CODES[:, :, 0]
    wanted = from_rgb(np.repeat(gray[:, :, None], 3, axis=2)).weights
    deep = Image.fromarray(gray.astype(np.uint16) * 257)
    deep.save(tmp_path / "deep.png")
    Image.fromarray(gray).convert("P").save(tmp_path / "p.png")
    alpha = np.dstack([gray, gray, gray, np.full_like(gray, 255)])
    for file in (
        saved(tmp_path / "l.png", gray),
        tmp_path / "deep.png",
        tmp_path / "p.png",
        saved(tmp_path / "alpha.png", alpha),
    ):
        np.testing.assert_allclose(read_scene(file, mean_luminance_cd_m2=40).weights, wanted, atol=1e-7)


def test_colors_outside_srgb_are_clipped_on_request(tmp_path: Path, profile: Profile) -> None:
    """Display P3, whose green is beyond sRGB's."""
    codes = np.full((5, 7, 3), 120, np.uint8)
    codes[0, 0] = 0, 255, 0
    file = saved(tmp_path / "wide.png", codes, icc_profile=profile("", "Display P3"))
    error_of(file)
    clipped = read_scene(file, mean_luminance_cd_m2=40, out_of_gamut="clip")
    wanted = from_rgb(codes, space="Display P3", out_of_gamut="clip")
    np.testing.assert_array_equal(clipped.weights, wanted.weights)
    np.testing.assert_array_equal(clipped.weights[[0, 2], 0, 0], 0)
    macbeth(mean_luminance_cd_m2=40).save(tmp_path / "chart.h5")
    assert "out_of_gamut" in str(error_of(tmp_path / "chart.h5", mean_luminance_cd_m2=None, out_of_gamut="clip"))
    with raises(InputError, "out_of_gamut", value="cut"):
        read_scene(file, out_of_gamut="cut")


def test_profiles_of_known_spaces(tmp_path: Path, profile: Profile) -> None:
    codes = np.clip(CODES, 90, 160)
    plain = read_scene(
        saved(tmp_path / "s.png", codes, icc_profile=profile("GIMP built-in sRGB")), mean_luminance_cd_m2=40
    )
    np.testing.assert_array_equal(plain.weights, from_rgb(codes).weights)
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
    ("make", "about"),
    [
        (lambda p: saved(p / "a.png", CODES, icc_profile=b"nothing"), "ICC profile"),
        (lambda p: png_with_chunk(p / "a.png", b"gAMA", struct.pack(">I", 100_000)), "gamma (gAMA)"),
        (lambda p: png_with_chunk(p / "a.png", b"cICP", b"\x09\x10\0\x01"), "cICP"),
        (lambda p: uncalibrated(p / "a.jpg"), "not sRGB"),
        (lambda p: saved(p / "a.png", np.dstack([CODES, CODES[:, :, :1]])), TRANSPARENT),
        (lambda p: saved(p / "a.png", np.zeros((4, 4, 3), np.uint8)), "black"),
    ],
)
def test_unsupported_pictures(tmp_path: Path, make: object, about: str) -> None:
    assert about in error_of(make(tmp_path)).what  # type: ignore[operator]


def test_cmyk_is_an_error(tmp_path: Path) -> None:
    Image.fromarray(CODES).convert("CMYK").save(tmp_path / "a.jpg")
    assert (error_of(tmp_path / "a.jpg").what, error_of(tmp_path / "a.jpg").value) == ("colors", "CMYK")


def test_required_and_inapplicable_options(tmp_path: Path) -> None:
    file = saved(tmp_path / "a.png", CODES)
    assert "mean_luminance_cd_m2" in error_of(file, mean_luminance_cd_m2=None).arguments
    assert "units" in error_of(file, units="W/sr/m2/nm").arguments


@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_damaged_pictures_are_an_error(tmp_path: Path, name: str) -> None:
    whole = saved(tmp_path / name, CODES).read_bytes()
    for count in (20, 60, len(whole) // 2, len(whole) - 30):
        (tmp_path / name).write_bytes(whole[:count])
        error_of(tmp_path / name)


def test_missing_rows_are_an_error(tmp_path: Path) -> None:
    """Pillow reads them as black."""
    whole = saved(tmp_path / "a.png", CODES).read_bytes()
    head = b"IHDR" + struct.pack(">II", 13, 10) + whole[24:29]
    (tmp_path / "a.png").write_bytes(whole[:12] + head + struct.pack(">I", zlib.crc32(head)) + whole[33:])
    assert "is damaged" in error_of(tmp_path / "a.png").what
