"""Image sections: overscan and covered lines never count as light."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import FileError, InputError
from photosite.frames.sections import Section, parse_region, parse_section, section_with_light
from photosite.frames.stored_rows import StoredRows
from photosite.values.cfa import cfa_from

fits = pytest.importorskip("astropy.io.fits")
DN = np.random.default_rng(1).integers(0, 4000, (20, 30)).astype(np.uint16)


def put(path, **keywords):
    header = fits.Header({"EXPTIME": 1.0, "IMAGETYP": "FLAT", **keywords})
    fits.PrimaryHDU(DN, header).writeto(path)
    return path


@pytest.mark.parametrize(
    ("keywords", "inside"),
    [
        ({"DATASEC": "[4:30,1:20]"}, np.s_[:, 3:]),
        ({"TRIMSEC": "[1:26,1:20]", "BIASSEC": "[27:30,1:20]"}, np.s_[:, :26]),
        ({"TRIMSEC": "[3:26,2:19]", "DATASEC": "[1:27,1:20]"}, np.s_[1:19, 2:26]),
        ({"BIASSEC": "[1:30,18:20]"}, np.s_[:17]),
        ({"BIASSEC": "[1:4,1:20]"}, np.s_[:, 4:]),
        ({"DATASEC": "[ 5 : 30 , * ]"}, np.s_[:, 4:]),
        ({"DATASEC": "[*,*]"}, np.s_[:]),
    ],
)
def test_sections_of_fits(tmp_path, keywords, inside):
    path = put(tmp_path / "a.fits", **keywords)
    frames = ps.open_frames(tmp_path)
    source = frames.groups[0].frames[0]
    np.testing.assert_array_equal(source.read(), DN[inside])
    np.testing.assert_array_equal(ps.read_raw(path).dn, DN[inside])
    assert (frames.rows, frames.cols) == DN[inside].shape
    if frames.border is not None:
        np.testing.assert_array_equal(source.whole(), DN)


@pytest.mark.parametrize(
    ("keywords", "what"),
    [
        ({"TRIMSEC": "[1:31,1:20]"}, "TRIMSEC"),
        ({"TRIMSEC": "1:30,1:20"}, "TRIMSEC"),
        ({"DATASEC": "[0:30,1:20]"}, "DATASEC"),
        ({"DATASEC": "[1:9,*]", "TRIMSEC": "[10:30,*]"}, "DATASEC and TRIMSEC have no pixel in common"),
        ({"BIASSEC": "[10:12,1:20]"}, "BIASSEC"),
        ({"BIASSEC": "[1:30,1:20]"}, "BIASSEC"),
    ],
)
def test_sections_that_contradict_the_image_or_each_other(tmp_path, keywords, what):
    path = put(tmp_path / "a.fits", **keywords)
    with raises(FileError, what, path=str(path)):
        ps.open_frames(tmp_path)


def test_overscan_between_two_amplifiers(tmp_path):
    """The error names the region of one of them, which is read."""
    path = put(tmp_path / "a.fits", BIASSEC="[10:12,1:20]")
    with raises(FileError, "BIASSEC", value="[10:12,1:20]") as caught:
        ps.open_frames(tmp_path)
    assert caught.value.arguments == {"region": "0:20,0:9"}
    np.testing.assert_array_equal(ps.read_raw(path, region="0:20,0:9").dn, DN[:, :9])
    np.testing.assert_array_equal([*ps.open_frames(tmp_path, region="0:20,0:9").groups[0]], [DN[:, :9]])


def test_overscan_is_the_black_level_of_a_single_frame(tmp_path):
    frame = ps.read_raw(put(tmp_path / "a.fits", TRIMSEC="[1:26,*]", BIASSEC="[27:30,*]"))
    assert frame.black_level_dn == DN[:, 26:].mean()
    assert ps.read_raw(put(tmp_path / "b.fits", TRIMSEC="[1:26,*]")).black_level_dn == 0.0


def drifting(path, drift, signal, **keywords):
    """Write a frame with overscan of 5 columns, a black level of 100 + drift, and one saturated pixel."""
    dn = np.full((20, 30), 100 + drift, np.uint16)
    dn[:, :25] += np.uint16(signal)
    dn[3, 4] = 65535
    dn[:, 25] += np.uint16(40)  # charge of the last pixels with light
    header = fits.Header({"EXPTIME": 1.0, "TRIMSEC": "[1:25,*]", "BIASSEC": "[26:30,*]", **keywords})
    fits.PrimaryHDU(dn, header).writeto(path)


def test_frames_follow_their_overscan(tmp_path):
    for number, (kind, drift, signal) in enumerate((("DARK", 0, 0), ("DARK", 7, 0), ("FLAT", -4, 1000))):
        drifting(tmp_path / f"{number}.fits", drift, signal, IMAGETYP=kind)
    frames = ps.open_frames(tmp_path)
    dark, light = ([*group] for group in frames.groups)
    for dn, level in zip((*dark, *light), (100, 100, 1100), strict=True):
        assert dn[3, 4] == 65535  # a saturated pixel stays one
        assert set(np.delete(dn, 3 * 25 + 4)) == {level}
    assert [entry.size for entry in frames.diagnostics if entry.id == "overscan-levels"] == [4.0]


def test_prescan_and_overscan_of_eso(tmp_path):
    keywords = {"HIERARCH ESO DET OUT1 PRSCX": 3, "HIERARCH ESO DET OUT1 OVSCX": 5, "HIERARCH ESO DET OUT1 OVSCY": 2}
    frame = ps.read_raw(put(tmp_path / "a.fits", **keywords))
    np.testing.assert_array_equal(frame.dn, DN[:18, 3:25])
    assert frame.black_level_dn == np.median(DN[:18, 25:].mean(axis=0))
    path = put(tmp_path / "b.fits", **keywords, **{"HIERARCH ESO DET OUTPUTS": 2})
    with raises(FileError, "ESO DET OUT NX, NY, PRSC and OVSC"):
        ps.read_raw(path)


def test_a_region_replaces_sections_that_are_not_those_of_the_image(tmp_path):
    path = put(tmp_path / "a.fits", DATASEC="[1:31,1:20]")
    with raises(FileError, "DATASEC", value="[1:31,1:20]", hint="Pass {region} with the pixels that receive light"):
        ps.read_raw(path)
    np.testing.assert_array_equal(ps.read_raw(path, region="0:20,0:26").dn, DN[:, :26])
    frames = ps.open_frames(tmp_path, region="0:20,0:26")
    np.testing.assert_array_equal([*frames.groups[0]], [DN[:, :26]])


def test_frames_of_a_set_have_the_same_sections(tmp_path):
    put(tmp_path / "a.fits", TRIMSEC="[1:26,*]")
    put(tmp_path / "b.fits", TRIMSEC="[2:27,*]")
    with raises(FileError, "the border without light is"):
        ps.open_frames(tmp_path)


def test_the_mosaic_begins_at_the_first_pixel_with_light(tmp_path):
    path = put(tmp_path / "a.fits", DATASEC="[2:30,1:20]", BAYERPAT="RGGB")
    assert ps.read_raw(path).cfa == cfa_from("grbg")


@pytest.mark.parametrize(("rows", "cfa"), [("TOP-DOWN", "rggb"), ("BOTTOM-UP", "gbrg")])
def test_bayerpat_is_that_of_the_upright_picture(tmp_path, rows, cfa):
    """Siril's documentation: RGGB of a picture stored upside down, with an even number of rows, is GBRG."""
    assert ps.read_raw(put(tmp_path / "a.fits", BAYERPAT="RGGB", ROWORDER=rows)).cfa == cfa_from(cfa)


