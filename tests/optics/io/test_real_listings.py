"""Excerpts of real files from public repositories, against other data of the same lens."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError
from photosite.optics.io.iset import RayTrace, read_parameters
from photosite.optics.io.zemax import read_distortion, read_psf, read_relative_illumination

# github.com/ruthshiferaw/2.156-Lens-Project, Prime Lenses + Data/AnalysisExports: OpticStudio 2025, saved through its
# programming interface; every 25th row of Cox1-01_FieldCurvature.txt.
FIELD_CURVATURE = """Results for:\t
File:\tC:\\Lens Project\\Prime Lenses\\Cox1-01.zmx
Title:\t
Date:\t11/7/2025 5:22:16 PM

0 message(s) in output.
2 series table(s) in output.

Table series: Data for wavelength : 0.486133 µm.
   Y Angle (deg)       Tan Shift       Sag Shift     Real Height     Ref. Height      Distortion
  --------------  --------------  --------------  --------------  --------------  --------------
      0.00000000     0.061287407     0.061287407      0.00000000      0.00000000      0.00000000
       2.0000000  1.5161449E-003     0.033852291      0.95186714      0.95190002 -3.4546014E-003
       4.0000000     -0.17699412    -0.048314413       1.9058607       1.9061245    -0.013836768

Table series: Data for wavelength : 0.587562 µm.
   Y Angle (deg)       Tan Shift       Sag Shift     Real Height     Ref. Height      Distortion
  --------------  --------------  --------------  --------------  --------------  --------------
      0.00000000    -0.020734977    -0.020734977      0.00000000      0.00000000      0.00000000
       2.0000000    -0.079997892    -0.047949897      0.95133976      0.95137397 -3.5962686E-003
       4.0000000     -0.25700297     -0.12945805       1.9047967       1.9050711    -0.014405017
"""
# CN207216120_Example01P_FieldCurvature.txt of the same folder: 29 degrees, 2.8 % of barrel.
WIDE = """      0.00000000      0.20824802      0.20824802      0.00000000      0.00000000      0.00000000
       10.134638     0.097936196      0.10482271       7.1532342       7.1811564     -0.38882673
       20.269276     0.092324818    -0.045773302       14.618319       14.836363      -1.4696597
       28.956108    -0.088084567     0.020589054       21.602390       22.228649      -2.8173509
"""
# Its _Vignetting.txt, and that of Cox1-01 in degrees.
ILLUMINATION = """Results for:\tRelative Illumination Data


File:\tC:\\Lens Project\\Prime Lenses\\CN207216120_Example01P.zmx
Title:\tCN 207216120 U Example 1 (Yongnuo YN40mm F2.8N)
Date:\t11/7/2025 4:06:22 PM

0 message(s) in output.
Wavelength: 0.587562 µm
Field values are in {unit}
Relative Illumination values are dimensionless.
1 series table(s) in output.

Table series: See program documentation for a discussion of Effective F/#.
         Y Field        Rel. Ill   Effective F/#
  --------------  --------------  --------------
      0.00000000       1.0000000       2.9704239
       10.800000      0.67809031       3.6072369
       21.600000      0.14798199       7.7217192
"""
# ISETCam, opticalimage/raytrace/zemax/20050902 db/AsphereF=2mm_GridDistortion_3.dat: some rows, blanks narrowed.
GRID_HEAD = """Listing of Grid Distortion Data

File : C:\\ZEMAX\\ISET\\AsphereF=2mm\\AsphereF=2mm.ZMX
Title: AsphereF=2mm
Date : TUE AUG 30 2005


Units are Millimeters.
Field units are degrees
Wavelength: 0.55000 µm
Reference Coordinates: Xref = 0.00000E+000, Yref = 0.00000E+000

 i j X-Field Y-Field R-Field Predicted X Predicted Y Real X Real Y Distortion
"""
GRID = """\
 -16 -32 -9.99711E+000 -1.48108E+001 1.76294E+001 -3.48006E-001 -5.22008E-001 -3.39435E-001 -5.09152E-001 -2.462861%
 -16 0 -9.99711E+000 0.00000E+000 9.99711E+000 -3.48006E-001 0.00000E+000 -3.45302E-001 0.00000E+000 -0.776763%
 0 0 0.00000E+000 0.00000E+000 0.00000E+000 0.00000E+000 0.00000E+000 0.00000E+000 0.00000E+000 0.000000%
 0 32 0.00000E+000 1.48108E+001 1.48108E+001 0.00000E+000 5.22008E-001 0.00000E+000 5.13010E-001 -1.723756%
 1 1 6.31213E-001 4.73418E-001 7.88998E-001 2.17504E-002 1.63128E-002 2.17493E-002 1.63120E-002 -0.004794%
 15 15 9.38376E+000 7.06540E+000 1.16715E+001 3.26255E-001 2.44691E-001 3.22789E-001 2.42092E-001 -1.062312%
 16 16 9.99711E+000 7.53118E+000 1.24262E+001 3.48006E-001 2.61004E-001 3.43808E-001 2.57856E-001 -1.206148%
 31 31 1.88567E+001 1.43674E+001 2.31184E+001 6.74261E-001 5.05696E-001 6.45117E-001 4.83838E-001 -4.322334%
 32 32 1.94201E+001 1.48108E+001 2.37825E+001 6.96011E-001 5.22008E-001 6.64084E-001 4.98063E-001 -4.587114%

