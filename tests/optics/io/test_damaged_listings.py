"""Damaged listings and indices: errors name the line, and no row is skipped silently."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError, InputError
from photosite.optics.io import zemax
from photosite.optics.io.formats import load_lens_design
from photosite.optics.io.listing import Layout, PsfListing, table_row
from photosite.optics.point_spread import sample_positions


def write_grid(path: Path, rows: int, cols: int, at: tuple[float, float], sigma: float = 2.0) -> None:
    """Write a round spot at a position in samples of 0.5 um, as a bare grid."""
    y, x = (np.arange(n)[:, None] - c for n, c in zip((rows, cols), at, strict=True))
    spot = np.exp(-(y**2 + x.T**2) * 0.25 / (2 * sigma**2))
    path.write_text("PSF\n\n" + "\n".join(" ".join(f"{v:.8e}" for v in row) for row in spot), encoding="utf-8")


def index_of(folder: Path, *entries: str, more: str = "") -> Path:
    file = folder / "index.yaml"
    lines = "".join(f"  - {{file: a.dat, {entry}}}\n" for entry in entries)
    file.write_text(f"photosite_lens_design: 1\nprogram: grid\naxes: upright\n{more}files:\n{lines}", encoding="utf-8")
    return file


ENTRY = "wavelength_nm: 550, field_deg: [0, 0], spacing_um: 0.5"


@pytest.mark.parametrize("shift", [(-0.64, 0), (0.64, 0), (0.5, -0.5), (-0.5, 0.5), (0, 0.9), (-1.5, 1.2), (0, -0.4)])
@pytest.mark.parametrize("axes", ["image", "upright"])
@pytest.mark.parametrize("shape", [(64, 64), (65, 63)])
def test_origin_between_samples(shift: tuple[float, float], axes: str, shape: tuple[int, int], tmp_path: Path) -> None:
    origin = 32 + shift[0], 31 + shift[1]
    write_grid(tmp_path / "a.dat", *shape, origin)
    index = index_of(tmp_path, f"{ENTRY}, origin: [{origin[0] + 1}, {origin[1] + 1}]")
    index.write_text(index.read_text().replace("axes: upright", f"axes: {axes}"))
    psf = load_lens_design(index).psf[0, 0]
    place = sample_positions(psf.shape[0], 0.5)
    assert psf.sum(axis=1) @ place == pytest.approx(0, abs=2e-3)
    assert psf.sum(axis=0) @ place == pytest.approx(0, abs=2e-3)


def test_one_file_with_two_origins(tmp_path: Path) -> None:
    write_grid(tmp_path / "a.dat", 65, 65, (32, 32))
    entries = [
        f"wavelength_nm: {nm}, field_deg: [0, 0], spacing_um: 0.5, origin: [33, {col}]"
        for nm, col in ((450, 33), (550, 45))
    ]
    psf = load_lens_design(index_of(tmp_path, *entries)).psf[0]
    place = sample_positions(psf.shape[-1], 0.5)
    np.testing.assert_allclose(psf.sum(axis=1) @ place, [0.0, -6.0], atol=2e-2)  # 12 samples of 0.5 um


@pytest.mark.parametrize(
    ("entry", "error"),
    [
        (ENTRY.replace("[0, 0]", "[.nan, 0]"), ("field_deg", 5)),
        (ENTRY.replace("[0, 0]", "[.inf, 0]"), ("field_deg", 5)),
        (ENTRY.replace("[0, 0]", "[true, 0]"), ("field_deg", 5)),
        (ENTRY + ", origin: [.nan, 3]", ("origin", 5)),
        (ENTRY + ", origin: [.inf, 3]", ("origin", 5)),
        (ENTRY + ", origin: [1000000, 1000000]", ("origin", 5)),
        (ENTRY + ", origin: [0.5, 3]", ("origin", 5)),
        (ENTRY.replace("0.5}", "").replace("spacing_um: 0.5", "spacing_um: .inf"), ("spacing_um", 5)),
        (ENTRY.replace("spacing_um: 0.5", "spacing_um: 1e-300"), ("spacing_um", 5)),
        (ENTRY.replace("550", "0.45"), ("wavelength_nm", 5)),
        (ENTRY.replace("550", ".nan"), ("wavelength_nm", 5)),
    ],
)
def test_invalid_entries_name_their_line(entry: str, error: tuple[str, int | None], tmp_path: Path) -> None:
    write_grid(tmp_path / "a.dat", 21, 21, (10, 10), 1.0)
    with pytest.raises(FileError) as caught:
        load_lens_design(index_of(tmp_path, entry))
    assert (caught.value.what.startswith(error[0]), caught.value.line) == (True, error[1])
    assert len(str(caught.value)) < 300


def test_extreme_spacings_give_a_short_error(tmp_path: Path) -> None:
    write_grid(tmp_path / "a.dat", 21, 21, (10, 10), 1.0)
    with pytest.raises(FileError) as caught:
        load_lens_design(index_of(tmp_path, ENTRY, ENTRY.replace("550", "650").replace("0.5", "1.0e+300")))
    assert caught.value.what.startswith("spacing_um")
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("key", ["detail_um", "tolerance"])
def test_booleans_are_not_numbers(key: str, tmp_path: Path) -> None:
    write_grid(tmp_path / "a.dat", 21, 21, (10, 10), 1.0)
    with raises(FileError, key, line=4):
        load_lens_design(index_of(tmp_path, ENTRY, more=f"{key}: true\n"))


def test_unknown_option(tmp_path: Path) -> None:
    write_grid(tmp_path / "a.dat", 21, 21, (10, 10), 1.0)
    with raises(InputError, "unknown option"):
        load_lens_design(index_of(tmp_path, ENTRY), ranks=1)


def test_listing_without_a_field() -> None:
    with raises(FileError, "does not state its field_deg or"):
        Layout().field_point(PsfListing(Path("a.txt"), np.ones((3, 3)), (1, 1)))


RELATIVE = """Listing of Relative Illumination Data
Field units are degrees.
     Y Field      Rel. Ill.
    0.000000       1.000000
   10.000000       0.900000
   20.000000       0.650000
