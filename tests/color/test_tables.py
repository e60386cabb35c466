"""The tables that photosite ships hold the numbers of colour-science, to the last bit."""

import numpy as np
import pytest

from photosite.color.colorimetry import colour_science
from photosite.color.illuminants import daylight
from photosite.color.tables import rows, spectra

colour = colour_science()
OBSERVER = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
PRIMARIES = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
SUNLIGHT = colour.plotting.datasets.astm_g_173


def of_curves(names, curves):
    return {name: (curves.wavelengths, values) for name, values in zip(names, curves.values.T, strict=True)}


def of_distributions(distributions):
    return {name: (curve.wavelengths, curve.values) for name, curve in distributions.items()}


SPECTRA = {
    "cie_1931_observer": of_curves("xyz", OBSERVER),
    "cie_illuminants": of_distributions(colour.SDS_ILLUMINANTS),
    "color_checker": of_distributions(colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]),
    "srgb_reflectances": of_curves(("red", "green", "blue"), PRIMARIES),
}


@pytest.mark.parametrize("table", SPECTRA)
def test_spectra(table):
    found = spectra(table)
    assert list(found) == list(SPECTRA[table])
    for name, (wavelength_nm, values) in SPECTRA[table].items():
        np.testing.assert_array_equal(found[name].wavelength_nm, wavelength_nm)
        np.testing.assert_array_equal(found[name].values, values)


@pytest.mark.parametrize("edition", ["After", "Before"])
def test_color_checker_sg(edition):
    expected = colour.CCS_COLOURCHECKERS[f"ColorCheckerSG - {edition} November 2014"].data
    found = rows(f"color_checker_sg_{edition.lower()}_2014")
    assert list(found) == list(expected)
    for name, color in expected.items():
        np.testing.assert_allclose(found[name], color, rtol=1e-14)  # computed there, and rounded as the processor does


@pytest.mark.parametrize(
    ("name", "expected"),
    [("global", SUNLIGHT.DATA_ASTMG173_GLOBAL_TILT), ("direct", SUNLIGHT.DATA_ASTMG173_DIRECT_CIRCUMSOLAR)],
)
def test_sunlight(name, expected):
    found = rows("astm_g173")
    assert dict(zip(found["wavelength_nm"].tolist(), found[name].tolist(), strict=True)) == expected


@pytest.mark.parametrize("temperature_k", [4000.0, 5003.2, 7000.0, 7001.0, 25000.0])
def test_daylight(temperature_k):
    expected = colour.sd_CIE_illuminant_D_series(colour.temperature.CCT_to_xy_CIE_D(temperature_k))
    found = daylight(temperature_k)
    np.testing.assert_array_equal(found.wavelength_nm, expected.wavelengths)
    np.testing.assert_array_equal(found.values, expected.values)
