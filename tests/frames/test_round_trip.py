"""Frames are read back as they were saved, in every format; damaged files raise one error."""

from __future__ import annotations

import json
import random
import re
import warnings
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from PIL import Image
from raising import raises

from photosite.errors import FileError, InputError
from photosite.frames.io.format_table import FORMATS, Format
from photosite.frames.io.formats import detect_format, read_headers, read_raw
from photosite.frames.raw_frame import RawFrame
from photosite.values.cfa import cfa_from

ENDINGS = ("dng", "tif", "png", "h5")


def make_frame(shape=(31, 27), *, bits=12, cfa="rggb", seed=1, **fields) -> RawFrame:
    dn = np.random.default_rng(seed).integers(0, 1 << bits, shape, dtype=np.uint16)
    dn[0, :2] = 0, (1 << bits) - 1
    return RawFrame(dn, bits=bits, cfa=cfa_from(cfa), **fields)


def assert_same(one: RawFrame, other: RawFrame) -> None:
    assert one.dn.dtype == np.uint16
    assert np.array_equal(one.dn, other.dn)
    for name in ("bits", "cfa", "black_level_dn", "white_level_dn", "exposure_s", "metadata"):
        assert getattr(one, name) == getattr(other, name), name
    for name in ("color_matrix", "noise_profile"):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        assert a is None or np.array_equal(a, b), name


@pytest.mark.parametrize("ending", [*ENDINGS, "tiff", "DNG", "hdf5"])
@pytest.mark.parametrize(("cfa", "bits"), [("mono", 10), ("rggb", 12), ("bggr", 14), ("gbrg", 16), ("grbg", 12)])
def test_round_trip_keeps_everything(tmp_path, ending, cfa, bits):
    channels = 1 if cfa == "mono" else 3
    rng = np.random.default_rng(2)
    frame = make_frame(
        bits=bits,
        cfa=cfa,
        black_level_dn=64.3,
        white_level_dn=float((1 << bits) - 7),
        exposure_s=1 / 8000,
        color_matrix=np.eye(3) + rng.normal(0, 0.05, (3, 3)) if channels == 3 else None,
        noise_profile=rng.uniform(1e-6, 1e-3, (channels, 2)),
        metadata=MappingProxyType({"camera": "Nikon D200 µ", "iso": 100, "temperature_c": 21.3, "seed": 2**63 + 1}),
    )
    frame.save(tmp_path / f"a.{ending}")
    assert_same(read_raw(tmp_path / f"a.{ending}"), frame)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("shape", [(22, 22), (23, 22), (45, 101)])
def test_round_trip_of_a_plain_frame(tmp_path, ending, shape):
    frame = make_frame(shape, cfa="mono", bits=8)
    frame.save(tmp_path / f"a.{ending}")
    assert_same(read_raw(tmp_path / f"a.{ending}"), frame)


@pytest.mark.parametrize("ending", ["tif", "png", "h5"])
@pytest.mark.parametrize("cfa", [[["R"]], [["R", "G", "B"]], [["R", "G"], ["G", "W"]]])
def test_any_tile_except_in_dng(tmp_path, ending, cfa):
    frame = make_frame((1, 5), cfa=cfa)
    frame.save(tmp_path / f"a.{ending}")
    assert_same(read_raw(tmp_path / f"a.{ending}"), frame)


