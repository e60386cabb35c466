"""FITS as camera programs write it."""

from __future__ import annotations

import gzip
import sys

import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError
from photosite.frames.io.formats import read_headers, read_raw
from photosite.frames.open import open_frames
from photosite.values.cfa import cfa_from

fits = pytest.importorskip("astropy.io.fits")


def dn(seed=0, shape=(6, 8)):
    values = np.random.default_rng(seed).integers(0, 65536, shape).astype(np.uint16)
    values.flat[:2] = 0, 65535
    return values


def put(path, data, unit=None, **keywords):
    unit = fits.PrimaryHDU(data) if unit is None else unit
    for name, value in keywords.items():
        unit.header[name.replace("_", "-")] = value
    fits.HDUList([unit] if isinstance(unit, fits.PrimaryHDU) else [fits.PrimaryHDU(), unit]).writeto(path)


def test_a_frame_and_its_keywords(tmp_path):
    data = dn()
    put(
        tmp_path / "a.fits", data, EXPTIME=0.25, GAIN=120, CCD_TEMP=-10.1, IMAGETYP="Dark Frame", BAYERPAT="RGGB",
        XBAYROFF=1, INSTRUME="ZWO ASI",
    )  # fmt: skip
    assert fits.getheader(tmp_path / "a.fits")["BZERO"] == 32768
    frame = read_raw(tmp_path / "a.fits")
    assert np.array_equal(frame.dn, data)
    assert (frame.bits, frame.cfa, frame.exposure_s) == (16, cfa_from("grbg"), 0.25)
    (group,) = open_frames(tmp_path).groups
    assert (group.kind, group.exposure_s, group.gain_setting, group.temperature_c) == ("dark", 0.25, 120.0, -10.1)


def test_the_temperature_is_measured_or_else_the_one_that_was_set(tmp_path):
    put(tmp_path / "dark_a.fits", dn(), EXPTIME=1.0, SET_TEMP=-20.0)
    put(tmp_path / "light_a.fits", dn(1), EXPTIME=1.0, SET_TEMP=-20.0, CCD_TEMP=-18.5)
    assert [group.temperature_c for group in open_frames(tmp_path).groups] == [-20.0, -18.5]


@pytest.mark.parametrize(
    ("image_type", "kind"), [("BIAS", "dark"), ("Flat Field", "light"), ("Light Frame", "light"), ("dark", "dark")]
)
def test_kinds(tmp_path, image_type, kind):
    put(tmp_path / "a.fit", dn(), EXPOSURE=1.0, IMAGETYP=image_type)
    assert [g.kind for g in open_frames(tmp_path).groups] == [kind]


def test_an_ambiguous_kind_leaves_the_decision_to_the_name(tmp_path):
    put(tmp_path / "dark_1.fits", dn(), EXPTIME=1.0, IMAGETYP="Dark Flat")
    assert [g.kind for g in open_frames(tmp_path).groups] == ["dark"]


@pytest.mark.parametrize("compressed", [False, True])
def test_units_and_cubes_are_bursts(tmp_path, compressed):
    cube, single = dn(1, (5, 6, 8)), dn(2)
    kind = fits.CompImageHDU if compressed else fits.ImageHDU
    units = [fits.PrimaryHDU(), kind(cube), kind(single)]
    units[0].header.update({"EXPTIME": 0.5, "IMAGETYP": "DARK"})
    units[2].header["EXPTIME"] = 2.0
    fits.HDUList(units).writeto(tmp_path / "burst.fits")
    frames = open_frames(tmp_path / "burst.fits")
    assert [(g.kind, g.exposure_s, len(g)) for g in frames.groups] == [("dark", 0.5, 5), ("dark", 2.0, 1)]
    assert np.array_equal(np.stack(list(frames.groups[0])), cube)
    assert np.array_equal(next(iter(frames.groups[1])), single)
    assert frames.groups[0].frames[3].name.endswith("burst.fits[1, 3]")


def gzipped(path):
    path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()


