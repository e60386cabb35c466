"""Illuminants against CIE tables and formulas."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.color import illuminants
from photosite.color.colorimetry import colour_science, xyz
from photosite.color.illuminants import blackbody, illuminant
from photosite.color.spectrum import LIGHT_SPEED_M_S, PLANCK_J_S, Spectrum, integration_weights, photons_from_energy
from photosite.errors import FileError, InputError

FINE = np.arange(360.0, 831.0)


def chromaticity(energy: np.ndarray, grid: np.ndarray = FINE) -> np.ndarray:
    values = xyz(photons_from_energy(energy, grid), grid)
    return values[:2] / values.sum()


@pytest.mark.parametrize(("name", "kelvin"), [("D50", 5003), ("D55", 5503), ("D65", 6504), ("D75", 7504)])
def test_daylight_matches_the_cie_tables(name: str, kelvin: float) -> None:
    """M1 and M2 of the formula are rounded to three places; the tables agree to 0.1 of 100."""
    grid = np.arange(380.0, 781.0, 10.0)
    assert illuminants.daylight(kelvin).at(grid) == pytest.approx(illuminant(name, grid), abs=0.12)


@pytest.mark.parametrize("kelvin", [4000.0, 5600.0, 9300.0, 25000.0])
def test_daylight_is_on_the_daylight_locus(kelvin: float) -> None:
    """CIE 015:2018, 4.1.2: y = -3 x^2 + 2.87 x - 0.275."""
    x, y = chromaticity(illuminants.daylight(kelvin).at(FINE))
    assert y == pytest.approx(-3 * x**2 + 2.87 * x - 0.275, abs=5e-4)


@pytest.mark.parametrize(
    ("name", "kelvin"), [("daylight 5600", 5600), ("Daylight 5600K", 5600), ("D5600", 5600), ("d5000 k", 5000)]
)
def test_daylight_by_name(name: str, kelvin: float) -> None:
    assert (illuminant(name, [500.0, 600.0]) == illuminants.daylight(kelvin).at([500.0, 600.0])).all()


@pytest.mark.parametrize(
    ("name", "values", "total"),
    [
        ("AM1.5G", [4.7309e-23, 1.5451, 1.5634, 0.73532, 0.48577, 7.1043e-3], 1000.4),
        ("AM1.5D", [2.5361e-26, 1.3391, 1.3883, 0.69159, 0.46113, 7.1199e-3], 900.1),
    ],
)
def test_sunlight_is_the_published_table(name: str, values: list[float], total: float) -> None:
    """ASTM G173-03: entries in W/m2/nm, and the integrals that the standard states, 1000.4 and 900.1 W/m2."""
    np.testing.assert_array_equal(illuminant(name, [280.0, 500.0, 555.0, 1000.0, 1100.0, 4000.0]), values)
    spectrum = illuminants.sunlight("global" if name == "AM1.5G" else "direct")
    assert spectrum.wavelength_nm.size == 2002
    assert np.trapezoid(spectrum.values, spectrum.wavelength_nm) == pytest.approx(total, rel=2e-4)


def test_sunlight_lights_near_infrared_scenes() -> None:
    from photosite.scene import charts

    grid = np.arange(400.0, 1101.0, 5.0)
    field = charts.uniform("sunlight", 1000, wavelength_nm=grid)
    light = photons_from_energy(illuminants.sunlight().at(grid), grid)
    np.testing.assert_allclose(field.basis[0] / field.basis[0].max(), light / light.max())
    with raises(InputError, "wavelength_nm"):
        illuminant("sunlight", [250.0, 500.0])
    with raises(InputError, "kind"):
        illuminants.sunlight("tilted")  # type: ignore[arg-type]
    assert xyz(light, grid)[1] > 0


@pytest.mark.parametrize("kelvin", [2200.0, 2700.0, 4000.0, 4999.0])
def test_warm_white_leds_have_a_blackbody_chromaticity(kelvin: float) -> None:
    spectrum = illuminants.white_led(kelvin)
    assert chromaticity(spectrum.at(FINE)) == pytest.approx(chromaticity(blackbody(kelvin, FINE)), abs=1e-5)
    assert spectrum.values.min() >= 0


@pytest.mark.parametrize("kelvin", [5000.0, 6500.0, 10000.0])
def test_cool_white_leds_have_daylight_chromaticity(kelvin: float) -> None:
    found = chromaticity(illuminant(f"led {kelvin:g}", FINE))
    assert found == pytest.approx(chromaticity(illuminants.daylight(kelvin).at(FINE)), abs=1e-5)


def test_white_led_color_temperature_by_another_formula() -> None:
    """Ohno (2013), in colour-science."""
    colour = colour_science()
    x, y = chromaticity(illuminants.white_led(3500).at(FINE))
    kelvin, duv = colour.temperature.uv_to_CCT_Ohno2013(colour.xy_to_UCS_uv([x, y]))
    assert kelvin == pytest.approx(3500, abs=5)
    assert duv == pytest.approx(0, abs=1e-4)


def test_led_peaks_have_their_width_and_power() -> None:
    spectrum = illuminants.led([460, 630], [22, 18], [1.0, 3.0])
    fine = np.arange(300.0, 1100.0, 0.01)
    values = np.interp(fine, spectrum.wavelength_nm, spectrum.values)
    for peak, width, power in ((460, 22, 1.0), (630, 18, 3.0)):
        near = np.abs(fine - peak) < 60
        above = fine[near & (values > values[near].max() / 2)]
        assert above[-1] - above[0] == pytest.approx(width, abs=0.15)  # linear between entries of 1 nm
        assert values[near].sum() * 0.01 == pytest.approx(power, rel=1e-3)


def test_led_shape_matches_ohno_2005() -> None:
    from colour.colorimetry import sd_single_led_Ohno2005

    colour = colour_science()
    theirs = sd_single_led_Ohno2005(550, 30, colour.SpectralShape(450, 650, 1))
    half = 2 * math.sqrt(-math.log(0.8086092632)) * 30
    ours = illuminants.led(550, half).at(np.arange(450.0, 651.0))
    assert ours / ours.max() == pytest.approx(theirs.values, abs=1e-9)


def test_older_names_of_fluorescent_illuminants() -> None:
    assert (illuminant("F11", [546.0]) == illuminant("FL11", [546.0])).all()


@pytest.mark.parametrize(
    ("name", "x", "y"),
    [("A", 0.44758, 0.40745), ("D65", 0.31272, 0.32903), ("FL2", 0.37208, 0.37529), ("E", 1 / 3, 1 / 3)],
)
def test_published_chromaticities(name: str, x: float, y: float) -> None:
    """CIE 015:2018, 2 degree observer. The tables have 5 nm steps to 780 nm; the rest contributes less than 2e-4."""
    grid = np.arange(360.0, 781.0) if name != "FL2" else np.arange(380.0, 781.0)
    assert chromaticity(illuminant(name, grid), grid) == pytest.approx([x, y], abs=2e-4)


@pytest.mark.parametrize("temperature", [1000.0, 2856.0, 6504.0])
def test_blackbody_obeys_the_stefan_boltzmann_law(temperature: float) -> None:
    grid = np.geomspace(50, 1e6, 20001)
    radiant_exitance = math.pi * blackbody(temperature, grid) @ integration_weights(grid)
    assert radiant_exitance == pytest.approx(5.670374419e-8 * temperature**4, rel=1e-5)


def test_blackbody_obeys_wiens_law() -> None:
    grid = np.arange(300.0, 1500.0, 0.1)
    peak = grid[np.argmax(blackbody(5000, grid))]
    assert peak == pytest.approx(2.897771955e6 / 5000, abs=0.1)


@pytest.mark.parametrize("name", [3200, "3200", "3200K", "3200 k", "blackbody 3200", "blackbody:3200K"])
def test_blackbody_names(name: str | int) -> None:
    assert (illuminant(name) == blackbody(3200.0)).all()


@pytest.mark.parametrize("name", ["10K", 25, "blackbody 60"])
def test_blackbody_too_cold_to_emit_light(name: str | int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert blackbody(10.0)[0] == 0.0
        with pytest.raises(InputError) as caught:
            illuminant(name)
    assert caught.value.what == "temperature_k"


def test_tungsten_is_cie_a() -> None:
    assert (illuminant("Tungsten") == illuminant("A")).all()


def test_illuminant_from_a_spectrum() -> None:
    assert illuminant(Spectrum([300.0, 900.0], [1.0, 3.0]), [600.0]) == pytest.approx([2.0])


def test_cie_a_beyond_its_table_follows_its_definition() -> None:
    """A blackbody of 2848 K with c2 = 1.435e-2 m K is one of 2856 K with today's c2, 100 at 560 nm (ISO 11664-2)."""
    c2 = PLANCK_J_S * LIGHT_SPEED_M_S / illuminants.BOLTZMANN_J_K
    grid = np.array([250.0, 299, 560, 781, 800, 830, 1000, 2500])
    glow = blackbody(2848 * c2 / 1.435e-2, grid)
    for name in ("A", "tungsten"):
        np.testing.assert_allclose(illuminant(name, grid), 100 * glow / glow[2], rtol=1e-9)
    within = np.arange(380.0, 781.0, 10)
    ratio = illuminant("A", within) / blackbody(2848 * c2 / 1.435e-2, within)
    assert ratio / ratio.mean() == pytest.approx(np.ones(within.size), abs=2e-4)


