"""`photosite optics`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import photosite as ps
from photosite.cli.optics import _mtf
from photosite.optics.lens_design import LensDesign

FILE = """photosite_optics: 1
name: made up 50 mm
f_number: 2.8
focal_length_mm: 50
focus_distance_m: 2
blur: {kind: wavefront, zernike: {8: 60}}
veiling_glare: {fraction: 0.02}
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.optics.yaml"
    path.write_text(FILE, encoding="utf-8")
    return path


@pytest.mark.smoke("optics check")
def test_check_describes_the_lens(photosite: Any, file: Path) -> None:
    text = photosite("optics", "check", file).out
    assert "made up 50 mm: f/2.8, 50 mm; blur: wavefront; holds: a fixed focus, veiling glare" in text
    assert "550 nm, an object at 2 m" in text


def test_mtf_is_that_of_the_lens(photosite: Any, file: Path) -> None:
    found = photosite("optics", "check", file, "--wavelength", "500", "--distance", "2.1", "--json").json
    assert (found["name"], found["blur"], found["holds"]) == (
        "made up 50 mm",
        "wavefront",
        ["a fixed focus", "veiling glare"],
    )
    mtf = found["mtf"]
    f = np.array(mtf["frequency_per_mm"]) * 1e3
    otf = ps.load_optics(file).point_spread(2.1).otf
    np.testing.assert_allclose(mtf["along_rows"], np.abs(otf(0 * f, f, 500.0)), rtol=1e-9)
    np.testing.assert_allclose(mtf["along_columns"], np.abs(otf(f, 0 * f, 500.0)), rtol=1e-9)
    assert np.ptp([mtf["along_rows"][2], mtf["along_columns"][2]]) > 0.01  # coma differs along the two


def test_a_ray_trace_by_isets_macros_is_a_lens(photosite: Any, tmp_path: Path) -> None:
    """From Zemax, two heights at one wavelength; every PSF is the same Gaussian of 1 um (1 sigma)."""
    axis = np.arange(-16, 16) * 0.5
    spot = np.exp(-(axis[:, None] ** 2 + axis**2) / 2)
    numbers = "\n".join("\t".join(f"{v:.6E}" for v in row) for row in spot)
    (tmp_path / "ISETPARMS.TXT").write_text(
        "lensFile='Round.ZMX';\npsfSize=32;\npsfSpacing=0.0005;\nwave=550;\nimgHeightNum=2;\nimgHeightMax=3.0;\n"
        "objDist=10000000000.0;\nmag=0;\nbaseLensFileName='C:\\R\\Round'\nrefWave=550;\nefl=6;\nfnumber=2;\n"
    )
    (tmp_path / "Round_DI_.dat").write_text("0\n2.9\n")
    (tmp_path / "Round_RI_.dat").write_text("1\n0.8\n")
    for number in (1, 2):
        head = (
            f"Listing of Huygens PSF Data\n\n0.5500 µm at 0.0000, {3 - 3 * number:.4f} (mm).\n"
            "Data spacing is 0.5 µm.\nCenter point is: 17, 17\nValues are relative intensity.\n\n"
        )
        (tmp_path / f"Round_2D_PSF_Fld{number}_Wave1.dat").write_text(head + numbers, "utf-16")
    found = photosite("optics", "check", tmp_path / "ISETPARMS.TXT", "--json").json
    assert (found["name"], found["f_number"], found["focal_length_mm"], found["blur"]) == ("Round", 2, 6, "lens_design")
    assert found["holds"] == ["a fixed focus", "relative illumination", "distortion"]
    f = np.array(found["mtf"]["frequency_per_mm"])
    np.testing.assert_allclose(found["mtf"]["along_rows"], np.exp(-2 * (np.pi * f * 1e-3) ** 2), atol=3e-4)
    (tmp_path / "Round_RI_.dat").unlink()
    done = photosite("optics", "check", tmp_path)
    assert done.status == 2
    assert "ISETPARMS.TXT: there is no Round_RI_.dat beside it" in done.err


def test_a_perfect_lens_is_diffraction_at_infinity(photosite: Any, tmp_path: Path) -> None:
    path = tmp_path / "perfect.optics.yaml"
    path.write_text("photosite_optics: 1\nf_number: 8\nfocal_length_mm: 50\n", encoding="utf-8")
    found = photosite("optics", "check", path, "--json").json
    assert (found["name"], found["blur"], found["holds"], found["distance_m"]) == (None, "diffraction", [], None)
    r = np.array([10, 20, 40, 80, 160]) * 550e-6 * 8
    expected = 2 / np.pi * (np.arccos(r) - r * np.sqrt(1 - r * r))
    np.testing.assert_allclose(found["mtf"]["along_rows"], expected, rtol=1e-9)
    assert "describes a lens: f/8" in photosite("optics", "check", path).out


def test_a_psf_table_is_linear_between_its_wavelengths(photosite: Any, tmp_path: Path) -> None:
    x = np.arange(-12, 13) * 0.5
    psf = np.stack([np.exp(-(x[:, None] ** 2 + x**2) / 2 / s**2) for s in (0.7, 1.2)])
    psf /= psf.sum(axis=(1, 2), keepdims=True)
    np.savez(tmp_path / "psf.npz", psf=psf, spacing_um=0.5, wavelength_nm=[450.0, 650.0])
    path = tmp_path / "psf.optics.yaml"
    path.write_text(
        "photosite_optics: 1\nf_number: 8\nfocal_length_mm: 50\nblur: {kind: psf, file: psf.npz}\n", encoding="utf-8"
    )

    def at(wavelength_nm: float) -> Any:
        args = ("optics", "check", path, "--wavelength", str(wavelength_nm), "--json")
        return np.array(photosite(*args).json["mtf"]["along_rows"])

    np.testing.assert_allclose(at(500), 0.75 * at(450) + 0.25 * at(650), atol=1e-12)
    np.testing.assert_allclose(at(450), np.exp(-2 * (np.pi * 0.7e-3 * np.array([10, 20, 40, 80, 160])) ** 2), atol=1e-4)


