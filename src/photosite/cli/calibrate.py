"""`photosite calibrate`: a sensor's parameters from dark and flat frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.gain_series import calibrate_gain_series
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.calibration.result import Calibration


@click.command("calibrate", cls=Command)
@click.argument("path", type=click.Path(path_type=Path))
@click.option(
    "--sensor",
    "sensor_name",
    metavar="NAME|FILE",
    help="Sensor as known before: pixel size, volts, spectra. Default: the sensor file of the protocol.",
)
@click.option(
    "-o",
    "--output",
    type=options.output_file(".yaml", ".yml"),
    metavar="FILE",
    help="Sensor file to write (YAML).",
)
@click.option(
    "--report",
    type=options.output_file(".html", ".pdf"),
    metavar="FILE",
    help="Report to write: a data sheet as one self-contained HTML page or a PDF, by the suffix.",
)
@click.option(
    "--checkpoint",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Checkpoint folder; an interrupted run resumes from it.",
)
@click.option("--bits", type=click.IntRange(1, 16), help="Bit depth, for files without it.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files without it.")
@click.option("--dark", multiple=True, metavar="PATTERN", help="Dark frames of the folder, by file name: 'IMG_00*'.")
@click.option("--light", multiple=True, metavar="PATTERN", help="Light frames of the folder, by file name.")
@click.option(
    "--outlier-dark",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="DN",
    help="List pixels of the mean dark frame that deviate from its mean by more. Default: a limit beyond which a "
    "normal distribution has a tenth of a pixel.",
)
@click.option(
    "--outlier-light",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="PERCENT",
    help="The same for the mean light frame near half saturation, high-passed, in percent of the mean signal.",
)
@click.option(
    "--maps",
    is_flag=True,
    help="Also measure maps of offset, response, dark rate and read noise, defects, row and column noise; -o writes "
    "the maps beside the sensor file (HDF5).",
)
@options.json_option
def command(
    path: Path,
    sensor_name: str | None,
    output: Path | None,
    report: Path | None,
    checkpoint: Path | None,
    bits: int | None,
    cfa: str | None,
    dark: tuple[str, ...],
    light: tuple[str, ...],
    outlier_dark: float | None,
    outlier_light: float | None,
    maps: bool,
    as_json: bool,
) -> None:
    """Estimate a sensor's parameters, with standard uncertainties, from dark and flat frames.

    PATH is a folder of frames, a protocol (YAML), an EMVA 1288 descriptor or a file with many frames. Parameters that
    cannot be estimated are reported with the reason. Millivolts and the sensor file need the pixel size, the voltage
    swing and the spectral response, which frames do not show: they come from the sensor file named by the protocol or
    by --sensor.

    Frames of several gain settings (ISO) are calibrated as a series: each setting by itself, then the switch of the
    conversion gain and the two parts of the read noise. -o then writes a sensor file per setting,
    mine.gain400.sensor.yaml and so on.

    \b
    Frames are read from
      DNG, camera raw   NEF, CR2, CR3, ARW, RAF, ...; exposure and ISO from their metadata
      TIFF, PNG         8 or 16 bits, grey; pages of a TIFF are frames
      HDF5              datasets (rows, cols) or (frames, rows, cols) of uint8 or uint16;
                        attributes exposure_s, kind, gain_setting, bits, black_level_dn, cfa
      FITS              EXPTIME, GAIN, CCD-TEMP, IMAGETYP, BAYERPAT (needs photosite[fits])

    \b
    Missing metadata are read from the name of the file or its subfolder
      dark, bias, d_012; light, flat, bright, b_012   dark or light
      10ms, 0.04s, 250us, 1-8000s                     exposure time (1-8000s is 1/8000 s)
      iso400, gain_2.5; _-10C                         gain setting; temperature

    A protocol overrides metadata and file names. Without any of them, the level of the frames decides between dark and
    light, with a warning; --dark and --light override it.

    Example: photosite calibrate stack -o mine.sensor.yaml --report report.html
    """
    from photosite.calibration.calibrate import calibrate
    from photosite.calibration.spatial.spatial_analysis import OutlierThresholds
    from photosite.frames.open import open_frames
    from photosite.sensor.io.maps_file import maps_path
    from photosite.sensor.io.sensor_file import load_sensor

    frames = open_frames(path, bits=bits, cfa=cfa, dark=dark, light=light)
    sensor = frames.sensor if sensor_name is None else load_sensor(sensor_name)
    if output is not None and sensor is None:
        raise click.UsageError("-o needs pixel size, volts and spectra, which frames lack: give --sensor")
    if maps and len(frames.gain_settings) > 1:
        raise click.UsageError("--maps needs frames of one gain setting: calibrate each setting separately")
    if (outlier_dark or outlier_light) and len(frames.gain_settings) > 1:
        raise click.UsageError("--outlier-dark and --outlier-light need frames of one gain setting")
    say_if_compiling()
    if len(frames.gain_settings) > 1:
        calibrate_gain_series(frames, sensor, output, report, checkpoint, as_json)
        return
    outliers = OutlierThresholds(outlier_dark, outlier_light)
    calibration = calibrate(frames, sensor, maps=maps, outliers=outliers, progress=Stages(), checkpoint=checkpoint)
    _save(calibration, output, report)
    beside = maps_path(output) if calibration.chip is not None and output is not None else None
    if as_json:
        written = {"sensor": output, "maps": beside, "report": report}
        print_json(calibration.to_dict() | {name: str(file) for name, file in written.items() if file is not None})
        return
    _show(calibration)
    for file in (output, beside, report):
        if file is not None:
            click.echo(f"wrote {file}")


def _save(calibration: Calibration, output: Path | None, report: Path | None) -> None:
    if output is not None:
        _ = calibration.sensor  # raises before anything is written
    if report is not None:
        calibration.report(report)
    if output is not None:
        calibration.save(output)


def _show(calibration: Calibration) -> None:
    from photosite.calibration.parameters import PARAMETER_LABELS
    from photosite.report.numbers import format_uncertain

    model = f"EMVA 1288's {calibration.model} model"
    click.echo(f"{calibration.source}: {calibration.frame_count} frames, {model}\n")
    rows = [("parameter", "value", "unit", "method")]
    missing = [("not estimated", "reason")]
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
    _show_chip(calibration)
    for what, lines in (("warnings", calibration.warnings), ("left out", calibration.rejected)):
        if lines:
            click.echo(f"\n{what}:")
            for line in lines:
                click.echo(f"  {line}")


def _show_chip(calibration: Calibration) -> None:
    from photosite.calibration.chip_maps.noise_shape import NORMAL_SHAPE
    from photosite.report.numbers import format_uncertain

    chip, temporal = calibration.chip, calibration.temporal
    if chip is None or temporal is None:
        return
    rows = [("dark temporal noise", "value", "unit", "method")]
    for label, unit, entry in (
        ("pixel noise", "DN", temporal.pixel_noise_dn),
        ("row noise", "DN", temporal.row_noise_dn),
        ("column noise", "DN", temporal.column_noise_dn),
        ("frame noise", "DN", temporal.frame_noise_dn),
        ("excess kurtosis", "", temporal.shape.excess_kurtosis),
        ("  within pixels", "", temporal.shape.within_pixels),
        ("  between pixels", "", temporal.shape.between_pixels),
        (f"Tukey lambda ({NORMAL_SHAPE:.4f}: normal)", "", temporal.shape.tukey_lambda),
    ):
        if entry.value is not None and entry.standard_uncertainty is not None:
            rows.append((label, format_uncertain(entry.value, entry.standard_uncertainty), unit, entry.method))
    click.echo("\n" + table(rows, "<<<<"))
    defects = [("defective pixels", "number")] + [(kind, str(n)) for kind, n in chip.defects.counts().items()]
    click.echo("\n" + table(defects, "<>"))
    bands = [("bands", "cycles per pixel", "amplitude, DN")]
    bands += [
        (name, f"{band.cycles_per_pixel:.4f}", format_uncertain(band.amplitude_dn, band.standard_uncertainty_dn))
        for name, found in temporal.bands.items()
        for band in found
    ]
    if len(bands) > 1:
        click.echo("\n" + table(bands, "<><"))
