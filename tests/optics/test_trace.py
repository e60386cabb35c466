"""Traced lenses: Airy's pattern of a perfect lens, paraxial and third-order formulas, a Cooke triplet, bad input."""

from __future__ import annotations

import importlib.util
import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raising import raises
from scipy.special import j0, j1

import photosite as ps
from photosite.errors import FileError, InputError, PhotositeWarning
from photosite.optics.io.prescription import read_prescription
from photosite.optics.lens_design import LensDesign
from photosite.optics.trace import TracedLens, trace_lens

HAS_RAYOPTICS = importlib.util.find_spec("rayoptics") is not None
needs_rayoptics = pytest.mark.skipif(not HAS_RAYOPTICS, reason="needs rayoptics")

HEAD = "# f_number: {f_number}\n# fields_deg: {fields}\n# wavelengths_nm: {waves}\n"
COLUMNS = "radius_mm, thickness_mm, glass, semi_diameter_mm, conic, stop\n"

TRIPLET = """# f_number: 5
# fields_deg: 0, 14, 20
# wavelengths_nm: 486.13, 587.56, 656.27
radius_mm; thickness_mm; glass; semi_diameter_mm; stop
22,01359; 3,25896; N-SK16 Schott; 9,5; 0
-435,76044; 6,00755; ; 9,5; 0
-22,21328; 0,99997; F2 Schott; 5; 0
20,29192; 4,75041; ; 5; 1
79,68360; 2,95208; N-SK16 Schott; 7,5; 0
-18,39533; 42,20778; ; 7,5; 0
"""
"""A Cooke triplet of 50 mm, f/5, 20 degrees, in the form of textbooks of lens design."""


def table(folder: Path, surfaces: str, *, f_number: float = 4, fields: str = "0", waves: str = "550") -> Path:
    file = folder / "lens.csv"
    file.write_text(HEAD.format(f_number=f_number, fields=fields, waves=waves) + COLUMNS + surfaces)
    return file


def perfect(folder: Path, f_number: float = 8, **stated: Any) -> Path:
    """A plano-hyperboloid, of conic constant -n^2, images a point at infinity on its axis without aberrations."""
    return table(folder, "inf, 5, 1.5, 10, 0, 1\n-25, 50, , 10, -2.25, 0\n", f_number=f_number, **stated)


