"""TIFF pages that would take much more memory or time than the file holds."""

import json
import tracemalloc

import imagecodecs
import numpy as np
import pytest
import tifffile
from raising import raises

from photosite import read_raw, read_scene
from photosite.errors import FileError

CODES = np.arange(12 * 16, dtype=np.uint8).reshape(12, 16)


def write_strip(path, strip, compression):
    tifffile.imwrite(
        path, iter([strip]), shape=CODES.shape, dtype=CODES.dtype, photometric="minisblack", compression=compression
    )


def read_picture(path):
    return read_scene(path, mean_luminance_cd_m2=40)


@pytest.mark.parametrize("read", [read_raw, read_picture])
def test_jpeg_larger_than_its_strip(tmp_path, read):
    strip = imagecodecs.jpeg8_encode(CODES)
    at = strip.index(b"\xff\xc0") + 5
    write_strip(tmp_path / "a.tif", strip, 7)
    read(tmp_path / "a.tif")
    write_strip(tmp_path / "a.tif", strip[:at] + b"\x40\x00\x40\x00" + strip[at + 4 :], 7)
    tracemalloc.start()
    with raises(FileError, "is damaged"):
        read(tmp_path / "a.tif")
    assert tracemalloc.get_traced_memory()[1] < 1 << 24
    tracemalloc.stop()


@pytest.mark.parametrize("read", [read_raw, read_picture])
def test_tiles_larger_than_the_file_holds(tmp_path, read):
    tifffile.imwrite(tmp_path / "a.tif", CODES, compression="zlib", tile=(16, 16), photometric="minisblack")
    read(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["TileWidth"].overwrite(65520)
        file.pages.first.tags["TileLength"].overwrite(65520)
    with raises(FileError, "is damaged"):
        read(tmp_path / "a.tif")


@pytest.mark.parametrize("read", [read_raw, read_picture])
def test_compressions_with_sizes_of_their_own_are_refused(tmp_path, read):
    write_strip(tmp_path / "a.tif", imagecodecs.jpeg2k_encode(CODES), 34712)
    with raises(FileError, "compression"):
        read(tmp_path / "a.tif")


@pytest.mark.parametrize("planes", [(40, 256), (3, 1024)])
@pytest.mark.parametrize("compression", ["zlib", "lzw", "packbits", "lzma", "zstd"])
def test_uniform_planes_of_many_bands(tmp_path, compression, planes):
    """Each strip holds one band: a few bytes where it is uniform."""
    bands, size = planes
    cube = np.full((bands, size, size), 7, np.uint16)
    description = json.dumps({"wavelength_nm": [400 + 10 * band for band in range(bands)], "units": "photons"})
    tifffile.imwrite(
        tmp_path / "a.tif",
        cube,
        photometric="minisblack",
        planarconfig="separate",
        compression=compression,
        description=description,
        metadata=None,
    )
    assert read_scene(tmp_path / "a.tif").shape == (size, size)


@pytest.mark.parametrize("value", [0, 700])
def test_a_uniform_frame_in_zstandard(tmp_path, value):
    dn = np.full((2048, 2048), value, np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", dn, photometric="minisblack", compression="zstd", rowsperstrip=2048)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        assert dn.nbytes > 10_000 * file.pages.first.databytecounts[0]
    assert (read_raw(tmp_path / "a.tif", bits=12).dn == value).all()


@pytest.mark.parametrize("sides", [(40_000, 20_000), (65_535, 65_535)])
@pytest.mark.parametrize("read", [read_raw, read_picture])
@pytest.mark.parametrize("compression", ["zlib", "lzma", "zstd"])
def test_few_bytes_that_ask_for_gigabytes(tmp_path, compression, read, sides):
    """The stored bytes are valid, and hold 64 rows of the stated size."""
    strip = np.zeros((64, sides[1]), np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", strip, photometric="minisblack", compression=compression, rowsperstrip=64)
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        for name in ("ImageLength", "RowsPerStrip"):
            file.pages.first.tags[name].overwrite(sides[0])
    tracemalloc.start()
    with pytest.raises(FileError):
        read(tmp_path / "a.tif")
    assert tracemalloc.get_traced_memory()[1] < 1 << 24
    tracemalloc.stop()


def test_pages_without_end(tmp_path):
    """Each directory points to the next, and the last to one in the middle."""
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((3, 12, 16), np.uint16), photometric="minisblack")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        offsets = [page.offset for page in file.pages]
    content = bytearray((tmp_path / "a.tif").read_bytes())
    count = int.from_bytes(content[offsets[-1] : offsets[-1] + 2], "little")
    link = offsets[-1] + 2 + 12 * count
    content[link : link + 4] = offsets[1].to_bytes(4, "little")
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(FileError):
        read_scene(tmp_path / "a.tif", units="photons", wavelength_nm=[500, 510, 520])
