"""`photosite measure`: image quality on frames of a chart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import diagnostics_text, listed, say, show, table, tabular, working

if TYPE_CHECKING:
    from photosite.metrics.measure import ImageQuality


@click.command("measure", cls=Command)
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="FRAMES")
@click.option("--chart", metavar="NAME", help="Chart in the frames, a built-in scene; --list shows which are measured.")
@click.option("--only", multiple=True, metavar="ID", help="A measurement to make; may be repeated.  [default: all]")
@click.option("--list", "list_them", is_flag=True, help="List the measurements, their charts and standards.")
@click.option(
    *("--set", "settings"),
    type=options.name_and_value,
    multiple=True,
    metavar="ID.NAME=VALUE",
    help="An option of a measurement, such as edge-sfr.order=1; may be repeated.",
)
@click.option(
    *("--chart-option", "chart_options"),
    type=options.name_and_value,
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the chart, such as cycles=72; `photosite scenes list` lists them; may be repeated.",
)
@options.corners_option(
    "Corners of the chart's patches (of the whole chart where it has none): top left, top right, bottom right, bottom "
    "left, row,col in pixels.  [default: the chart fills the frame]"
)
@click.option("--detect", is_flag=True, help="Find a ColorChecker; the report shows its outlines.")
@click.option(
    "--illuminant",
    metavar="NAME|FILE",
    help=f"Light of the chart: {options.ILLUMINANT_HELP}  [default: D65]",
)
@options.quantity("--luminance", "luminance_cd_m2", unit="CD/M2", text="Mean luminance of the chart, in cd/m2.")
@options.sensor_option(text="Sensor of raw frames (preset or file), for values in electrons.")
@click.option("--linear", is_flag=True, help="Codes of PNG, JPEG and TIFF pictures are proportional to light.")
@options.file_option("--report", suffixes=options.REPORT_SUFFIXES, text="Report to write, .html or .pdf.")
@options.reading_options
@options.json_option
def command(
    paths: tuple[Path, ...],
    chart: str | None,
    only: tuple[str, ...],
    list_them: bool,
    settings: Sequence[tuple[str, Any]],
    report: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Measure image quality on frames of a chart, by the standards of camera labs, with 95 % intervals.

    FRAMES are raw frames, several of one scene and setting as one stack, folders of them, or pictures (PNG, JPEG, TIFF
    in color). All measurements that the chart supports are made.

    \b
    Example: photosite measure edge.dng --chart slanted-edge --report edge.html
    with     photosite simulate --scene slanted-edge --exposure auto -o edge.dng
    """
    if list_them:
        _list(as_json)
        return
    if not paths or chart is None:
        raise click.UsageError("expected FRAMES and --chart, or --list")
    found = _measured(paths, chart, only, settings, given)
    if report is not None:
        with working("writing the report"):
            found.report(report)
    show(
        as_json,
        found.to_dict,
        lambda: "\n\n".join([tabular(found), *diagnostics_text(found.diagnostics)]),
        report=report,
    )


def _measured(
    paths: Sequence[Path], chart: str, only: Sequence[str], settings: Sequence[tuple[str, Any]], given: dict[str, Any]
) -> ImageQuality:
    from photosite.frames.io.formats import raw_files
    from photosite.metrics.chart_image import chart_image
    from photosite.metrics.measure import measure
    from photosite.sensor.io.sensor_file import load_sensor

    reading = {name: given.pop(name) for name in options.READING}
    name, linear = given.pop("sensor_name"), given.pop("linear")
    sensor = None if name is None else load_sensor(name)
    files = [file for path in paths for file in raw_files(path)]
    image = chart_image(files, sensor=sensor, linear=linear, **reading)
    own: dict[str, dict[str, Any]] = {}
    for key, value in settings:
        id, dot, option = key.partition(".")
        if not dot:
            raise click.BadParameter(f"must be ID.NAME=VALUE, such as edge-sfr.order=1, got '{key}'")
        own.setdefault(id.replace("_", "-"), {})[option] = value
    given["chart_options"] = dict(given["chart_options"])
    return measure(image, chart, only=only, options=own, on_progress=lambda id: say(f"measuring {id}"), **given)


def _list(as_json: bool) -> None:
    from photosite.metrics.registry import measurements

    found = measurements()
    content = {
        "measurements": [
            entry.about
            | {
                "charts": list(entry.charts),
                "oracle": entry.oracle,
                "options": {name: field.default for name, field in entry.options.model_fields.items()},
                "quantities": {name: vars(quantity) for name, quantity in entry.quantities.items()},
            }
            for entry in found.values()
        ]
    }
    rows = [("id", "measurement", "standard", "charts")]
    rows += [(entry.id, entry.title, entry.standard, ", ".join(entry.charts) or "any") for entry in found.values()]
    with_options = (
        f"{entry.id}: {', '.join(f'{name}={field.default}' for name, field in entry.options.model_fields.items())}"
        for entry in found.values()
        if entry.options.model_fields
    )
    show(as_json, content, lambda: f"{table(rows, '<<<<')}\n\n{listed('Options (--set ID.NAME=VALUE):', with_options)}")
