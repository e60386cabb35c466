"""Listings of Zemax OpticStudio in the layouts of docs/howto/optics.md, with synthetic numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises

from photosite.errors import FileError
from photosite.optics.distortion import RadialMapping, image_height
from photosite.optics.io.formats import load_lens_design, load_optics
from photosite.optics.io.listing import Layout, PsfListing
from photosite.optics.io.zemax import read_distortion, read_psf, read_relative_illumination
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import sample_positions

Array = NDArray[np.float64]
FFT_HEAD = """Listing of FFT PSF Data

File : C:\\lenses\\made up.zmx
Title: made up
Date : 1/2/2026


Polychromatic FFT PSF
{wave} to {wave} µm at {x}, {y} deg.
Data spacing is {spacing} µm.
Data area is 4.000 µm wide.
Surface: Image
Reference Coordinates: 0.00000E+000, 1.20000E+001
Pupil grid size: 32 by 32
Image grid size: {cols} by {rows}
Center point is: row {row}, column {col}
Values are not normalized.

"""
HUYGENS_HEAD = """Listing of Huygens PSF Data

File : C:\\lenses\\made up.zmx
Title: made up
Date : 1/2/2026


Polychromatic Huygens PSF
{wave} µm at {x}, {y} (deg).
Data spacing is {spacing} µm.
Data area is 10 by 10 µm.
Strehl ratio: 0.812
Pupil grid size: 64 by 64
Image grid size: {cols} by {rows}
Center point is: {col}, {row}
Center coordinates  :   0.00000000E+00,  -1.75880000E+01 Millimeters
Values are relative intensity.

