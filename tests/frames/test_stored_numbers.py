"""Signed numbers, floats, numbers that wrapped, and numbers that are shifted: read where nothing is lost."""

from __future__ import annotations

import importlib
import pickle
import warnings

import h5py
import numpy as np
import pytest
import tifffile
from raising import raises

import photosite as ps
from photosite.errors import FileError, PhotositeWarning
from photosite.frames.stored_numbers import Conversion, NumberRange, conversion_of

fits = pytest.importorskip("astropy.io.fits")
DN = np.random.default_rng(1).integers(60, 4000, (12, 20)).astype(np.uint16)
DN[0, 1] = 60


def put(path, data):
    if path.suffix == ".fits":
        fits.PrimaryHDU(data).writeto(path)
    elif path.suffix == ".tif":
        tifffile.imwrite(path, data, photometric="minisblack", predictor=False)
    else:
        with h5py.File(path, "w") as file:
            file["frame"] = data
    return path


def read(path, **options):
    """Return a frame and the texts of its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", PhotositeWarning)
        frame = ps.read_raw(path, **options)
    return frame, [str(entry.message) for entry in caught]


@pytest.mark.parametrize("suffix", ["fits", "tif", "h5"])
@pytest.mark.parametrize("kind", ["int16", "int32", "float32", "float64", ">i2", ">f4"])
def test_whole_numbers_are_read_as_they_are(tmp_path, suffix, kind):
    frame, told = read(put(tmp_path / f"a.{suffix}", DN.astype(kind)), bits=12)
    np.testing.assert_array_equal(frame.dn, DN)
    assert (frame.dn.dtype, frame.bits, frame.black_level_dn, told) == (np.uint16, 12, 0.0, [])


@pytest.mark.parametrize("options", [{"compression": "zlib"}, {"compression": "zlib", "predictor": True}])
def test_compressed_floats(tmp_path, options):
    tifffile.imwrite(tmp_path / "a.tif", DN.astype(np.float32), photometric="minisblack", **options)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "a.tif").dn, DN)


@pytest.mark.parametrize("suffix", ["fits", "tif", "h5"])
def test_negative_numbers_are_kept(tmp_path, suffix):
    data = DN.astype(np.int32) - 100
    frame, told = read(put(tmp_path / f"a.{suffix}", data.astype(np.int16)))
    assert data.min() == -40
    np.testing.assert_array_equal(frame.dn.astype(int) - frame.black_level_dn, data)
    assert frame.black_level_dn == 64
    assert "64 is added to all numbers" in told[0]


@pytest.mark.parametrize("suffix", ["fits", "tif", "h5"])
def test_numbers_of_16_bits_that_wrapped(tmp_path, suffix):
    dn = np.random.default_rng(2).integers(0, 65536, DN.shape).astype(np.uint16)
    frame, told = read(put(tmp_path / f"a.{suffix}", dn.view(np.int16)))
    np.testing.assert_array_equal(frame.dn, dn)
    assert "they are read as 0 to 65535" in told[0]


@pytest.mark.parametrize(
    ("stored", "keywords"),
    [
        (DN.astype(np.int32), {"BZERO": 10.0}),
        ((DN % 100).astype(np.uint8), {"BZERO": -128.0}),
        ((DN // 2).astype(np.int16), {"BSCALE": 2.0}),
        ((DN // 2).astype(np.int16), {"BSCALE": 2.0, "BZERO": 1000.0}),
    ],
)
def test_scaled_numbers_of_fits(tmp_path, stored, keywords):
    unit = fits.PrimaryHDU(stored)
    unit.header.update(keywords)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fits.HDUList([unit]).writeto(tmp_path / "a.fits")
        raw = fits.open(tmp_path / "a.fits", do_not_scale_image_data=True)[0].data.astype(int)
    frame, _ = read(tmp_path / "a.fits", bits=13 if stored.dtype == np.int32 else None)
    physical = raw * keywords.get("BSCALE", 1) + keywords.get("BZERO", 0)
    np.testing.assert_array_equal(frame.dn.astype(int) - frame.black_level_dn, physical)


def test_fractions_are_rounded_with_a_warning(tmp_path):
    data = DN + np.float32(0.25)
    frame, told = read(put(tmp_path / "a.fits", data))
    np.testing.assert_array_equal(frame.dn, DN)
    assert "which are rounded: they were processed" in told[0]


def test_small_ranges_with_fractions_are_scaled(tmp_path):
    data = (DN / 65535).astype(np.float32)
    frame, told = read(put(tmp_path / "a.tif", data))
    np.testing.assert_array_equal(frame.dn, DN)
    assert "multiplied by 65535 and rounded" in told[0]


def test_a_set_has_one_conversion(tmp_path):
    """The lowest number of all frames decides; that of the first frames is higher."""
    for number, added in enumerate((-80, -100, -70)):
        put(tmp_path / f"{'dark' if number < 2 else 'flat'}_{number + 1}s.tif", DN.astype(np.int16) + added)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhotositeWarning)
        frames = ps.open_frames(tmp_path, bits=12)
    read_dn = {g.exposure_s: next(iter(g)).astype(int) for g in frames.groups}
    for exposure_s, added in ((1.0, -80), (2.0, -100), (3.0, -70)):
        np.testing.assert_array_equal(read_dn[exposure_s] - 64, DN.astype(int) + added)
    assert [entry.id for entry in frames.diagnostics] == ["negative-numbers"]
    assert frames.bits == 12


def test_the_bits_grow_with_the_constant(tmp_path):
    data = DN.astype(np.int16) - 100
    data[0, 0] = 4095
    put(tmp_path / "dark_1s.tif", data)
    frames = ps.open_frames(tmp_path, bits=12)
    assert frames.bits == 13
    assert next(iter(frames.groups[0])).max() == 4095 + 64


def test_numbers_shifted_by_bits(tmp_path):
    """The dark frame alone would fit the 12 bits."""
    dark = (DN % 200).astype(np.uint16)
    put(tmp_path / "dark_1s.tif", dark * 16)
    put(tmp_path / "flat_2s.tif", DN * 16)
    frames = ps.open_frames(tmp_path, bits=12)
    np.testing.assert_array_equal(next(iter(frames.groups[0])), dark)
    np.testing.assert_array_equal(next(iter(frames.groups[1])), DN)
    assert frames.groups[0].frames[0].open_rows() is None
    assert [(entry.id, entry.size) for entry in frames.diagnostics] == [("numbers-shifted-down", 4.0)]
    frame, told = read(tmp_path / "flat_2s.tif", bits=12)
    np.testing.assert_array_equal(frame.dn, DN)
    assert "shifted up by 4" in told[0]
    assert ps.open_frames(tmp_path).bits == 16
    put(tmp_path / "dark_3s.tif", dark)
    with raises(FileError, "dn", expected="multiples of 16, as in the other frames, whose numbers are shifted"):
        [*ps.open_frames(tmp_path, bits=12).groups[1]]


def test_numbers_above_the_bits_that_are_not_shifted(tmp_path):
    put(tmp_path / "dark_1s.tif", DN * 16 + 1)
    with raises(FileError, "dn", value=int(DN.max()) * 16 + 1, expected="at most 4095, for 12 bits"):
        [*ps.open_frames(tmp_path, bits=12).groups[0]]


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (np.where(DN.max() == DN, np.nan, DN).astype(np.float32), "the frame has pixels without a number"),
        (DN.astype(np.float32) * 100, "dn"),
        (DN.astype(np.complex64), "pixels"),
    ],
)
def test_numbers_that_are_refused(tmp_path, data, what):
    tifffile.imwrite(tmp_path / "a.tif", data, photometric="minisblack")
    with raises(FileError, what):
        ps.read_raw(tmp_path / "a.tif")


def test_fractions_that_the_first_frames_do_not_have(tmp_path):
    for number, data in enumerate((DN, DN + 0.5, DN)):
        put(tmp_path / f"dark_{number + 1}s.tif", data.astype(np.float32))
    frames = ps.open_frames(tmp_path)
    with raises(FileError, "the frame has numbers with fractions, and the frames that were read first have none"):
        [*frames.groups[1]]


def test_conversions():
    whole = NumberRange(-64.0, 100.0, True, 0)
    assert conversion_of(whole, "signed", None, 16) == Conversion(added=64)
    assert conversion_of(NumberRange(-65.0, 9.0, True, 0), "signed", None, 16).added == 128
    assert conversion_of(NumberRange(-16385.0, 9.0, True, 0), "signed", None, 32).added == 32768
    assert NumberRange.of("a", np.array([[16, 48]], np.uint16)).clear_bits == 4
    assert conversion_of(NumberRange(0.0, 4080.0, True, 4), "unsigned", 12, 16).plain


@pytest.mark.parametrize("level", [1, 6])
def test_numbers_below_zero_that_are_stored_as_unsigned_ones(tmp_path, level):
    """-1 is stored as 65535; the level of 6 has no number below 0."""
    rng = np.random.default_rng(1)
    signed = {}
    for name, signal in (("dark_1s_0", 0), ("dark_1s_1", 0), ("flat_1s_0", 20000), ("flat_1s_1", 20000)):
        numbers = np.rint(np.clip(rng.normal(level + signal, 2.0, (40, 50)), level + signal - 6, None)).astype(np.int16)
        signed[name] = numbers
        tifffile.imwrite(tmp_path / f"{name}.tif", numbers.view(np.uint16), photometric="minisblack")
    frames = ps.open_frames(tmp_path)
    added = 8 if level == 1 else 0
    read = {source.path.stem: source.read() for group in frames.groups for source in group.frames}
    for name, numbers in signed.items():
        np.testing.assert_array_equal(read[name], numbers.astype(int) + added)
    assert [entry.id for entry in frames.diagnostics if entry.id == "negative-numbers"] == ["negative-numbers"] * (
        level == 1
    )


def test_saturated_hot_pixels_are_not_below_zero(tmp_path):
    dark = np.random.default_rng(1).integers(0, 5, (40, 50)).astype(np.uint16)
    dark[::7, ::9] = 65535
    tifffile.imwrite(tmp_path / "dark_1s.tif", dark, photometric="minisblack")
    np.testing.assert_array_equal([*ps.open_frames(tmp_path).groups[0]], [dark])


def test_numbers_that_are_below_zero_in_the_dark_and_large_in_the_light(tmp_path):
    dark = np.rint(np.random.default_rng(1).normal(1.0, 2.0, (40, 50))).astype(np.int16).view(np.uint16)
    for name, numbers in (("dark_1s", dark), ("flat_1s", np.full((40, 50), 40000, np.uint16))):
        tifffile.imwrite(tmp_path / f"{name}.tif", numbers, photometric="minisblack")
    with raises(FileError, "dark frames have numbers below 0 that are stored as 65535 and less"):
        ps.open_frames(tmp_path)


@pytest.mark.parametrize("suffix", [".tif", ".fits"])
def test_a_set_is_decoded_once(tmp_path, monkeypatch, suffix):
    """The first dark frame, in which numbers below 0 are looked for, is not decoded again for its first read."""
    frames = [np.full((20, 30), 100 + n, np.uint16) for n in range(3)]
    for n, dn in enumerate(frames):
        path = tmp_path / f"dark_1s_{n}{suffix}"
        if suffix == ".tif":
            tifffile.imwrite(path, dn, compression="zlib")
        else:
            fits.PrimaryHDU(dn).writeto(path)
    reader = importlib.import_module({".tif": "photosite.frames.io.tiff", ".fits": "photosite.frames.io.fits"}[suffix])
    decoded = []
    plain = reader.read_pixels

    def counted(path, *arguments):
        decoded.append(path.name)
        return plain(path, *arguments)

    monkeypatch.setattr("photosite.files.small_files.SETTLED_NS", -1)
    monkeypatch.setattr(reader, "read_pixels", counted)
    (group,) = ps.open_frames(tmp_path).groups
    again = pickle.loads(pickle.dumps(group.frames[0]))
    for _ in range(2):
        np.testing.assert_array_equal([source.read() for source in group.frames], frames)
    assert [decoded.count(f"dark_1s_{n}{suffix}") for n in range(3)] == [2, 2, 2]
    np.testing.assert_array_equal(again.read(), frames[0])
