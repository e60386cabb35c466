"""`photosite polarizers`: angle and extinction ratio of each channel, from flat fields behind a polarizer."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import show, table
from photosite.errors import FileError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from photosite.calibration.light.polarizers import Polarizer
    from photosite.frames.raw_frame import RawFrame

_ANGLE = re.compile(r"(\d+(?:\.\d+)?)deg(?![a-zA-Z])")


@click.command("polarizers", cls=Command)
@click.argument("path", metavar="FOLDER", type=click.Path(path_type=Path, exists=True, file_okay=False))
@options.sensor_option(text="Sensor file to complete: needed for -o.")
@options.file_option(
    *("-o", "--output"), suffixes=options.SENSOR_SUFFIXES, text="Sensor file to write (YAML), with the polarizers."
)
@options.file_option("--figure", suffixes=(".png", ".svg"), text="Figure to write (PNG or SVG).")
@options.reading_options
@options.json_option
def command(
    path: Path, sensor_name: str | None, output: Path | None, figure: Path | None, as_json: bool, **reading: Any
) -> None:
    """Measure angle and extinction ratio of the polarizers on the pixels.

    FOLDER holds flat fields behind a rotating linear polarizer, two or more at each of three angles or more. The names
    of the files or of their subfolders state the angle, counterclockwise from the rows: flat_45deg_1.tif. Names with
    the word dark are dark frames of the same exposure time; without them, the black level of the files is subtracted.

    Example: photosite polarizers turned --sensor mine.sensor.yaml -o complete.sensor.yaml --figure polarizers.png
    """
    from photosite.calibration.light.polarizers import measure_polarizers, with_polarizers

    if output is not None and sensor_name is None:
        raise click.UsageError("-o needs the sensor file to complete: give --sensor")
    if output is None:
        options.only_for("-o", "sensor_name")
    flats, darks = _frames(path, reading)
    found = measure_polarizers(flats, darks)
    sensor = options.sensor_or(None, sensor_name)
    if sensor is not None and output is not None:
        with_polarizers(sensor, found).save(output)
    if figure is not None:
        _draw(flats, darks, found, figure)
    facts = {
        name: {
            "angle_deg": {"value": one.angle_deg.value, "standard_uncertainty": one.angle_deg.standard_uncertainty},
            "leakage": {"value": one.leakage.value, "standard_uncertainty": one.leakage.standard_uncertainty},
        }
        for name, one in found.items()
    }
    show(as_json, {"channels": facts}, lambda: _text(found), sensor=output, figure=figure)


def _frames(folder: Path, reading: dict[str, Any]) -> tuple[dict[float, list[RawFrame]], list[RawFrame]]:
    """Return the flat fields by angle, and the dark frames."""
    from photosite.frames.frame_settings import kinds_in_name
    from photosite.frames.io.format_table import is_frame_name
    from photosite.frames.io.formats import is_own_output, read_raw

    flats, darks = defaultdict(list), []
    files = sorted(file for file in folder.rglob("*") if is_frame_name(file))
    for file in (file for file in files if not is_own_output(file)):
        places = [str(file.relative_to(folder).with_suffix("")), folder.name]
        if any(kinds_in_name(place) == {"dark"} for place in places[:1]):
            darks.append(read_raw(file, **reading))
        elif (angle := next((one for place in places if (one := _ANGLE.search(place))), None)) is not None:
            flats[float(angle[1])].append(read_raw(file, **reading))
        else:
            hint = "Name it after the angle, such as flat_45deg_1.tif, or dark_1.tif"
            raise FileError(file, "neither file nor folder states an angle", hint=hint)
    return dict(flats), darks


def _draw(
    flats: Mapping[float, list[RawFrame]], darks: list[RawFrame], found: Mapping[str, Polarizer], path: Path
) -> None:
    from photosite.files.writing import atomic_path
    from photosite.report.figures.polarizers import polarizers_figure
    from photosite.report.style import png_bytes, svg_bytes

    drawn = polarizers_figure(flats, darks, found)
    with atomic_path(path) as temporary:
        temporary.write_bytes(svg_bytes(drawn) if path.suffix.lower() == ".svg" else png_bytes(drawn))


def _text(found: Mapping[str, Polarizer]) -> str:
    from photosite.report.numbers import format_uncertain

    rows = [("channel", "angle, degrees", "extinction ratio", "95 % interval")]
    for name, one in found.items():
        low, high = one.extinction_ratio_95
        angle = format_uncertain(one.angle_deg.value, one.angle_deg.standard_uncertainty)
        rows.append((name, angle, f"{one.extinction_ratio:.4g}", f"{low:.4g} to {high:.4g}"))
    return table(rows, "<<><")
