"""Units of spectral files: known ones with their factors, and invalid ones."""

from __future__ import annotations

import pytest
from raising import raises

from photosite.errors import InputError
from photosite.scene.units import Units, parse_units


@pytest.mark.parametrize(
    ("text", "quantity", "scale"),
    [
        ("W/sr/m2/nm", "energy radiance", 1.0),
        ("W m-2 sr-1 um-1", "energy radiance", 1e-3),
        ("W*m^-2*sr^-1*nm^-1", "energy radiance", 1.0),
        ("W/(m**2.sr.nm)", "energy radiance", 1.0),
        ("uW/cm^2/nm/sr", "energy radiance", 1e-6 * 1e4),
        ("µW/(cm^2*sr*nm)", "energy radiance", 1e-6 * 1e4),
        ("mW/(cm2 sr um)", "energy radiance", 1e-3 * 1e4 * 1e-3),
        ("Watts/(m^2 sr nm)", "energy radiance", 1.0),
        ("mW/m^2/sr/m", "energy radiance", 1e-3 * 1e-9),
        ("nW/mm2/sr/nm", "energy radiance", 1e-9 * 1e6),
        ("photons/s/sr/m2/nm", "photon radiance", 1.0),
        ("quanta s-1 sr-1 cm-2 nm-1", "photon radiance", 1e4),
        ("photons", "photon radiance", 1.0),
        ("Reflectance", "reflectance", 1.0),
        ("percent", "reflectance", 0.01),
        ("relative", "relative", 1.0),
    ],
)
def test_known_units(text: str, quantity: str, scale: float) -> None:
    found = parse_units(text)
    assert found.quantity == quantity
    assert found.scale == pytest.approx(scale, rel=1e-12)
    assert isinstance(found, Units)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("W/m2/nm", "steradian"),
        ("W/sr/m2", "wavelength"),
        ("photons/sr/m2/nm", "second"),
        ("W/sr/m2/nm/nm", "wavelength"),
        ("DN", "'DN'"),
        ("MW/sr/m2/nm", "'MW'"),
        ("W sr m2 nm", "'sr'"),
        ("W/sr/m3/nm", "'m-3'"),
        ("", "missing"),
        ("17", "'17'"),
    ],
)
def test_unknown_units(text: str, part: str) -> None:
    with raises(InputError, "units", value=text) as caught:
        parse_units(text)
    assert part in str(caught.value.expected)
    assert "photons/s/sr/m2/nm" in str(caught.value.hint)


@pytest.mark.parametrize(
    ("text", "quantity", "scale"),
    [
        ("Radiance (W/m^2/sr/um)", "energy radiance", 1e-3),
        ("spectral radiance [uW/cm^2/nm/sr]", "energy radiance", 1e-2),
        ("Reflectance (%)", "reflectance", 1e-2),
        ("reflectance/10000", "reflectance", 1e-4),
        ("Reflectance / 255", "reflectance", 1 / 255),
    ],
)
def test_a_quantity_with_its_unit(text: str, quantity: str, scale: float) -> None:
    assert parse_units(text).quantity == quantity
    assert parse_units(text).scale == pytest.approx(scale)


@pytest.mark.parametrize(
    "text",
    [
        "radiance (percent)",
        "reflectance (W/m2/sr/nm)",
        "reflectance/0",
        "reflectance/1e400",
        "radiance ()",
        "radiance (" * 3000,
    ],
)
def test_a_quantity_with_the_unit_of_another_is_an_error(text: str) -> None:
    with raises(InputError, "units"):
        parse_units(text)


def test_ambiguous_units_are_an_error() -> None:
    with raises(InputError, "units", value="W/m^2 sr nm"):
        parse_units("W/m^2 sr nm")
