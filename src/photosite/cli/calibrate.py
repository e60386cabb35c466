"""`photosite calibrate`: a sensor's parameters from dark and flat frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.gain_series import calibrate_gain_series
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.calibration.result import Calibration


@click.command("calibrate")
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--sensor",
    "sensor_name",
    metavar="NAME|FILE",
    help="What is known beforehand (pixel, volts, spectra), if the protocol names no sensor file.",
)
@click.option(
    "-o",
    "--output",
    type=options.output_file(".yaml", ".yml"),
    metavar="FILE",
    help="Sensor file to write (YAML), as measured.",
)
@click.option(
    "--report",
    type=options.output_file(".html", ".pdf"),
    metavar="FILE",
    help="Report to write: a data sheet in one self-contained HTML page, or a PDF, by the file's ending.",
)
@click.option(
    "--partial",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Keep partial sums here; a run that was broken off goes on from them.",
)
@click.option("--bits", type=click.IntRange(1, 16), help="Bits of the converter, for files that do not say.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files that do not say.")
@click.option("--dark", multiple=True, metavar="PATTERN", help="Files of a folder that are dark frames: 'IMG_00*'.")
@click.option("--light", multiple=True, metavar="PATTERN", help="Files of a folder that are light frames.")
@options.json_option
def command(
    path: Path,
    sensor_name: str | None,
    output: Path | None,
    report: Path | None,
    partial: Path | None,
    bits: int | None,
    cfa: str | None,
    dark: tuple[str, ...],
    light: tuple[str, ...],
    as_json: bool,
) -> None:
    """Estimate a sensor's parameters, with standard uncertainties, from dark and flat frames.

    PATH is a folder of frames, a protocol (YAML), an EMVA 1288 descriptor or a file of many frames. What cannot be
    estimated is said with the reason. Frames of several gain settings (ISO) are a series: each setting is
    calibrated, the switch of the conversion gain and the two parts of the read noise are looked for, and -o writes
    a sensor file for each setting, mine.gain400.sensor.yaml and so on. Millivolts and the sensor file need what
    frames do not tell: the pixel's size, the voltage swing and the spectral response, from the sensor file that the
    protocol names or from --sensor.

    \b
    Frames are read from
      DNG, camera raw   NEF, CR2, CR3, ARW, RAF, ...; exposure and ISO from their metadata
      TIFF, PNG         8 or 16 bits, grey; pages of a TIFF are frames
      HDF5              datasets (rows, cols) or (frames, rows, cols) of uint8 or uint16;
                        attributes exposure_s, kind, gain_setting, bits, black_level_dn, cfa
      FITS              EXPTIME, GAIN, CCD-TEMP, IMAGETYP, BAYERPAT (needs photosite[fits])

    \b
    What a file does not say is read from its name, or its subfolder's:
      dark, bias, d_012; light, flat, bright, b_012   dark or light
      10ms, 0.04s, 250us, 1-8000s                     exposure (1-8000s is 1/8000 s)
      iso400, gain_2.5; _-10C                         gain setting; temperature

    A protocol stands before files and names. Where nothing says dark or light, the level of the frames tells it, with a
    warning; --dark and --light say otherwise.

    Example: photosite calibrate stack -o mine.sensor.yaml --report report.html
    """
    from photosite.calibration.calibrate import calibrate
    from photosite.frames.open import open_frames
    from photosite.sensor.file import load_sensor

    frames = open_frames(path, bits=bits, cfa=cfa, dark=dark, light=light)
    sensor = frames.sensor if sensor_name is None else load_sensor(sensor_name)
    if output is not None and sensor is None:
        raise click.UsageError("-o needs what frames do not tell (pixel, volts, spectra): name a sensor with --sensor")
    say_if_compiling()
    if len(frames.gain_settings) > 1:
        calibrate_gain_series(frames, sensor, output, report, partial, as_json)
        return
    calibration = calibrate(frames, sensor, progress=Stages(), partial=partial)
    _save(calibration, output, report)
    if as_json:
        written = {"sensor": output, "report": report}
        print_json(calibration.to_dict() | {name: str(file) for name, file in written.items() if file is not None})
        return
    _show(calibration)
    for file in (output, report):
        if file is not None:
            click.echo(f"wrote {file}")


def _save(calibration: Calibration, output: Path | None, report: Path | None) -> None:
    sensor = None if output is None else calibration.sensor
    if report is not None:
        calibration.report(report)
    if sensor is not None and output is not None:
        sensor.save(output)


def _show(calibration: Calibration) -> None:
    from photosite.calibration.parameters import PARAMETER_LABELS
    from photosite.report.numbers import format_uncertain

    click.echo(f"{calibration.source}: {calibration.frame_count} frames\n")
    rows = [("parameter", "value", "unit", "how")]
    missing = [("not estimated", "why")]
    for name, entry in calibration.estimates().items():
        shown = PARAMETER_LABELS[name]
        if entry.value is None or entry.standard_uncertainty is None:
            missing.append((f"{shown.label}, {shown.unit}", entry.reason or ""))
            continue
        value = format_uncertain(entry.value, entry.standard_uncertainty)
        if entry.upper_limit_95 is not None:
            value += f" (< {entry.upper_limit_95:.3g})"
        rows.append((shown.label, value, shown.unit, entry.method))
    click.echo(table(rows, "<<<<"))
    if len(missing) > 1:
        click.echo("\n" + table(missing, "<<"))
    for what, lines in (("warnings", calibration.warnings), ("left out", calibration.rejected)):
        if lines:
            click.echo(f"\n{what}:")
            for line in lines:
                click.echo(f"  {line}")
