"""`photosite temperature`: the doubling temperature of the dark current, from dark frames at several temperatures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, diagnostics_text, held_warnings, not_listed, say_if_compiling, show, table

if TYPE_CHECKING:
    from photosite.calibration.dark.temperature import DarkTemperature


def temperatures_of(text: str) -> tuple[float, ...]:
    """Parse 15,25,35."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"must be temperatures such as 15,25,35, got '{text}'") from None


@click.command("temperature", cls=Command)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--at",
    "temperature_c",
    type=temperatures_of,
    metavar="C,C,...",
    help="Temperature of each PATH in degrees Celsius.  [default: those that the frames or their names state]",
)
@options.sensor_option(text="Sensor file to complete: needed for -o.")
@options.file_option(
    *("-o", "--output"),
    suffixes=options.SENSOR_SUFFIXES,
    text="Sensor file to write (YAML): that of --sensor with the dark current, its temperature and the doubling "
    "temperature.",
)
@options.file_option("--report", suffixes=options.REPORT_SUFFIXES, text="Report to write, HTML or PDF by the suffix.")
@options.reading_options
@options.unstated_exposure_option
@options.where_option
@options.json_option
def command(
    paths: tuple[Path, ...],
    temperature_c: tuple[float, ...] | None,
    sensor_name: str | None,
    output: Path | None,
    report: Path | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Measure the doubling temperature of the dark current.

    Each PATH is what `photosite calibrate` takes: a folder, a protocol or a file with many frames. The frames of all
    PATHs are sorted by their temperature; each temperature needs dark frames of two exposure times or more. Flat fields
    are not needed.

    Example: photosite temperature 15C 25C 35C --sensor mine.sensor.yaml -o complete.sensor.yaml --report dark.html
    """
    from photosite.calibration.dark.temperature import dark_temperature
    from photosite.calibration.setting import calibrate_setting
    from photosite.frames.frame_set import STEADY_TEMPERATURE_C, split_by_temperature
    from photosite.frames.open import open_frames

    held = click.get_current_context().with_resource(held_warnings())
    if output is not None and sensor_name is None:
        raise click.UsageError("-o needs the sensor file to complete: give --sensor")
    if temperature_c is not None and len(temperature_c) != len(paths):
        raise click.UsageError(f"--at must have a temperature for each of {len(paths)} paths, got {len(temperature_c)}")
    sensor = options.sensor_or(None, sensor_name)
    reading |= {"sensor": sensor, "together": ("set_temperature_c",)}
    opened = sets = [open_frames(path, **reading) for path in paths]
    if temperature_c is None:
        sets = [part for frames in sets for part in split_by_temperature(frames)]
    else:
        for path, frames in zip(paths, sets, strict=True):
            stated = [c for group in frames.groups for c in group.temperatures_c or () if c is not None]
            if stated and max(stated) - min(stated) >= STEADY_TEMPERATURE_C:
                spread = f"{min(stated):g} to {max(stated):g} deg C"
                raise click.UsageError(f"{path}: the frames state temperatures from {spread}; leave out --at")
    if len(sets) < 2:
        raise click.UsageError("dark frames of two temperatures or more are needed, got one; name further paths")
    say_if_compiling()
    calibrations = [calibrate_setting(frames, sensor, progress=Stages()) for frames in sets]
    found = dark_temperature(calibrations, temperature_c)
    not_listed(held, (*found.warnings, *(text for frames in opened for text in frames.warnings)))
    completed = None if output is None or sensor is None else found.applied_to(sensor)
    if report is not None:
        found.report(report)
    if completed is not None and output is not None:
        completed.save(output)
    show(as_json, found.to_dict(), lambda: _text(found), sensor=output, report=report)


def _text(found: DarkTemperature) -> str:
    from photosite.report.tables import format_estimate, interval_text

    points = [("temperature, °C", "dark current, DN/s", "95 % interval", "fit, DN/s")]
    points += [
        (f"{celsius:.1f}", format_estimate(entry), interval_text(entry), f"{found.at(celsius):.4g}")
        for celsius, entry in found.measured
    ]
    rows = [("quantity", "value", "unit", "95 % interval")]
    for label, unit, entry in (
        ("doubling temperature", "°C", found.doubling_c),
        (f"dark current at {found.reference_c:.1f} °C", "DN/s", found.dark_current_dn_per_s),
    ):
        rows.append((label, format_estimate(entry), unit, interval_text(entry) or entry.reason or ""))
    parts = [table(points, "><<>"), table(rows, "<<<<")]
    return "\n\n".join([*parts, *diagnostics_text(found.diagnostics)])
