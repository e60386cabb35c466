"""`photosite compare`: patches or mosaics of another simulator against photosite or a second file."""

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
    from photosite.validation.patch_values import PatchComparison
    from photosite.validation.result import Validation
    from photosite.validation.set_up import SetUp
    from photosite.validation.tool_files import Content

_OF_OPTIONS = (
    "sensor_name",
    "illuminant",
    "mean_luminance_cd_m2",
    "distance_m",
    "f_number",
    "focal_length_mm",
    "exposure_s",
)
"""Options that a set-up file replaces."""


@click.command("compare", cls=Command)
@click.argument("other", type=click.Path(path_type=Path))
@click.argument("reference", type=click.Path(path_type=Path), required=False)
@click.option(
    "--tolerance",
    "tolerance_percent",
    type=options.above(or_equal=True),
    default=0.1,
    metavar="PERCENT",
    help="Relative tolerance of means, and of the noise of raw frames, in percent.",
)
@click.option("--level", type=options.above(), default=0.05, help="False-alarm rate where there is noise.")
@click.option(
    "--unit",
    type=click.Choice(["e", "dn"]),
    help="Unit of MATLAB files and raw files: electrons, or DN above black. Raw files are in DN by default.",
)
@click.option("--variable", metavar="NAME", help="Array of a MATLAB file, with dots for fields: sensor.data.volts.")
@click.option(
    "--bits", type=click.IntRange(1, 16), help="Bit depth of mosaics without it. Default: that of the sensor."
)
@click.option("--cfa", help="Colour filter array (rggb, ...) of mosaics without it. Default: that of the sensor.")
@options.black_level_option("Black level in DN of mosaics without it. Default: that of the sensor.")
@click.option(
    "--set-up",
    "set_up_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Set-up as a JSON file (docs/isetcam.md).",
)
@click.option("--case", metavar="NAME", help="Case of a JSON file with several cases.")
@click.option(
    "--integration",
    type=click.Choice(["trapezoid", "rectangle"]),
    default="trapezoid",
    help="Rule of the integrals over wavelength.",
)
@options.sensor_option()
@options.illuminant_option("A")
@click.option(
    "--luminance",
    "mean_luminance_cd_m2",
    type=options.above(),
    default=40.0,
    metavar="CD/M2",
    help="Mean luminance of the patches, in cd/m2.",
)
@click.option(
    "--distance",
    "distance_m",
    type=options.above(),
    default=1.2,
    metavar="M",
    help="Distance from lens to chart, in m.",
)
@options.lens_options
@click.option(
    "--exposure",
    "exposure_s",
    type=options.exposure_time,
    default="1/3",
    metavar="SECONDS",
    help="Exposure time in s, such as 0.01 or 1/3.",
)
@options.seed_option()
@options.json_option
@click.pass_context
def command(ctx: click.Context, /, other: Path, reference: Path | None, as_json: bool, **settings: Any) -> None:
    """Compare another simulator's ColorChecker with photosite's simulation of the same set-up, or with a second file.

    OTHER is the output of the tool: patch values as CSV (patch,R_e,G_e,B_e in electrons; R_dn,... in DN above black) or
    as a MATLAB matrix; a mosaic filled by the chart as a MATLAB matrix, TIFF, raw frame or folder of frames; or a JSON
    file with set-up and patch electrons. REFERENCE is the output of another tool. Without it, photosite simulates the
    set-up of the JSON file, of --set-up, or of the options.

    The exit status is 0 for either verdict. The verdict is the first line, and "agrees" in the JSON object.

    Example: photosite compare patches.csv --sensor mine.sensor.yaml --illuminant D65 --exposure 1/30 --tolerance 0.5

    Example: photosite compare isetcam.mat --unit dn --variable sensor.data.dv
    """
    from photosite.validation.tool_comparison import compare

    say_if_compiling()
    set_up = _set_up(ctx, other, settings, needed=reference is None)
    values = _content(other, settings, set_up)
    base = set_up if reference is None else _content(reference, settings, set_up)
    if base is None:
        raise click.UsageError("nothing to compare with; pass REFERENCE or a set-up", ctx)
    result = compare(
        values, base, tolerance_percent=settings["tolerance_percent"], level=settings["level"], seed=settings["seed"]
    )
    case, hint = None, None
    file = settings["set_up_file"] or (other if other.suffix.lower() == ".json" else None)
    if file is not None and set_up is not None:
        from photosite.validation.set_up import case_of, read_set_up

        case = case_of(file, settings["case"])
        if not result.agrees and settings["integration"] == "trapezoid":
            by_rectangle = read_set_up(file, case, integration="rectangle")[0]
            again = compare(
                values,
                by_rectangle,
                tolerance_percent=settings["tolerance_percent"],
                level=settings["level"],
                seed=settings["seed"],
            )
            if again.agrees:
                hint = "they agree with the rectangle rule: --integration rectangle"
    named = [str(other), "photosite" if reference is None else str(reference)]
    if as_json:
        print_json({"compared": named, "case": case, "hint": hint} | result.to_dict())
    else:
        _show(named, result, [line for line in (case and f"case: {case}", hint) if line])


