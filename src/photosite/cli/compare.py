"""`photosite compare`: patches or mosaics of another simulator against photosite or a second file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click
import numpy as np

from photosite.cli import options
from photosite.cli.command import Command, OptionSpelling
from photosite.cli.output import listed, say_if_compiling, show, table, tabular, verdict

if TYPE_CHECKING:
    from photosite.validation.patch_values import PatchComparison
    from photosite.validation.result import Validation
    from photosite.validation.set_up import SetUp
    from photosite.validation.tool_comparison import Content

_OF_OPTIONS = (
    *("sensor_name", "illuminant", "mean_luminance_cd_m2", "distance_m"),
    *("f_number", "focal_length_mm", "exposure_s"),
)
"""Options that a set-up file replaces."""

_OF_SIMULATION = (*(name for name in _OF_OPTIONS if name != "sensor_name"), "integration", "set_up_file", "seed")
"""Options of the simulation; the sensor also completes what a file does not state."""


@click.command("compare", cls=Command)
@click.argument("other", type=click.Path(path_type=Path))
@click.argument("reference", type=click.Path(path_type=Path), required=False)
@options.tolerance_percent_option(0.1, "Relative tolerance of means, and of the noise of raw frames, in percent.")
@options.level_option
@click.option(
    "--unit",
    type=click.Choice(["e", "dn"]),
    help="Unit of MATLAB files and raw files: electrons, or DN above black. Raw files are in DN by default.",
)
@click.option("--variable", metavar="NAME", help="Array of a MATLAB file, with dots for fields: sensor.data.volts.")
@options.number_options("mosaics", " Default: that of the sensor.")
@options.black_level_option(" of mosaics without it; by default that of the sensor")
@options.path_option("--set-up", "set_up_file", text="Set-up as a JSON file (docs/validation/isetcam.md).")
@click.option("--case", metavar="NAME", help="Case of a JSON file with several cases.")
@click.option(
    "--integration",
    type=click.Choice(["trapezoid", "rectangle"]),
    default="trapezoid",
    help="Rule of the integrals over wavelength.",
)
@options.sensor_option("nikon-d200")
@click.option("--illuminant", default="A", metavar="NAME", help=options.ILLUMINANT_HELP)
@options.luminance_option("Mean luminance of the patches, in cd/m2.", default=40.0)
@options.distance_option("Distance from lens to chart, in m.", default=1.2)
@options.lens_options()
@options.exposure_option(text="Exposure time: 0.01, 1/100 or 10ms.", default="1/3")
@click.option(
    "--value",
    "values",
    multiple=True,
    metavar="NAME",
    help="A value of image quality of both mosaics, such as noise.snr_18_db.G; may be repeated.",
)
@options.seed_option()
@options.json_option
@click.pass_context
def command(
    ctx: click.Context, /, other: Path, reference: Path | None, values: tuple[str, ...], as_json: bool, **settings: Any
) -> None:
    """Compare another simulator's ColorChecker with photosite's simulation of the same set-up, or with a second file.

    OTHER is the output of the tool: patch values as CSV (patch,R_e,G_e,B_e in electrons; R_dn,... in DN above black) or
    as a MATLAB matrix; a mosaic filled by the chart as a MATLAB matrix, TIFF, raw frame or folder of frames; or a JSON
    file with set-up and patch electrons. REFERENCE is the output of another tool. Without it, photosite simulates the
    set-up of the JSON file, of --set-up, or of the options.

    The exit status is 0 for either verdict. The verdict is the first line, and "agrees" in the JSON object.

    Example: photosite compare patches.csv --sensor mine.sensor.yaml --illuminant D65 --exposure 1/30 --tolerance 0.5

    Example: photosite compare other.dng --exposure 1/3 --value noise.snr_18_db --value color-accuracy.delta_e_2000_mean

    Example: photosite compare isetcam.mat --unit dn --variable sensor.data.dv
    """
    from photosite.validation.set_up import read_set_up
    from photosite.validation.tool_comparison import compare, compare_tool_quality

    _check_options(other, reference, settings["set_up_file"])
    say_if_compiling()
    file = settings["set_up_file"] or (other if other.suffix.lower() == ".json" else None)
    set_up = _set_up(ctx, file, settings) if reference is None else None
    theirs = _content(other, settings, set_up)
    base = _content(reference, settings, set_up) if reference is not None else set_up
    assert base is not None
    test: dict[str, Any] = {name: settings[name] for name in ("tolerance_percent", "level", "seed")}
    result = compare(theirs, base, **test)
    quality = compare_tool_quality(theirs, base, values, **test) if values else None
    case, hint = None, None
    if file is not None and set_up is not None:
        case = set_up.case
        if not result.agrees and settings["integration"] == "trapezoid":
            rectangle = read_set_up(file, case, integration="rectangle")[0]
            if compare(theirs, rectangle, **test).agrees:
                hint = "they agree with the rectangle rule: --integration rectangle"
    named = [str(other), "photosite" if reference is None else str(reference)]
    lines = [line for line in (case and f"case: {case}", hint) if line]
    content = {"compared": named, "case": case, "hint": hint} | result.to_dict()
    if quality is not None:
        content["image_quality"] = quality.to_dict()
    text = _text(named, result, lines)
    show(as_json, content, lambda: text if quality is None else f"{text}\n\n{tabular(quality)}")


def _check_options(other: Path, reference: Path | None, set_up_file: Path | None) -> None:
    """Raise a usage error for an option that does not apply to these files."""
    read = [path for path in (other, reference) if path is not None]
    suffixes = {path.suffix.lower() for path in read}
    if reference is not None:
        options.only_for("a simulation, which REFERENCE replaces", *_OF_SIMULATION)
    if ".json" not in suffixes and set_up_file is None:
        options.only_for("JSON files", "case")
    if ".mat" not in suffixes:
        options.only_for("MATLAB files", "variable")
    if suffixes <= {".csv", ".json"}:
        options.only_for("MATLAB files and raw files", "unit", "bits", "cfa", "black_level_dn")


def _set_up(ctx: click.Context, file: Path | None, settings: dict[str, Any]) -> SetUp:
    """Return the set-up from a file, else from the options."""
    from photosite.camera.camera import Camera
    from photosite.optics.diffraction import DiffractionLimited
    from photosite.scene.charts import macbeth
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.lamp import load_lamp
    from photosite.validation.set_up import SetUp, read_set_up

    rule = settings["integration"]
    if file is not None:
        if given := [name for name in _OF_OPTIONS if options.is_given(ctx, name)]:
            option = OptionSpelling(ctx.command).name(given[0])
            raise click.UsageError(f"{option} does not apply, because {file} contains the set-up", ctx)
        return read_set_up(file, settings["case"], integration=rule)[0]
    lamp = load_lamp(settings["illuminant"])
    place = {"wavelength_nm": lamp.wavelength_nm, "distance_m": settings["distance_m"]}
    chart = macbeth(lamp.light, settings["mean_luminance_cd_m2"], **place, rule=rule)
    optics = DiffractionLimited(f_number=settings["f_number"], focal_length_mm=settings["focal_length_mm"])
    return SetUp.from_chart(Camera(optics, load_sensor(settings["sensor_name"]), rule), chart, settings["exposure_s"])


def _content(path: Path, settings: dict[str, Any], set_up: SetUp | None) -> Content:
    """Return what a tool wrote; the sensor of the set-up, else of --sensor, completes it."""
    from photosite.errors import FileError
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.set_up import read_set_up
    from photosite.validation.tool_comparison import ReadOptions, read_tool_file
    from photosite.values.cfa import cfa_from

    if path.suffix.lower() == ".json":
        values = read_set_up(path, settings["case"])[1]
        if values is None:
            hint = "Pass the tool's values as CSV with --set-up"
            raise FileError(path, "the case has no result to compare", hint=hint)
        return values
    sensor = load_sensor(settings["sensor_name"]) if set_up is None else set_up.camera.sensor
    black_dn = settings["black_level_dn"]
    read_options = ReadOptions(
        cfa=sensor.array.cfa if settings["cfa"] is None else cfa_from(settings["cfa"]),
        bits=settings["bits"] or sensor.readout.bits,
        black_level_dn=sensor.readout.black_level_dn.value if black_dn is None else black_dn,
        unit=settings["unit"],
        variable=settings["variable"],
    )
    return read_tool_file(path, read_options)


def _text(named: list[str], result: PatchComparison | Validation, before: list[str]) -> str:
    from photosite.validation.patch_values import UNITS
    from photosite.validation.result import Validation

    heading = f"{named[0]} and {named[1]} {verdict(result.agrees)}, at a tolerance of {result.tolerance_percent:g} %"
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
    parts = [
        listed(heading, (*before, *result.reasons, *result.notes)),
        f"Means in {unit}, and the relative difference:\n" + table(rows, "<" + ">" * len(columns)),
    ]
    if result.color is not None:
        delta = result.color.delta_e_2000
        parts.append(f"delta E 2000 of the patches: mean {delta.mean():.3g}, largest {delta.max():.3g}")
    return "\n\n".join(parts)
