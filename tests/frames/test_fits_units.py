"""FITS files of several units: amplifiers of a chip, chips of a camera, repeated frames."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from raising import raises

import photosite as ps
from photosite.errors import FileError
from photosite.frames.conditions import label
from photosite.frames.io.formats import read_headers
from photosite.frames.open import open_settings

fits = pytest.importorskip("astropy.io.fits")
CHIP = np.random.default_rng(1).integers(100, 4000, (12, 20)).astype(np.uint16)


def put(path, *units, **primary):
    first = fits.PrimaryHDU(header=fits.Header({"EXPTIME": 1.0, "IMAGETYP": "FLAT", **primary}))
    made = []
    for data, name, keywords in units:
        unit = fits.ImageHDU(data, name=name)
        unit.header.update(keywords)
        made.append(unit)
    fits.HDUList([first, *made]).writeto(path)
    return path


def overscanned(data):
    """Return pixels with three columns of overscan behind them, and the keywords that state it."""
    rows, cols = data.shape
    sections = {"DATASEC": f"[1:{cols},1:{rows}]", "BIASSEC": f"[{cols + 1}:{cols + 3},1:{rows}]"}
    return np.pad(data, ((0, 0), (0, 3)), constant_values=7), sections


def quadrants(binning=1, keyword="DETSEC", offset=0):
    """Return the four amplifiers of CHIP, each read towards its own corner."""
    rows, cols = CHIP.shape
    units = []
    for number, (top, left) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1)), 1):
        part = CHIP[top * rows // 2 :, left * cols // 2 :][: rows // 2, : cols // 2]
        part = part[:: -1 if top else 1, :: -1 if left else 1]
        data, sections = overscanned(part)
        x = [1, cols // 2] if not left else [cols, cols // 2 + 1]
        y = [1, rows // 2] if not top else [rows, rows // 2 + 1]
        x, y = ([offset + (n - 1) * binning + (1 if n == min(e) else binning) for n in e] for e in (x, y))
        place = f"[{x[0]}:{x[1]},{y[0]}:{y[1]}]"
        keywords = {**sections, keyword: place, "GAIN": 1.0 + number, "CCDSUM": f"{binning} {binning}"}
        units.append((data, f"im{number}", keywords))
    return units


@pytest.mark.parametrize(("binning", "keyword", "offset"), [(1, "DETSEC", 0), (2, "DETSEC", 4000), (1, "CCDSEC", 0)])
def test_amplifiers_of_a_chip_are_joined(tmp_path, binning, keyword, offset):
    path = put(tmp_path / "a.fits", *quadrants(binning, keyword, offset))
    frames = ps.open_frames(tmp_path)
    assert (frames.rows, frames.cols, frames.frame_count, frames.gain_settings) == (12, 20, 1, (None,))
    np.testing.assert_array_equal(frames.groups[0].frames[0].read(), CHIP)
    np.testing.assert_array_equal(ps.read_raw(path).dn, CHIP)


def test_pixels_that_fill_no_bin(tmp_path):
    """Two halves of 32 columns in bins of three: 10 columns each, as those of 2048 are 682."""
    halves = ("[1:32,1:36]", CHIP[:, :10]), ("[64:33,1:36]", CHIP[:, :9:-1])
    units = [(data, f"im{k}", {"DETSEC": place, "CCDSUM": "3 3"}) for k, (place, data) in enumerate(halves)]
    np.testing.assert_array_equal(ps.read_raw(put(tmp_path / "a.fits", *units)).dn, CHIP)


def test_reference_pixels_within_detsec_are_no_light(tmp_path):
    """The border of each detector of an array, which DETSEC includes, and DATASEC does not."""
    place = {"DATASEC": "[3:18,3:10]"}
    units = [(CHIP, f"Q{k + 1}", {"DETSEC": f"[{1 + 20 * k}:{20 + 20 * k},1:12]", **place}) for k in range(2)]
    put(tmp_path / "a.fits", *units)
    settings = open_settings(tmp_path)
    assert [label(each.conditions) for each in settings] == ["part=Q1", "part=Q2"]
    np.testing.assert_array_equal(ps.read_raw(f"{tmp_path / 'a.fits'}[Q1]").dn, CHIP[2:10, 2:18])


def test_stacks_of_amplifiers_are_joined(tmp_path):
    units = [(np.stack([data, data + (data != 7)]), name, keywords) for data, name, keywords in quadrants()]
    put(tmp_path / "a.fits", *units)
    (group,) = ps.open_frames(tmp_path).groups
    np.testing.assert_array_equal([*group], [CHIP, CHIP + 1])


def test_each_amplifier_follows_its_overscan(tmp_path):
    """The second frame has other black levels, one for each amplifier."""
    for name, drifts in (("dark_1.fits", (0, 0, 0, 0)), ("dark_2.fits", (2, -3, 0, 5))):
        chip = zip(quadrants(), drifts, strict=True)
        put(tmp_path / name, *(((data.astype(int) + drift).astype(np.uint16), *rest) for (data, *rest), drift in chip))
    frames = ps.open_frames(tmp_path)
    np.testing.assert_array_equal([*frames.groups[0]], [CHIP, CHIP])
    (found,) = [entry for entry in frames.diagnostics if entry.id == "overscan-levels"]
    assert found.size == 5.0


def test_chips_of_a_camera_are_joined_each(tmp_path):
    units = []
    for chip in ("North", "South"):
        units += [
            (data, f"{chip}{name}", {**keys, "CCDNAME": chip}) for data, name, keys in quadrants(keyword="CCDSEC")
        ]
    put(tmp_path / "a.fits", *units)
    settings = open_settings(tmp_path)
    assert [label(each.conditions) for each in settings] == ["part=North", "part=South"]
    for each in settings:
        np.testing.assert_array_equal(each.groups[0].frames[0].read(), CHIP)


@pytest.mark.parametrize(
    "keywords",
    [
        ({"DETSEC": "[1:20,1:12]"}, {"DETSEC": "[22:41,1:12]"}),  # a gap
        ({"DETSEC": "[1:20,1:12]"}, {"DETSEC": "[20:39,1:12]"}),  # an overlap
        ({"DETSEC": "[1:10,1:12]"}, {"DETSEC": "[11:20,1:12]"}),  # another size than the pixels
        ({"GAIN": 1.0}, {"GAIN": 1.5}),
        ({"AMPNAME": "left"}, {"AMPNAME": "right"}),
        ({"CCDCHIP": 1}, {"CCDCHIP": 2}),
    ],
)
def test_units_that_do_not_join_are_parts(tmp_path, keywords):
    put(tmp_path / "a.fits", (CHIP, "ONE", keywords[0]), (CHIP, "TWO", keywords[1]))
    assert [label(each.conditions) for each in open_settings(tmp_path)] == ["part=ONE", "part=TWO"]


@pytest.mark.parametrize(("names", "parts"), [(("AMP1", "AMP2"), True), (("im1", "im2"), True), (("t1", "t2"), False)])
def test_names_of_parts(tmp_path, names, parts):
    put(tmp_path / "a.fits", *((CHIP, name, {}) for name in names))
    assert len(open_settings(tmp_path)) == (2 if parts else 1)


def test_uncertainties_and_flags_are_no_frames(tmp_path):
    """Hubble's files: science, uncertainty and flags of each chip, with the chip's number."""
    units = [(CHIP, name, {"EXTVER": chip, "CCDCHIP": chip}) for chip in (1, 2) for name in ("SCI", "ERR", "DQ")]
    put(tmp_path / "a.fits", *units)
    assert [label(each.conditions) for each in open_settings(tmp_path)] == ["part=SCI", "part=SCI,2"]
    assert ps.open_frames(tmp_path, where={"part": "SCI,2"}).frame_count == 1


@pytest.mark.parametrize(("selection", "index"), [("1", 0), ("2", 1), ("amp2", 1), ("2,0", 1), (" 2 , 0 ", 1)])
def test_a_unit_of_a_file(tmp_path, selection, index):
    put(tmp_path / "a.fits", (CHIP, "AMP1", {}), (CHIP + 1, "AMP2", {}))
    np.testing.assert_array_equal(ps.read_raw(tmp_path / f"a.fits[{selection}]").dn, CHIP + index)


def test_parts_of_other_formats(tmp_path):
    h5py = pytest.importorskip("h5py")
    stack = np.stack([CHIP, CHIP + 1])
    tifffile.imwrite(tmp_path / "a.tif", stack, photometric="minisblack")
    np.testing.assert_array_equal(ps.read_raw(f"{tmp_path}/a.tif[1]").dn, CHIP + 1)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["dark/1s"], file["flat"] = stack, CHIP
    np.testing.assert_array_equal(ps.read_raw(f"{tmp_path}/a.h5[/dark/1s,1]").dn, CHIP + 1)
    np.testing.assert_array_equal(ps.read_raw(f"{tmp_path}/a.h5[flat]").dn, CHIP)
    assert ps.open_frames(f"{tmp_path}/a.h5[dark/1s]").frame_count == 2
    ps.RawFrame(CHIP, 12).save(tmp_path / "a.png")
    np.testing.assert_array_equal(ps.read_raw(f"{tmp_path}/a.png[0]").dn, CHIP)


def test_a_part_that_a_file_does_not_have(tmp_path):
    put(tmp_path / "a.fits", (CHIP, "AMP1", {}), (CHIP, "AMP2", {}))
    with raises(FileError, "the file has no such part", path=f"{tmp_path}/a.fits[3]"):
        ps.read_raw(tmp_path / "a.fits[3]")
    with raises(FileError, "the file holds 2 frames", hint="Name one of them: a.fits[AMP1]"):
        ps.read_raw(tmp_path / "a.fits")


def test_parts_in_a_protocol(tmp_path):
    put(tmp_path / "a.fits", (CHIP, "AMP1", {}), (CHIP + 1, "AMP2", {}))
    files = '["a.fits[2]"]'
    (tmp_path / "protocol.yaml").write_text(f"photosite_protocol: 1\nframes: [{{kind: dark, files: {files}}}]\n")
    (group,) = ps.open_frames(tmp_path).groups
    np.testing.assert_array_equal(next(iter(group)), CHIP + 1)


def test_the_unit_selects_frames_of_files_in_a_folder(tmp_path):
    put(tmp_path / "a.fits", (CHIP, "x", {}), (CHIP + 1, "y", {}))
    (group,) = ps.open_frames(tmp_path, where="unit=2").groups
    np.testing.assert_array_equal([*group], [CHIP + 1])


def test_a_section_that_is_none(tmp_path):
    path = put(tmp_path / "a.fits", (CHIP, "AMP1", {"DETSEC": "all"}), (CHIP, "AMP2", {"DETSEC": "[1:20,1:12]"}))
    with raises(FileError, "DETSEC", value="all"):
        read_headers(path)
