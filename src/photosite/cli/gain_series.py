"""`photosite calibrate` for frames of several gain settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli.output import Stages, print_json, table

if TYPE_CHECKING:
    from photosite.calibration.gain_series.result import GainSeries
    from photosite.frames.frame_set import FrameSet
    from photosite.sensor.model import Sensor


def calibrate_gain_series(
    frames: FrameSet,
    sensor: Sensor | None,
    output: Path | None,
    report: Path | None,
    checkpoint: Path | None,
    as_json: bool,
) -> None:
    """Calibrate each setting and analyse them together; the names of sensor files contain the setting."""
    from photosite.calibration.gain_series.calibrate_series import calibrate_series

    series = calibrate_series(frames, sensor, progress=Stages(), checkpoint=checkpoint)
    written: list[Path] = []
    if output is not None:
        for step in series.steps:
            written.append(setting_path(output, step.setting))
            step.calibration.sensor.save(written[-1])
    if report is not None:
        series.report(report)
    if as_json:
        files = {"sensors": [str(file) for file in written]} if written else {}
        print_json(series.to_dict() | files | ({} if report is None else {"report": str(report)}))
        return
    _show(series)
    for file in (*written, *([] if report is None else [report])):
        click.echo(f"wrote {file}")


def setting_path(path: Path, setting: float) -> Path:
    """Return the path of a setting's sensor file: mine.sensor.yaml becomes mine.gain400.sensor.yaml.

    Examples
    --------
    >>> setting_path(Path("out/mine.sensor.yaml"), 400.0).as_posix()
    'out/mine.gain400.sensor.yaml'
    """
    ending = "".join(path.suffixes[-2:]) if path.name.endswith((".sensor.yaml", ".sensor.yml")) else path.suffix
    return path.with_name(f"{path.name.removesuffix(ending)}.gain{setting:g}{ending}")


def _show(series: GainSeries) -> None:
    from photosite.calibration.parameters import parameter_label
    from photosite.report.gain_series import SERIES_PARAMETERS, switch_sentence, unity_sentence
    from photosite.report.tables import format_estimate

    labels = [parameter_label(name) for name in SERIES_PARAMETERS]
    rows = [("setting", *(f"{shown.label}, {shown.unit}" for shown in labels))]
    for step in series.steps:
        values = [format_estimate(getattr(step.calibration, name)) for name in SERIES_PARAMETERS]
        rows.append((f"{step.setting:g}", *values))
    frames = sum(step.calibration.frame_count for step in series.steps)
    click.echo(f"{series.source}: {frames} frames at {len(series.steps)} gain settings ({series.scale})\n")
    click.echo(table(rows, ">" * len(rows[0])))
    heading = ("settings", "noise before the amplifier, e⁻", "after it, DN", "chi square", "degrees of freedom")
    parts = [
        (
            f"{mode.settings[0]:g} to {mode.settings[-1]:g}",
            format_estimate(mode.pre_amplifier_noise_e),
            format_estimate(mode.post_amplifier_noise_dn),
            "" if mode.chi_square is None else f"{mode.chi_square:.3g}",
            "" if mode.degrees_of_freedom is None else str(mode.degrees_of_freedom),
        )
        for mode in series.modes
    ]
    click.echo("\n" + table([heading, *parts], "<>>>>"))
    click.echo(f"\n{switch_sentence(series)}\n{unity_sentence(series)}")
    if series.warnings:
        click.echo("\nwarnings:")
        for line in series.warnings:
            click.echo(f"  {line}")
