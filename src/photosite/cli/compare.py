"""`photosite compare`: another simulator's patches or mosaics against photosite's, or against a second file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click
import numpy as np

from photosite.cli import options
from photosite.cli.command import Command, OptionSpelling
from photosite.cli.output import print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor
    from photosite.validation.compare import PatchComparison
    from photosite.validation.other_tool import Content
    from photosite.validation.result import Validation
    from photosite.validation.set_up import SetUp

_OF_OPTIONS = (
    "sensor_name",
    "illuminant",
    "mean_luminance_cd_m2",
    "distance_m",
    "f_number",
    "focal_length_mm",
    "exposure_s",
)
"""Parameters that a set-up's file says itself."""


@click.command("compare", cls=Command)
@click.argument("other", type=click.Path(path_type=Path))
@click.argument("reference", type=click.Path(path_type=Path), required=False)
@click.option(
    "--tolerance",
    type=options.above(or_equal=True),
    default=0.1,
    metavar="PERCENT",
    help="Relative difference let pass; of noise, too, where raw frames are compared.",
)
@click.option("--level", type=options.above(), default=0.05, help="Share of false alarms allowed where there is noise.")
@click.option(
    "--unit",
    type=click.Choice(["e", "dn"]),
    help="Electrons, or DN above black; of MATLAB files, and of raw files if not DN.",
)
@click.option("--variable", metavar="NAME", help="Array in a MATLAB file, with dots for fields: sensor.data.volts.")
@click.option("--bits", type=click.IntRange(1, 16), help="Bits of mosaics that do not say; else the sensor's.")
@click.option("--cfa", help="Colour filter array (rggb, ...) of mosaics that do not say; else the sensor's.")
@options.black_level_option("Black level of mosaics that do not say; else the sensor's.")
@click.option(
    "--set-up", "set_up_file", type=click.Path(path_type=Path), metavar="FILE", help="The set-up as JSON; see the docs."
)
@click.option("--case", metavar="NAME", help="Case of a JSON file with several.")
@click.option(
    "--integration",
    type=click.Choice(["trapezoid", "rectangle"]),
    default="trapezoid",
    help="Rule of photosite's integrals over wavelength.",
)
@options.sensor_option()
@options.illuminant_option("A")
@click.option(
    "--luminance",
    "mean_luminance_cd_m2",
    type=options.above(),
    default=40.0,
    metavar="CD/M2",
    help="Mean luminance of the patches.",
)
@click.option(
    "--distance", "distance_m", type=options.above(), default=1.2, metavar="M", help="From lens to chart, in m."
)
@options.lens_options
@click.option(
    "--exposure",
    "exposure_s",
    type=options.exposure_time,
    default="1/3",
    metavar="SECONDS",
    help="Exposure time in s; 1/3 is read as such.",
)
@options.seed_option()
@options.json_option
@click.pass_context
def command(ctx: click.Context, /, other: Path, reference: Path | None, as_json: bool, **told: Any) -> None:
    """Compare another simulator's ColorChecker with photosite's of the same set-up, or with a second file.

    OTHER is what the tool made: patch values as CSV (patch,R_e,G_e,B_e in electrons; R_dn,... in DN above black) or as
    a MATLAB matrix; a mosaic that the chart fills as a MATLAB matrix, TIFF, or any raw frame or folder of frames; or a
    JSON file with set-up and patch electrons. REFERENCE is the same of another tool; without it, photosite simulates
    the set-up: that of the JSON file, of --set-up, or of the options.

    Exit status 0 whatever the verdict; the verdict is the first line, and "agrees" in the JSON object.

    Example: photosite compare patches.csv --sensor mine.sensor.yaml --illuminant D65 --exposure 1/30 --tolerance 0.5

    Example: photosite compare isetcam.mat --unit dn --variable sensor.data.dv
    """
    from photosite.validation.compare_tools import compare

    say_if_compiling()
    set_up = _set_up(ctx, other, told, needed=reference is None)
    values = _content(other, told, set_up)
    base = set_up if reference is None else _content(reference, told, set_up)
    if base is None:
        raise click.UsageError("there is nothing to compare with; give a REFERENCE or a set-up", ctx)
    result = compare(values, base, tolerance_percent=told["tolerance"], level=told["level"], seed=told["seed"])
    case, hint = None, None
    file = told["set_up_file"] or (other if other.suffix.lower() == ".json" else None)
    if file is not None and set_up is not None:
        from photosite.validation.set_up import case_of, read_set_up

        case = case_of(file, told["case"])
        if not result.agrees and told["integration"] == "trapezoid":
            by_rectangle = read_set_up(file, case, integration="rectangle")[0]
            again = compare(
                values, by_rectangle, tolerance_percent=told["tolerance"], level=told["level"], seed=told["seed"]
            )
            if again.agrees:
                hint = "by the rectangle rule they agree: --integration rectangle"
    named = [str(other), "photosite" if reference is None else str(reference)]
    if as_json:
        print_json({"compared": named, "case": case, "hint": hint} | result.to_dict())
    else:
        _show(named, result, [line for line in (case and f"case: {case}", hint) if line])