def test_daylight_reaches_830_nm() -> None:
    """CIE 015:2018, table 1: D65 from 780 to 830 nm in steps of 5 nm."""
    table = [63.3828, 63.8434, 64.3040, 61.8779, 59.4519, 55.7054, 51.9590, 54.6998, 57.4406, 58.8765, 60.3125]
    np.testing.assert_allclose(illuminant("D65", np.arange(780.0, 831, 5)), table, atol=6e-5)


@pytest.mark.parametrize(
    ("name", "grid", "limits"),
    [("D65", [400.0, 1000.0], (300, 830)), (Spectrum([400.0, 700.0], np.ones(2)), [390.0, 500.0], (400, 700))],
)
def test_no_extrapolation_beyond_the_table(name: str | Spectrum, grid: list[float], limits: tuple[int, int]) -> None:
    with raises(InputError, "wavelength_nm", value=tuple(grid), arguments={"band_range_nm": limits}):
        illuminant(name, grid)


def test_illuminant_files(tmp_path: Path) -> None:
    grid = np.arange(380.0, 781.0, 5.0)
    energy = illuminant("D65", grid)
    photons = photons_from_energy(energy, grid)
    files = {}
    for name, values in (("relative_energy", energy), ("relative_photons", photons / photons.max())):
        files[name] = tmp_path / f"{name}.csv"
        lines = "\n".join(f"{w:g},{v:.9g}" for w, v in zip(grid, values, strict=True))
        files[name].write_text(f"wavelength_nm,{name}\n{lines}\n")
    assert illuminant(str(files["relative_energy"]), grid) == pytest.approx(energy, rel=1e-8)
    from_photons = illuminant(str(files["relative_photons"]), grid)
    assert from_photons / from_photons.sum() == pytest.approx(energy / energy.sum(), rel=1e-7)


