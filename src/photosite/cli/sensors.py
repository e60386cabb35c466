"""`photosite sensors`: list presets; make, show, check and export sensor files."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.options import SENSOR_SUFFIXES, Whole, file_option, json_option
from photosite.cli.output import say, show, table, tabular
from photosite.files.writing import atomic_path
from photosite.files.yaml import parse_yaml
from photosite.values.cfa import NAMED, tile_name

F = TypeVar("F", bound=Callable[..., Any])


@click.group("sensors", cls=Group)
def command() -> None:
    """List the presets, or make, show, compare, check and export sensor files.

    In all commands, a sensor is the name of a preset or the path of a sensor file.

    Example: photosite sensors list
    """


@command.command("list")
@json_option
def list_(as_json: bool) -> None:
    """List the presets, one per line.

    Example: photosite sensors list --json
    """
    from photosite.sensor.io.sensor_file import load_sensor, preset_names

    presets = {name: load_sensor(name) for name in preset_names()}
    facts = {
        name: {
            "name": sensor.name,
            "rows": sensor.array.rows,
            "cols": sensor.array.cols,
            "cfa": sensor.array.cfa,
            "pixel_width_um": sensor.pixel.width_um.value,
            "bits": sensor.readout.bits,
            "read_noise_mv": sensor.noise.read_noise_mv.value,
            "read_noise_e": sensor.electrons(sensor.noise.read_noise_mv.value),
            "gain_settings": sensor.all_gain_settings,
            "saturation_capacity_e": sensor.saturation_capacity_e,
        }
        for name, sensor in presets.items()
    }
    rows = [("sensor", "pixel", "rows x cols", "CFA", "bits", "read noise", "name")]
    for name, sensor in presets.items():
        size = f"{sensor.array.rows} x {sensor.array.cols}"
        tile = tile_name(sensor.array.cfa)
        noise = f"{sensor.electrons(sensor.noise.read_noise_mv.value):.1f} e-"
        bits = str(sensor.readout.bits)
        rows.append((name, f"{sensor.pixel.width_um.value:g} um", size, tile, bits, noise, sensor.name))
    show(as_json, {"sensors": facts}, lambda: table(rows, "<><<>><"))


@command.command("show")
@click.argument("name", metavar="NAME|FILE")
@json_option
def show_sensor(name: str, as_json: bool) -> None:
    """Print a sensor file, with the source of every value.

    Example: photosite sensors show vendor-2.2um --json
    """
    from photosite.sensor.io.sensor_file import dump_sensor, load_sensor

    sensor = load_sensor(name)
    content = sensor.model_dump(mode="json", exclude_none=True)
    show(as_json, content, lambda: dump_sensor(sensor).removesuffix("\n"))


@command.command("schema")
def schema() -> None:
    """Print the JSON Schema of sensor files.

    Editors and other tools use it to check files.

    Example: photosite sensors schema > sensor.schema.json
    """
    from photosite.sensor.model import Sensor

    click.echo(json.dumps(Sensor.model_json_schema(), indent=2))


@command.command("check")
@click.argument("file", type=click.Path(path_type=Path))
@json_option
def check(file: Path, as_json: bool) -> None:
    """Check a sensor file.

    The exit status is 0 if the file is valid, otherwise 2 with the line and the reason.

    Example: photosite sensors check mine.sensor.yaml
    """
    from photosite.sensor.io.sensor_file import dump_sensor, load_sensor

    sensor = load_sensor(file)
    assumed = _assumed(parse_yaml(dump_sensor(sensor), file))
    text = f"{file}: valid sensor file of {sensor.name}; assumed values: {', '.join(assumed) or 'none'}"
    show(as_json, {"file": file, "name": sensor.name, "assumed": assumed}, lambda: text)


_SHEET_FIELDS = (
    *("pitch_um", "full_well_e", "read_noise_e", "read_noise_dn", "read_noise_mv", "system_gain_dn_per_e"),
    *("system_gain_e_per_dn", "conversion_gain_uv_per_e", "voltage_swing_v", "dsnu_e", "prnu_percent"),
    *("dark_current_e_per_s", "dark_current_temperature_c", "dcnu_percent", "fill_factor", "black_level_dn"),
)
"""Fields of a sensor file with an option of `photosite sensors new`."""

_QE_PEAK = "Largest quantum efficiency, per photon on the photodetector: on the whole pixel, without --fill-factor."

_ASKED = ("pitch_um", "full_well_e", "read_noise_e")
"""Fields that are required, read noise in any unit."""


def _sheet_options(function: F) -> F:
    """Add an option for each of `_SHEET_FIELDS`, with the help of the file's schema."""
    for name in reversed(_SHEET_FIELDS):
        flag = "--pixel-um" if name == "pitch_um" else f"--{name.replace('_', '-')}"
        function = click.option(flag, name, type=float, metavar="X", help=_description(name))(function)
    return function


def _description(name: str) -> str:
    from photosite.sensor.new_sensor import described

    meaning, unit = described(name)
    return f"{meaning} Unit: {unit}."


