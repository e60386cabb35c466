"""`photosite demo`: measure a virtual camera and compare the result with the truth."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, say, say_if_compiling, show, table, verdict

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor
    from photosite.studies.closed_loop import ClosedLoop

REPORT_NAME, SENSOR_NAME, FRAMES_NAME = "report.html", "calibrated.sensor.yaml", "frames"
PROTOCOL_NAME = "protocol.yaml"


@click.command("demo", cls=Command)
@options.sensor_option("nikon-d200")
@options.gain_setting_option
@options.size_options(1296, 1936)
@options.seed_option(2008)
@options.folder_option(
    options.shared_folder, "Folder for the report and the calibrated sensor file.", default="photosite-demo"
)
@click.option("--keep-frames", is_flag=True, help="Keep the frames in the subfolder frames.")
@options.json_option
def command(seed: int, output: Path, keep_frames: bool, as_json: bool, **chip: Any) -> None:
    """Measure a virtual camera and compare the result with the truth.

    A virtual sensor takes the 405 dark frames and flat fields of the 2008 paper. photosite calibrates the sensor from
    the files, simulates a ColorChecker with the true and with the calibrated sensor, compares the two, and writes an
    HTML report. The default chip has a quarter of the D200's pixels: about a minute on two cores, and 2 GB of disk
    space while it runs.

    Example: photosite demo -o photosite-demo
    """
    from photosite.errors import FileError
    from photosite.files.writing import atomic_folder

    sensor, note = options.prepared_sensor(**chip)
    if keep_frames and (output / FRAMES_NAME).exists():
        raise FileError(
            output / FRAMES_NAME, "the folder already exists", hint="Choose another folder, or omit --keep-frames"
        )
    if note:
        say(note)
    say_if_compiling()
    with atomic_folder(output, add=True) as place:
        source = str(output / FRAMES_NAME / PROTOCOL_NAME) if keep_frames else "virtual frames, not kept"
        loop = _loop(sensor, seed, place, source)
        if not keep_frames:
            shutil.rmtree(place / FRAMES_NAME)
    report = output / REPORT_NAME
    content = loop.to_dict() | {"report": report, "seconds": loop.seconds}
    show(as_json, content, lambda: f"{_text(loop)}\n\nreport: {report}")


def _loop(sensor: Sensor, seed: int, place: Path, source: str) -> ClosedLoop:
    from photosite.studies.closed_loop import closed_loop

    stages = Stages()
    loop = closed_loop(
        sensor, photons_known=True, seed=seed, folder=place / FRAMES_NAME, source=source, progress=stages
    )
    stages.stage("writing the report")
    loop.calibration.sensor.save(place / SENSOR_NAME)
    loop.report(place / REPORT_NAME)
    return loop


def _text(loop: ClosedLoop) -> str:
    from photosite.report.numbers import format_number

    rows: list[tuple[str, ...]] = [("parameter", "true", "estimated", "uncertainty", "unit")]
    missing = []
    for row in loop.parameters:
        if row.estimated is None or row.standard_uncertainty is None:
            missing.append((f"{row.label}, {row.unit}", row.reason or ""))
            continue
        numbers = (row.true, 5), (row.estimated, 5), (row.standard_uncertainty, 2)
        rows.append((row.label, *(format_number(value, digits) for value, digits in numbers), row.unit))
    parts = [table(rows, "<>>><"), *([table([("not estimated", "why"), *missing], "<<")] if missing else [])]
    result = loop.validation
    agreement = f"{verdict(result.agrees)} (relative tolerance {result.tolerance_percent:g} %)"
    return "\n" + "\n\n".join([*parts, f"ColorChecker by the true and the calibrated sensor: {agreement}"])