Maximum distortion: -4.5871%
"""


# ISETCam, opticalimage/raytrace/ISETPARMS.TXT; and the first lines that the macro of 2005 writes for the asphere.
PARAMETERS = r"""%   C:\PROGRAM FILES\ZEMAX\LENSES\EO54852.ZMX
lensFile='EO54852.ZMX';     %Lens file name
psfSize=128;                 % PSF ROW AND COL SIZE
psfSpacing=0.0002500;   % PSF GRID SPACING IN MM
wave=400:50:700;            % WAVELENGTH SAMPLES (NM)
imgHeightNum=13;             % Number of IMAGE HEIGHTS
imgHeightMax=3.0000000;     % Maximum IMAGE HEIGHT (MM)
objDist=250.000;                 % OBJECT DISTANCE (MM)
mag=-0.023954;          % OPTICAL SYSTEM MAGNIFICATION
baseLensFileName='C:\Program Files\ZEMAX\ISET\EO54852\EO54852'
refWave=587.562;          % REFERENCE WAVELENGTH (NM)
fov=26.198448;          % MAXIMUM DIAGONAL HALF FOV (DEGREE)
efl=5.999968;          % EFFECTIVE FOCAL LENGTH
fnumber_eff=1.780820;          % EFFECTIVE F-NUMBER
fnumber=1.774644;          % F-NUMBER
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_parameters_of_a_ray_trace(encoding: str, tmp_path: Path) -> None:
    said = read_parameters(written(tmp_path, PARAMETERS, encoding))
    assert (said.program, said.lens_file) == ("zemax", "EO54852.ZMX")
    assert said.base_name == r"C:\Program Files\ZEMAX\ISET\EO54852\EO54852"
    assert (said.focal_length_mm, said.f_number, said.magnification) == (5.999968, 1.774644, -0.023954)
    assert (said.object_distance_mm, said.reference_nm, said.wavelengths_nm) == (250, 587.562, (400, 50, 700))
    assert (said.heights, said.largest_height_mm, said.samples, said.spacing_mm) == (13, 3.0, 128, 0.00025)
    # The lens's first surface is 6.5 mm from its principal plane: 250 mm before that, the magnification says 256.5.
    found = RayTrace(tmp_path, said, "", {}, np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    assert found.focus_distance_m == pytest.approx(0.2565, abs=1e-4)
    asphere = PARAMETERS.replace("'EO54852.ZMX';     %", "'AsphereF=2mm.ZMX' % ")
    assert read_parameters(written(tmp_path, asphere)).lens_file == "AsphereF=2mm.ZMX"


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    file = folder / "a.txt"
    file.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    return file


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_field_curvature_saved_by_a_script(encoding: str, tmp_path: Path) -> None:
    distortion, color = read_distortion(written(tmp_path, FIELD_CURVATURE, encoding), wavelength_nm=587.562)
    np.testing.assert_allclose((distortion.ratio - 1) * 100, [0, -3.5962686e-3, -1.4405017e-2], rtol=1e-3)
    assert color is not None
    np.testing.assert_allclose(color.wavelength_nm, [486.133, 587.562])
    np.testing.assert_allclose(color.shift_um[:, -1], [1.0640, 0], atol=1e-4)
    focal = 22.228649 / math.tan(math.radians(28.956108))
    wide = FIELD_CURVATURE.split("      0.0000")[0] + WIDE
    distortion, _ = read_distortion(written(tmp_path, wide))
    np.testing.assert_allclose(distortion.heights_m(focal * 1e-3)[1] * 1e3, [0, 7.1532342, 14.618319, 21.602390], 1e-6)


# Lines that readers of the program's files quote: PyEchelle's RIMAS spectrograph, UTF-16, tabs and blanks between.
HUYGENS = """Listing of Huygens PSF Data

Huygens PSF
0.9194 µm at 0.0000, 0.0000 (deg).
Data spacing is 0.422 µm.
Data area is 13.517 by 13.517 µm.
Pupil grid size: 32 by 32
Image grid size: 32 by 32
Center point is: 17, 17
Center coordinates  :   6.20652974E+00,  -4.18352207E-01 Millimeters
Values are relative intensity.

"""


def test_spacing_from_the_data_area(tmp_path: Path) -> None:
    samples = np.random.default_rng(4).random((32, 32))
    numbers = "\n".join("\t  ".join(f"{v:.8E}" for v in row) for row in samples)
    got = read_psf(written(tmp_path, HUYGENS + numbers, "utf-16"))
    assert got.spacing_um == pytest.approx(13.517 / 32, rel=1e-12)
    assert got.center_mm == pytest.approx((6.20652974, -0.418352207))
    assert got.wavelength_nm == pytest.approx(919.4)
    np.testing.assert_allclose(got.samples, samples, rtol=1e-8)
    between = HUYGENS.replace("intensity.", "intensity.\nSome version says 1, 2") + numbers
    np.testing.assert_array_equal(read_psf(written(tmp_path, between)).samples, got.samples)
    other = written(tmp_path, HUYGENS.replace("13.517 by 13.517", "13.60 by 13.60") + numbers)
    assert read_psf(other).spacing_um == 0.422


def test_footer_after_the_stated_number_of_rows(tmp_path: Path) -> None:
    samples = np.random.default_rng(4).random((32, 32))
    rows = ["\t  ".join(f"{v:.8E}" for v in row) for row in samples]
    text = HUYGENS + "\n".join(rows) + "\n"
    for footer in ("\n2 warning(s)\n", "\nMaximum is 0.9\n\n3\n", "\n\n"):
        np.testing.assert_allclose(read_psf(written(tmp_path, text + footer)).samples, samples, rtol=1e-8)
    first = HUYGENS.count("\n")
    for more, line, word in (
        ("2 warning(s)\n", 33, "warning(s)"),  # no empty line
        (f"\nthe next\n{rows[0]}\n", 34, "the"),  # rows follow
    ):
        with pytest.raises(FileError) as caught:
            read_psf(written(tmp_path, text + more))
        assert (caught.value.value, caught.value.line) == (word, first + line)
    with raises(FileError, "samples"):
        read_psf(written(tmp_path, f"{text}\n{rows[0]}\n"))
    early = HUYGENS + "\n".join([*rows[:30], "", "2 warning(s)"])
    with raises(FileError, "entry", line=44):
        read_psf(written(tmp_path, early))


def test_reference_heights_must_be_tangents(tmp_path: Path) -> None:
    rows = "".join(f" {a:.6f} 0.1 0.1 {a * 0.47:.6f} {a * 0.475:.6f} {-1.0:.4f}\n" for a in (0.0, 1.0, 2.0, 4.0))
    with raises(FileError, "distortion"):
        read_distortion(written(tmp_path, FIELD_CURVATURE.split("      0.0000")[0] + rows))
    inches = "Height units are Inches.\nDistortion Type: F-Tan(Theta).\n" + FIELD_CURVATURE
    with raises(FileError, "unit of the heights"):
        read_distortion(written(tmp_path, inches))


def test_relative_illumination_saved_by_a_script(tmp_path: Path) -> None:
    table = read_relative_illumination(written(tmp_path, ILLUMINATION.format(unit="Millimeters"), "utf-16"))
    np.testing.assert_array_equal(table.field.height_mm, [0, 10.8, 21.6])
    np.testing.assert_array_equal(table.relative, [1, 0.67809031, 0.14798199])
    table = read_relative_illumination(written(tmp_path, ILLUMINATION.format(unit="degrees")))
    np.testing.assert_array_equal(table.field.angle_deg, [0, 10.8, 21.6])


@pytest.mark.parametrize("unit", ["Millimeters", "Centimeters", "Inches", "Meters"])
def test_heights_are_converted_to_mm(unit: str, tmp_path: Path) -> None:
    mm = {"Millimeters": 1.0, "Centimeters": 10.0, "Inches": 25.4, "Meters": 1000.0}[unit]
    text = ILLUMINATION.format(unit=unit)
    table = read_relative_illumination(written(tmp_path, text))
    np.testing.assert_allclose(table.field.height_mm, np.array([0, 10.8, 21.6]) * mm)
    head = text.replace(f"Field values are in {unit}\n", "").replace("Y Field ", "Y Field ({}) ")
    short = {"Millimeters": "mm", "Centimeters": "cm", "Inches": "in", "Meters": "m"}[unit]
    table = read_relative_illumination(written(tmp_path, head.format(short)))
    np.testing.assert_allclose(table.field.height_mm, np.array([0, 10.8, 21.6]) * mm)


def test_field_in_an_unknown_unit(tmp_path: Path) -> None:
    with raises(FileError, "unit of the field", line=10):
        read_relative_illumination(written(tmp_path, ILLUMINATION.format(unit="Furlongs")))
    beyond = ILLUMINATION.format(unit="Meters").replace("21.600000", "1e308")
    with raises(FileError, "field, in mm"):
        read_relative_illumination(written(tmp_path, beyond))
    with raises(FileError, "length", line=10):
        read_psf(written(tmp_path, HUYGENS.replace("6.20652974E+00", "1e308").replace("Millimeters", "Meters")))


def test_footer_that_begins_with_a_number(tmp_path: Path) -> None:
    text = ILLUMINATION.format(unit="degrees") + "\n2 warning(s)\n"
    np.testing.assert_array_equal(
        read_relative_illumination(written(tmp_path, text)).relative, [1, 0.67809031, 0.14798199]
    )


def test_grid_distortion_along_the_diagonal(tmp_path: Path) -> None:
    file = written(tmp_path, GRID_HEAD + GRID, "latin-1")
    distortion, color = read_distortion(file, wavelength_nm=550)
    assert color is None
    # To 5e-4 percent: numbers have six digits.
    np.testing.assert_allclose(
        (distortion.ratio - 1) * 100, [-0.004794, -1.062312, -1.206148, -4.322334, -4.587114], atol=5e-4
    )
    assert distortion.field.height_mm is not None
    assert distortion.field.height_mm[-1] == pytest.approx(math.hypot(0.696011, 0.522008))


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("Units are Millimeters", "Units are Inches", "units"),
        ("Yref = 0.0", "Yref = 0.1", "reference field"),
        ("0.55000 µm", "0.65000 µm", "wavelength_nm"),
        ("Real X", "", "has no table of predicted and real X and Y"),
        (" 1 1 ", " 1 2 ", None),
        ("5.13010E-001", "5.18010E-001", "the distortion is not rotationally symmetric"),
        ("-3.45302E-001 0.00000E+000", "-3.45302E-001 5.00000E-003", "the distortion is not rotationally symmetric"),
        ("6.64084E-001", "4.64084E-001", "the distorted image folds back"),
        (" 31 31 ", " 31 30 ", None),
    ],
)
def test_invalid_grids(old: str, new: str, what: str | None, tmp_path: Path) -> None:
    text = GRID_HEAD + GRID
    assert old in text
    file = written(tmp_path, text.replace(old, new))
    if what is None:  # one point fewer
        assert read_distortion(file)[0].ratio.size == 4
        return
    with raises(FileError, what):
        read_distortion(file, wavelength_nm=550)


