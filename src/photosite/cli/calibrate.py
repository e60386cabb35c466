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
    "--checkpoint",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Keep partial sums here; a run that was broken off goes on from them.",
)
@click.option("--bits", type=click.IntRange(1, 16), help="Bits of the converter, for files that do not say.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files that do not say.")
@click.option("--dark", multiple=True, metavar="PATTERN", help="Files of a folder that are dark frames: 'IMG_00*'.")
@click.option("--light", multiple=True, metavar="PATTERN", help="Files of a folder that are light frames.")
@click.option(
    "--far-dark",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="DN",
    help="List pixels of the mean dark frame that deviate from its mean by more; else those too far out for a normal "
    "distribution.",
)
@click.option(
    "--far-light",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="PERCENT",
    help="The same for the mean light frame near half saturation, high-passed.",
)
@click.option(
    "--maps",
    is_flag=True,
    help="Measure the chip itself: maps of offset, response, dark rate and read noise, defects, row and column noise; "
    "-o writes the maps beside the sensor file (HDF5).",
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
    far_dark: float | None,
    far_light: float | None,
    maps: bool,
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
    from photosite.calibration.spatial.spatial_analysis import FarThresholds
    from photosite.frames.open import open_frames
    from photosite.sensor.io.maps_file import maps_path
    from photosite.sensor.io.sensor_file import load_sensor

    frames = open_frames(path, bits=bits, cfa=cfa, dark=dark, light=light)
    sensor = frames.sensor if sensor_name is None else load_sensor(sensor_name)
    if output is not None and sensor is None:
        raise click.UsageError("-o needs what frames do not tell (pixel, volts, spectra): name a sensor with --sensor")
    if maps and len(frames.gain_settings) > 1:
        raise click.UsageError("--maps takes frames of one gain setting; calibrate those of one setting by themselves")
    if (far_dark or far_light) and len(frames.gain_settings) > 1:
        raise click.UsageError("--far-dark and --far-light take frames of one gain setting")
    say_if_compiling()
    if len(frames.gain_settings) > 1:
        calibrate_gain_series(frames, sensor, output, report, checkpoint, as_json)
        return
    far = FarThresholds(far_dark, far_light)
    calibration = calibrate(frames, sensor, maps=maps, far=far, progress=Stages(), checkpoint=checkpoint)
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
        _ = calibration.sensor  # what it may lack is said before anything is written
    if report is not None:
        calibration.report(report)
    if output is not None:
        calibration.save(output)


def _show(calibration: Calibration) -> None:
    from photosite.calibration.parameters import PARAMETER_LABELS
    from photosite.report.numbers import format_uncertain

    model = f"EMVA 1288's {calibration.model} model"
    click.echo(f"{calibration.source}: {calibration.frame_count} frames, {model}\n")
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
    rows = [("noise in the dark", "value", "unit", "how")]
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
