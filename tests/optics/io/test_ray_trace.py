"""Sets of ISET's macros, written in their layouts from a lens that is known, and read back.

Layouts: ISETCam, opticalimage/raytrace: ISET_RT_ZEMAX_b.ZPL of 2005, ISET_RT_ZEMAX_2D.ZPL of 2013, ISET_RT_CODEV.SEQ.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from raising import raises, warns

from photosite.errors import FileError
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import image_height
from photosite.optics.io.formats import load_lens_design, load_optics
from photosite.optics.io.iset import read_ray_trace
from photosite.optics.lens import Lens
from photosite.optics.lens_design import LensDesign
from photosite.optics.point_spread import sample_positions

Array = NDArray[np.float64]

HEIGHTS = np.linspace(0.0, 3.0, 4)
WAVES = np.array([450.0, 550.0, 650.0])
SAMPLES, SPACING_UM = 40, 0.5
REFERENCE_NM = 580.0
PUPIL_MM = 9.0


def real_mm(wavelength_nm: float) -> Array:
    """Barrel of 4 % at the edge, 0.2 % of magnification between the outer wavelengths."""
    return HEIGHTS * (1 - 0.04 * (HEIGHTS / 3) ** 2) * (1 + 1e-5 * (wavelength_nm - 550))


def illumination(wavelength_nm: float) -> Array:
    return 1 - (0.3 + 1e-5 * (wavelength_nm - 550)) * (HEIGHTS / 3) ** 2


def spot(y: Array, x: Array, height: float, wavelength_nm: float, outwards: float) -> Array:
    """A spot at the chief ray with a tail that grows with height; `outwards` is +1 if y points away from the axis."""
    tail = outwards * height
    width = 0.8 * wavelength_nm / 550
    blobs = (np.exp(-((y[:, None] - tail * t) ** 2 + x**2) / (2 * width**2)) for t in (0.0, 0.5, 1.0))
    return np.asarray(sum(blobs), np.float64)


PARAMETERS = r"""%   C:\LENSES\Made Up.ZMX
lensFile='Made Up.ZMX';     %Lens file name
psfSize=40;                 % PSF ROW AND COL SIZE
psfSpacing=0.0005000;   % PSF GRID SPACING IN MM
wave=450:100:650;            % WAVELENGTH SAMPLES (NM)
imgHeightNum=4;                % Number of IMAGE HEIGHTS
imgHeightMax=3.0000000;                % Maximum IMAGE HEIGHT (mm)
objDist=250.000;                 % OBJECT DISTANCE (MM)
mag=-0.023954;          % OPTICAL SYSTEM MAGNIFICATION
baseLensFileName='C:\LENSES\Made Up\Made Up'
refWave=580.000;          % REFERENCE WAVELENGTH (NM)
fov=26.198448;          % MAXIMUM DIAGONAL HALF FOV (DEGREE)
efl=5.999968;          % EFFECTIVE FOCAL LENGTH
fnumber_eff=1.780820;          % EFFECTIVE F-NUMBER
fnumber=1.774644;          % F-NUMBER
"""
CODEV = """%   C:\\LENSES\\Made Up
lensFile='Made Up'
psfSize=40\t                 % PSF ROW AND COL SIZE
psfSpacing=0.0005\t   % PSF GRID SPACING IN MM
wave=450:100:650\t            % WAVELENGTH SAMPLES (NM)
imgHeight=0:1:3\t     % PARAXIAL IMAGE HEIGHTS (MM)
objDist=1e+013\t                 % OBJECT DISTANCE IN MM
mag=0\t          % OPTICAL SYSTEM MAGNIFICATION
baseLensFileName='Made Up'
refWave=580\t          % Reference Wavelength
fov=26.2\t          % MAXIMUM DIAGONAL HALF FOV IN DEG
efl=6\t          % EFFECTIVE FOCAL LENGTH IN MM
fnumber=1.8\t          % F-NUMBER = FOCAL LENGTH/ENTRANCE PUPIL DIAMETER
fnumber_eff=1.8\t          % EFFECTIVE F-NUMBER = 0.5/NUMERICAL APERTURE
"""
# Header lines as in ISETCam's AsphereF=2mm_PSF_21_3.dat, a listing of 2005, and in later versions.
OLD_HEAD = """Listing of Huygens PSF Data

File : C:\\LENSES\\Made Up.ZMX
Title: Made Up
Date : TUE AUG 30 2005


