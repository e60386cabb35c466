"""Formatted numbers, uncertainties and intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from photosite.errors import InputError
from photosite.report.numbers import format_interval, format_number, format_uncertain

MINUS = "−"


def read(text: str) -> float:
    """Parse a formatted number."""
    digits = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
    mantissa, _, power = text.replace("\u202f", "").replace(MINUS, "-").partition("\u00a0×\u00a010")
    exponent = "".join("-0123456789"[digits.index(letter)] for letter in power)
    return float(mantissa) * 10.0 ** int(exponent or 0)


@pytest.mark.parametrize(
    ("value", "significant", "text"),
    [
        (0.0, 4, "0"),
        (1.0, 4, "1.000"),
        (9.9999, 3, "10.0"),
        (-0.5, 2, "−0.50"),
        (1234.5, 2, "1234"),
        (12345.6, 4, "12\u202f346"),
        (9.9996e-5, 4, "0.0001000"),
        (9.996e-5, 4, "9.996\u00a0×\u00a010⁻⁵"),
        (1.6e9, 2, "1.6\u00a0×\u00a010⁹"),
    ],
)
def test_number(value: float, significant: int, text: str) -> None:
    assert format_number(value, significant) == text


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (0.52, 0.00996, "0.520 ± 0.010"),
        (4095.0, 0.0, "4095"),
        (4000.0, 0.0, "4000"),
        (0.25, 0.0, "0.25"),
        (0.0, 0.0, "0"),
        (-0.0001, 0.02, "0.000 ± 0.020"),
        (1234567.0, 1200.0, "1\u202f234\u202f600 ± 1200"),
        (3.0e-9, 1.04e-8, "(0.3 ± 1.0)\u00a0×\u00a010⁻⁸"),
        (2.0e10, 1.5e8, "(2.000 ± 0.015)\u00a0×\u00a010¹⁰"),
    ],
)
def test_value_with_uncertainty(value: float, uncertainty: float, text: str) -> None:
    assert format_uncertain(value, uncertainty) == text


def test_formatted_numbers_parse_to_their_last_digit() -> None:
    rng = np.random.default_rng(8)
    for exponent in range(-12, 13):
        for value in (rng.uniform(-10, 10, 20) * 10.0**exponent).tolist():
            assert read(format_number(value, 4)) == pytest.approx(value, rel=5.1e-4)
            u = abs(value) * 10.0 ** rng.uniform(-4, 1)
            text = format_uncertain(value, u)
            pair, _, power = text.partition("\u00a0×")
            shown, shown_u = (
                read(part.strip("()") + ("\u00a0×" + power if power else "")) for part in pair.split(" ± ")
            )
            assert shown_u == pytest.approx(u, rel=0.051)
            # The value is rounded at the second digit of the uncertainty.
            assert abs(shown - value) <= 0.51 * 10.0 ** (math.floor(math.log10(shown_u * (1 + 1e-9))) - 1)


def test_interval_has_the_digits_of_its_uncertainty() -> None:
    assert format_interval(-0.004, 0.0481, 0.013) == "−0.004 to 0.048"
    assert format_interval(0.14e-5, 2.62e-5, 0.63e-5) == "(0.14 to 2.62)\u00a0×\u00a010⁻⁵"
    assert format_interval(1.0, 1.0, 0.0) == "exact"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_non_finite_numbers_are_rejected(value: float) -> None:
    with pytest.raises(InputError):
        format_number(value)
    with pytest.raises(InputError):
        format_uncertain(value, 1.0)
    with pytest.raises(InputError):
        format_uncertain(1.0, value)