@pytest.mark.parametrize("ending", ENDINGS)
def test_arrays_in_any_memory_order(tmp_path, ending):
    frame = make_frame((40, 60))
    turned = RawFrame(frame.dn.T[::-1], bits=12)
    turned.save(tmp_path / f"a.{ending}")
    assert np.array_equal(read_raw(tmp_path / f"a.{ending}").dn, turned.dn)


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_header_needs_no_pixels(tmp_path, ending):
    frame = make_frame((31, 27), exposure_s=0.25)
    frame.save(tmp_path / f"a.{ending}")
    (header,) = read_headers(tmp_path / f"a.{ending}")
    assert (header.rows, header.cols, header.bits, header.cfa, header.exposure_s) == (31, 27, 12, frame.cfa, 0.25)


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_same_frame_gives_the_same_bytes(tmp_path, ending):
    """No time stamp, random number or temporary name is in the file."""
    frame = make_frame((24, 24), metadata=MappingProxyType({"seed": 3}))
    for name in ("a", "b"):
        frame.save(tmp_path / f"{name}.{ending}")
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_content_decides_the_format(tmp_path, ending):
    frame = make_frame()
    frame.save(tmp_path / f"a.{ending}")
    (tmp_path / f"a.{ending}").rename(tmp_path / "a.data")
    assert_same(read_raw(tmp_path / "a.data"), frame)


def test_saving_with_another_ending_is_refused(tmp_path):
    with raises(InputError, "path", value="a.jpg"):
        make_frame().save(tmp_path / "a.jpg")


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("metadata", [{"a": [1]}, {"a": None}, {"a": float("nan")}])
def test_unsupported_metadata_raise_and_the_old_file_stays(tmp_path, ending, metadata):
    path = tmp_path / f"a.{ending}"
    path.write_bytes(b"before")
    with raises(InputError, "metadata['a']"):
        make_frame(metadata=MappingProxyType(metadata)).save(path)
    assert path.read_bytes() == b"before"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_failing_writer_leaves_nothing(tmp_path, ending, monkeypatch):
    """The disk is full after the pixels are written: the old frame stays and no partial file is left."""
    path = tmp_path / f"a.{ending}"
    old = make_frame(seed=5)
    old.save(path)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("photosite.files.writing.os.replace", full)
    with raises(FileError, "cannot be written: No space left", path=str(path)):
        make_frame(seed=6).save(path)
    assert_same(read_raw(path), old)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_saving_into_a_missing_folder(tmp_path):
    with raises(FileError, "cannot be written"):
        make_frame().save(tmp_path / "nowhere" / "a.png")


# Files of other origin.


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize(("dtype", "bits"), [(np.uint8, 8), (np.uint16, 16)])
def test_plain_files_have_as_many_bits_as_they_store(tmp_path, ending, dtype, bits):
    dn = np.random.default_rng(3).integers(0, 1 << bits, (9, 11)).astype(dtype)
    Image.fromarray(dn).save(tmp_path / f"a.{ending}")
    frame = read_raw(tmp_path / f"a.{ending}")
    assert np.array_equal(frame.dn, dn)
    assert (frame.bits, frame.black_level_dn, frame.exposure_s, frame.is_mosaic) == (bits, 0.0, None, False)


@pytest.mark.parametrize("compression", ["tiff_adobe_deflate", "packbits"])
def test_compressed_tiff(tmp_path, compression):
    dn = np.random.default_rng(3).integers(0, 65536, (50, 61)).astype(np.uint16)
    Image.fromarray(dn).save(tmp_path / "a.tif", compression=compression)
    assert np.array_equal(read_raw(tmp_path / "a.tif").dn, dn)


@pytest.mark.parametrize("options", [{"byteorder": ">"}, {"rowsperstrip": 7}, {"tile": (16, 32)}, {"bigtiff": True}])
def test_tiff_in_its_variants(tmp_path, options):
    import tifffile

    dn = np.random.default_rng(4).integers(0, 65536, (50, 61)).astype(np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", **options)
    assert np.array_equal(read_raw(tmp_path / "a.tif").dn, dn)


def test_bits_and_cfa_from_the_caller(tmp_path):
    Image.fromarray(np.full((4, 4), 4095, np.uint16)).save(tmp_path / "a.png")
    frame = read_raw(tmp_path / "a.png", bits=12, cfa="bggr")
    assert (frame.bits, frame.white_level_dn, frame.channels) == (12, 4095.0, ("B", "G", "R"))


def test_file_and_caller_contradict(tmp_path):
    make_frame(bits=12, cfa="rggb").save(tmp_path / "a.png")
    with raises(FileError, "bits", value=14):
        read_raw(tmp_path / "a.png", bits=14)
    with raises(FileError, "cfa", value="BG/GR"):
        read_raw(tmp_path / "a.png", cfa="bggr")
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "b.png")
    with raises(FileError, "bits", value=12):
        read_raw(tmp_path / "b.png", bits=12)
    with raises(InputError, "bits", value=25):
        read_raw(tmp_path / "b.png", bits=25)


