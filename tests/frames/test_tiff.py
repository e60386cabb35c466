"""TIFF with several pages, and the tags of cameras."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import tifffile
from raising import raises

from photosite.errors import FileError
from photosite.frames.io import tiff
from photosite.frames.io.description import describe_frame
from photosite.frames.io.read import read_headers, read_raw
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
    with pytest.raises(FileError, match="is an ImageJ stack of 300 frames with one page; save it as an image sequence"):
        read_raw(tmp_path / "a.tif")


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
    with pytest.raises(FileError, match="its 20000 x 24 pixels are 4000 pieces, and 4 are there"):
        read_raw(tmp_path / "a.tif")
    tifffile.imwrite(tmp_path / "b.tif", pages(1)[0], compression="zlib")
    with tifffile.TiffFile(tmp_path / "b.tif", mode="r+") as file:
        for name in ("ImageLength", "RowsPerStrip"):
            file.pages.first.tags[name].overwrite(2_000_000)
    with pytest.raises(FileError, match="2000000 x 24 pixels cannot come out of"):
        read_raw(tmp_path / "b.tif")


def test_places_that_are_no_whole_numbers_are_refused(tmp_path):
    """A damaged field type makes a float of an offset."""
    path = tmp_path / "a.tif"
    RawFrame(np.full((4, 6), 64, np.uint16), bits=12).save(path)
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<HH", 273, 4))  # StripOffsets, LONG
    content[at + 2 : at + 4] = struct.pack("<H", 11)  # FLOAT
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"tag 273 is .*, not a whole number"):
        read_raw(path)