def test_field_psf_on_the_axis() -> None:
    x = np.arange(-12, 13) * 0.5
    psf = np.stack([np.exp(-(x[:, None] ** 2 + x**2) / 2 / s**2) for s in (1.0, 1.4)])[:, None]
    design = LensDesign(np.array([550.0]), psf, 0.5, np.zeros(2), np.array([0.0, 8.0]), rank=2)
    spread = ps.Lens(ps.DiffractionLimited(2.8, 50), design).point_spread(2.0)
    f, along_rows, along_columns = zip(*_mtf(spread, 550.0), strict=True)
    expected = np.exp(-2 * (np.pi * 1e-3 * np.array(f)) ** 2)
    np.testing.assert_allclose([along_rows, along_columns], [expected, expected], atol=1e-4)


def test_lens_design_over_the_field(photosite: Any, tmp_path: Path) -> None:
    """Gaussians: round on the axis, at the edge 1.6 um along the radius and 0.9 um across it (1 sigma)."""
    x, sigmas = np.arange(-20, 21) * 0.5, ((1.0, 1.0), (0.9, 1.6))
    psf = np.stack([np.exp(-((x[:, None] / down) ** 2 + (x / right) ** 2) / 2) for down, right in sigmas])
    waves, heights = np.array([450.0, 650.0]), np.array([0.0, 8.0])
    for field_y, field_x in ((heights, 0 * heights), (0 * heights, -heights)):  # rotated to the right of the axis
        turned = psf.transpose(0, 2, 1) if field_y.any() else psf
        both = np.stack([turned, turned], axis=1)
        design = LensDesign(waves, both, 0.5, field_y, field_x, tolerance=1e-6, detail_um=2.0)
        ps.Lens(ps.DiffractionLimited(2.8, 50), design).save(tmp_path / "d.yaml")
        found = photosite("optics", "check", tmp_path / "d.yaml", "--json").json["lens_design"]
        assert (found["wavelength_nm"], found["field_unit"], found["spacing_um"]) == ([450, 650], "mm", 0.5)
        np.testing.assert_array_equal(found["field_xy"], np.stack([field_x, field_y], 1))
        assert found["relative_error"] <= 1e-6
        assert found["modes"] > 2
        assert [at["height_mm"] for at in found["mtf_over_field"]] == pytest.approx([4, 5.6, 8])
        edge = found["mtf_over_field"][-1]
        f = np.array(edge["frequency_per_mm"]) * 1e-3
        np.testing.assert_allclose(edge["tangential"], np.exp(-2 * (np.pi * f * 1.6) ** 2), atol=1e-3)
        np.testing.assert_allclose(edge["sagittal"], np.exp(-2 * (np.pi * f * 0.9) ** 2), atol=1e-3)
    text = photosite("optics", "check", tmp_path / "d.yaml").out
    assert "2 wavelengths, 450, 650 nm; 2 field points along a radius to 8 mm; 41 x 41 samples 0.5 um apart" in text
    assert f"{found['modes']} modes, RMS error of their sum 0.00%, blurred by pixels of 2 um" in text
    assert "8 mm T" in text


def test_a_single_field_point(photosite: Any, tmp_path: Path) -> None:
    x = np.arange(-12, 13) * 0.5
    psf = np.exp(-(x[:, None] ** 2 + x**2) / 2)[None, None]
    design = LensDesign(np.array([550.0]), psf, 0.5, np.zeros(1), np.zeros(1))
    ps.Lens(ps.DiffractionLimited(2.8, 50), design).save(tmp_path / "d.yaml")
    found = photosite("optics", "check", tmp_path / "d.yaml", "--json").json["lens_design"]
    assert (found["modes"], found["relative_error"], found["mtf_over_field"]) == (1, 0, [])
    text = photosite("optics", "check", tmp_path / "d.yaml").out
    assert "1 wavelength, 550 nm; 1 field point along a radius to 0 mm" in text


def test_errors_are_one_line(photosite: Any, file: Path) -> None:
    file.write_text(FILE.replace("zernike", "zernikes"), encoding="utf-8")
    refused = photosite("optics", "check", file)
    assert (refused.status, refused.err.count("\n")) == (2, 1)
    assert "mine.optics.yaml:6: blur: unknown field 'zernikes'. Did you mean 'zernike'?" in refused.err
    for option in ("--wavelength", "--distance"):
        for value in ("nan", "0.5" if option == "--wavelength" else "0"):
            file.write_text(FILE, encoding="utf-8")
            refused = photosite("optics", "check", file, option, value)
            assert (refused.status, refused.out, refused.err.count("\n")) == (2, "", 1)
    refused = photosite("optics", "check", file, "--wavelength", "nan")
    assert "--wavelength must be above 0, got nan" in refused.err
    assert "Did you mean 'check'" in photosite("optics", "chek", file).err