def test_numbers_above_the_bits_are_refused(tmp_path):
    Image.fromarray(np.full((4, 4), 4096, np.uint16)).save(tmp_path / "a.png")
    with raises(FileError, "dn", value=4096):
        read_raw(tmp_path / "a.png", bits=12)


def test_exposure_time_of_a_tiff(tmp_path):
    import tifffile

    tag = (33434, "2I", 1, (1, 250), True)
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((4, 4), np.uint16), photometric="minisblack", extratags=[tag])
    assert read_raw(tmp_path / "a.tif").exposure_s == 1 / 250


# Wrong files.


def other_kind(path: Path, kind: str) -> None:
    grey = Image.fromarray(np.zeros((8, 8), np.uint8))
    match kind:
        case "rgb.png" | "rgb.tif" | "picture.jpg":
            grey.convert("RGB").save(path)
        case "palette.png":
            grey.convert("P").save(path)
        case "alpha.png":
            grey.convert("LA").save(path)
        case "one-bit.png" | "one-bit.tif":
            grey.convert("1").save(path)
        case "pages.tif":
            grey.save(path, save_all=True, append_images=[grey])
        case "text.dng" | "text.nef" | "text.png" | "text.txt":
            path.write_text("photosite_protocol: 1\n" * 20)
        case "empty.dng" | "empty.nef" | "empty.png":
            path.touch()
        case "folder.dng":
            path.mkdir()


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("rgb.png", "RGB"),
        ("rgb.tif", "RGB with 3 samples"),
        ("picture.jpg", "is a JPEG"),
        ("palette.png", "a palette"),
        ("alpha.png", "gray with alpha"),
        ("one-bit.png", "1 bits"),
        ("one-bit.tif", "1 bits"),
        ("text.dng", "is not a frame"),
        ("text.png", "is not a frame"),
        ("text.txt", "is not a frame"),
        ("text.nef", "LibRaw cannot open|cannot be decoded"),
        ("empty.dng", "is empty"),
        ("empty.nef", "is empty"),
        ("empty.png", "is empty"),
        ("folder.dng", "is a folder"),
        ("missing.dng", "there is no such file"),
    ],
)
def test_files_that_are_not_frames(tmp_path, name, why):
    path = tmp_path / name
    other_kind(path, name)
    for read in (read_raw, read_headers):
        with pytest.raises(FileError, match=f"{re.escape(str(path))}: .*({why})") as caught:
            read(path)
        assert "\n" not in str(caught.value)
        assert caught.value.__suppress_context__ or caught.value.__context__ is None


EVERY_BYTE = pytest.param(1, marks=pytest.mark.slow)


@pytest.mark.parametrize("step", [7, EVERY_BYTE])
@pytest.mark.parametrize("ending", ENDINGS)
def test_truncated_anywhere(tmp_path, ending, step):
    make_frame((22, 23), exposure_s=0.1, metadata=MappingProxyType({"camera": "a"})).save(tmp_path / f"a.{ending}")
    whole = (tmp_path / f"a.{ending}").read_bytes()
    cut = tmp_path / f"cut.{ending}"
    for length in (*range(0, len(whole), step), len(whole) - 1):
        cut.write_bytes(whole[:length])
        with pytest.raises(FileError) as caught:
            read_raw(cut)
        assert "\n" not in str(caught.value)
        with pytest.raises(FileError):
            read_headers(cut)


