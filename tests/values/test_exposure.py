"""Exposure times: parsing, validation, and exact round trips."""

from __future__ import annotations

import math

import numpy as np
import pytest
from raising import raises

from photosite.errors import InputError
from photosite.values.exposure import check_exposure, format_exposure, parse_exposure


@pytest.mark.parametrize(
    ("text", "exposure_s"),
    [
        ("1/8000", 0.000125),
        ("1/3", 1 / 3),
        ("0.005", 0.005),
        ("5e-3", 0.005),
        ("30", 30.0),
        ("0.5ms", 0.0005),
        ("5 ms", 0.005),
        ("250us", 250e-6),
        ("40 µs", 40e-6),
        ("1e3ns", 1e-6),
        ("1/60 s", 1 / 60),
        ("1/8000s", 1 / 8000),
        ("exp0.001", 0.001),
        ("exposure 2.5 sec", 2.5),
        (0.25, 0.25),
        (2, 2.0),
    ],
)
def test_parsed(text, exposure_s):
    assert parse_exposure(text) == exposure_s


@pytest.mark.parametrize(
    "text",
    [
        "0",
        "-1",
        "1/0",
        "-1/8000",
        "nan",
        "inf",
        "1e999",
        "",
        "fast",
        "5 min",
        "ms",
        "5 m s",
        "1 2 ms",
        "5ms 3",
        "1e999999999",
        0,
        -0.1,
        math.nan,
        math.inf,
    ],
)
def test_invalid_text_and_numbers(text):
    with raises(InputError, "exposure_s"):
        parse_exposure(text)


@pytest.mark.parametrize("exposure_s", ["1/3", "0.1", True, None, np.bool_(True), np.ones(2), 1j])
def test_numbers_only(exposure_s):
    with raises(InputError, "exposure_s"):
        check_exposure(exposure_s)


@pytest.mark.parametrize("exposure_s", [2, 0.5, np.float32(0.5), np.int64(3)])
def test_numbers_of_any_kind(exposure_s):
    assert check_exposure(exposure_s) == exposure_s
    assert type(check_exposure(exposure_s)) is float


def test_formatted_exposures_are_parsed_back_exactly():
    rng = np.random.default_rng(1)
    values = [*(1 / n for n in range(1, 9000, 7)), *(10.0 ** rng.uniform(-7, 3, 500)), 4e-5, 0.01402, 1e-15]
    assert [parse_exposure(format_exposure(value)) for value in values] == values