HUYGENS PSF
{wave:.4f} µm at {angle:.2f} deg.
Data spacing is 0.5 µm.
Data area is 20.00 by 20.00 µm.
Strehl ratio: 0.486
Pupil grid size: 32 by 32
Image grid size: 40 by 40
Center point is: 21, 21
Center coordinates: 0.00000000E+000, {center:.8E}
Values are relative intensity.

"""
NEW_HEAD = OLD_HEAD.replace("{angle:.2f} deg.", "0.0000, {height:.4f} (mm).").replace(
    "{center:.8E}", "{center:.8E} Millimeters"
)


def zemax(folder: Path, *, old: bool, off_center_um: float = 0.0) -> Path:
    """A Zemax set: PSFs for images at -y, the first row at +y."""
    encoding = "latin-1" if old else "utf-16"
    for kind, table in tables().items():
        rows = [" ".join(f"{v:.6E}" for v in row) for row in table]
        text = "\n".join(rows if old else " ".join(rows).split())
        (folder / f"Made Up_{kind}_.dat").write_text(text + "\n", encoding)
    up, right = sample_positions(SAMPLES, SPACING_UM)[::-1] + SPACING_UM, sample_positions(SAMPLES, SPACING_UM)
    for f, height in enumerate(HEIGHTS):
        for w, wave in enumerate(WAVES):
            center = -real_mm(wave)[f] + off_center_um * 1e-3
            samples = spot(up + off_center_um, right, height, wave, -1)
            angle = -math.degrees(math.atan(height / 6))
            head = (OLD_HEAD if old else NEW_HEAD).format(wave=wave / 1e3, angle=angle, height=-height, center=center)
            name = f"PSF_{f + 1}_{w + 1}" if old else f"2D_PSF_Fld{f + 1}_Wave{w + 1}"
            numbers = "\n".join("\t".join(f"{v:.8E}" for v in row) for row in samples)
            (folder / f"Made Up_{name}.dat").write_text(head + numbers + "\n", encoding)
    (folder / "ISETPARMS.TXT").write_text(PARAMETERS, encoding)
    return folder / "ISETPARMS.TXT"


def codev(folder: Path) -> Path:
    """A CODE V set: bare grids for images at +y."""
    for kind, table in tables().items():
        if kind != "CRA":
            text = "\n".join("\t".join(f"{v:.9g}" for v in row) for row in table)
            (folder / f"Made Up_{kind}_.dat").write_text(text, "latin-1")
    up, right = sample_positions(SAMPLES, SPACING_UM)[::-1] + SPACING_UM, sample_positions(SAMPLES, SPACING_UM)
    for f, height in enumerate(HEIGHTS):
        for w, wave in enumerate(WAVES):
            samples = 100 * spot(up, right, height, wave, 1)
            text = "\n".join("\t".join(f"{v:.8g}" for v in row) for row in samples)
            (folder / f"Made Up_PSF_{f + 1}_{w + 1}.dat").write_text(text, "latin-1")
    (folder / "Made Up_ISETPARMS.TXT").write_text(CODEV, "latin-1")
    return folder / "Made Up_ISETPARMS.TXT"


def tables() -> dict[str, Array]:
    heights = np.stack([real_mm(w) for w in WAVES], axis=1)
    angles = np.arctan(heights / PUPIL_MM)
    return {"DI": heights, "RI": np.stack([illumination(w) for w in WAVES], axis=1), "CRA": angles}


def written(folder: Path, kind: str, **more: Any) -> Path:
    return codev(folder) if kind == "codev" else zemax(folder, old=kind == "2005", **more)


@pytest.mark.parametrize("kind", ["2005", "2013", "codev"])
def test_a_set_gives_the_lens_it_was_written_from(kind: str, tmp_path: Path) -> None:
    lens = load_optics(written(tmp_path, kind))
    assert isinstance(lens, Lens)
    assert isinstance(lens.blur, LensDesign)
    assert lens.name == "Made Up"
    reference = real_mm(REFERENCE_NM)

    # Distortion and lateral color, also between the heights.
    mapping = lens.mapping(math.inf if kind == "codev" else lens.focus_distance_m or 0)
    assert mapping is not None
    np.testing.assert_allclose(mapping.wavelength_nm, WAVES)
    for w, wave in enumerate(WAVES):
        at = np.interp(HEIGHTS * 1e-3, mapping.ideal_m, mapping.real_m[w])
        np.testing.assert_allclose(at * 1e3, real_mm(wave), atol=2e-5)
    assert lens.distortion is not None
    np.testing.assert_allclose(lens.distortion.heights_m(1.0)[1] * 1e3, reference, atol=1e-6)

    assert lens.illumination is not None
    got = lens.illumination.at(reference * 1e-3, lens.illumination.field.ideal_m(1.0))
    np.testing.assert_allclose(got, illumination(REFERENCE_NM), atol=1e-6)

    # Zemax images at -y are in the upper half of the frame, CODE V images at +y in the lower; tails point outwards.
    side = 1 if kind == "codev" else -1
    np.testing.assert_allclose(lens.blur.field_y, side * reference, atol=1e-6)
    np.testing.assert_array_equal(lens.blur.field_x, 0)
    assert lens.blur.spacing_um == SPACING_UM
    axis = sample_positions(lens.blur.psf.shape[-1], SPACING_UM)
    for f, height in enumerate(HEIGHTS):
        for w, wave in enumerate(WAVES):
            expected = spot(axis, axis, height, wave, side)
            expected /= expected.sum()
            np.testing.assert_allclose(lens.blur.psf[f, w], expected, atol=2e-4 * expected.max())


def test_listings_without_a_field_are_of_images_at_minus_y(tmp_path: Path) -> None:
    found = read_ray_trace(zemax(tmp_path, old=True))
    for file in tmp_path.glob("*_PSF_*"):
        lines = file.read_text("latin-1").splitlines()
        file.write_text("\n".join(line for line in lines if " deg." not in line), "latin-1")
    np.testing.assert_allclose(found.point_spreads().field_y, -real_mm(REFERENCE_NM), atol=1e-6)


def test_base_and_focus_from_the_parameters(tmp_path: Path) -> None:
    lens = load_optics(zemax(tmp_path, old=True))
    assert isinstance(lens, Lens)
    assert (lens.base.f_number, lens.base.focal_length_mm) == (1.774644, 5.999968)
    assert lens.focus_distance_m is not None
    assert lens.magnification(lens.focus_distance_m) == pytest.approx(0.023954)
    file = tmp_path / "ISETPARMS.TXT"
    for distance, mag, expected in (("10000000000.000", "0.000000", math.inf), ("60000.000", "-0.000100", 60.0)):
        file.write_text(PARAMETERS.replace("250.000", distance).replace("-0.023954", mag), "latin-1")
        assert read_ray_trace(tmp_path).focus_distance_m == expected


@pytest.mark.parametrize("off_center_um", [-1.15, -0.2, 0.16, 0.25])
def test_listings_about_their_centroid(off_center_um: float, tmp_path: Path) -> None:
    for name, shift in (("chief", 0.0), ("centroid", off_center_um)):
        (tmp_path / name).mkdir()
        zemax(tmp_path / name, old=False, off_center_um=shift)
    chief, centroid = (read_ray_trace(tmp_path / name).point_spreads() for name in ("chief", "centroid"))
    a, b = chief.psf, centroid.psf
    margin = (b.shape[-1] - a.shape[-1]) // 2
    np.testing.assert_allclose(b if margin == 0 else b[..., margin:-margin, margin:-margin], a, atol=2e-3 * a.max())


def test_sections_of_an_optics_file_can_name_the_set(tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    zemax(tmp_path / "set", old=False)
    file = tmp_path / "mine.yaml"
    file.write_text(
        "photosite_optics: 1\nf_number: 1.77\nfocal_length_mm: 6\n"
        "blur: {kind: lens_design, source: set/ISETPARMS.TXT, rank: 3}\n"
        "distortion: {file: set/ISETPARMS.TXT, program: iset, wavelength_nm: 550}\n"
        "relative_illumination: {file: set, program: iset}\n"
    )
    lens = load_optics(file)
    assert isinstance(lens, Lens)
    assert isinstance(lens.blur, LensDesign)
    assert lens.blur.rank == 3
    assert lens.distortion is not None
    np.testing.assert_allclose(lens.distortion.heights_m(1.0)[1] * 1e3, real_mm(550), atol=1e-6)
    assert lens.lateral_color is not None
    np.testing.assert_allclose(
        lens.lateral_color.shift_um[:, -1], 1e3 * (tables()["DI"][-1] - real_mm(550)[-1]), atol=1e-3
    )
    assert lens.illumination is not None
    file.write_text(file.read_text().replace("nm: 550", "nm: 0.55"))
    with raises(FileError, "wavelength_nm"):
        load_optics(file)
    flipped = load_lens_design(tmp_path / "set", first_row="bottom")
    np.testing.assert_allclose(flipped.psf[-1, 1], lens.blur.psf[-1, 1][::-1], atol=1e-3 * lens.blur.psf[-1, 1].max())


def test_exit_pupil_from_chief_ray_angles(tmp_path: Path) -> None:
    found = read_ray_trace(zemax(tmp_path, old=True))
    assert found.exit_pupil_mm() == pytest.approx(PUPIL_MM, rel=1e-5)
    (tmp_path / "Made Up_CRA_.dat").write_text("0 0 0\n" * 4)
    assert found.exit_pupil_mm() == math.inf
    (tmp_path / "Made Up_CRA_.dat").write_text("0 0 0\n9 9 9\n18 18 18\n25 25 25\n")
    with raises(FileError, "chief-ray angles"):
        found.exit_pupil_mm()


def test_rounded_wavelength_step(tmp_path: Path) -> None:
    """8 wavelengths from 400 to 700: the macro prints wave=400:43:700."""
    (tmp_path / "Made Up_DI_.dat").write_text("\n".join(" ".join([f"{h}"] * 8) for h in HEIGHTS))
    (tmp_path / "ISETPARMS.TXT").write_text(PARAMETERS.replace("450:100:650", "400:43:700"))
    np.testing.assert_allclose(read_ray_trace(tmp_path).wavelength_nm, np.linspace(400, 700, 8))


def test_illumination_that_differs_with_wavelength_gives_a_warning(tmp_path: Path) -> None:
    file = zemax(tmp_path, old=True)
    (tmp_path / "Made Up_RI_.dat").write_text("1 1 1\n0.9 0.9 0.9\n0.8 0.8 0.8\n0.7 0.6 0.6\n")
    with warns("Made Up_RI_.dat"):
        read_ray_trace(file).relative_illumination()


@pytest.mark.parametrize(
    ("name", "old", "new", "error"),
    [
        ("ISETPARMS.TXT", "efl=5.999968", "", ("field 'efl' is missing", None)),
        ("ISETPARMS.TXT", "efl=5.999968", "efl=-6", ("efl", 13)),
        ("ISETPARMS.TXT", "efl=5.999968", "efl=six", ("efl", 13)),
        ("ISETPARMS.TXT", "=580.0", "=0.5800", ("refWave", 11)),
        ("ISETPARMS.TXT", "wave=450:100:650", "wave=450:650", ("wave", 5)),
        ("ISETPARMS.TXT", "wave=450:100:650", "wave=450:50:650", ("wave", None)),
        ("ISETPARMS.TXT", "imgHeightNum=4", "imgHeightNum=5", ("numbers", None)),
        ("ISETPARMS.TXT", "imgHeightNum=4", "imgHeightNum=1", ("imgHeightNum", 6)),
        ("ISETPARMS.TXT", "imgHeightNum=4", "imgHeightNum=6", ("heights", None)),
        ("ISETPARMS.TXT", "Made Up\\Made Up'", "Other'", ("there is no Other_DI_.dat beside it", None)),
        ("ISETPARMS.TXT", "objDist=250.000", "objDist(1)=250", ("holds several object distances", None)),
        ("Made Up_DI_.dat", " 0.000000E+00\n", "\n", ("numbers in this row", 2)),
        ("Made Up_RI_.dat", "1.000000E+00", "9.000000E-01", ("relative", None)),
        ("Made Up_RI_.dat", "7", "x", ("entry", 2)),
        ("Made Up_PSF_2_1.dat", "0.4500 µm", "0.6500 µm", ("wavelength", None)),
        ("Made Up_PSF_2_1.dat", " -9.9", " -9.7", ("center coordinates", None)),
        ("Made Up_PSF_2_1.dat", "Listing of Huygens PSF Data", "Sampling too low", ("is not a listing of an", None)),
    ],
)
def test_invalid_sets(name: str, old: str, new: str, error: tuple[str, int | None], tmp_path: Path) -> None:
    parameters = zemax(tmp_path, old=True)
    file = tmp_path / name
    text = file.read_text("latin-1")
    assert old in text
    file.write_text(text.replace(old, new), "latin-1")
    with raises(FileError, error[0], line=error[1]):
        load_optics(parameters)


def test_missing_and_exchanged_files(tmp_path: Path) -> None:
    file = zemax(tmp_path, old=False)
    two, three = (tmp_path / f"Made Up_2D_PSF_Fld{n}_Wave1.dat" for n in (2, 3))
    content = two.read_bytes()
    two.write_bytes(three.read_bytes())
    with raises(FileError, "image height"):
        load_optics(file)
    two.write_bytes(content)
    three.unlink()
    with raises(FileError, "there is no Made Up_"):
        load_optics(file)
    (tmp_path / "Made Up_DI_.dat").write_text("0 1 2 3\n0 1 2 3\n0 1 2 3\n")  # heights along rows
    with raises(FileError, "heights"):
        load_optics(file)
    (tmp_path / "b_ISETPARMS.txt").write_text(CODEV)
    with raises(FileError, "holds several sets, ISETPARMS.TXT and b_ISETPARMS.txt"):
        load_optics(tmp_path)


def test_size_of_code_v_grids(tmp_path: Path) -> None:
    file = codev(tmp_path)
    file.write_text(CODEV.replace("psfSize=40", "psfSize=64"))
    with raises(FileError, "samples"):
        load_optics(file)
    file.write_text(CODEV.replace("imgHeight=0:1:3", "imgHeight=1:1:3"))
    with raises(FileError, "imgHeight", line=6):
        load_optics(file)


# ISETCam, opticalimage/raytrace/zemax/20050902 db/AsphereF=2mm_DI_.dat: 400, 475 ... 700 nm, every second height.
REAL_DI = """0.000000E+000 0.000000E+000 0.000000E+000 0.000000E+000 0.000000E+000
1.013804E-001 1.018726E-001 1.021772E-001 1.023836E-001 1.025341E-001
2.023449E-001 2.033305E-001 2.039404E-001 2.043538E-001 2.046553E-001
3.024854E-001 3.039669E-001 3.048836E-001 3.055052E-001 3.059583E-001
4.014101E-001 4.033907E-001 4.046165E-001 4.054476E-001 4.060535E-001
4.987499E-001 5.012339E-001 5.027713E-001 5.038138E-001 5.045739E-001
5.941653E-001 5.971571E-001 5.990091E-001 6.002649E-001 6.011807E-001
6.873509E-001 6.908551E-001 6.930247E-001 6.944960E-001 6.955689E-001
7.780395E-001 7.820606E-001 7.845505E-001 7.862392E-001 7.874707E-001
8.660046E-001 8.705462E-001 8.733590E-001 8.752668E-001 8.766583E-001
9.510611E-001 9.561261E-001 9.592636E-001 9.613920E-001 9.629444E-001
"""


def test_real_heights_against_the_grid_distortion_of_the_program(tmp_path: Path) -> None:
    """AsphereF=2mm_GridDistortion_3.dat of the same folder, 550 nm: predicted and real heights."""
    efl = 0.696011 / math.tan(math.radians(19.4201))
    largest = efl * math.tan(math.radians(27.38))  # the field of AsphereF=2mm_PSF_21_3.dat
    text = PARAMETERS.replace("450:100:650", "400:75:700").replace("imgHeightNum=4", "imgHeightNum=11")
    (tmp_path / "ISETPARMS.TXT").write_text(text.replace("3.0000000", f"{largest:.7f}"))
    (tmp_path / "Made Up_DI_.dat").write_text(REAL_DI)
    distortion, color = read_ray_trace(tmp_path).distortion(550)
    mapping = Lens(DiffractionLimited(2.8, efl), distortion=distortion).mapping(math.inf)
    assert mapping is not None
    curve = image_height(mapping, 550.0)
    for x, y, real_x, real_y in (
        (0.696011, 0.0, 0.675084, 0.0),
        (0.696011, 0.326255, 0.670725, 0.314402),
        (0.674261, 0.522008, 0.644473, 0.498947),
    ):
        got = float(curve(np.array([math.hypot(x, y) * 1e-3]))[0]) * 1e3
        assert got == pytest.approx(math.hypot(real_x, real_y), abs=2.5e-4)
    assert color is not None
    np.testing.assert_allclose(color.shift_um[[0, 4], -1], [-8.2025, 3.6808], atol=1e-3)
