"""Spectra, integration over wavelength and tristimulus values."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import colour_science, lab, luminance_cd_m2
from photosite.color.spectrum import Spectrum, integration_weights, load_spectrum, photons_from_energy, wavelength_grid
from photosite.errors import FileError, InputError
from photosite.scene import charts


def test_trapezoid_is_exact_for_straight_lines_on_uneven_grids() -> None:
    grid = np.array([400.0, 410.0, 440.0, 445.0])
    assert (3 * grid + 1) @ integration_weights(grid) == pytest.approx(1.5 * (445**2 - 400**2) + 45, rel=1e-14)


def test_rectangle_rule_rejects_unequal_steps() -> None:
    with pytest.raises(InputError):
        integration_weights([400, 410, 430], "rectangle")


@pytest.mark.parametrize("grid", [[500, 400], [400, 400], [], [[400, 500]], [math.nan, 1], [-1, 5]])
def test_invalid_wavelength_grids(grid: list[float]) -> None:
    with raises(InputError, "wavelength_nm"):
        wavelength_grid(grid)


def test_spectrum_needs_a_value_per_wavelength() -> None:
    with raises(InputError, "values"):
        Spectrum([400.0, 500.0], [1.0])


def test_luminance_of_a_monochromatic_watt() -> None:
    """1 W/sr/m2 at 555 nm is 683 cd/m2 by definition; at 507 nm V = 0.444310 (CIE 1931, 1 nm table)."""
    grid = np.arange(380.0, 781.0)
    for wavelength, v in ((555.0, 1.0), (507.0, 0.444310)):
        line = photons_from_energy(np.where(grid == wavelength, 1.0, 0.0), grid)
        assert luminance_cd_m2(line, grid) == pytest.approx(683 * v, rel=1e-5)


@pytest.mark.parametrize("xyz", [[1.0, 2.0], [1.0, np.nan, 1.0]])
def test_lab_rejects_invalid_xyz(xyz: list[float]) -> None:
    with raises(InputError, "xyz"):
        lab(xyz)


def test_importing_colour_science_keeps_numpy_print_options() -> None:
    before = np.get_printoptions()
    colour_science()
    assert np.get_printoptions() == before


def test_chart_without_visible_light() -> None:
    with pytest.raises(InputError):
        charts.macbeth(Spectrum(np.array([380.0, 780.0]), np.zeros(2)))


def test_read_spectrum(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("# a lamp\nnm, Power, u\n400, 1.5, 0.1  # first line\n\n410,2,0.2\n")
    content = load_spectrum(file)
    assert content.spectrum.wavelength_nm.tolist() == [400.0, 410.0]
    assert content.spectrum.values.tolist() == [1.5, 2.0]
    assert content.standard_uncertainty.tolist() == [0.1, 0.2]
    assert content.columns == ("wavelength_nm", "power", "u")
    file.write_text("400,1\n")
    assert load_spectrum(file).columns == ()


@pytest.mark.parametrize(
    "text",
    [
        "400;0,25\n410;0,5\n",
        "400\t0,25\n410\t0,5\n",
        "400 0,25\n410 0,5\n",
        "400 0.25\n410   0.5\n",
        "400, 0.25,\n410, 0.5,\n",
        "410,0.5\n400,0.25\n",
        "Wavelength [µm];QE\n0,4;0,25\n0,41;0,5\n",
        "lambda,QE\n0.4,0.25\n0.41,0.5\n",
        "# camera: X\n# Wavelength (um), QE\n0.4,0.25\n0.41,0.5\n",
        "% made by hand\n4000 0.25\n4100 0.5\n".replace("%", "% Wavelength(angstrom) QE\n%"),
    ],
)
def test_spectra_as_people_write_them(tmp_path: Path, text: str) -> None:
    file = tmp_path / "a.csv"
    for written in (text.encode(), text.encode("utf-16"), text.replace("\n", "\r\n").encode("utf-8-sig")):
        file.write_bytes(written)
        spectrum = load_spectrum(file).spectrum
        np.testing.assert_allclose(spectrum.wavelength_nm, [400, 410], rtol=1e-14)
        assert spectrum.values.tolist() == [0.25, 0.5]


@pytest.mark.parametrize(
    ("text", "what", "line"),
    [
        ("", "the file holds no spectrum", None),
        ("nm,v\n", "the file holds no spectrum", None),
        ("nm,v\nnm,v\n", "the file is not a spectrum: a cell is not a finite number: 'nm'", 2),
        ("400,1\n410,1\n390,2\n", "wavelength", 3),
        ("400,1\n410,nan\n", "the file is not a spectrum: a cell is not a finite number: 'nan'", 2),
        ("400,1\n410,2,3\n", "the file is not a spectrum: the row has 3 cells, not 2", 2),
        ("410,1\n400,2\n400,3\n", "wavelength", 2),
        ("400,1,-1\n", "standard_uncertainty", 1),
        ("-400,1\n", "wavelength_nm", None),
    ],
)
def test_invalid_spectrum_files(tmp_path: Path, text: str, what: str, line: int | None) -> None:
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(FileError) as caught:
        load_spectrum(file)
    assert (caught.value.what, caught.value.line) == (what, line)


def test_missing_spectrum_file(tmp_path: Path) -> None:
    with pytest.raises(FileError):
        load_spectrum(tmp_path / "none.csv")


def test_columns_in_percent(tmp_path):
    file = tmp_path / "a.csv"
    file.write_text("nm,relative energy (%),standard uncertainty (%)\n400,50,1\n500,100,2\n")
    content = load_spectrum(file)
    assert content.columns == ("wavelength_nm", "relative_energy", "standard_uncertainty")
    assert content.spectrum.values.tolist() == [0.5, 1.0]
    assert content.standard_uncertainty.tolist() == [0.01, 0.02]
    file.write_text("nm,responsivity_a_per_w,u (%)\n400,0.1,1\n500,0.2,2\n")
    with raises(FileError, "the heading of the standard uncertainty", value="u (%)", line=1):
        load_spectrum(file)