@needs_rayoptics
def test_a_perfect_lens_has_airys_pattern(tmp_path: Path) -> None:
    traced = trace_lens(perfect(tmp_path))
    assert traced.lens.base.focal_length_mm == pytest.approx(50, rel=1e-9)
    bundle = traced.bundles[0][0]
    assert bundle.spot_radius_mm < 1e-7
    blur = traced.lens.blur
    assert isinstance(blur, LensDesign)
    psf = blur.psf[0, 0]
    # The rim of a perfect lens of n = 1.5 is at the sine of the marginal ray, traced by Snell's law in the test.
    aperture = float(np.hypot(*bundle.rim.T).max())
    place = (np.arange(len(psf)) - len(psf) // 2) * blur.spacing_um
    r = np.hypot(place[:, None], place) * 2 * np.pi / 0.55 * aperture
    airy = np.where(r == 0, 1, 2 * j1(np.where(r == 0, 1, r)) / np.where(r == 0, 1, r)) ** 2
    np.testing.assert_allclose(psf / psf.max(), airy, atol=4e-3)
    # Encircled energy, 1 - J0^2 - J1^2, over that of the whole window.
    for radius in (3.83, 7.02, 10.17):
        inside = (psf * (r <= radius)).sum() / (airy * (r <= radius)).sum() * airy.sum()
        assert inside == pytest.approx(1, abs=0.01)
    edge = float(r[len(psf) // 2].max())
    assert psf[r <= 10.17].sum() == pytest.approx((1 - j0(10.17) ** 2 - j1(10.17) ** 2) / (1 - j0(edge) ** 2), abs=0.02)


def paraxial(surfaces: list[tuple[float, float, float]], height: float) -> tuple[float, float, float]:
    """Focal length, back focal distance, and Seidel sum S_I of curvature, thickness, index behind; stop in front."""
    y, u, n, spherical = height, 0.0, 1.0, 0.0
    for curvature, thickness, behind in surfaces:
        incidence = n * (u + y * curvature)  # n i, H. H. Hopkins' A
        after = (n * u - y * curvature * (behind - n)) / behind
        spherical -= incidence**2 * y * (after / behind - u / n)
        n, u = behind, after
        y, last = y + thickness * u, y
    return -height / u, -last / u, spherical


@needs_rayoptics
def test_spherical_aberration_is_the_third_order_formula(tmp_path: Path) -> None:
    """A convex-plano singlet at f/25: the path at the paraxial focus is -S_I / 8 rho^4, within the next order.

    Hopkins' wavefront aberration is the path of the chief ray less that of the ray.
    """
    index, radius, thick = 1.6, 60.0, 4.0
    surfaces = [(1 / radius, thick, index), (0.0, 0.0, 1.0)]
    focal, back, _ = paraxial(surfaces, 1.0)
    file = table(tmp_path, f"{radius}, {thick}, {index}, 20, 0, 1\ninf, {back!r}, , 20, 0, 0\n", f_number=25)
    traced = trace_lens(file)
    assert traced.lens.base.focal_length_mm == pytest.approx(focal, rel=1e-9)
    height = focal / 50
    *_, spherical = paraxial(surfaces, height)
    bundle = traced.bundles[0][0]
    rho = np.hypot(*bundle.pupil.T)
    fitted = np.linalg.lstsq(np.stack([rho**2, rho**4], axis=1), bundle.path, rcond=None)[0]
    assert fitted[1] == pytest.approx(-spherical / 8, rel=0.02)
    assert abs(fitted[0]) < 0.02 * abs(fitted[1])


@pytest.fixture(scope="module")
def triplet(tmp_path_factory: pytest.TempPathFactory) -> TracedLens:
    file = tmp_path_factory.mktemp("triplet") / "cooke.csv"
    file.write_text(TRIPLET)
    return trace_lens(file)


@needs_rayoptics
def test_a_cooke_triplet(triplet: TracedLens) -> None:
    lens = triplet.lens
    assert lens.base.focal_length_mm == pytest.approx(50.0, rel=1e-3)
    assert lens.base.f_number == pytest.approx(5, rel=1e-9)
    assert lens.distortion is not None
    assert lens.illumination is not None
    assert lens.lateral_color is not None
    assert np.abs(lens.distortion.ratio - 1).max() < 0.01
    # Nearly cos^4 where nothing is cut off.
    natural = np.cos(np.radians(triplet.field_deg)) ** 4
    np.testing.assert_allclose(lens.illumination.relative, natural, atol=0.02)
    assert all(row[triplet.reference].spot_radius_mm < 0.02 for row in triplet.bundles)
    assert np.abs(lens.lateral_color.shift_um).max() < 10
    blur = lens.blur
    assert isinstance(blur, LensDesign)
    np.testing.assert_allclose(blur.psf.sum(axis=(2, 3)), 1, rtol=1e-12)
    # The centroid of a PSF is that of the rays: gradients of the wavefront are displacements.
    for row, psf in zip(triplet.bundles, blur.psf, strict=True):
        bundle = row[triplet.reference]
        rows = (np.arange(psf.shape[-1]) - psf.shape[-1] // 2) * blur.spacing_um * 1e-3
        centroid = float((psf[triplet.reference].sum(axis=1) * rows).sum())
        rays = (bundle.landing[bundle.even] - bundle.chief).mean(axis=0)
        assert centroid == pytest.approx(np.sign(bundle.chief[1] or 1) * rays[1], abs=0.003)


@needs_rayoptics
def test_vignetting_is_less_light_and_a_narrower_pupil(tmp_path: Path) -> None:
    """A stop behind a narrow front element cuts the pupil at 6 degrees, and not on the axis."""
    surfaces = "50, 4, 1.5, {semi}, 0, 0\ninf, 40, , 20, 0, 0\ninf, 53, , 20, 0, 1\n"
    narrow, wide = (
        trace_lens(table(tmp_path, surfaces.format(semi=semi), f_number=8, fields="0, 6"), fields=2) for semi in (8, 30)
    )
    assert narrow.lens.illumination is not None
    assert wide.lens.illumination is not None
    assert narrow.lens.illumination.relative[1] < 0.8 * wide.lens.illumination.relative[1]
    assert narrow.bundles[0][0].projected_solid_angle == pytest.approx(
        wide.bundles[0][0].projected_solid_angle, rel=1e-9
    )


@needs_rayoptics
def test_a_camera_takes_a_traced_lens(tmp_path: Path, triplet: TracedLens) -> None:
    triplet.lens.save(tmp_path / "cooke.optics.yaml")
    lens = ps.load_optics(tmp_path / "cooke.optics.yaml")
    sensor = ps.load_sensor("nikon-d200").with_(rows=60, cols=90)
    frame = ps.Camera(lens, sensor).capture(ps.charts.macbeth("D65", 100), exposure_s=0.01, seed=1)
    assert frame.dn.mean() > 100
    page = pytest.importorskip("photosite.report.lens").lens_page(triplet)
    assert [section.title for section in page.sections] == ["Layout", "Spots", "MTF", "Field"]


@needs_rayoptics
@pytest.mark.parametrize(
    ("surfaces", "what"),
    [
        ("50, 4, N-XYZ9, 10, 0, 1\ninf, 90, , 10, 0, 0\n", "the glass 'N-XYZ9' is in no catalogue"),
        ("50, 4, 1.5, 10, 0, 0\ninf, 90, , 10, 0, 0\n", "no surface is the stop"),
        ("x, 4, 1.5, 10, 0, 1\n", "'radius_mm' is not a number: 'x'"),
        ("-50, 4, 1.5, 10, 0, 1\n50, 90, , 10, 0, 0\n", "focal length"),
    ],
)
def test_bad_tables(tmp_path: Path, surfaces: str, what: str) -> None:
    with pytest.raises(FileError) as caught:
        trace_lens(table(tmp_path, surfaces))
    assert what in caught.value.what
    assert len(str(caught.value).splitlines()) == 1


@needs_rayoptics
def test_bad_files(tmp_path: Path) -> None:
    file = tmp_path / "a.zmx"
    file.write_text("VERS 1\nnothing\n")
    for path, what in (
        (tmp_path / "none.zmx", "there is no such file"),
        (tmp_path / "a.abc", "suffix"),
        (file, "is not a lens prescription"),
    ):
        with pytest.raises(FileError) as caught:
            trace_lens(path)
        assert what in caught.value.what or "cannot be read as a lens prescription" in caught.value.what
    with raises(InputError, "fields", value=1):
        trace_lens(perfect(tmp_path), fields=1)


ZMX = """VERS 140730 195 26155
MODE SEQ
NAME {name}
UNIT MM X W X CM MR CPMM
ENVD 20 1 0
PFIL 0 0 0
FNUM 10 0
FTYP 0 0 1 1 0 0 0
XFLN 0
YFLN 0
FWGN 1
WAVM 1 0.55 1
PWAV 1
SURF 0
  TYPE STANDARD
  CURV 0.0
  DISZ {object}
SURF 1
  STOP
  TYPE STANDARD
  CURV 0.02
  DISZ 4
  GLAS {glass}
  DIAM 10 1 0 0 1
SURF 2
  TYPE STANDARD
  CURV 0.0
  DISZ 90
  DIAM 10 1 0 0 1
SURF 3
  TYPE STANDARD
  CURV 0.0
  DISZ 0
"""


@needs_rayoptics
@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"glass": "MIRROR 0 0 1.5 40"}, "has a mirror"),
        ({"object": "200"}, "has an object at 200 mm"),
        ({"glass": "NOSUCHGLASS99 0 0 1.62 36.4"}, "has a glass that is in no catalogue: NOSUCHGLASS99"),
        ({}, ""),
    ],
)
def test_zemax_files(tmp_path: Path, changed: dict[str, str], what: str) -> None:
    file = tmp_path / "lens.zmx"
    file.write_text(ZMX.format(**({"name": "one", "glass": "N-BK7 0 0 1.5168 64.2", "object": "INFINITY"} | changed)))
    if not what:
        traced = trace_lens(file)
        # The lensmaker's formula with the index of N-BK7 at 550 nm.
        assert traced.lens.base.focal_length_mm == pytest.approx(50 / 0.51852, rel=1e-4)
        return
    with pytest.raises(FileError) as caught:
        trace_lens(file)
    assert what in caught.value.what
    assert [path.name for path in tmp_path.iterdir()] == ["lens.zmx"]  # the library writes a template of glasses


