"""TIFF of several pages, compressed TIFF, and the tags of cameras."""

from __future__ import annotations

import struct

import imagecodecs
import numpy as np
import pytest
import tifffile
from raising import raises

from photosite.errors import FileError, InputError
from photosite.frames.frame_file import describe_frame
from photosite.frames.from_files import EXPOSURE_HINT
from photosite.frames.io import tiff
from photosite.frames.io.formats import read_headers, read_raw
from photosite.frames.open import open_frames
from photosite.frames.raw_frame import RawFrame


def pages(count=4, seed=0):
    return np.random.default_rng(seed).integers(0, 4096, (count, 20, 24)).astype(np.uint16)


@pytest.mark.parametrize(
    "options", [{}, {"compression": "zlib"}, {"bigtiff": True}, {"byteorder": ">"}, {"tile": (16, 16)}]
)
def test_pages_are_a_burst(tmp_path, options):
    data = pages()
    tifffile.imwrite(tmp_path / "dark_10ms.tif", data, photometric="minisblack", **options)
    frames = open_frames(tmp_path, bits=12)
    (group,) = frames.groups
    assert (group.kind, group.exposure_s, len(group)) == ("dark", 0.01, 4)
    assert np.array_equal(np.stack(list(group)), data)
    assert group.frames[3].name == f"{tmp_path / 'dark_10ms.tif'}[3]"
    assert np.array_equal(read_raw(tmp_path / "dark_10ms.tif", index=2).dn, data[2])
    with raises(FileError, "the file holds 4 frames"):
        read_raw(tmp_path / "dark_10ms.tif")


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    "options",
    [
        {"compression": "lzw"},
        {"compression": "lzw", "predictor": True},
        {"compression": "deflate"},
        {"compression": "deflate", "predictor": True, "tile": (16, 16)},
        {"compression": "packbits", "rowsperstrip": 7},
        {"compression": "zstd"},
    ],
)
def test_compressed_frames_are_read(tmp_path, options, bits):
    dn = (pages(1)[0] >> (16 - bits if bits == 8 else 0)).astype(f"u{bits // 8}")
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", **options)
    frame = read_raw(tmp_path / "a.tif")
    assert (frame.bits, frame.dn.dtype) == (bits, np.uint16)
    assert np.array_equal(frame.dn, dn)


@pytest.mark.parametrize("bits", [8, 16])
def test_lossless_jpeg_is_read(tmp_path, bits):
    """As cameras and scanners write it: compression 7 with frames of type SOF3."""
    dn = (pages(1)[0] >> (16 - bits if bits == 8 else 0)).astype(f"u{bits // 8}")
    strip = imagecodecs.ljpeg_encode(dn, bitspersample=bits)
    tifffile.imwrite(
        tmp_path / "a.tif", iter([strip]), shape=dn.shape, dtype=dn.dtype, photometric="minisblack", compression=7
    )
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["BitsPerSample"].overwrite(bits)
    assert np.array_equal(read_raw(tmp_path / "a.tif").dn, dn)


@pytest.mark.parametrize("compression", ["lzw", "deflate", "packbits"])
@pytest.mark.parametrize("keep", [0.5, 0.9])
def test_truncated_compressed_frames_are_an_error(tmp_path, compression, keep):
    """The directory lies before the data, so that the file still lists."""
    tifffile.imwrite(tmp_path / "a.tif", pages(1)[0], photometric="minisblack", compression=compression)
    content = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(content[: int(keep * len(content))])
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.tif")
    assert "is truncated" in caught.value.what


def test_a_page_costs_its_own_directory(tmp_path, monkeypatch):
    """Reading the last of many pages walks no chain."""
    tifffile.imwrite(tmp_path / "dark_1s.tif", pages(50), photometric="minisblack")
    frames = open_frames(tmp_path)
    monkeypatch.setattr(tiff, "read_directories", lambda path: pytest.fail("the chain was walked"))
    assert np.array_equal(frames.groups[0].frames[49].read(), pages(50)[49])


def test_pages_without_metadata_use_those_of_the_first(tmp_path):
    """Exposure and ISO of each page, and photosite's own description of the first."""
    data = pages(3)
    first = describe_frame(RawFrame(data[0], bits=12, exposure_s=0.1, black_level_dn=64.0))
    with tifffile.TiffWriter(tmp_path / "dark.tif") as file:
        file.write(data[0], description=first, metadata=None)
        file.write(data[1], metadata=None, extratags=[(33434, "2I", 1, (1, 4), True), (34855, "H", 1, 400, True)])
        file.write(data[2], metadata=None)
    headers = read_headers(tmp_path / "dark.tif")
    assert [(h.exposure_s, h.metadata.get("iso"), h.bits) for h in headers] == [
        (0.1, None, 12),
        (0.25, 400, 12),
        (0.1, None, 12),
    ]
    assert [g.exposure_s for g in open_frames(tmp_path).groups] == [0.1, 0.25]


