"""`photosite spectral`: quantum efficiency from bands of light and a photodiode, or from a chart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.calibration.spectral.result import SpectralCalibration
    from photosite.sensor.model import Sensor


@click.command("spectral", cls=Command)
@click.argument("path", metavar="PROTOCOL", type=click.Path(path_type=Path))
@click.option(
    "--sensor",
    "sensor_name",
    metavar="NAME|FILE",
    help="Sensor with measured gain and pixel size. Default: the sensor named in the protocol.",
)
@click.option(
    "-o",
    "--output",
    type=options.output_file(".yaml", ".yml"),
    metavar="FILE",
    help="Sensor file to write (YAML), with the measured quantum efficiencies.",
)
@click.option(
    "--figure", type=options.output_file(".png", ".svg"), metavar="FILE", help="Figure to write (PNG or SVG)."
)
@click.option("--beside", metavar="NAME|FILE", help="Sensor to draw in the figure for comparison.")
@options.seed_option()
@options.json_option
def command(
    path: Path,
    sensor_name: str | None,
    output: Path | None,
    figure: Path | None,
    beside: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Measure the quantum efficiency of each colour channel.

    PROTOCOL is a YAML file with 'photosite_spectral: 1'. It lists either bands of light (monochromator or filters) with
    their frames, dark frames and photodiode readings, or frames of a chart under known lights ('lights'). System gain
    and pixel size come from a sensor file, preferably one written by 'photosite calibrate -o'.

    Example: photosite spectral spectral.yaml --sensor mine.sensor.yaml -o mine.sensor.yaml --figure qe.png
    """
    from photosite.sensor.io.sensor_file import load_sensor

    sensor = None if sensor_name is None else load_sensor(sensor_name)
    known = None if beside is None else load_sensor(beside)
    say_if_compiling()
    calibration = _calibrated(path, sensor, seed)
    if output is not None:
        calibration.sensor.save(output)
    if figure is not None:
        _draw(calibration, known, figure)
    written = {"sensor": output, "figure": figure}
    if as_json:
        print_json(calibration.to_dict() | {name: str(file) for name, file in written.items() if file is not None})
        return
    _show(calibration)
    for file in written.values():
        if file is not None:
            click.echo(f"wrote {file}")


def _calibrated(path: Path, sensor: Sensor | None, seed: int) -> SpectralCalibration:
    from photosite.calibration.spectral.chart import calibrate_chart
    from photosite.calibration.spectral.monochromator import calibrate_spectral
    from photosite.calibration.spectral.protocol import open_spectral
    from photosite.studies.chart_spectral import is_chart_protocol, open_chart

    if not is_chart_protocol(path):
        return calibrate_spectral(open_spectral(path), sensor, progress=Stages())
    views, used = open_chart(path, sensor)
    return calibrate_chart(views, used, seed=seed)


def _draw(calibration: SpectralCalibration, beside: Sensor | None, path: Path) -> None:
    from photosite.files.atomic import atomic_path
    from photosite.report.figures.sensor import quantum_efficiency_figure
    from photosite.report.style import png_bytes, svg_bytes

    drawn = quantum_efficiency_figure(calibration, beside)
    with atomic_path(path) as temporary:
        temporary.write_bytes(svg_bytes(drawn) if path.suffix.lower() == ".svg" else png_bytes(drawn))


def _show(calibration: SpectralCalibration) -> None:
    from photosite.report.numbers import format_uncertain

    click.echo(f"{calibration.source}: {calibration.frame_count} frames, {calibration.light}\n")
    for name, channel in calibration.channels.items():
        rows = [("nm", f"{name}: electrons per photon", "95 % interval")]
        low, high = channel.interval_95
        for nm, value, uncertainty, lower, upper in zip(
            channel.wavelength_nm, channel.quantum_efficiency, channel.standard_uncertainty, low, high, strict=True
        ):
            rows.append((f"{nm:g}", format_uncertain(value, uncertainty), f"{lower:.4f} to {upper:.4f}"))
        click.echo(table(rows, "><<"))
        click.echo(f"  {channel.method}\n")
    for line in calibration.warnings:
        click.echo(f"  {line}")
