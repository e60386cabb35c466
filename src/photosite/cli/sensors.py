"""`photosite sensors`: list presets; show, check and export sensor files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from photosite.cli.command import Group
from photosite.cli.options import SENSOR_SUFFIXES, file_option, json_option
from photosite.cli.output import show, table
from photosite.errors import FileError
from photosite.values.cfa import tile_text


@click.group("sensors", cls=Group, invoke_without_command=True)
@json_option
@click.pass_context
def command(ctx: click.Context, as_json: bool) -> None:
    """List the presets, or show, check and export sensor files.

    Without a subcommand, lists the presets. In all commands, a sensor is the name of a preset or the path of a sensor
    file.

    Example: photosite sensors show nikon-d200
    """
    if ctx.invoked_subcommand is None:
        ctx.invoke(list_, as_json=as_json)


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
            "saturation_capacity_e": sensor.saturation_capacity_e,
        }
        for name, sensor in presets.items()
    }
    rows = [("sensor", "pixel", "rows x cols", "CFA", "bits", "read noise", "name")]
    for name, sensor in presets.items():
        size = f"{sensor.array.rows} x {sensor.array.cols}"
        tile = tile_text(sensor.array.cfa).replace("/", "").lower()
        noise = f"{sensor.noise.read_noise_mv.value:g} mV"
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
    from photosite.sensor.io.sensor_file import load_sensor

    sensor = load_sensor(file)
    assumed = _assumed(sensor.model_dump(mode="json", exclude_none=True))
    text = f"{file}: valid sensor file of {sensor.name}; assumed values: {', '.join(assumed) or 'none'}"
    show(as_json, {"file": file, "name": sensor.name, "assumed": assumed}, lambda: text)


def _assumed(node: Any, path: str = "") -> list[str]:
    """Return the dotted names of values that are marked as assumptions."""
    if not isinstance(node, dict):
        return []
    own = [path] if node.get("assumed") is True else []
    return own + [name for key, value in node.items() for name in _assumed(value, f"{path}.{key}".lstrip("."))]


@command.command("export")
@click.argument("name", metavar="NAME|FILE")
@file_option(
    *("-o", "--output"), suffixes=SENSOR_SUFFIXES, required=True, text="Sensor file to write (YAML); a new name."
)
@json_option
def export(name: str, output: Path, as_json: bool) -> None:
    """Write a sensor to a new file for editing.

    Existing files are not overwritten.

    Example: photosite sensors export nikon-d200 -o mine.sensor.yaml
    """
    from photosite.sensor.io.sensor_file import load_sensor

    if output.exists():
        raise FileError(output, "the file exists already", hint="Choose another name")
    sensor = load_sensor(name)
    sensor.save(output)
    show(as_json, {"name": sensor.name}, lambda: sensor.name, sensor=output)