def test_compressed_files_are_read_and_named_as_others(tmp_path):
    data = [dn(number, (20, 30)) for number in range(5)]
    for number in range(2):
        put(tmp_path / f"dark_{number}.fits", data[number], EXPTIME=1.0)
        put(tmp_path / f"flat_{number}.fit", data[2 + number], EXPTIME=1.0)
    for path in list(tmp_path.iterdir()):
        gzipped(path)
    put(tmp_path / "flat_3.fits.fz", None, fits.CompImageHDU(data[4]), EXPTIME=1.0)
    groups = open_frames(tmp_path).groups
    assert [(group.kind, len(group), group.level) for group in groups] == [("dark", 2, None), ("light", 3, None)]
    assert np.array_equal(np.stack(list(groups[1])), data[2:])
    assert np.array_equal(read_raw(tmp_path / "flat_0.fit.gz").dn, data[2])


def test_compressed_files_that_are_truncated_or_no_fits(tmp_path):
    put(tmp_path / "a.fits", dn(0, (40, 50)), EXPTIME=1.0)
    short = tmp_path / "short.fits"
    short.write_bytes((tmp_path / "a.fits").read_bytes()[:4000])
    gzipped(tmp_path / "a.fits")
    gzipped(short)
    whole = (tmp_path / "a.fits.gz").read_bytes()
    (tmp_path / "other.fits.gz").write_bytes(gzip.compress(b"text"))
    with raises(FileError, "the file is truncated", path=str(tmp_path / "short.fits.gz")):
        read_raw(tmp_path / "short.fits.gz")
    with raises(FileError, "the file is not a frame"):
        read_raw(tmp_path / "other.fits.gz")
    for length in [*range(1, len(whole), 97), len(whole) - 30]:
        (tmp_path / "b.fits.gz").write_bytes(whole[:length])
        with pytest.raises(FileError):
            read_raw(tmp_path / "b.fits.gz")


def test_eight_and_signed_bits(tmp_path):
    put(tmp_path / "a.fits", dn().astype(np.uint8))
    assert np.array_equal(read_raw(tmp_path / "a.fits").dn, dn().astype(np.uint8))
    assert read_headers(tmp_path / "a.fits")[0].stored_bits == 8
    put(tmp_path / "b.fits", (dn() >> 1).astype(np.int16))
    assert np.array_equal(read_raw(tmp_path / "b.fits").dn, dn() >> 1)


@pytest.mark.parametrize(
    ("data", "keywords", "what"),
    [
        (np.zeros((4, 5), np.int64), {}, "the file does not state its bit depth"),
        (np.zeros((3, 4, 5), np.uint16), {}, "3 planes are those of a color picture"),
        (np.zeros(5, np.uint16), {}, "shape"),
        (np.zeros((4, 5), np.uint16), {"EXPTIME": "long"}, "EXPTIME"),
        (np.zeros((4, 5), np.uint16), {"EXPTIME": 0.0, "IMAGETYP": "LIGHT"}, "exposure_s"),
        (np.zeros((4, 5), np.uint16), {"BAYERPAT": "CYGM"}, "cfa"),
        (None, {}, "the FITS file holds no image"),
    ],
)
def test_invalid_files(tmp_path, data, keywords, what):
    put(tmp_path / "dark.fits", data, **({"EXPTIME": 1.0} | keywords))
    with raises(FileError, what, path=str(tmp_path / "dark.fits")):
        open_frames(tmp_path)


def test_exposure_0_is_valid_for_a_bias_frame(tmp_path):
    put(tmp_path / "bias.fits", dn(), EXPTIME=0.0)
    assert read_raw(tmp_path / "bias.fits").exposure_s == 0.0
    put(tmp_path / "less.fits", dn(), EXPTIME=-1.0)
    with raises(FileError, "exposure_s", value=-1.0):
        read_raw(tmp_path / "less.fits")


def test_truncated_anywhere(tmp_path):
    put(tmp_path / "a.fits", dn(0, (40, 50)), EXPTIME=1.0)
    whole = (tmp_path / "a.fits").read_bytes()
    for length in [*range(1, len(whole), 97), len(whole) - 1]:
        (tmp_path / "b.fits").write_bytes(whole[:length])
        with pytest.raises(FileError) as caught:
            read_raw(tmp_path / "b.fits")
        assert "\n" not in str(caught.value)


def test_without_astropy(tmp_path, monkeypatch):
    put(tmp_path / "a.fits", dn())
    monkeypatch.setitem(sys.modules, "astropy.io", None)
    with raises(FileError, "FITS needs astropy", hint="Run pip install '.[fits]' in the clone"):
        read_raw(tmp_path / "a.fits")
