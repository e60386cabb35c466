"""The benchmark's cases by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from photosite.errors import InputError, did_you_mean
from photosite.studies.bench.accumulate import accumulate_against_reading, accumulate_d200
from photosite.studies.bench.calibrate_protocol import calibrate_protocol
from photosite.studies.bench.camera import capture_d200, noise_d200, optics_d200
from photosite.studies.bench.command import cli_simulate
from photosite.studies.bench.convert_cube import convert_cube
from photosite.studies.bench.field import field_varying_d200, lateral_color_d200, lens_d200, plane_d200
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


def run_cases(names: Sequence[str], quick: bool, say: Callable[[str], object]) -> dict[str, Case]:
    """Measure the named cases, or all.

    Parameters
    ----------
    names
        Of `CASES`; none for all.
    quick
        Fewer repeats and smaller stacks.
    say
        Is told each name before it is measured.

    Raises
    ------
    InputError
        If there is no such case.
    """
    for name in names:
        if name not in CASES:
            raise InputError(f"there is no benchmark case '{name}'. {did_you_mean(name, CASES)}")
    measured = {}
    for name in names or CASES:
        say(name)
        measured[name] = CASES[name](quick)
    return measured