@pytest.mark.parametrize("step", [7, EVERY_BYTE])
@pytest.mark.parametrize("ending", ["png", "tif"])
def test_truncated_anywhere_in_files_of_other_programs(tmp_path, ending, step):
    """Pillow writes a TIFF's directory before the strips, and its values after it."""
    image = Image.fromarray(np.random.default_rng(5).integers(0, 65536, (22, 23)).astype(np.uint16))
    image.save(tmp_path / f"a.{ending}")
    whole = (tmp_path / f"a.{ending}").read_bytes()
    assert np.array_equal(read_raw(tmp_path / f"a.{ending}").dn, np.asarray(image))
    for length in (*range(0, len(whole), step), len(whole) - 1):
        (tmp_path / f"cut.{ending}").write_bytes(whole[:length])
        with pytest.raises(FileError):
            read_raw(tmp_path / f"cut.{ending}")


@pytest.mark.parametrize("step", [11, pytest.param(3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("ending", ENDINGS)
def test_damage_is_a_frame_or_a_file_error(tmp_path, ending, step):
    """Single flipped bits never raise another library's exception. PNG's checksums always detect them."""
    frame = make_frame((22, 23), bits=16, exposure_s=0.1, color_matrix=np.eye(3))
    frame.save(tmp_path / f"a.{ending}")
    whole = (tmp_path / f"a.{ending}").read_bytes()
    dice = random.Random(7)
    found = 0
    places = range(0, len(whole), step)
    for at in places:
        damaged = bytearray(whole)
        damaged[at] ^= 1 << dice.randrange(8)
        (tmp_path / f"b.{ending}").write_bytes(damaged)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # without its description it is a DNG of another program
            try:
                read_raw(tmp_path / f"b.{ending}")
            except FileError:
                found += 1
    assert found == len(places) if ending == "png" else found > 0


def test_damaged_descriptions(tmp_path):
    make_frame().save(tmp_path / "a.tif")
    whole = (tmp_path / "a.tif").read_bytes()
    for old, new in ((b'"bits": 12', b'"bats": 12'), (b'"cfa": [[', b'"cfa": 1[')):
        (tmp_path / "b.tif").write_bytes(whole.replace(old, new))
        with raises(FileError, "the description of the frame is damaged"):
            read_raw(tmp_path / "b.tif")
    (tmp_path / "c.tif").write_bytes(whole.replace(b'_frame": 1', b'_frame": 2'))
    with raises(FileError, "photosite_frame", value=2):
        read_raw(tmp_path / "c.tif")


def test_the_description_is_json_that_other_programs_can_read(tmp_path):
    """It is in TIFF's ImageDescription and in PNG's text chunk 'photosite'."""
    frame = make_frame(black_level_dn=64.25)
    frame.save(tmp_path / "a.tif")
    frame.save(tmp_path / "a.png")
    with Image.open(tmp_path / "a.tif") as tiff, Image.open(tmp_path / "a.png") as png:
        assert json.loads(tiff.tag_v2[270]) == json.loads(png.text["photosite"])
        assert json.loads(tiff.tag_v2[270])["black_level_dn"] == 64.25


@pytest.mark.parametrize("format", FORMATS, ids=lambda format: format.module)
def test_each_format_has_its_functions(format: Format) -> None:
    module = format.load()
    assert hasattr(module, "read_headers")
    assert hasattr(module, "read_pixels") != hasattr(module, "read_frame")
    assert hasattr(module, "write") == bool(format.writes)
    assert format.signatures or hasattr(module, "recognizes")
    assert set(format.writes) <= set(format.suffixes)


def test_formats_by_magic(tmp_path):
    for head, kind in (
        (b"FUJIFILMCCD-RAW 0201", "camera raw"),
        (b"IIRO\x08\0\0\0", "camera raw"),
        (b"\0\0\0\x18ftypcrx \0\0\0\x01", "camera raw"),
        (b"\x89PNG\r\n\x1a\n", "PNG"),
    ):
        (tmp_path / "a").write_bytes(head)
        assert detect_format(tmp_path / "a").name == kind
