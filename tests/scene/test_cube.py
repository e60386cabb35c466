"""Wavelengths of bands: units, order, and invalid values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from raising import raises

from photosite.errors import FileError
from photosite.scene.cube import band_order, wavelengths_in_nm

FILE = Path("cube.hdr")


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        ([400, 500, 700], "Nanometers"),
        ([0.4, 0.5, 0.7], "Micrometers"),
        ([0.4, 0.5, 0.7], "µm"),
        ([4e-7, 5e-7, 7e-7], "m"),
        ([4000, 5000, 7000], "Angstroms"),
        ([400, 500, 700], None),
    ],
)
def test_units_of_wavelengths(values: list[float], unit: str | None) -> None:
    assert wavelengths_in_nm(FILE, values, unit, None) == pytest.approx([400, 500, 700])


def test_the_callers_wavelengths() -> None:
    assert wavelengths_in_nm(FILE, None, None, [400, 500]).tolist() == [400, 500]
    assert wavelengths_in_nm(FILE, [0.4, 0.5], None, [400, 500]).tolist() == [400, 500]  # the file's have no unit
    assert wavelengths_in_nm(FILE, [0.4, 0.5], "um", [400, 500]).tolist() == [400, 500]
    with raises(FileError, "states other wavelengths", arguments={"wavelength_nm": (400.0, 500.0)}):
        wavelengths_in_nm(FILE, [0.4, 0.6], "um", [400, 500])


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        (None, None),
        ([0.01, 0.5], None),
        ([4000, 7000], None),
        ([0.4, 0.5], "nm"),
        ([400, 500], "um"),
        ([400, 500], "furlongs"),
        ([400, np.nan], "nm"),
        (["red", "green"], "nm"),
        ([-400, 500], "nm"),
    ],
)
def test_invalid_wavelengths(values: object, unit: str | None) -> None:
    with pytest.raises(FileError) as caught:
        wavelengths_in_nm(FILE, values, unit, None)  # type: ignore[arg-type]
    assert list(caught.value.arguments) == ["wavelength_nm"]
    assert "\n" not in str(caught.value)


def test_bands_out_of_order_are_named() -> None:
    grid = np.array([400.0, 420, 410, 430])
    with raises(FileError, "its wavelengths are not", arguments={"sort_bands": True}):
        band_order("cube.hdr", grid, sort=False)
    assert band_order("cube.hdr", grid, sort=True).tolist() == [0, 2, 1, 3]
    assert band_order("cube.hdr", grid[::-1], sort=True).tolist() == [3, 1, 2, 0]


def test_two_bands_of_one_wavelength() -> None:
    for sort in (False, True):
        with raises(FileError, "two bands have"):
            band_order("a.h5", np.array([400.0, 500, 500, 600]), sort=sort)