def _set_up(ctx: click.Context, other: Path, told: dict[str, Any], *, needed: bool) -> SetUp | None:
    """The set-up by file or by options; None where neither is needed."""
    from photosite.validation.set_up import read_set_up

    file: Path | None = told["set_up_file"]
    if file is None and other.suffix.lower() == ".json":
        file = other
    given = [name for name in _OF_OPTIONS if ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE]
    if file is not None and needed:
        if given:
            option = OptionSpelling(ctx.command).name(given[0])
            raise click.UsageError(f"{option} belongs to a set-up by options, and {file} gives the set-up", ctx)
        return read_set_up(file, told["case"], integration=told["integration"])[0]
    return _of_options(told) if needed else None


def _of_options(told: dict[str, Any]) -> SetUp:
    from photosite.camera.camera import Camera
    from photosite.scene.charts import macbeth
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.lamp import lamp_from
    from photosite.validation.set_up import SetUp

    lamp = lamp_from(told["illuminant"])
    rule = told["integration"]
    chart = macbeth(
        lamp.light,
        told["mean_luminance_cd_m2"],
        wavelength_nm=lamp.wavelength_nm,
        distance_m=told["distance_m"],
        rule=rule,
    )
    camera = Camera(options.lens(told["f_number"], told["focal_length_mm"]), load_sensor(told["sensor_name"]), rule)
    return SetUp.of_chart(camera, chart, told["exposure_s"])


def _content(path: Path, told: dict[str, Any], set_up: SetUp | None) -> Content:
    from photosite.errors import FileError
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.other_tool import read_other
    from photosite.validation.set_up import read_set_up

    if path.suffix.lower() == ".json":
        values = read_set_up(path, told["case"])[1]
        if values is None:
            raise FileError(path, "the case has no result to compare; give the tool's values as CSV, with --set-up")
        return values
    sensor = load_sensor(told["sensor_name"]) if set_up is None else set_up.camera.sensor
    return read_other(path, _reading(told, sensor))


def _reading(told: dict[str, Any], sensor: Sensor) -> Any:
    from photosite.validation.other_tool import Reading
    from photosite.values.cfa import cfa_from

    black_dn = told["black_level_dn"]
    return Reading(
        cfa=sensor.array.cfa if told["cfa"] is None else cfa_from(told["cfa"]),
        bits=told["bits"] or sensor.readout.bits,
        black_level_dn=sensor.readout.black_level_dn.value if black_dn is None else black_dn,
        unit=told["unit"],
        variable=told["variable"],
    )


def _show(named: list[str], result: PatchComparison | Validation, before: list[str]) -> None:
    from photosite.validation.compare import UNITS
    from photosite.validation.result import Validation

    verdict = "agree" if result.agrees else "differ"
    click.echo(f"{named[0]} and {named[1]} {verdict}, at a tolerance of {result.tolerance_percent:g} %")
    for line in (*before, *result.reasons, *result.notes):
        click.echo(f"  {line}")
    if isinstance(result, Validation):
        names, channels, unit = result.measured.names, result.measured.channels, UNITS["dn"]
        pair = result.measured.mean_dn, result.simulated.mean_dn
    else:
        names, channels, unit = result.other.names, result.other.channels, UNITS[result.other.unit]
        pair = result.other.mean, result.reference.mean
    percent = 100 * np.ma.filled(cast("Any", result.relative_difference), np.nan)
    columns = [(c, what) for c in channels for what in ("other", "reference", "%")]
    rows = [("patch", *(f"{c} {what}" for c, what in columns))]
    for patch, name in enumerate(names):
        cells = []
        for k in range(len(channels)):
            difference = f"{percent[patch, k]:+.3g}" if np.isfinite(percent[patch, k]) else "-"
            cells += [f"{pair[0][patch, k]:.1f}", f"{pair[1][patch, k]:.1f}", difference]
        rows.append((name, *cells))
    click.echo(f"\nMeans in {unit}, and the relative difference:")
    click.echo(table(rows, "<" + ">" * len(columns)))
    if result.color is not None:
        delta = result.color.delta_e_2000
        click.echo(f"\ndelta E 2000 of the patches: mean {delta.mean():.3g}, largest {delta.max():.3g}")
