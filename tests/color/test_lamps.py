"""Lamps: daylight and LEDs against the CIE's tables and formulas, files that say what they hold."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from photosite.color import lamps
from photosite.color.cie import colour_science
from photosite.color.spectrum import blackbody, illuminant, photons_from_energy, xyz
from photosite.errors import FileError, InputError

FINE = np.arange(360.0, 831.0)


def chromaticity(energy: np.ndarray, grid: np.ndarray = FINE) -> np.ndarray:
    values = xyz(photons_from_energy(energy, grid), grid)
    return values[:2] / values.sum()


@pytest.mark.parametrize(("name", "kelvin"), [("D50", 5003), ("D55", 5503), ("D65", 6504), ("D75", 7504)])
def test_daylight_is_the_cie_s_tables(name: str, kelvin: float) -> None:
    """The formula's M1 and M2 are rounded to three places; the tables agree to 0.1 of 100."""
    grid = np.arange(380.0, 781.0, 10.0)
    assert lamps.daylight(kelvin).at(grid) == pytest.approx(illuminant(name, grid), abs=0.12)


@pytest.mark.parametrize("kelvin", [4000.0, 5600.0, 9300.0, 25000.0])
def test_daylight_lies_on_its_locus(kelvin: float) -> None:
    """CIE 015:2018, 4.1.2: y = -3 x^2 + 2.87 x - 0.275."""
    x, y = chromaticity(lamps.daylight(kelvin).at(FINE))
    assert y == pytest.approx(-3 * x**2 + 2.87 * x - 0.275, abs=5e-4)


@pytest.mark.parametrize(
    ("name", "kelvin"), [("daylight 5600", 5600), ("Daylight 5600K", 5600), ("D5600", 5600), ("d5000 k", 5000)]
)
def test_daylight_by_name(name: str, kelvin: float) -> None:
    assert (illuminant(name, [500.0, 600.0]) == lamps.daylight(kelvin).at([500.0, 600.0])).all()


@pytest.mark.parametrize("kelvin", [2200.0, 2700.0, 4000.0, 4999.0])
def test_warm_white_leds_have_a_blackbody_s_chromaticity(kelvin: float) -> None:
    spectrum = lamps.white_led(kelvin)
    assert chromaticity(spectrum.at(FINE)) == pytest.approx(chromaticity(blackbody(kelvin, FINE)), abs=1e-5)
    assert spectrum.values.min() >= 0


@pytest.mark.parametrize("kelvin", [5000.0, 6500.0, 10000.0])
def test_cool_white_leds_have_daylight_s_chromaticity(kelvin: float) -> None:
    found = chromaticity(illuminant(f"led {kelvin:g}", FINE))
    assert found == pytest.approx(chromaticity(lamps.daylight(kelvin).at(FINE)), abs=1e-5)


def test_a_white_led_s_colour_temperature_by_another_formula() -> None:
    """Ohno's method of 2013, in colour-science."""
    colour = colour_science()
    x, y = chromaticity(lamps.white_led(3500).at(FINE))
    kelvin, duv = colour.temperature.uv_to_CCT_Ohno2013(colour.xy_to_UCS_uv([x, y]))
    assert kelvin == pytest.approx(3500, abs=5)
    assert duv == pytest.approx(0, abs=1e-4)


def test_led_peaks_have_their_width_and_power() -> None:
    spectrum = lamps.led([460, 630], [22, 18], [1.0, 3.0])
    fine = np.arange(300.0, 1100.0, 0.01)
    values = np.interp(fine, spectrum.wavelength_nm, spectrum.values)
    for peak, width, power in ((460, 22, 1.0), (630, 18, 3.0)):
        near = np.abs(fine - peak) < 60
        above = fine[near & (values > values[near].max() / 2)]
        assert above[-1] - above[0] == pytest.approx(width, abs=0.15)  # linear between entries of 1 nm
        assert values[near].sum() * 0.01 == pytest.approx(power, rel=1e-3)


def test_the_shape_of_an_led_is_ohno_s() -> None:
    from colour.colorimetry import sd_single_led_Ohno2005

    colour = colour_science()
    theirs = sd_single_led_Ohno2005(550, 30, colour.SpectralShape(450, 650, 1))
    half = 2 * math.sqrt(-math.log(0.8086092632)) * 30
    ours = lamps.led(550, half).at(np.arange(450.0, 651.0))
    assert ours / ours.max() == pytest.approx(theirs.values, abs=1e-9)


def test_the_older_names_of_fluorescent_lamps() -> None:
    assert (illuminant("F11", [546.0]) == illuminant("FL11", [546.0])).all()


def test_lights_from_files(tmp_path: Path) -> None:
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
    with pytest.raises(InputError, match="known from 380 to 780 nm only"):
        illuminant(str(files["relative_energy"]), [370.0, 500.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("400,1\n700,2\n", "does not say what its values are"),
        ("wavelength_nm,value\n400,1\n700,2\n", "not 'wavelength_nm,value'"),
        ("wavelength_nm,relative_energy\n400,-1\n700,2\n", "0 or more at each wavelength"),
        ("wavelength_nm,relative_energy\n400,0\n700,0\n", "not 0 at all of them"),
        ("wavelength_nm,relative_energy\n700,1\n400,2\n", "rise from line to line"),
    ],
)
def test_files_that_are_no_light(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "lamp.csv"
    file.write_text(text)
    with pytest.raises(FileError, match=message):
        illuminant(str(file), [500.0])


def test_a_light_s_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        illuminant(str(tmp_path / "none.csv"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: illuminant("daylight 3000"), "from 4000 to 25000 K, not 3000; .* 'blackbody 3000'"),
        (lambda: illuminant("D30000"), "from 4000 to 25000 K"),
        (lambda: illuminant("led 1000"), "from 2200 to 10000 K"),
        (lambda: illuminant("daylght 5600"), "did you mean 'daylight 5600'"),
        (lambda: illuminant("lde 4000"), "did you mean 'led 4000'"),
        (lambda: lamps.led([460, 530], [20, 20], [1.0]), "2 peaks, 1 powers"),
        (lambda: lamps.led(200, 20), "from 350 to 1050"),
        (lambda: lamps.led(500, 0), "width is above 0"),
        (lambda: lamps.led(500, 20, [-1.0]), "power is 0 or more"),
        (lambda: lamps.led(500, math.nan), "width is above 0"),
    ],
)
def test_lamps_that_cannot_be(call: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()  # type: ignore[operator]


def test_a_lamp_is_named_or_is_none() -> None:
    assert lamps.lamp("D65") is None
    assert lamps.lamp("3200K") is None