@pytest.mark.parametrize(
    ("text", "what", "line"),
    [
        ("400,1\n700,2\n", "the first line", 1),
        ("wavelength_nm,value\n400,1\n700,2\n", "the first line", 1),
        ("wavelength_nm,relative_energy\n400,-1\n700,2\n", "relative_energy", None),
        ("wavelength_nm,relative_energy\n400,0\n700,0\n", "relative_energy", None),
    ],
)
def test_invalid_illuminant_files(tmp_path: Path, text: str, what: str, line: int | None) -> None:
    file = tmp_path / "lamp.csv"
    file.write_text(text)
    with pytest.raises(FileError) as caught:
        illuminant(str(file), [500.0])
    assert (caught.value.what, caught.value.line) == (what, line)


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: illuminant("daylight 3000"), "temperature_k"),
        (lambda: illuminant("D30000"), "temperature_k"),
        (lambda: illuminant("led 1000"), "temperature_k"),
        (lambda: illuminant(True), "illuminant"),
        (lambda: illuminant("moonshine"), "illuminant"),
        (lambda: illuminants.led([460, 530], [20, 20], [1.0]), "power"),
        (lambda: illuminants.led(200, 20), "peak_nm"),
        (lambda: illuminants.led(500, 0), "fwhm_nm"),
        (lambda: illuminants.led(500, math.nan), "fwhm_nm"),
        (lambda: illuminants.led(500, 20, [-1.0]), "power"),
    ],
)
def test_invalid_arguments(call: Callable[[], object], field: str) -> None:
    with raises(InputError, field) as caught:
        call()
    assert len(str(caught.value)) < 240


@pytest.mark.parametrize(("name", "nearest"), [("daylght 5600", "daylight 5600"), ("lde 4000", "led 4000")])
def test_unknown_names_are_answered_with_the_nearest(name: str, nearest: str) -> None:
    with pytest.raises(InputError) as caught:
        illuminant(name)
    assert caught.value.hint == f"Did you mean '{nearest}'?"
