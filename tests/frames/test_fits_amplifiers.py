"""Amplifiers whose pixels lie side by side in one FITS image."""

from __future__ import annotations

import numpy as np
import pytest
from raising import raises

import photosite as ps
from photosite.errors import FileError
from photosite.frames.io.fits_amplifiers import eso_amplifiers, numbered_amplifiers

fits = pytest.importorskip("astropy.io.fits")
CHIP = np.random.default_rng(1).integers(100, 4000, (12, 20))
LEFT, RIGHT = (slice(None), slice(0, 10)), (slice(None), slice(10, 20))


def put(path, data, **keywords):
    header = fits.Header({"EXPTIME": 1.0, "IMAGETYP": "DARK"})
    for name, value in keywords.items():
        header[name] = value
    fits.PrimaryHDU(data.astype(np.uint16), header).writeto(path)


def overscan(rows, level, cols=3):
    return np.full((rows, cols), level)


def two_amplifiers(levels=(50, 60), drift=(0, 0)):
    """CTIO's order: left pixels, overscan of the left and of the right amplifier, right pixels."""
    parts = [CHIP[LEFT] + drift[0], overscan(12, levels[0] + drift[0]), overscan(12, levels[1] + drift[1])]
    return np.hstack([*parts, CHIP[RIGHT] + drift[1]])


ARCON = {
    "AMPLIST": "11 12",
    "ASEC11": "[1:13,1:12]",
    "DSEC11": "[1:10,1:12]",
    "BSEC11": "[11:13,1:12]",
    "ASEC12": "[14:26,1:12]",
    "DSEC12": "[17:26,1:12]",
    "BSEC12": "[14:16,1:12]",
}
KECK = {
    "DSEC1": "[1:10,1:12]",
    "BSEC1": "[11:13,1:12]",
    "TSEC1": "[1:10,1:12]",
    "CSEC1": "[1:10,1:12]",
    "DSEC2": "[26:17,1:12]",  # read from the right
    "BSEC2": "[14:16,1:12]",
    "TSEC2": "[11:20,1:12]",
}


CHIRON = {"AMPLIST": "21 22", "DSEC21": "[2:684,1:4112]", "BSEC21": "[685:700,1:4112]", "TSEC21": "[2:684,1:4112]"}
CHIRON |= {"DSEC22": "[718:1400,1:4112]", "BSEC22": "[701:717,1:4112]", "TSEC22": "[718:1400,1:4112]"}
ESPADONS = {"DATASEC": "[21:2068,1:4608]", "TRIMSEC": "[21:2068,4:4605]", "AMPLIST": "a,b", "CSECA": "[21:1044,1:4608]"}
ESPADONS |= {"DSECA": "[21:1044,1:4608]", "BSECA": "[1:20,1:4608]"}
ESPADONS |= {"DSECB": "[1045:2068,1:4608]", "BSECB": "[2069:2088,1:4608]"}
DECAM = {"DATASECA": "[1081:2104,51:4146]", "BIASSECA": "[2105:2154,51:4146]"}
DECAM |= {"DATASECB": "[57:1080,51:4146]", "BIASSECB": "[7:56,51:4146]"}
LRIS = {
    "AMPLIST": "2,1,0,0 ",
    "DSEC1": "[1:4,1:9]",
    "BSEC1": "[9:10,1:9]",
    "DSEC2": "[5:8,1:9]",
    "BSEC2": "[11:12,1:9]",
}


@pytest.mark.parametrize(
    ("keywords", "size", "expected"),
    [
        (CHIRON, (4112, 1400), {"21": "[1:683,1:4112] [685:700,1:4112]", "22": "[684:1366,1:4112] [701:717,1:4112]"}),
        (ESPADONS, (4608, 2088), {"A": "[1:1024,1:4602] [1:20,4:4605]", "B": "[1025:2048,1:4602] [2069:2088,4:4605]"}),
        (DECAM, (4146, 2160), {"A": "[1025:2048,1:4096] [2105:2154,51:4146]", "B": "[1:1024,1:4096] [7:56,51:4146]"}),
        (LRIS, (9, 12), {"2": "[5:8,1:9] [11:12,1:9]", "1": "[1:4,1:9] [9:10,1:9]"}),
    ],
    ids=["CTIO", "CFHT", "DECam", "Keck"],
)
def test_headers_of_observatories(keywords, size, expected):
    """Values of raw frames of CHIRON, ESPaDOnS and DECam; a list of amplifiers that ends with zeros."""
    found = numbered_amplifiers(keywords, size)
    assert {each.name: f"{each.target} {each.overscan}" for each in found} == expected


