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
    from photosite.metrics.camera_quality import CameraQuality
    from photosite.metrics.limits import Limits
    from photosite.metrics.measure import ImageQuality


@click.command("measure", cls=Command)
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="FRAMES")
@click.option(
    "--chart",
    "charts",
    multiple=True,
    metavar="NAME",
    help="Chart in the frames, a built-in scene; --list shows which are measured. With --camera: may be repeated.  "
    "[default: all]",
)
@click.option(
    "--photographs",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="List of photographs of several charts (YAML, docs/howto/image-quality.md): measure all, for one report.",
)
@click.option(
    *("--camera", "camera_file"),
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Camera file: simulate its frames of the charts, and measure them.",
)
@click.option(
    *("--frames", "count"),
    type=options.Whole(0),
    default=8,
    help="Simulated frames of each chart; 0: mean electrons without noise. With --camera.",
)
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
@click.option("--detect", is_flag=True, help="Find a ColorChecker or slanted squares; the report shows the outlines.")
@click.option(
    "--illuminant",
    metavar="NAME|FILE",
    help=f"Light of the chart: {options.ILLUMINANT_HELP}  [default: D65]",
)
@options.quantity("--luminance", "luminance_cd_m2", unit="CD/M2", text="Mean luminance of the chart, in cd/m2.")
@options.sensor_option(text="Sensor of raw frames (preset or file), for values in electrons.")
@click.option(
    "--tone-curve",
    default="file",
    show_default=False,
    metavar="srgb|linear|chart|FILE",
    help="Tone curve of pictures: srgb; linear; that of the chart's gray patches; or the JSON of oecf on a picture of "
    "gray patches.  [default: what the file states, else sRGB]",
)
@click.option(
    *("--limits", "limits_file"),
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Limits (YAML, docs/howto/image-quality.md) to judge the values by.",
)
@click.option("--exit-status", is_flag=True, help="Exit with status 1 unless every limit passes.")
@options.seed_option()
@options.file_option("--report", suffixes=options.REPORT_SUFFIXES, text="Report to write, .html or .pdf.")
@options.reading_options
@options.json_option
def command(
    paths: tuple[Path, ...],
    list_them: bool,
    photographs: Path | None,
    report: Path | None,
    limits_file: Path | None,
    exit_status: bool,
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
    if exit_status and limits_file is None:
        raise click.UsageError("--exit-status requires --limits")
    limits = None if limits_file is None else _limits(limits_file)
    found: ImageQuality | CameraQuality
    if photographs is not None:
        _check_alone(click.get_current_context())
        found = _of_photographs(photographs, given)
    elif given["camera_file"] is not None:
        if paths:
            raise click.UsageError("expected FRAMES or --camera, not both")
        found = _simulated(given)
    else:
        if not paths or len(given["charts"]) != 1:
            raise click.UsageError("expected FRAMES and one --chart, --photographs, --camera, or --list")
        found = _measured(paths, given)
    judged = None if limits is None else limits.judge(found)
    if report is not None:
        with working("writing the report"):
            (found if judged is None else judged).report(report)
    content = found.to_dict() if judged is None else found.to_dict() | {"verdicts": judged.to_dict()}

    def text() -> str:
        verdicts = [] if judged is None else [tabular(judged)]
        return "\n\n".join([tabular(found), *diagnostics_text(found.diagnostics), *verdicts])

    show(as_json, content, text, report=report)
    if exit_status and judged is not None and not judged.passed:
        raise click.exceptions.Exit(1)


_WITH_PHOTOGRAPHS = {"photographs", "report", "limits_file", "exit_status", "as_json", "force", *options.READING}


def _check_alone(context: click.Context) -> None:
    """Raise an error for an option that the list of photographs states itself."""
    for parameter in context.command.params:
        name = parameter.name or ""
        if name not in _WITH_PHOTOGRAPHS and options.is_given(context, name):
            shown = parameter.opts[0] if isinstance(parameter, click.Option) else "FRAMES"
            raise click.UsageError(f"--photographs lists the frames and how they are measured; omit {shown}")


def _limits(path: Path) -> Limits:
    from photosite.metrics.limits import load_limits

    return load_limits(path)


def _own_options(settings: Sequence[tuple[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the options of measurements by id."""
    own: dict[str, dict[str, Any]] = {}
    for key, value in settings:
        id, dot, option = key.partition(".")
        if not dot:
            raise click.BadParameter(f"must be ID.NAME=VALUE, such as edge-sfr.order=1, got '{key}'")
        own.setdefault(id.replace("_", "-"), {})[option] = value
    return own


def _simulated(given: dict[str, Any]) -> CameraQuality:
    from photosite.camera.file import load_camera
    from photosite.studies.simulated_charts import ChartConditions, measure_camera

    setup = load_camera(given["camera_file"])
    light = {name: given[name] for name in ("illuminant", "luminance_cd_m2") if given[name] is not None}
    return measure_camera(
        setup.camera,
        ChartConditions(given["count"], given["seed"], **light),
        charts=given["charts"],
        only=given["only"],
        options=_own_options(given["settings"]),
        name=setup.name or given["camera_file"].name,
        on_progress=say,
    )


def _measured(paths: Sequence[Path], given: dict[str, Any]) -> ImageQuality:
    from photosite.frames.io.formats import raw_files
    from photosite.metrics.photographs import measure_files
    from photosite.sensor.io.sensor_file import load_sensor

    placing = {name: given[name] for name in ("corners", "detect", "illuminant", "luminance_cd_m2", "tone_curve")}
    return measure_files(
        [file for path in paths for file in raw_files(path)],
        given["charts"][0],
        sensor=None if given["sensor_name"] is None else load_sensor(given["sensor_name"]),
        reading={name: given[name] for name in options.READING},
        only=given["only"],
        options=_own_options(given["settings"]),
        on_progress=lambda id: say(f"measuring {id}"),
        chart_options=dict(given["chart_options"]),
        **placing,
    )


def _of_photographs(file: Path, given: dict[str, Any]) -> CameraQuality:
    from photosite.metrics.photographs import measure_photographs

    reading = {name: given[name] for name in options.READING}
    return measure_photographs(file, reading=reading, on_progress=lambda text: say(f"measuring {text}"))


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
