"""`photosite spectral`: quantum efficiency from bands of light and a photodiode, or from a chart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, diagnostics_text, listed, say_if_compiling, show, table

if TYPE_CHECKING:
    from photosite.calibration.spectral.result import SpectralCalibration
    from photosite.sensor.model import Sensor


@click.command("spectral", cls=Command)
@click.argument("path", metavar="PROTOCOL", type=click.Path(path_type=Path))
@options.sensor_option(text="Sensor with measured gain and pixel size. Default: the sensor named in the protocol.")
@options.file_option(
    *("-o", "--output"),
    suffixes=options.SENSOR_SUFFIXES,
    text="Sensor file to write (YAML), with the measured quantum efficiencies.",
)
@options.file_option("--figure", suffixes=(".png", ".svg"), text="Figure to write (PNG or SVG).")
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
    """Measure the quantum efficiency of each color channel.

    PROTOCOL is a YAML file with 'photosite_spectral: 1'. It lists either bands of light (monochromator or filters) with
    their frames, dark frames and photodiode readings, or frames of a chart under known lights ('lights'). System gain
    and pixel size come from a sensor file, preferably one written by 'photosite calibrate -o'.

    Example: photosite spectral spectral.yaml --sensor mine.sensor.yaml -o mine.sensor.yaml --figure qe.png
    """
    if figure is None:
        options.only_for("--figure", "beside")
    sensor, known = options.sensor_or(None, sensor_name), options.sensor_or(None, beside)
    say_if_compiling()
    calibration = _calibrated(path, sensor, seed)
    if output is not None:
        calibration.sensor.save(output)
    if figure is not None:
        _draw(calibration, known, figure)
    show(as_json, calibration.to_dict(), lambda: _text(calibration), sensor=output, figure=figure)


def _calibrated(path: Path, sensor: Sensor | None, seed: int) -> SpectralCalibration:
    from photosite.calibration.spectral.chart import calibrate_chart
    from photosite.calibration.spectral.monochromator import calibrate_spectral
    from photosite.calibration.spectral.protocol import open_spectral
    from photosite.studies.chart_spectral import is_chart_protocol, read_chart

    if not is_chart_protocol(path):
        options.only_for("frames of a chart", "seed")
        return calibrate_spectral(open_spectral(path), sensor, progress=Stages())
    views, used = read_chart(path, sensor)
    return calibrate_chart(views, used, seed=seed)


def _draw(calibration: SpectralCalibration, beside: Sensor | None, path: Path) -> None:
    from photosite.files.writing import atomic_path
    from photosite.report.figures.sensor import quantum_efficiency_figure
    from photosite.report.style import png_bytes, svg_bytes

    drawn = quantum_efficiency_figure(calibration, beside)
    with atomic_path(path) as temporary:
        temporary.write_bytes(svg_bytes(drawn) if path.suffix.lower() == ".svg" else png_bytes(drawn))


def _text(calibration: SpectralCalibration) -> str:
    from photosite.report.numbers import format_uncertain

    lines = [f"{calibration.source}: {calibration.frame_count} frames, {calibration.light}\n"]
    for name, channel in calibration.channels.items():
        columns = (channel.wavelength_nm, channel.quantum_efficiency, channel.standard_uncertainty)
        rows = [("nm", f"{name}: electrons per photon", "95 % interval")]
        for nm, value, uncertainty, low, high in zip(*columns, *channel.interval_95, strict=True):
            rows.append((f"{nm:g}", format_uncertain(value, uncertainty), f"{low:.4f} to {high:.4f}"))
        lines.append(listed(table(rows, "><<"), [f"{channel.method}\n"]))
    return "\n".join([*lines, *diagnostics_text(calibration.diagnostics)])