"""


def spot(
    tail: float, rows: int = 21, cols: int = 21, spacing: float = 0.5, center: tuple[int, int] | None = None
) -> Array:
    """A spot with a tail towards the first row of the file, its head at the center (row, col from 0)."""
    row, col = center or (rows // 2, cols // 2)
    y, x = (np.arange(rows) - row) * spacing, (np.arange(cols) - col) * spacing
    return np.asarray(
        sum(np.exp(-((y[:, None] + tail * t) ** 2 + x**2) / (2 * 0.8**2)) for t in (0.0, 0.5, 1.0)), np.float64
    )


def listing(
    samples: Array,
    *,
    head: str = FFT_HEAD,
    wave: float = 0.55,
    x: float = 0.0,
    y: float = 10.0,
    spacing: float = 0.5,
    center: tuple[int, int] | None = None,
    comma: bool = False,
) -> str:
    row, col = center or (samples.shape[0] // 2, samples.shape[1] // 2)
    values = {"wave": f"{wave:.4f}", "x": f"{x:.4f}", "y": f"{y:.4f}", "spacing": f"{spacing:.3f}"}
    numbers = "\n".join("\t".join(f"{v:.8E}" for v in line) for line in samples)
    if comma:
        values, numbers = {k: v.replace(".", ",") for k, v in values.items()}, numbers.replace(".", ",")
    rows, cols = samples.shape
    return head.format(row=row + 1, col=col + 1, rows=rows, cols=cols, **values) + numbers + "\n"


@pytest.mark.parametrize("head", [FFT_HEAD, HUYGENS_HEAD])
@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("comma", [False, True])
def test_psf_listings_in_every_encoding_and_decimal_mark(head: str, encoding: str, comma: bool, tmp_path: Path) -> None:
    samples = spot(2.0, 20, 22)
    file = tmp_path / "psf.txt"
    file.write_bytes(listing(samples, head=head, center=(11, 9), comma=comma).encode(encoding))
    got = read_psf(file)
    np.testing.assert_allclose(got.samples, samples, rtol=1e-8)
    assert got.origin == (11, 9)
    assert got.spacing_um == 0.5
    assert got.wavelength_nm == pytest.approx(550.0)
    assert got.field == (0.0, 10.0)
    assert got.field_unit == "deg"
    assert got.center_mm == (None if head is FFT_HEAD else pytest.approx((0, -17.588)))


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("Listing of FFT PSF Data", "Listing of Spot Data", ("is not a listing of an", None)),
        ("0.5500 to 0.5500", "0.4500 to 0.6500", ("is of several wavelengths together", 9)),
        ("0.0000, 10.0000 deg.", "0.0000, 10.0000 furlongs.", ("unit of the field", 9)),
        ("Data spacing is 0.500 µm.\n", "", ("does not state", None)),
        ("spacing is 0.500 µm", "spacing is 0.500 arcmin", ("unit of length", 10)),
        ("Values are not normalized.\n", "", ("has no line 'Values are ...'", None)),
        ("Values are not normalized", "Values are Log of intensity", ("values", 17)),
        ("grid size: 21 by 21", "grid size: 32 by 21", ("samples", None)),
        ("row 11, column", "row 40, column", ("center point", None)),
    ],
)
def test_invalid_psf_listings(old: str, new: str, error: tuple[str, int | None], tmp_path: Path) -> None:
    text = listing(spot(2.0))
    assert old in text
    file = tmp_path / "psf.txt"
    file.write_text(text.replace(old, new), encoding="utf-16")
    with raises(FileError, error[0], line=error[1]):
        read_psf(file)


def test_damaged_numbers_name_their_line(tmp_path: Path) -> None:
    lines = listing(spot(2.0)).splitlines()
    file = tmp_path / "psf.txt"
    for change, value in ((lambda t: t.rsplit("\t", 1)[0], 20), (lambda t: "oh\t" + t, "oh")):
        file.write_text("\n".join([*lines[:25], change(lines[25]), *lines[26:]]), encoding="utf-8")
        with pytest.raises(FileError) as caught:
            read_psf(file)
        assert (caught.value.value, caught.value.line) == (value, 26)
    file.write_bytes(bytes(range(256)) * 4)
    with raises(FileError, "is not a listing of a"):
        read_psf(file)
    with raises(FileError, "there is no such file"):
        read_psf(tmp_path / "none.txt")


def folder_of(path: Path, *, skip: tuple[float, float] | None = None) -> Path:
    for y in (0.0, 5.0, 10.0):
        for wave, spacing in ((0.45, 0.4), (0.65, 0.6)):
            if (y, wave) != skip:
                samples = spot(0.3 * y, 41, 41, spacing)
                text = listing(samples, wave=wave, y=y, spacing=spacing)
                (path / f"f{y:g}_w{wave:g}.txt").write_text(text, encoding="utf-16")
    return path


def test_a_folder_of_listings(tmp_path: Path) -> None:
    design = load_lens_design(folder_of(tmp_path), rank=3)
    np.testing.assert_allclose(design.wavelength_nm, [450, 650])
    np.testing.assert_allclose(design.field_y, [0, 5, 10])  # the image of a positive angle is at +y: the lower half
    np.testing.assert_array_equal(design.field_x, 0)
    assert (design.unit, design.spacing_um, design.rank) == ("deg", 0.4, 3)
    count = design.psf.shape[-1]
    y = sample_positions(count, 0.4)
    for f, field in enumerate((0.0, 5.0, 10.0)):
        tail = 0.3 * field
        # The tail points to +y of the image surface, outwards, which is downwards in the frame.
        rows = sum(np.exp(-((y[:, None] - tail * t) ** 2 + y**2) / (2 * 0.8**2)) for t in (0.0, 0.5, 1.0))
        for w in (0, 1):
            np.testing.assert_allclose(design.psf[f, w], rows / np.sum(rows), atol=1e-4 * np.max(rows / np.sum(rows)))


def test_missing_and_duplicate_psfs(tmp_path: Path) -> None:
    folder_of(tmp_path, skip=(5.0, 0.65))
    with raises(FileError, "has no PSF at"):
        load_lens_design(tmp_path)
    (tmp_path / "again.txt").write_text(listing(spot(0.0, 41, 41), wave=0.45, y=0.0), encoding="utf-8")
    with raises(FileError, "has the same field and wavelength"):
        load_lens_design(tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    with raises(FileError, "holds no listing of a PSF"):
        load_lens_design(empty)


INDEX = """photosite_lens_design: 1
program: grid
axes: upright
symmetric: false
rank: 2
files:
  - {file: a.dat, wavelength_nm: 550, field_mm: [-4, 3], spacing_um: 0.5}
  - {file: b.dat, wavelength_nm: 550, field_mm: [4, 3], spacing_um: 0.5}