def _set_up(ctx: click.Context, other: Path, settings: dict[str, Any], *, needed: bool) -> SetUp | None:
    """Return the set-up from a file or from options; None where none is needed."""
    from photosite.validation.set_up import read_set_up

    file: Path | None = settings["set_up_file"]
    if file is None and other.suffix.lower() == ".json":
        file = other
    given = [name for name in _OF_OPTIONS if ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE]
    if file is not None and needed:
        if given:
            option = OptionSpelling(ctx.command).name(given[0])
            raise click.UsageError(f"{option} does not apply, because {file} contains the set-up", ctx)
        return read_set_up(file, settings["case"], integration=settings["integration"])[0]
    return _of_options(settings) if needed else None


def _of_options(settings: dict[str, Any]) -> SetUp:
    from photosite.camera.camera import Camera
    from photosite.scene.charts import macbeth
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.lamp import load_lamp
    from photosite.validation.set_up import SetUp

    lamp = load_lamp(settings["illuminant"])
    rule = settings["integration"]
    chart = macbeth(
        lamp.light,
        settings["mean_luminance_cd_m2"],
        wavelength_nm=lamp.wavelength_nm,
        distance_m=settings["distance_m"],
        rule=rule,
    )
    camera = Camera(
        options.lens(settings["f_number"], settings["focal_length_mm"]), load_sensor(settings["sensor_name"]), rule
    )
    return SetUp.from_chart(camera, chart, settings["exposure_s"])


def _content(path: Path, settings: dict[str, Any], set_up: SetUp | None) -> Content:
    from photosite.errors import FileError
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.set_up import read_set_up
    from photosite.validation.tool_files import read_tool_file

    if path.suffix.lower() == ".json":
        values = read_set_up(path, settings["case"])[1]
        if values is None:
            raise FileError(
                path, "the case has no result to compare", hint="Pass the tool's values as CSV with --set-up"
            )
        return values
    sensor = load_sensor(settings["sensor_name"]) if set_up is None else set_up.camera.sensor
    return read_tool_file(path, _read_options(settings, sensor))


def _read_options(settings: dict[str, Any], sensor: Sensor) -> Any:
    from photosite.validation.tool_files import ReadOptions
    from photosite.values.cfa import cfa_from

    black_dn = settings["black_level_dn"]
    return ReadOptions(
        cfa=sensor.array.cfa if settings["cfa"] is None else cfa_from(settings["cfa"]),
        bits=settings["bits"] or sensor.readout.bits,
        black_level_dn=sensor.readout.black_level_dn.value if black_dn is None else black_dn,
        unit=settings["unit"],
        variable=settings["variable"],
    )


def _show(named: list[str], result: PatchComparison | Validation, before: list[str]) -> None:
    from photosite.validation.patch_values import UNITS
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