@command.command("new")
@file_option(*("-o", "--output"), suffixes=SENSOR_SUFFIXES, required=True, text="Sensor file to write (YAML).")
@click.option("--name", metavar="TEXT", help="Name of the sensor.  [default: the file's name]")
@click.option("--rows", type=Whole(1), metavar="N", help="Rows of the active array.")
@click.option("--cols", type=Whole(1), metavar="N", help="Columns of the active array.")
@click.option("--bits", type=Whole(1, 16), metavar="N", help="Bit depth of the converter.")
@click.option(
    "--cfa",
    default="mono",
    metavar="TILE",
    help=f"Color filter array: {', '.join(NAMED)}, or a tile such as RG/GB.",
)
@click.option("--qe-peak", type=float, metavar="X", help=_QE_PEAK)
@_sheet_options
@click.option("--source", metavar="TEXT", help="Origin of the values, such as the data sheet.")
@json_option
def new(output: Path, name: str | None, source: str | None, cfa: str, as_json: bool, **given: Any) -> None:
    """Write a commented sensor file from the figures of a data sheet.

    Pixel pitch, full well, read noise, rows, columns, bits and the largest quantum efficiency are required; on a
    terminal, the command asks for those that are missing. Whatever else is not given is assumed and marked with
    `assumed: true`.

    Example: photosite sensors new --pixel-um 3.45 --full-well-e 10500 --read-noise-e 2.4 --qe-peak 0.65 --bits 12
    --rows 2048 --cols 2448 -o mine.sensor.yaml
    """
    from photosite.sensor.io.sensor_file import parse_sensor
    from photosite.sensor.new_sensor import new_sensor_file

    _ask(given)
    stated = {field: given[field] for field in _SHEET_FIELDS if given[field] is not None}
    text = new_sensor_file(
        name or output.name.removesuffix(output.suffix).removesuffix(".sensor"),
        **{field: given[field] for field in ("rows", "cols", "bits", "qe_peak")},
        cfa=cfa,
        values=stated,
        source=source,
    )
    with atomic_path(output) as temporary:
        temporary.write_text(text, encoding="utf-8")
    assumed = _assumed(parse_yaml(text, output))
    content = {"name": parse_sensor(text, output).name, "assumed": assumed}
    show(as_json, content, lambda: f"assumed values: {', '.join(assumed) or 'none'}", sensor=output)


def _ask(given: dict[str, Any]) -> None:
    """Ask for required values that are missing, on a terminal; raise a usage error elsewhere."""
    required = [name for name in (*_ASKED, "rows", "cols", "bits", "qe_peak") if given[name] is None]
    if any(given[name] is not None for name in ("read_noise_dn", "read_noise_mv")):
        required = [name for name in required if name != "read_noise_e"]
    context = click.get_current_context()
    options = {parameter.name: parameter for parameter in context.command.params}
    if required and not _is_terminal():
        raise click.UsageError(f"missing options: {', '.join(options[name].opts[0] for name in required)}")
    for name in required:
        option = options[name]
        text, _, rest = (getattr(option, "help", "") or "").rstrip(".").partition(". ")
        unit = rest.partition("Unit: ")[2]
        given[name] = click.prompt(f"{text} ({unit})" if unit else text, type=option.type, err=True)


def _is_terminal() -> bool:
    return sys.stdin.isatty()


def _assumed(node: Any, path: str = "") -> list[str]:
    """Return the dotted names of values that are marked as assumptions."""
    if not isinstance(node, dict):
        return []
    own = [path] if node.get("assumed") is True else []
    return own + [name for key, value in node.items() for name in _assumed(value, f"{path}.{key}".lstrip("."))]


@command.command("export")
@click.argument("name", metavar="NAME|FILE")
@file_option(*("-o", "--output"), suffixes=SENSOR_SUFFIXES, required=True, text="Sensor file to write (YAML).")
@json_option
def export(name: str, output: Path, as_json: bool) -> None:
    """Write a sensor to a file for editing, with its comments.

    Example: photosite sensors export nikon-d200 -o mine.sensor.yaml
    """
    from photosite.sensor.io.sensor_file import load_sensor

    sensor = load_sensor(name)
    sensor.save(output)
    show(as_json, {"name": sensor.name}, lambda: sensor.name, sensor=output)


@command.command("compare")
@click.argument("names", metavar="NAME|FILE...", nargs=-1, required=True)
@options.quantity("--f-number", unit="N", default=2.8, text="f-number of the common lens, without losses.")
@options.exposure_option(text="Exposure time in s, such as 0.01 or 1/15.", default="1/15")
@options.option("--illuminant", default="3200K", metavar="NAME", help=options.ILLUMINANT_HELP)
@options.values_option()
@file_option("--report", suffixes=options.REPORT_SUFFIXES, text="Page to write, .html or .pdf.")
@json_option
def compare(names: tuple[str, ...], as_json: bool, report: Path | None, **conditions: Any) -> None:
    """Compare sensors behind the same lens: SNR against luminance, SNR10, dynamic range.

    SNR10 is the illuminance on an 18 % gray chart at which a pixel's signal is 10 times its noise.

    Example: photosite sensors compare nikon-d200 vendor-2.2um --report sensors.html
    """
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.studies.sensor_comparison import compare_sensors

    found = compare_sensors({name: load_sensor(name) for name in names}, on_progress=say, **conditions)
    if report is not None:
        found.report(report)
    show(as_json, found.to_dict(), lambda: tabular(found), report=report)