"""


def grids(path: Path, index: str = INDEX) -> Path:
    for name, tail in (("a", 1.0), ("b", 2.0)):
        grid = "\n".join(", ".join(f"{v:.7g}" for v in row) for row in spot(tail))
        (path / f"{name}.dat").write_text(f"PSF buffer\nrows x cols\n\n{grid}\n", encoding="utf-8")
    (path / "index.yaml").write_text(index, encoding="utf-8")
    return path / "index.yaml"


def test_index_of_bare_grids(tmp_path: Path) -> None:
    design = load_lens_design(grids(tmp_path))
    assert isinstance(design, LensDesign)
    np.testing.assert_array_equal(design.field_x, [-4, 4])
    np.testing.assert_array_equal(design.field_y, [-3, -3])
    assert (design.unit, design.symmetric, design.rank) == ("mm", False, 2)
    middle = design.psf.shape[-1] // 2
    column = design.psf[1, 0, :, middle]
    assert column @ sample_positions(column.size, 0.5) / column.sum() == pytest.approx(-1.0, abs=1e-3)  # upwards
    turned = load_lens_design(grids(tmp_path, INDEX.replace("upright", "image")))
    np.testing.assert_array_equal(turned.field_x, [-4, 4])
    np.testing.assert_array_equal(turned.field_y, [3, 3])
    np.testing.assert_allclose(turned.psf[0, 0], design.psf[1, 0, ::-1, ::-1], atol=1e-9)  # the longer tail
    flipped = load_lens_design(grids(tmp_path, INDEX.replace("axes: upright", "axes: upright\nfirst_row: bottom")))
    np.testing.assert_allclose(flipped.psf[0, 0], design.psf[0, 0, ::-1], atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("photosite_lens_design: 1", "photosite_lens_design: 2", ("photosite_lens_design", 1)),
        ("program: grid", "program: oslo", ("program", 2)),
        ("axes:", "axis:", ("unknown field", 3)),
        ("spacing_um: 0.5}\n  - {file: b", "}\n  - {file: b", ("does not state its spacing_um", None)),
        ("wavelength_nm: 550, field_mm: [4", "field_mm: [4", ("does not state its wavelength_nm", None)),
        ("field_mm: [4, 3]", "field_mm: 4", ("field_mm", 8)),
        ("field_mm: [4, 3]", "field_deg: [4, 3]", ("mixes fields in degrees and in", None)),
        ("field_mm: [4, 3]", "field_mm: [4, 2]", ("2 field points on 2 rows", None)),
        ("spacing_um: 0.5}\n  - {file: b", "spacing_um: 0}\n  - {file: b", ("spacing_um", 7)),
        ("b.dat", "c.dat", ("there is no such file", None)),
        ("rank: 2", "rank: 9", ("rank", None)),
        ("rank: 2", "tolerance: much", ("tolerance", 5)),
    ],
)
def test_invalid_indices(old: str, new: str, error: tuple[str, int | None], tmp_path: Path) -> None:
    assert old in INDEX
    with raises(FileError, error[0], line=error[1]):
        load_lens_design(grids(tmp_path, INDEX.replace(old, new)))


RELATIVE = """Listing of Relative Illumination Data

File : C:\\lenses\\made up.zmx
Title: made up
Date : 1/2/2026

Wavelength: 0.5500 µm
Field values are in degrees.

     Y Field      Rel. Ill.       Eff F/#
    0.000000       1.000000       2.8000
   10.000000       0.900000       2.8500
   20.000000       0.650000       3.0100
"""


def test_relative_illumination(tmp_path: Path) -> None:
    file = tmp_path / "ri.txt"
    file.write_text(RELATIVE, encoding="utf-16")
    table = read_relative_illumination(file)
    np.testing.assert_array_equal(table.field.angle_deg, [0, 10, 20])
    np.testing.assert_allclose(table.relative, [1, 0.9, 0.65])
    file.write_text(re.sub(r"(\d)\.(\d)", r"\1,\2", RELATIVE).replace("degrees", "millimeters"), "utf-8")
    table = read_relative_illumination(file)
    np.testing.assert_array_equal(table.field.height_mm, [0, 10, 20])
    for old, new, what in (
        ("Field values are in degrees.", "", "does not state whether its field"),
        ("Relative Illumination", "Vignetting", "is not a listing of relative"),
        ("    0.000000       1.000000       2.8000\n", "", "relative"),
        ("Rel. Ill.", "Nothing", "has no table"),
    ):
        file.write_text(RELATIVE.replace(old, new), "utf-8")
        with raises(FileError, what):
            read_relative_illumination(file)


def curvature(waves: dict[float, list[tuple[float, float]]]) -> str:
    """Angle and real height at each wavelength; the focal length is 50 mm."""
    text = """Listing of Field Curvature Distortion Data

File : C:\\lenses\\made up.zmx
Title: made up
Date : 1/2/2026