SEQ = """RDM;LEN
TITLE 'one'
EPD 10
DIM M
WL 550
REF 1
WTW 1
YAN 0
SO 0 1e11
S 50 5 {glass}
 STO
S 0 90
SI 0 0
GO
"""
ONLINE = "https://refractiveindex.info/database/data/main/CaF2/nk/Li.yml"


@needs_rayoptics
@pytest.mark.parametrize(
    ("suffix", "glass", "named"),
    [
        (".zmx", f"{ONLINE} 0 0 1.43 95", ONLINE),
        (".seq", f"{ONLINE}_rindexinfo", ONLINE),
        (".seq", "NOSUCHGLASS99", "NOSUCHGLASS99"),
        (".seq", "PMMA_SPECIAL", "PMMA"),
        (".csv", f"{ONLINE} rindexinfo", ONLINE[:40]),
        (".csv", "prices.yml rindexinfo", "prices.yml rindexinfo"),
        (".csv", "N-BK7 Nosuch", "N-BK7 Nosuch"),
    ],
)
def test_glasses_are_those_of_local_catalogues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, glass: str, named: str
) -> None:
    """No socket is opened, and the error names the glass."""
    opened = []
    for name in ("socket", "create_connection", "getaddrinfo"):
        monkeypatch.setattr(socket, name, lambda *given, **_: opened.append(given))
    file = tmp_path / f"lens{suffix}"
    if suffix == ".csv":
        table(tmp_path, f"50, 4, {glass}, 10, 0, 1\ninf, 90, , 10, 0, 0\n")
    elif suffix == ".zmx":
        content = ZMX.format(name="one", glass=glass, object="INFINITY")
        file.write_text(content.replace("MODE SEQ", "MODE SEQ\nGCAT rindexinfo"))
    else:
        file.write_text(SEQ.format(glass=glass))
    with pytest.raises(FileError) as caught:
        read_prescription(file)
    assert "in no catalogue" in caught.value.what
    assert named in caught.value.what
    assert not opened