def test_a_header_of_four_outputs():
    """Values of raw frames of MUSE: prescan and overscan of 32 lines on each axis of an output."""
    header = {"ESO DET OUTPUTS": 4}
    for n, (x, y) in enumerate(((1, 1), (4096, 1), (4096, 4112), (1, 4112)), 1):
        sizes = {"X": x, "Y": y, "NX": 2048, "NY": 2056} | dict.fromkeys(("PRSCX", "OVSCX", "PRSCY", "OVSCY"), 32)
        header |= {f"ESO DET OUT{n} {name}": value for name, value in sizes.items()}
    found = eso_amplifiers(header.get, (4240, 4224))
    sources = "[33:2080,33:2088]", "[2145:4192,33:2088]", "[2145:4192,2153:4208]", "[33:2080,2153:4208]"
    assert tuple(str(each.source) for each in found) == sources
    assert str(found[2].target) == "[2049:4096,2057:4112]"


@pytest.mark.parametrize(("keywords", "names"), [(ARCON, ("11", "12")), (KECK, ("1", "2"))])
def test_sections_of_each_amplifier(tmp_path, keywords, names):
    put(tmp_path / "dark_1.fits", two_amplifiers(), **keywords)
    put(tmp_path / "dark_2.fits", two_amplifiers(drift=(5, -4)), **keywords)
    frames = ps.open_frames(tmp_path)
    assert [(a.name, a.r0, a.r1, a.c0, a.c1) for a in frames.amplifiers] == [
        (names[0], 0, 12, 0, 10),
        (names[1], 0, 12, 10, 20),
    ]
    np.testing.assert_array_equal([*frames.groups[0]], [CHIP, CHIP])  # each follows its own overscan
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "dark_1.fits").dn, CHIP)


def test_trimmed_sections_within_the_data(tmp_path):
    """IRAF's quad: TSEC leaves out lines of DSEC."""
    keywords = ARCON | {"TSEC11": "[2:10,2:12]", "TSEC12": "[17:25,2:12]"}
    put(tmp_path / "dark.fits", two_amplifiers(), **keywords)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "dark.fits").dn, CHIP[1:, 1:-1])


def test_four_amplifiers(tmp_path):
    rows = [
        np.hstack([CHIP[r, :10], overscan(6, 40, 2), overscan(6, 41, 2), CHIP[r, 10:]])
        for r in (slice(6), slice(6, 12))
    ]
    keywords = {"READAMPS": "Quad"}
    for y, x in ((1, 1), (1, 2), (2, 1), (2, 2)):
        lines = f"{6 * y - 5 + 2 * (y - 1)}:{6 * y + 2 * (y - 1)}"
        keywords[f"DSEC{y}{x}"] = f"[{'1:10' if x == 1 else '15:24'},{lines}]"
        keywords[f"BSEC{y}{x}"] = f"[{'11:12' if x == 1 else '13:14'},{lines}]"
    put(tmp_path / "dark.fits", np.vstack([rows[0], np.zeros((2, 24)), rows[1]]), **keywords)
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "dark.fits").dn, CHIP)


def eso(outputs, **sizes):
    keywords = {"HIERARCH ESO DET OUTPUTS": len(outputs)}
    for n, (x, y, nx, ny) in enumerate(outputs, 1):
        values = {"X": x, "Y": y, "NX": nx, "NY": ny, "PRSCX": 2, "OVSCX": 3, "PRSCY": 0, "OVSCY": 0} | sizes
        keywords |= {f"HIERARCH ESO DET OUT{n} {name}": value for name, value in values.items()}
    return keywords


