"""Benchmark cases by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from photosite.errors import InputError, did_you_mean
from photosite.studies.bench.captures import capture_d200, cli_simulate, noise_d200, optics_d200
from photosite.studies.bench.convert_cube import convert_cube
from photosite.studies.bench.frames import accumulate_against_reading, accumulate_d200, calibrate_protocol
from photosite.studies.bench.lenses import field_varying_d200, lateral_color_d200, lens_d200, plane_d200
from photosite.studies.bench.timing import Case

CASES: dict[str, Callable[[bool], Case]] = {
    "capture_d200": capture_d200,
    "optics_d200": optics_d200,
    "plane_d200": plane_d200,
    "field_varying_d200": field_varying_d200,
    "lens_d200": lens_d200,
    "lateral_color_d200": lateral_color_d200,
    "noise_d200": noise_d200,
    "accumulate_d200": accumulate_d200,
    "accumulate_against_reading": accumulate_against_reading,
    "calibrate_protocol": calibrate_protocol,
    "convert_cube": convert_cube,
    "cli_simulate": cli_simulate,
}


def run_cases(names: Sequence[str], quick: bool, report: Callable[[str], object]) -> dict[str, Case]:
    """Measure cases.

    Parameters
    ----------
    names
        Names in `CASES`; all by default.
    quick
        Fewer repeats and smaller stacks.
    report
        Called with each name before it is measured.

    Raises
    ------
    InputError
        If a case is unknown.
    """
    for name in names:
        if name not in CASES:
            raise InputError("case", value=name, expected="a known name", hint=did_you_mean(name, CASES))
    measured = {}
    for name in names or CASES:
        report(name)
        measured[name] = CASES[name](quick)
    return measured
