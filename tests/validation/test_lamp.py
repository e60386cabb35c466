"""Lamps from files: levels against photometry by hand, lines against their energy, and files that do not say."""

import numpy as np
import pytest
from raising import raises

from photosite.color.colorimetry import color_matching_functions
from photosite.color.illuminants import illuminant
from photosite.color.spectrum import Spectrum
from photosite.errors import FileError, InputError
from photosite.scene.charts import macbeth, macbeth_reflectance
from photosite.validation.lamp import Lamp, load_lamp, read_lamp


def write(folder, quantity, wavelength_nm, values, name="lamp.csv"):
    lines = [f"{a:.6g},{b:.9g}" for a, b in zip(wavelength_nm, values, strict=True)]
    path = folder / name
    path.write_text("\n".join([f"# a meter, serial 7\nWavelength_nm, {quantity}", *lines]) + "\n")
    return path


def luminance_by_hand(energy_radiance, grid):
    """K_m times the sum over every patch, energy throughout: no photons, no trapezoids."""
    per_nm = np.gradient(grid)
    y_bar = color_matching_functions(grid)[1]
    return 683.0 * float((macbeth_reflectance(grid).mean(axis=0) * energy_radiance * y_bar * per_nm).sum())


@pytest.mark.parametrize(
    ("quantity", "per_unit"),
    [
        ("spectral_radiance_w_per_sr_m2_nm", 1.0),
        ("spectral_radiance_mw_per_sr_m2_nm", 1e-3),
        ("spectral_irradiance_w_per_m2_nm", 1 / np.pi),
        ("spectral_irradiance_mw_per_m2_nm", 1e-3 / np.pi),
        ("spectral_irradiance_uw_per_cm2_nm", 1e-6 * 1e4 / np.pi),
    ],
)
def test_the_level_is_that_of_a_matte_chart_in_this_light(tmp_path, quantity, per_unit):
    grid = np.arange(340.0, 781.0, 5.0)
    energy = 1e-4 * illuminant("A", grid)
    lamp = read_lamp(write(tmp_path, quantity, grid, energy))
    fine = np.arange(380.0, 780.5, 1.0)
    wanted = luminance_by_hand(np.interp(fine, grid, energy) * per_unit, fine)
    assert lamp.chart_luminance_cd_m2 == pytest.approx(wanted, rel=2e-3)  # sums in steps of 10 nm


def test_a_smooth_lamp_in_a_file_is_the_lamp_by_name(tmp_path):
    for step in (1.0, 5.0, 10.0):
        grid = np.arange(380.0, 781.0, step)
        lamp = read_lamp(write(tmp_path, "relative_energy", grid, illuminant("A", grid)))
        assert lamp.chart_luminance_cd_m2 is None
        named, filed = (
            macbeth(light.light, 40, wavelength_nm=light.wavelength_nm) for light in (Lamp.from_name("A"), lamp)
        )
        np.testing.assert_allclose(filed.basis, named.basis, rtol=1e-6)


def test_lines_between_the_simulators_wavelengths_keep_their_energy(tmp_path):
    # Two lines, 1 nm wide, at 546 and 611 nm, on a weak continuum: sampled every 10 nm they would be lost.
    grid = np.arange(380.0, 781.0, 1.0)
    energy = 1e-5 + 1e-2 * (grid == 546) + 2e-2 * (grid == 611)
    lamp = read_lamp(write(tmp_path, "spectral_radiance_w_per_sr_m2_nm", grid, energy))
    light = lamp.light
    assert isinstance(light, Spectrum)
    assert np.trapezoid(light.values, light.wavelength_nm) == pytest.approx(energy.sum(), rel=5e-3)
    # The luminance is that of the lines, as well as a y bar and reflectances that are linear over 10 nm allow.
    assert lamp.chart_luminance_cd_m2 == pytest.approx(luminance_by_hand(energy, grid), rel=2e-2)
    assert light.values.min() >= 0


def test_a_file_that_ends_early_is_used_as_far_as_it_goes(tmp_path):
    grid = np.arange(403.0, 699.0, 4.0)
    lamp = read_lamp(write(tmp_path, "relative_energy", grid, np.ones(grid.size)))
    assert (lamp.wavelength_nm[0], lamp.wavelength_nm[-1]) == (403.0, 695.0)
    assert set(np.arange(410.0, 691.0, 10.0)) <= set(lamp.wavelength_nm)


def test_files_and_names(tmp_path):
    assert load_lamp("D65").name == "D65"
    file = write(tmp_path, "relative_energy", [380, 780], [1, 1], "meter.txt")
    assert load_lamp(file).name == "meter.txt"
    with raises(FileError, "there is no such"):
        load_lamp(tmp_path / "missing.csv")
    with raises(InputError, "illuminant", value="D66"):
        load_lamp("D66")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("380,1\n780,1\n", "heading"),
        ("band,relative_energy\n380,1\n780,1\n", "heading"),
        ("wavelength_nm,spectral_iradiance_w_per_m2_nm\n380,1\n780,1\n", "heading of the second column"),
        ("wavelength_nm,relative_energy\n380,1\n500,-0.1\n780,1\n", "light at 500 nm"),
        ("wavelength_nm,relative_energy\n380,0\n780,0\n", "all values between 380 and 780 nm are 0"),
        ("wavelength_nm,relative_energy\n800,1\n900,1\n", "wavelengths"),
        ("wavelength_nm,relative_energy\n", "the file holds no spectrum"),
    ],
)
def test_invalid_files(tmp_path, text, what):
    path = tmp_path / "lamp.csv"
    path.write_text(text)
    with pytest.raises(FileError) as caught:
        read_lamp(path)
    assert caught.value.path == str(path)
    assert caught.value.what.startswith(what)