def test_row_order_with_offsets(tmp_path):
    """The color of each pixel, from the upright picture turned over: 20 rows, offset by one row and column."""
    path = put(
        tmp_path / "a.fits", BAYERPAT="RGGB", ROWORDER="BOTTOM-UP", XBAYROFF=1, YBAYROFF=1, DATASEC="[2:30,4:20]"
    )
    upright = [["RGGB"[2 * ((r + 1) % 2) + (c + 1) % 2] for c in range(30)] for r in range(20)]
    stored = [row[1:] for row in upright[::-1][3:]]
    tile = ps.read_raw(path).cfa
    assert [[tile[r % 2][c % 2] for c in range(29)] for r in range(17)] == stored


@pytest.mark.parametrize("suffix", ["tif", "png", "h5", "dng", "fits"])
@pytest.mark.parametrize("region", ["[5:26,3:26]", "2:26,4:26"])
def test_region_of_files_that_state_none(tmp_path, suffix, region):
    dn = np.random.default_rng(2).integers(0, 4000, (28, 30)).astype(np.uint16)
    path = tmp_path / f"flat_1s.{suffix}"
    if suffix == "fits":
        fits.PrimaryHDU(dn, fits.Header({"BAYERPAT": "RGGB"})).writeto(path)
    else:
        ps.RawFrame(dn, 12, cfa_from("rggb")).save(path)
    frames = ps.open_frames(tmp_path, region=region)
    source = frames.groups[0].frames[0]
    assert (frames.rows, frames.cols, frames.border) == (24, 22, (2, 2, 4, 4))
    np.testing.assert_array_equal(source.read(), dn[2:26, 4:26])
    np.testing.assert_array_equal(source.whole(), dn)
    frame = ps.read_raw(path, region="[6:26,3:26]")
    np.testing.assert_array_equal(frame.dn, dn[2:26, 5:26])
    assert frame.cfa == cfa_from("grbg")