"""
DISTORTION = """Listing of Field Curvature Distortion Data
Shift units are Millimeters.
Distortion Type: F-Tan(Theta).
Maximum distortion = 1.9 %

Data for wavelength : 0.550000 µm.

  Y Angle (deg)   Tan Shift    Sag Shift   Distortion
  0.000000  0.001000  0.000500  0.000000 %
  10.000000  0.001000  0.000500  0.500000 %
  20.000000  0.001000  0.000500  1.900000 %
"""
GRID = """Listing of Grid Distortion Data
Units are Millimeters.
   i    j      X-Field       Y-Field      R-Field   Predicted X   Predicted Y        Real X        Real Y   Distortion
""" + "".join(f"  {i}  {i}  {i}.0  {i}.0  {1.4 * i:.4f}  {i}.0  {i}.0  {i}.0  {i}.0  0.000000 %\n" for i in range(5))
READERS: dict[str, tuple[str, Any]] = {
    "relative": (RELATIVE, zemax.read_relative_illumination),
    "distortion": (DISTORTION, zemax.read_distortion),
    "grid": (GRID, zemax.read_distortion),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("bad", ["*******", "1.#IND", "nan", "1e999", "-", "oh", "", "1 2"])
def test_invalid_rows_name_their_line(kind: str, bad: str, tmp_path: Path) -> None:
    text, read = READERS[kind]
    lines = text.splitlines()
    file = tmp_path / "listing.txt"
    first = lines[-1].removesuffix("%").rstrip().rpartition(" ")[0]
    file.write_text("\n".join([*lines[:-1], f"{first} {bad}"]), encoding="utf-8")
    with pytest.raises(FileError) as caught:
        read(file)
    assert caught.value.line == len(lines)
    assert "\n" not in str(caught.value)


def test_a_word_in_place_of_a_field(tmp_path: Path) -> None:
    file = tmp_path / "listing.txt"
    file.write_text(RELATIVE.replace("   10.000000", "   ERROR"), encoding="utf-8")
    with raises(FileError, "entry", line=5):
        zemax.read_relative_illumination(file)


@pytest.mark.parametrize("kind", READERS)
def test_headings_and_footers_are_skipped(kind: str, tmp_path: Path) -> None:
    text, read = READERS[kind]
    file = tmp_path / "listing.txt"
    file.write_text(text, encoding="utf-8")
    plain = read(file)
    file.write_text(f"{text}\n-----------\nMaximum field is 14 Degrees\nfocal length = 50.0\nend\n", encoding="utf-8")
    again = read(file)
    of = (plain[0], again[0]) if isinstance(plain, tuple) else (plain, again)
    name = "relative" if kind == "relative" else "ratio"
    np.testing.assert_array_equal(getattr(of[0], name), getattr(of[1], name))


def values_of(found: Any) -> Any:
    one = found[0] if isinstance(found, tuple) else found
    return getattr(one, "relative", None) if hasattr(one, "relative") else one.ratio


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("footer", ["2 warning(s)", "0 error(s), 2 warning(s)", "3", "v 1.2 3 4 5"])
def test_a_table_ends_at_an_empty_line_after_its_rows(kind: str, footer: str, tmp_path: Path) -> None:
    text, read = READERS[kind]
    file = tmp_path / "listing.txt"
    file.write_text(text, encoding="utf-8")
    plain = values_of(read(file))
    for blank in ("\n", " \t\n\n"):
        file.write_text(f"{text}{blank}{footer}\n\n{footer}\n", encoding="utf-8")
        np.testing.assert_array_equal(values_of(read(file)), plain)
    lines = text.splitlines()
    count = len(lines)
    file.write_text(f"{text}{footer}\n", encoding="utf-8")  # no empty line: an invalid row
    with pytest.raises(FileError) as caught:
        read(file)
    assert caught.value.line == count + 1
    file.write_text("\n".join([*lines[:-1], "", footer, "", lines[-1]]), encoding="utf-8")  # rows follow
    with pytest.raises(FileError) as caught:
        read(file)
    assert caught.value.line == count + 1


@pytest.mark.parametrize("kind", READERS)
def test_table_with_empty_lines_between_rows(kind: str, tmp_path: Path) -> None:
    text, read = READERS[kind]
    file = tmp_path / "listing.txt"
    file.write_text(text, encoding="utf-8")
    plain = values_of(read(file))
    lines = text.splitlines()
    file.write_text("\n\n".join(lines), encoding="utf-8")
    np.testing.assert_array_equal(values_of(read(file)), plain)
    file.write_text("\n\n".join([*lines, "oh " + lines[-1]]), encoding="utf-8")
    with pytest.raises(FileError) as caught:
        read(file)
    assert (caught.value.value, caught.value.line) == ("oh", 2 * len(lines) + 1)


def test_footer_between_two_tables(tmp_path: Path) -> None:
    block = DISTORTION[DISTORTION.index("Data for") :]
    file = tmp_path / "listing.txt"
    other = block.replace("0.550000 µm", "0.650000 µm").replace("1.900000", "1.800000")
    file.write_text(f"{DISTORTION}\n2 warning(s)\n\n{other}\n1 warning(s)\n", encoding="utf-8")
    for nm, last in ((550, 1.9), (650, 1.8)):
        found, _ = zemax.read_distortion(file, wavelength_nm=nm)
        np.testing.assert_allclose((found.ratio - 1) * 100, [0, 0.5, last], atol=1e-9)


def test_inconsistent_tables(tmp_path: Path) -> None:
    file = tmp_path / "listing.txt"
    block = DISTORTION[DISTORTION.index("Data for") :]
    file.write_text(DISTORTION + "\n" + block, encoding="utf-8")
    with raises(FileError, "this is the second table of"):
        zemax.read_distortion(file)
    file.write_text(DISTORTION.rsplit("  10.0", 1)[0], encoding="utf-8")
    with raises(FileError, "rows of this table", line=8):
        zemax.read_distortion(file)
    real = block.replace("Tan Shift    Sag Shift", "Real Height  Ref. Height").replace("0.001000  0.000500", "{h}  {h}")
    tables = ""
    for wave in ("0.550000", "0.650000"):
        one = real.replace("0.550000", wave)
        for angle in (0, 10, 20):
            one = one.replace("{h}  {h}", 2 * f"{50 * math.tan(math.radians(angle)):.6f}  ", 1)
        tables += one + "\n"
    head = DISTORTION[: DISTORTION.index("Data for")]
    file.write_text(head + tables, encoding="utf-8")
    assert zemax.read_distortion(file)[1] is not None
    cut = "\n".join((head + tables).rstrip().splitlines()[:-1])
    file.write_text(cut, encoding="utf-8")
    with raises(FileError, "the angles of this table differ"):
        zemax.read_distortion(file)


def test_unknown_unit(tmp_path: Path) -> None:
    file = tmp_path / "bad.txt"
    file.write_text(DISTORTION.replace("µm", "fm"), encoding="utf-8")
    with raises(FileError, "unit of length", line=6):
        zemax.read_distortion(file)


@pytest.mark.parametrize(
    "line", ["", "   ", "-----", "====", "Page 3 of these", "10:23:45", "12/5/2026", "Wavelength: 0.55", "(deg) (mm)"]
)
def test_lines_that_are_not_rows(line: str) -> None:
    assert table_row(line, 4, Path("a.txt"), 1) is None