def test_grid_without_points(tmp_path: Path) -> None:
    with raises(FileError, "the grid of points"):
        read_distortion(written(tmp_path, GRID_HEAD))


# ISETCam: raytrace/AsphereF=2mm_PSF_21_3.dat, with 3 x 3 of its 128 x 128 numbers; one byte a letter, CR LF.
REAL_PSF = """Listing of Huygens PSF Data

File : C:\\ZEMAX\\ISET\\AsphereF=2mm\\AsphereF=2mm.ZMX
Title: AsphereF=2mm
Date : TUE AUG 30 2005


HUYGENS PSF
0.5500 µm at -27.38 deg.
Data spacing is 0.25 µm.
Data area is 32.00 by 32.00 µm.
Strehl ratio: 0.486
Pupil grid size: 32 by 32
Image grid size: 3 by 3
Center point is: 2, 2
Center coordinates: 0.00000000E+000, -9.59263593E-001
Values are relative intensity.

1.684E-003\t1.702E-003\t1.684E-003
2.553E-003\t2.574E-003\t2.553E-003
3.417E-003\t3.439E-003\t3.417E-003
"""


def test_header_of_a_real_listing(tmp_path: Path) -> None:
    """A field of -27.38 degrees has its image at -y, as the table of heights has +27.38 degrees at +0.9592636 mm."""
    (tmp_path / "a.dat").write_bytes(REAL_PSF.replace("\n", "\r\n").encode("latin-1"))
    got = read_psf(tmp_path / "a.dat")
    assert (got.wavelength_nm, got.spacing_um, got.origin) == (pytest.approx(550.0), 0.25, (1, 1))
    assert (got.field, got.field_unit) == ((0.0, -27.38), "deg")
    assert got.center_mm == (0.0, pytest.approx(-0.9592636, abs=1e-7))  # as in AsphereF=2mm_DI_.dat
    np.testing.assert_array_equal(got.samples[:, 0], [1.684e-3, 2.553e-3, 3.417e-3])
