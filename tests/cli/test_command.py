"""Errors and warnings are written with the options of the command that runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import click
import pytest

from photosite.cli import main
from photosite.cli.command import Command, NameValueOption
from photosite.cli.options import name_and_value
from photosite.errors import FileError, InputError, PhotositeWarning


class _Carrier(NameValueOption):
    def carries(self, field: str) -> bool:
        return field in ("band_range_nm", "negative", "sort_bands", "exposure_unit")


@pytest.fixture
def run(photosite: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], None]], str]:
    """Run a function as a command with a few options, and return standard error."""
    options = [
        click.Option(["--luminance", "mean_luminance_cd_m2"], type=float),
        click.Option(["--units"]),
        click.Option(["--wavelengths", "wavelength_nm"]),
        click.Option(["--clip", "clip_to_gamut"], is_flag=True),
        click.Option(["-e", "--exposure", "exposure_s"], type=float),
        _Carrier(["--scene-option", "options"], type=name_and_value, multiple=True),
    ]

    def call(function: Callable[[], None]) -> str:
        command = Command("simulate", params=[*options], callback=lambda **given: function())
        monkeypatch.setattr(main.LazyGroup, "get_command", lambda self, ctx, name: command)
        done = photosite("simulate")
        assert done.status in (0, 2)
        assert done.out == ""
        return str(done.err)

    return call


def _raising(error: Exception) -> Callable[[], None]:
    def function() -> None:
        raise error

    return function


def test_the_field_of_an_argument_becomes_its_option(run: Any) -> None:
    error = InputError("exposure_s", value=-1.0, expected="above 0")
    assert run(_raising(error)) == "photosite: --exposure must be above 0, got -1.0\n"


@pytest.mark.parametrize(
    ("arguments", "written"),
    [
        ({"mean_luminance_cd_m2": 100}, "--luminance 100"),
        ({"units": "W/sr/m2/nm"}, "--units W/sr/m2/nm"),
        ({"wavelength_nm": [400, 410, 420.5]}, "--wavelengths 400,410,420.5"),
        ({"clip_to_gamut": True}, "--clip"),
        ({"negative": "zero"}, "--scene-option negative=zero"),
        ({"sort_bands": True}, "--scene-option sort_bands=true"),
        ({"band_range_nm": (400, 780)}, "--scene-option 'band_range_nm=[400,780]'"),
        ({"seed": 3}, "seed=3"),
    ],
)
def test_the_hint_of_an_error_names_options(run: Any, arguments: dict[str, Any], written: str) -> None:
    (name,) = arguments
    error = InputError("the values are unknown", hint=f"Pass {{{name}}}", arguments=arguments)
    assert run(_raising(error)) == f"photosite: the values are unknown. Pass {written}\n"


def test_the_field_of_a_file_is_not_an_option(run: Any) -> None:
    error = FileError("a.yaml", "exposure_s", 3, value=0, expected="above 0", hint="Or pass {units}")
    error.arguments = {"units": "percent"}
    assert run(_raising(error)) == ("photosite: a.yaml:3: exposure_s must be above 0, got 0. Or pass --units percent\n")


def test_the_hint_of_a_warning_names_options(run: Any) -> None:
    def warn() -> None:
        hint = PhotositeWarning("values are relative", hint="Pass {units}", arguments={"units": "percent"})
        warnings.warn(hint, stacklevel=1)

    assert run(warn) == "photosite: warning: values are relative. Pass --units percent\n"