def test_outputs_of_eso(tmp_path):
    """Prescan at the outer borders, overscan in the middle."""
    left = [overscan(12, 30, 2), CHIP[LEFT], overscan(12, 50)]
    right = [overscan(12, 60), CHIP[RIGHT], overscan(12, 31, 2)]
    keywords = eso([(1, 1, 10, 12), (20, 1, 10, 12)])
    put(tmp_path / "dark_1.fits", np.hstack([*left, *right]), **keywords)
    put(tmp_path / "dark_2.fits", np.hstack([*(p + 3 for p in left), *(p - 2 for p in right)]), **keywords)
    frames = ps.open_frames(tmp_path)
    assert [a.name for a in frames.amplifiers] == ["OUT1", "OUT2"]
    np.testing.assert_array_equal([*frames.groups[0]], [CHIP, CHIP])


def test_outputs_of_eso_in_four_corners(tmp_path):
    data = np.hstack(
        [overscan(12, 30, 2), CHIP[LEFT], overscan(12, 50), overscan(12, 60), CHIP[RIGHT], overscan(12, 3, 2)]
    )
    put(tmp_path / "dark.fits", data, **eso([(1, 1, 10, 6), (20, 1, 10, 6), (1, 12, 10, 6), (20, 12, 10, 6)]))
    np.testing.assert_array_equal(ps.read_raw(tmp_path / "dark.fits").dn, CHIP)


@pytest.mark.parametrize(
    ("keywords", "what"),
    [
        (ARCON | {"DSEC12": "[17:27,1:12]"}, "DSEC12"),
        (ARCON | {"DSEC12": "[9:18,1:12]", "BSEC12": ""}, "pixels of the amplifiers"),
        (ARCON | {"DSEC12": "[17:26,3:12]"}, "pixels of the amplifiers"),
        (ARCON | {"BSEC11": "[9:11,1:12]"}, "BSEC11"),
        (ARCON | {"AMPLIST": "11 12 21"}, "DSEC21"),
        (eso([(1, 1, 10, 12), (20, 1, 11, 12)]), "ESO DET OUT NX, NY, PRSC and OVSC"),
    ],
)
def test_sections_that_are_wrong(tmp_path, keywords, what):
    put(tmp_path / "dark.fits", two_amplifiers(), **keywords)
    with raises(FileError, what):
        ps.open_frames(tmp_path)
    frames = ps.open_frames(tmp_path, region="0:12,0:10")  # what the caller states is used
    np.testing.assert_array_equal(frames.groups[0].frames[0].read(), CHIP[LEFT])


def test_calibration_of_two_amplifiers(tmp_path):
    """Gains of 0.25 and 0.35 DN/e-, and black levels that differ by 40 and drift."""
    rng = np.random.default_rng(2)
    for t in (0.1, 0.1, 0.2, 0.2, 0.4, 0.4, 0.8, 0.8):
        for kind, electrons in (("DARK", 0), ("FLAT", 2e4 * t)):
            drift = rng.integers(0, 6, 2)
            part = [
                np.round(
                    black + drift[k] + gain * (rng.poisson(electrons, (40, 30)) + 4 * rng.standard_normal((40, 30)))
                )
                for k, (gain, black) in enumerate(((0.25, 200), (0.35, 240)))
            ]
            dark = [
                np.round(black + drift[k] + gain * 4 * rng.standard_normal((40, 8)))
                for k, (gain, black) in enumerate(((0.25, 200), (0.35, 240)))
            ]
            sections = {
                "DSEC11": "[1:30,1:40]",
                "BSEC11": "[31:38,1:40]",
                "DSEC12": "[47:76,1:40]",
                "BSEC12": "[39:46,1:40]",
            }
            name = f"{kind}_{t}_{len(list(tmp_path.iterdir()))}.fits"
            put(tmp_path / name, np.hstack([part[0], *dark, part[1]]), **sections, EXPTIME=t, IMAGETYP=kind)
    found = ps.calibrate(ps.open_frames(tmp_path, bits=16))
    for name, gain in (("11", 0.25), ("12", 0.35)):
        low, high = found.amplifiers[name].parameters.system_gain_dn_per_e.interval_95
        assert low < gain < high < 1.2 * gain
