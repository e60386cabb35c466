"""`photosite sweep`: a measure of a camera for all combinations of values of its fields."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import say_if_compiling, show, tabular
from photosite.errors import InputError

if TYPE_CHECKING:
    from photosite.studies.sweep import Sweep

_PARTIAL = ".partial"


@click.command("sweep", cls=Command)
@click.argument("path", type=click.Path(path_type=Path), metavar="FILE")
@options.file_option(
    *("-o", "--output"),
    suffixes=(".csv",),
    text="Table to write (CSV). Results so far are in the folder FILE.partial beside it, from which the same command "
    "resumes after an interruption.",
)
@options.file_option(
    "--figure", suffixes=(".png", ".svg", ".pdf"), text="Figure to write: a measured column against a field."
)
@click.option("--x", metavar="NAME", help="Field on the figure's horizontal axis.  [default: the first]")
@click.option("--y", metavar="NAME", help="Measured column of the figure.  [default: the last]")
@options.workers_options()
@options.json_option
def command(
    path: Path,
    output: Path | None,
    figure: Path | None,
    x: str | None,
    y: str | None,
    processes: int,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Measure a camera for all combinations of values of its fields.

    FILE is a sweep file (YAML): a camera, the values of its fields, and a measure: snr, sensor_figures or
    image_quality.

    \b
    photosite_sweep: 1
    camera: {sensor: google-pixel-4a, optics: {f_number: 2.8, focal_length_mm: 4}}
    values:
      pixel_width_um: [0.8, 1.0, 1.4, 2.0, 3.0]
      f_number: [1.8, 2.8, 4]
    measure: {snr: {luminance_cd_m2: 5, exposure: 1/15}}

    The table is the same for any number of workers, and after any interruption.

    Example: photosite sweep pixels.sweep.yaml -o pixels.csv --figure pixels.png --processes 4
    """
    from photosite.cli.memory_need import sweep_bytes, warn_if_short
    from photosite.studies.sweep import sweep
    from photosite.studies.sweep_file import load_sweep

    if figure is None and (x, y) != (None, None):
        raise click.UsageError(f"{'--x' if y is None else '--y'} applies to --figure only")
    wanted = load_sweep(path)
    if x is not None and x not in wanted.values:
        raise InputError("x", value=x, expected=f"a field of the sweep: {', '.join(wanted.values)}")
    need = sweep_bytes(wanted.camera.sensor, processes)
    warn_if_short(f"a sweep with --processes {processes}", need, "Use fewer --processes, or a smaller sensor")
    say_if_compiling()
    partial = None if output is None else output.with_name(output.name + _PARTIAL)
    found = sweep(
        wanted.camera,
        wanted.values,
        wanted.measure,
        scene=wanted.scene,
        processes=processes,
        scheduler=scheduler,
        checkpoint=partial,
    )
    if figure is not None:
        _draw(found, x, y, figure)
    if output is not None and partial is not None:
        found.save(output)
        shutil.rmtree(partial)
    content = {"name": wanted.name, "fields": found.fields, "measured": found.measured, "rows": _rows(found)}
    content["notes"] = found.notes
    show(as_json, content, lambda: "\n".join((tabular(found), *found.notes)), output=output, figure=figure)


def _rows(found: Sweep) -> list[list[Any]]:
    """Return the rows; None for NaN."""
    return [
        [None if isinstance(value, float) and not math.isfinite(value) else value for value in row]
        for row in found.rows
    ]


def _draw(found: Sweep, x: str | None, y: str | None, path: Path) -> None:
    from photosite.files.writing import atomic_path
    from photosite.report.style import new_figure, styled

    with styled():
        figure, axes = new_figure()
        found.plot(x, y, axes)
        with atomic_path(path) as temporary:
            figure.savefig(temporary, dpi=150)