def test_region_within_the_stated_sections(tmp_path):
    put(tmp_path / "a.fits", TRIMSEC="[3:28,1:20]")
    frames = ps.open_frames(tmp_path, region="5:15,2:10")
    np.testing.assert_array_equal(frames.groups[0].frames[0].read(), DN[5:15, 2:10])
    np.testing.assert_array_equal(frames.groups[0].frames[0].whole(), DN)
    assert frames.border == (5, 5, 2, 20)
    with raises(FileError, "region", value="[2:10,6:15]"):
        ps.open_frames(tmp_path, region="5:15,1:10")
    with raises(FileError, "region"):
        ps.read_raw(tmp_path / "a.fits", region="[1:31,1:20]")


@pytest.mark.parametrize("region", ["", "1:2", "5:5,1:3", "[3:1,1:4]", "0:3,0:4:2", "[1:2,1:3,1:4]"])
def test_invalid_regions(tmp_path, region):
    put(tmp_path / "a.fits")
    with raises(InputError, "region", value=region):
        ps.open_frames(tmp_path, region=region)


def test_region_of_a_protocol(tmp_path):
    put(tmp_path / "a.fits")
    text = "photosite_protocol: 1\nregion: {}\nframes: [{{kind: light, files: a.fits}}]\n"
    (tmp_path / "protocol.yaml").write_text(text.format('"[1:10,1:5]"'))
    assert ps.open_frames(tmp_path).border == (0, 15, 0, 20)
    assert ps.open_frames(tmp_path, region="0:5,0:10").rows == 5
    with raises(FileError, "region", value="[1:9,1:5]"):
        ps.open_frames(tmp_path, region="0:5,0:9")
    (tmp_path / "protocol.yaml").write_text(text.format("[1:10,1:5]"))
    with raises(FileError, "region", line=2):
        ps.open_frames(tmp_path)
    (tmp_path / "protocol.yaml").write_text(text.format("5:4,1:5"))
    with raises(FileError, "region", line=2, value="5:4,1:5"):
        ps.open_frames(tmp_path)


def test_rows_of_a_region_are_read_a_few_at_a_time(tmp_path):
    ps.RawFrame(DN, 12).save(tmp_path / "flat_1s.tif")
    rows = ps.open_frames(tmp_path, region="5:15,2:10").groups[0].frames[0].open_rows()
    assert isinstance(rows, StoredRows)
    part = DN[5:15, 2:10]
    np.testing.assert_array_equal(rows.take_rows([0, 9, 3]), part[[0, 9, 3]])
    np.testing.assert_array_equal(rows.read(), part)


def test_sections():
    assert parse_section("[2048:1,1:100]").flipped == (False, True)
    assert str(parse_section("[2048:1,1:100]")) == "[2048:1,1:100]"
    assert str(parse_region("3:5,10:11")) == "[11:11,4:5]"
    assert section_with_light((4, 5), None, None, None) == Section(0, 4, 0, 5)
    with raises(InputError, "section"):
        parse_section("[*,*]")