def test_smaller_versions_are_no_frames(tmp_path):
    data = pages(1)[0]
    with tifffile.TiffWriter(tmp_path / "dark_1s.tif") as file:
        file.write(data, metadata=None)
        file.write(data[::2, ::2], subfiletype=1, metadata=None)
    assert np.array_equal(read_raw(tmp_path / "dark_1s.tif").dn, data)


def test_pages_of_two_sizes(tmp_path):
    with tifffile.TiffWriter(tmp_path / "dark_1s.tif") as file:
        file.write(pages(1)[0], metadata=None)
        file.write(pages(1)[0, 1:], metadata=None)
    with raises(FileError, "the size is 19 x 24, but", path=f"{tmp_path / 'dark_1s.tif'}[1]"):
        open_frames(tmp_path)


def test_an_imagej_stack_without_directories(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif", pages(1)[0], metadata=None, description="ImageJ=1.54f\nimages=300\nslices=300\n"
    )
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.tif")
    assert "ImageJ stack of 300 frames" in caught.value.what
    assert caught.value.hint is not None


def test_iso_beyond_sixteen_bits(tmp_path):
    """Exif 2.3: PhotographicSensitivity stays at 65535, RecommendedExposureIndex goes on."""
    tags = [(34855, "H", 1, 65535, True), (34866, "I", 1, 102400, True), (33434, "2I", 1, (1, 8000), True)]
    tifffile.imwrite(tmp_path / "dark.tif", pages(1)[0], metadata=None, extratags=tags)
    assert [(g.gain_setting, g.exposure_s) for g in open_frames(tmp_path).groups] == [(102400.0, 1 / 8000)]


def test_pieces_that_do_not_make_the_page(tmp_path):
    """A damaged height would have a decoder look for strips that are not there, one after another."""
    tifffile.imwrite(tmp_path / "a.tif", pages(1)[0], compression="zlib", rowsperstrip=5)
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["ImageLength"].overwrite(20_000)
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "a.tif")
    assert caught.value.what == "is damaged: 20000 x 24 pixels need 4000 strips or tiles, the file has 4"
    tifffile.imwrite(tmp_path / "b.tif", pages(1)[0], compression="zlib")
    with tifffile.TiffFile(tmp_path / "b.tif", mode="r+") as file:
        for name in ("ImageLength", "RowsPerStrip"):
            file.pages.first.tags[name].overwrite(2_000_000)
    with pytest.raises(FileError) as caught:
        read_raw(tmp_path / "b.tif")
    assert caught.value.what.endswith("cannot hold 2000000 x 24 pixels")


def test_places_that_are_no_whole_numbers_are_refused(tmp_path):
    """A damaged field type makes a float of an offset."""
    path = tmp_path / "a.tif"
    RawFrame(np.full((4, 6), 64, np.uint16), bits=12).save(path)
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<HH", 273, 4))  # StripOffsets, LONG
    content[at + 2 : at + 4] = struct.pack("<H", 11)  # FLOAT
    path.write_bytes(content)
    with pytest.raises(FileError) as caught:
        read_raw(path)
    assert (caught.value.what, caught.value.expected) == ("tag 273", "a whole number of 0 or more")


@pytest.mark.parametrize("orientation", [1, 6])
def test_the_orientation_turns_the_picture_and_not_the_frame(tmp_path, orientation):
    """TIFF 6.0, tag 274: 6 is a picture whose first stored row is its right side."""
    from click.testing import CliRunner
    from PIL import Image

    from photosite.cli.develop import command

    values = np.zeros((24, 40), np.uint16)
    values[:, 30:] = 60000
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", extratags=[(274, 3, 1, orientation, True)])
    assert np.array_equal(read_raw(tmp_path / "a.tif").dn, values)
    picture = tmp_path / "a.png"
    done = CliRunner().invoke(command, [str(tmp_path / "a.tif"), "-o", str(picture), "--brightness", "1"])
    assert done.exit_code == 0, done.output
    gray = np.asarray(Image.open(picture))[..., 0] > 100
    assert np.array_equal(gray, values > 0 if orientation == 1 else np.rot90(values > 0, -1))


def test_another_orientation_is_noted_and_pixels_are_read_as_they_are_stored(tmp_path):
    stack = np.arange(3 * 64, dtype=np.uint16).reshape(3, 8, 8)
    for number, dn in enumerate(stack):
        extra = [(274, "H", 1, 3, True)] if number == 1 else []
        tifffile.imwrite(tmp_path / f"dark_1s_{number}.tif", dn, extratags=extra, metadata=None)
    frames = open_frames(tmp_path)
    assert np.array_equal(np.stack(list(frames.groups[0])), stack)
    (entry,) = (entry for entry in frames.diagnostics if entry.id == "other-orientation")
    assert (entry.size, "dark_1s_1.tif" in entry.text) == (1, True)