Shift units are Millimeters.
Height units are Millimeters.
Distortion Type: F-Tan(Theta).
Maximum Field is 20.000 Degrees.
Distortion focal length = 50.0000
"""
    for wave, rows in waves.items():
        text += f"\nData for wavelength : {wave:.6f} µm.\n\n"
        text += "  Y Angle (deg)   Tan Shift    Sag Shift   Real Height   Ref. Height   Distortion\n"
        for angle, real in rows:
            ideal = 50 * np.tan(np.radians(angle))
            percent = 0.0 if angle == 0 else 100 * (real - ideal) / ideal
            text += f"  {angle:.6f}  0.001000  0.000500  {real:.6f}  {ideal:.6f}  {percent:.6f} %\n"
    return text


def test_distortion_and_lateral_color(tmp_path: Path) -> None:
    angle = np.linspace(0, 20, 5)
    ideal = 50 * np.tan(np.radians(angle))
    green = ideal * (1 - 0.03 * (ideal / ideal[-1]) ** 2)
    blue, red = green + 0.004 * ideal / ideal[-1], green - 0.002 * ideal / ideal[-1]
    rows = {w: list(zip(angle, h, strict=True)) for w, h in ((0.55, green), (0.45, blue), (0.65, red))}
    file = tmp_path / "fcd.txt"
    file.write_text(curvature(rows), encoding="utf-16")
    distortion, color = read_distortion(file)
    np.testing.assert_allclose(distortion.heights_m(0.05)[1], green * 1e-3, atol=1e-9)
    assert color is not None
    np.testing.assert_array_equal(color.wavelength_nm, [450, 550, 650])
    np.testing.assert_allclose(color.shift_um[[0, 2], -1], [4, -2], atol=2e-3)
    real = read_distortion(file, wavelength_nm=450)[0].heights_m(0.05)[1]
    np.testing.assert_allclose(real, blue * 1e-3, atol=1e-9)
    mapping = RadialMapping(np.array([550.0]), *(h[None] if i else h for i, h in enumerate(distortion.heights_m(0.05))))
    assert image_height(mapping, 550.0)(np.array([0.01]))[0] == pytest.approx(
        0.01 * (1 - 0.03 * (10 / ideal[-1]) ** 2), abs=1e-8
    )
    alone, none = read_distortion(_written(tmp_path, curvature({0.55: rows[0.55]})))
    assert none is None
    np.testing.assert_allclose(alone.ratio, distortion.ratio)


def _written(folder: Path, text: str) -> Path:
    file = folder / "other.txt"
    file.write_text(text, encoding="utf-8")
    return file


def test_invalid_distortion_listings(tmp_path: Path) -> None:
    text = curvature({0.55: [(0.0, 0.0), (10.0, 8.7), (20.0, 17.5)]})
    for old, new, what in (
        ("F-Tan(Theta)", "F-Theta", "distortion"),
        ("Distortion", "Curve", "is not a listing of distortion"),
        ("Y Angle (deg)", "Y", "has no table"),
    ):
        with raises(FileError, what):
            read_distortion(_written(tmp_path, text.replace(old, new)))
    with raises(FileError, "wavelength_nm"):
        read_distortion(_written(tmp_path, text), wavelength_nm=600)


def test_listings_named_by_an_optics_file(tmp_path: Path) -> None:
    sub = tmp_path / "psf"
    sub.mkdir()
    folder_of(sub)
    (tmp_path / "ri.txt").write_text(RELATIVE, encoding="utf-16")
    rows = {0.55: [(0.0, 0.0), (10.0, 8.7), (20.0, 17.6)], 0.65: [(0.0, 0.0), (10.0, 8.702), (20.0, 17.603)]}
    (tmp_path / "fcd.txt").write_text(curvature(rows), encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(
        "photosite_optics: 1\nf_number: 4\nfocal_length_mm: 50\n"
        "blur: {kind: lens_design, source: psf, rank: 4, nodes: 9}\nrelative_illumination: {file: ri.txt}\n"
        "distortion: {file: fcd.txt, wavelength_nm: 550}\n",
        encoding="utf-8",
    )
    lens = load_optics(tmp_path / "mine.yaml")
    assert isinstance(lens, Lens)
    assert isinstance(lens.blur, LensDesign)
    assert (lens.blur.rank, lens.blur.nodes) == (4, 9)
    assert lens.illumination is not None
    assert lens.lateral_color is not None
    assert lens.lateral_color.shift_um[1, -1] == pytest.approx(3.0, abs=1e-6)


def test_layouts_rotate_and_flip_samples_with_their_origin() -> None:
    samples = np.arange(12.0).reshape(3, 4)
    listing = PsfListing(Path("a.txt"), samples, (0, 1), field=(2.0, 5.0), field_unit="mm")
    for axes, first_row, place in (
        ("upright", "top", (-5, 2)),
        ("upright", "bottom", (-5, 2)),
        ("image", "top", (5, -2)),
        ("image", "bottom", (5, -2)),
    ):
        layout = Layout(axes, first_row)  # type: ignore[arg-type]
        got, (row, col) = layout.upright(listing)
        expected = samples if first_row == "top" else np.flipud(samples)
        np.testing.assert_array_equal(got, expected if axes == "upright" else np.rot90(expected, 2))
        assert got[int(row), int(col)] == samples[0, 1]
        assert layout.field_point(listing) == place
