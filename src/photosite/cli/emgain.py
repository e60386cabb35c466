"""`photosite emgain`: gain and excess noise of an EMCCD's register, from frames without and with multiplication."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, diagnostics_text, held_warnings, not_listed, say_if_compiling, show, table

if TYPE_CHECKING:
    from photosite.calibration.effects.em_gain import EmGainResult


@click.command("emgain", cls=Command)
@click.argument("unity", type=click.Path(path_type=Path))
@click.argument("multiplied", type=click.Path(path_type=Path))
@options.sensor_option(
    text="Sensor as known before: pixel size, volts, spectra; stages of the register. Default: the sensor file of the "
    "protocol of UNITY."
)
@click.option(
    "--stages",
    type=options.Whole(1),
    metavar="N",
    help="Stages of the register, for the excess noise of theory.  [default: those of the sensor file, else many]",
)
@options.file_option("-o", "--output", suffixes=options.SENSOR_SUFFIXES, text="Sensor file to write (YAML).")
@options.file_option("--report", suffixes=options.REPORT_SUFFIXES, text="Report to write, HTML or PDF by the suffix.")
@options.reading_options
@options.unstated_exposure_option
@options.where_option
@options.json_option
def command(
    unity: Path,
    multiplied: Path,
    sensor_name: str | None,
    stages: int | None,
    output: Path | None,
    report: Path | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Measure the gain and the excess noise of a multiplication register.

    UNITY and MULTIPLIED are measurements of the same camera as `photosite calibrate` takes them: with a multiplication
    gain of 1, and with the gain to measure. Both state the photons per pixel in a protocol, or both are taken in the
    same light at stated exposure times.

    The sensor file has the values of UNITY and the register.

    Example: photosite emgain unity gain300 --stages 536 --sensor nominal.sensor.yaml -o emccd.sensor.yaml
    """
    from photosite.calibration.effects.em_gain import measure_em_gain
    from photosite.calibration.setting import calibrate_setting
    from photosite.frames.open import open_frames
    from photosite.sensor.effects.em_gain import EmGain
    from photosite.values.uncertain import Measured

    if unity.resolve() == multiplied.resolve():
        raise click.UsageError(f"UNITY and MULTIPLIED must be two measurements, got {unity} twice")
    held = click.get_current_context().with_resource(held_warnings())
    sets = [open_frames(path, sensor=options.sensor_or(None, sensor_name), **reading) for path in (unity, multiplied)]
    sensor = options.sensor_or(sets[0].sensor, sensor_name)
    if output is not None and sensor is None:
        raise click.UsageError("-o needs pixel size, volts and spectra, which frames lack: give --sensor")
    stated = None if sensor is None or sensor.effects is None else sensor.effects.em_gain
    plain = sensor.with_(em_gain=None) if sensor is not None and stated is not None else sensor
    say_if_compiling()
    first, second = (calibrate_setting(frames, plain, progress=Stages()) for frames in sets)
    if stages is not None:
        stated = (stated or EmGain(gain=Measured(1.0))).model_copy(update={"stages": stages})
    found = measure_em_gain(first, second, stated)
    not_listed(held, (*first.warnings, *second.warnings))
    completed = None if output is None else found.sensor
    if report is not None:
        found.report(report)
    if completed is not None and output is not None:
        completed.save(output)
    show(as_json, found.to_dict(), lambda: _text(found), sensor=output, report=report)


def _text(found: EmGainResult) -> str:
    from photosite.report.tables import format_estimate, interval_text

    rows = [("quantity", "value", "unit", "95 % interval", "method")]
    for label, unit, entry in (
        ("gain of the register", "1", found.gain),
        ("excess noise factor", "1", found.excess_noise_factor),
        ("read noise in front of it", "e-", found.read_noise_e),
    ):
        rows.append((label, format_estimate(entry), unit, interval_text(entry), entry.reason or entry.method))
    rows.insert(3, ("  of theory", f"{found.theory:.4g}", "1", "", f"stages: {found.stated.stages or 'many'}"))
    return "\n\n".join([table(rows, "<<<<<"), *diagnostics_text(found.diagnostics)])
