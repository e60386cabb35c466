"""Spectra against constants of nature and tables of the CIE."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from photosite.color import spectrum as spectra
from photosite.color.spectrum import Spectrum
from photosite.errors import InputError
from photosite.scene import charts


def test_trapezoid_is_exact_for_straight_lines_on_uneven_grids() -> None:
    grid = np.array([400.0, 410.0, 440.0, 445.0])
    assert (3 * grid + 1) @ spectra.integration_weights(grid) == pytest.approx(1.5 * (445**2 - 400**2) + 45, rel=1e-14)


def test_rectangle_rule_refuses_unequal_steps() -> None:
    with pytest.raises(InputError, match="equal steps"):
        spectra.integration_weights([400, 410, 430], "rectangle")


@pytest.mark.parametrize("grid", [[500, 400], [400, 400], [], [[400, 500]], [math.nan, 1], [-1, 5]])
def test_grids_that_cannot_be(grid: list[float]) -> None:
    with pytest.raises(InputError, match="wavelengths"):
        spectra.wavelength_grid(grid)


@pytest.mark.parametrize("temperature", [1000.0, 2856.0, 6504.0])
def test_blackbody_keeps_the_stefan_boltzmann_law(temperature: float) -> None:
    grid = np.geomspace(50, 1e6, 20001)
    radiant_exitance = math.pi * spectra.blackbody(temperature, grid) @ spectra.integration_weights(grid)
    assert radiant_exitance == pytest.approx(5.670374419e-8 * temperature**4, rel=1e-5)


def test_blackbody_peaks_where_wien_says() -> None:
    grid = np.arange(300.0, 1500.0, 0.1)
    peak = grid[np.argmax(spectra.blackbody(5000, grid))]
    assert peak == pytest.approx(2.897771955e6 / 5000, abs=0.1)


@pytest.mark.parametrize(
    ("name", "x", "y"),
    [("A", 0.44758, 0.40745), ("D65", 0.31272, 0.32903), ("FL2", 0.37208, 0.37529), ("E", 1 / 3, 1 / 3)],
)
def test_illuminants_have_their_published_chromaticities(name: str, x: float, y: float) -> None:
    """CIE 015:2018, 2 degree observer. The tables hold 5 nm steps to 780 nm; the rest is below 2e-4."""
    grid = np.arange(360.0, 781.0) if name != "FL2" else np.arange(380.0, 781.0)
    values = spectra.xyz(spectra.photons_from_energy(spectra.illuminant(name, grid), grid), grid)
    assert values[:2] / values.sum() == pytest.approx([x, y], abs=2e-4)


def test_illuminant_a_is_a_blackbody_of_2856_kelvin() -> None:
    """CIE A is Planck's law at 2848 K of the second constant 1.435e-2, which is 2855.5 K of today's."""
    grid = np.arange(380.0, 781.0, 10)
    ratio = spectra.illuminant("A", grid) / spectra.blackbody(1.4387768775e-2 / 1.435e-2 * 2848, grid)
    assert ratio / ratio.mean() == pytest.approx(np.ones(grid.size), abs=2e-4)


@pytest.mark.parametrize("name", [3200, "3200", "3200K", "3200 k", "blackbody 3200", "blackbody:3200K"])
def test_blackbodies_by_name(name: str | int) -> None:
    assert (spectra.illuminant(name) == spectra.blackbody(3200.0)).all()


def test_tungsten_means_cie_a_unless_a_spectrum_is_given() -> None:
    assert (spectra.illuminant("Tungsten") == spectra.illuminant("A")).all()
    own = Spectrum(np.array([300.0, 900.0]), np.array([1.0, 3.0]))
    assert spectra.illuminant(own, [600.0]) == pytest.approx([2.0])


@pytest.mark.parametrize("name", ["10K", 25, "blackbody 60"])
def test_a_blackbody_too_cold_to_shine_is_no_light(name: str | int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert spectra.blackbody(10.0)[0] == 0.0
        for make in (spectra.illuminant, charts.macbeth, charts.uniform, charts.color_checker_sg):
            with pytest.raises(InputError, match=r"K sends out no light from 380 to 7\d0 nm; give its temperature"):
                make(name)
    assert charts.macbeth(100).light().max() > 0


def test_a_chart_in_the_dark_has_no_luminance() -> None:
    with pytest.raises(InputError, match="no light that the eye sees"):
        charts.macbeth(Spectrum(np.array([380.0, 780.0]), np.zeros(2)))


def test_an_unknown_illuminant_far_from_all_is_answered_in_a_line() -> None:
    with pytest.raises(
        InputError, match=r"'moonshine'; known are the CIE's \(A, D65, .*'daylight 5600'.*illuminant"
    ) as said:
        spectra.illuminant("moonshine")
    assert len(str(said.value)) < 240


def test_an_illuminant_is_not_stretched_beyond_its_table() -> None:
    with pytest.raises(InputError, match="known from 400 to 700 nm only"):
        spectra.illuminant(Spectrum(np.array([400.0, 700.0]), np.ones(2)), [390.0, 500.0])


def test_luminance_of_a_monochromatic_watt() -> None:
    """1 W/sr/m2 at 555 nm is 683 cd/m2 by definition; at 507 nm V = 0.444310 (CIE 1931, 1 nm table)."""
    grid = np.arange(380.0, 781.0)
    for wavelength, v in ((555.0, 1.0), (507.0, 0.444310)):
        line = spectra.photons_from_energy(np.where(grid == wavelength, 1.0, 0.0), grid)
        assert spectra.luminance_cd_m2(line, grid) == pytest.approx(683 * v, rel=1e-5)


def test_importing_colour_science_leaves_printing_alone() -> None:
    before = np.get_printoptions()
    from photosite.color.cie import colour_science

    colour_science()
    assert np.get_printoptions() == before


def test_cie_a_beyond_its_table_is_its_definition() -> None:
    """A blackbody of 2848 K by a c2 of 1.435e-2 m K is one of 2856 K by today's, 100 at 560 nm (ISO 11664-2)."""
    c2 = spectra.PLANCK_J_S * spectra.LIGHT_SPEED_M_S / spectra.BOLTZMANN_J_K
    grid = np.array([250.0, 299, 560, 781, 800, 830, 1000, 2500])
    glow = spectra.blackbody(2848 * c2 / 1.435e-2, grid)
    for name in ("A", "tungsten"):
        np.testing.assert_allclose(spectra.illuminant(name, grid), 100 * glow / glow[2], rtol=1e-9)


def test_daylight_reaches_830_nm_as_the_cie_has_it() -> None:
    """CIE 015:2018, table 1: D65 from 780 to 830 nm in steps of 5 nm."""
    told = [63.3828, 63.8434, 64.3040, 61.8779, 59.4519, 55.7054, 51.9590, 54.6998, 57.4406, 58.8765, 60.3125]
    np.testing.assert_allclose(spectra.illuminant("D65", np.arange(780.0, 831, 5)), told, atol=6e-5)
    with pytest.raises(InputError, match=r"D65 is known from 300 to 830 nm only.*band_range_nm=\(300, 830\)"):
        spectra.illuminant("D65", [400.0, 1000.0])