STACK = np.random.default_rng(2).integers(60, 900, (3, 8, 9)).astype(np.uint16)


@pytest.mark.parametrize(
    ("times", "unit", "exposures"),
    [
        ([20.0] * 3, ["ms"] * 3, [0.02] * 3),
        ([0.5] * 3, None, [0.5] * 3),
        ([10.0, 20.0, 40.0], ["ms"] * 3, [0.01, 0.02, 0.04]),
        ([250.0] * 3, ["µs"] * 3, [0.00025] * 3),
    ],
)
def test_exposures_of_ome(tmp_path, times, unit, exposures):
    plane = {"ExposureTime": times, **({} if unit is None else {"ExposureTimeUnit": unit})}
    metadata = {"axes": "TYX", "SignificantBits": 12, "Plane": plane}
    tifffile.imwrite(tmp_path / "a.ome.tif", STACK, photometric="minisblack", ome=True, metadata=metadata)
    headers = read_headers(tmp_path / "a.ome.tif")
    assert [header.exposure_s for header in headers] == pytest.approx(exposures)
    assert {header.bits for header in headers} == {12}
    np.testing.assert_array_equal(read_raw(tmp_path / "a.ome.tif", index=1).dn, STACK[1])


@pytest.mark.parametrize("bits", [16, 0, 99])
def test_bits_of_ome_that_say_nothing(tmp_path, bits):
    metadata = {"axes": "TYX", "SignificantBits": bits}
    tifffile.imwrite(tmp_path / "a.ome.tif", STACK, photometric="minisblack", ome=True, metadata=metadata)
    assert {(header.bits, header.exposure_s) for header in read_headers(tmp_path / "a.ome.tif")} == {(None, None)}


def test_exposure_of_micro_manager(tmp_path):
    text = b'{"Camera": "Andor", "Exposure-ms": 20.5, "Binning": "1"}\0'
    tags = [(51123, 2, len(text), text, False)]
    tifffile.imwrite(tmp_path / "img.tif", STACK, photometric="minisblack", metadata=None, extratags=tags)
    assert {header.exposure_s for header in read_headers(tmp_path / "img.tif")} == {0.0205}


def test_the_exposure_of_files_that_state_none(tmp_path):
    for name in ("dark", "level1", "level2"):
        tifffile.imwrite(tmp_path / f"{name}.tif", STACK, photometric="minisblack")
    with raises(FileError, "the file and name do not state the exposure time", hint=EXPOSURE_HINT) as caught:
        open_frames(tmp_path)
    assert caught.value.arguments == {"exposure_s": 0.02}
    frames = open_frames(tmp_path, exposure_s=0.02, dark="dark*", light="level*")
    assert {group.exposure_s for group in frames.groups} == {0.02}
    tifffile.imwrite(tmp_path / "flat_10ms.tif", STACK, photometric="minisblack")
    times = [group.exposure_s for group in open_frames(tmp_path, exposure_s=0.02, light="level*").groups]
    assert sorted(times) == [0.01, 0.02, 0.02, 0.02]
    with raises(InputError, "exposure_s"):
        open_frames(tmp_path, exposure_s=-1)


def test_a_gray_page_behind_a_color_preview(tmp_path):
    """Gray pages keep their numbers; the color page is skipped as a thumbnail is, and refused by its kind."""
    data, file = pages(3), tmp_path / "dark_10ms.tif"
    with tifffile.TiffWriter(file) as writer:
        writer.write(np.zeros((5, 6, 3), np.uint8), photometric="rgb")
        for page in data[:2]:
            writer.write(page, photometric="minisblack")
    for number in (1, 2):
        assert np.array_equal(read_raw(f"{file}[{number}]").dn, data[number - 1])
    (group,) = open_frames(file, bits=12).groups
    assert [frame.name for frame in group.frames] == [f"{file}[1]", f"{file}[2]"]
    assert np.array_equal(np.stack(list(group)), data[:2])
    with raises(FileError, "pixels", value="RGB with 3 samples a pixel"):
        read_raw(f"{file}[0]")
    with raises(FileError, "the file holds 2 frames"):
        read_raw(file)


def test_one_page_of_several_is_no_measurement(tmp_path):
    file = tmp_path / "dark_10ms.tif"
    tifffile.imwrite(file, pages(4), photometric="minisblack")
    with raises(FileError, "the selection is one frame of 4", path=f"{file}[0]"):
        open_frames(f"{file}[0]", bits=12)