@needs_rayoptics
def test_glasses_of_a_sequence_and_replaced_ones(tmp_path: Path) -> None:
    """The glass of another maker is traced with a warning."""
    file = tmp_path / "lens.seq"
    file.write_text(SEQ.format(glass="NBK7_SCHOTT"))
    assert read_prescription(file).model["seq_model"].gaps[1].medium.name() == "N-BK7"
    file.write_text(SEQ.format(glass="X-SK16_SCHOTT"))
    with pytest.warns(PhotositeWarning, match="X-SK16 is in no catalogue; N-SK16 of Schott is traced"):
        read_prescription(file)


@needs_rayoptics
@pytest.mark.parametrize("suffix", [".zmx", ".seq"])
def test_replacements_of_glasses_are_not_run(tmp_path: Path, suffix: str) -> None:
    """rayoptics evaluates the .smx file beside a prescription as Python."""
    ran = tmp_path / "ran"
    content = ZMX.format(name="one", glass="NOSUCHGLASS99 0 0 1.62 36.4", object="INFINITY")
    (tmp_path / f"lens{suffix}").write_text(content if suffix == ".zmx" else "LEN\nEPD 10\nS 50 5 NOSUCHGLASS99\n")
    (tmp_path / "lens.smx").write_text(json.dumps({"NOSUCHGLASS99": f"open({str(ran)!r}, 'w')"}))
    with pytest.raises(FileError):
        trace_lens(tmp_path / f"lens{suffix}")
    assert not ran.exists()


@pytest.mark.skipif(HAS_RAYOPTICS, reason="rayoptics is installed")
def test_without_rayoptics(tmp_path: Path) -> None:
    with raises(FileError, "tracing a lens needs rayoptics, which is missing"):
        read_prescription(perfect(tmp_path))
