"""`photosite validate`: raw frames of a chart against simulated frames, or against a simulation from a sensor file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command, OptionSpelling
from photosite.cli.output import listed, say, say_if_compiling, show, table, tabular, verdict

if TYPE_CHECKING:
    from photosite.frames.raw_frame import RawFrame
    from photosite.validation.frame_validation import FrameValidation
    from photosite.validation.quality_comparison import QualityComparison
    from photosite.validation.result import Validation


_only_with_measured = options.stacked(
    click.option(
        "--measured",
        multiple=True,
        type=click.Path(path_type=Path),
        metavar="FILES",
        help="Raw frames or folders of raw frames; several are one stack. With --image-quality: a list of photographs, "
        "or the JSON of `photosite measure`.",
    ),
    click.option(
        *("--camera", "camera_file"),
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Camera file that is validated; with --image-quality.",
    ),
    options.sensor_option(),
    click.option(
        "--scene", "scene_name", type=click.Choice(["macbeth"]), default="macbeth", help="Chart in the frames."
    ),
    click.option(
        "--illuminant",
        metavar="FILE|NAME",
        help="Lamp: CSV file of a spectroradiometer, CIE illuminant (A, D65, ...) or blackbody (3200K).",
    ),
    options.quantity(
        *("--luminance", "luminance_cd_m2"),
        unit="CD/M2",
        text="Mean luminance of the patches, in cd/m2; overrides that of a lamp file.",
    ),
    options.distance_option("Distance from lens to chart, in m.", default=1.2),
    options.lens_options(),
    options.exposure_option(text="Exposure time: 0.01, 1/100 or 10ms; overrides that of the files."),
    options.black_level_option(" of files without it"),
    options.corners_option("Outer corners of the dark skin, bluish green, black and white patches, row,col in pixels."),
    click.option("--detect", is_flag=True, help="Find the chart; the report shows its outlines."),
    click.option(
        "--fit",
        type=click.Choice(["fill_factor", "light"]),
        help="Parameter to fit to the patch means: the fill factor or the light level.",
    ),
    options.file_option("--report", suffixes=options.REPORT_SUFFIXES, text="Report to write, .html or .pdf."),
    options.seed_option(),
)


@click.command("validate", cls=Command)
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="MEASURED SIMULATED | FILES")
@click.option("--chart", default="macbeth", help="Chart that fills the frames; only with two paths.")
@click.option(
    "--image-quality",
    is_flag=True,
    help="Compare every measurement of image quality, with a verdict for each value: of the chart in two paths, or of "
    "photographs (--measured) with charts that are simulated with --camera.",
)
@options.level_option
@options.tolerance_percent_option(
    0.0, "Relative tolerance of means and noise, in percent; with 0, every difference beyond the noise counts."
)
@options.reading_options
@_only_with_measured
@options.json_option
@click.pass_context
def command(
    ctx: click.Context,
    /,
    paths: tuple[Path, ...],
    chart: str,
    image_quality: bool,
    as_json: bool,
    measured: tuple[Path, ...],
    **camera: Any,
) -> None:
    """Compare raw frames of a chart with simulated frames: patch means, noise, colors, and a verdict.

    Two paths, MEASURED and SIMULATED, are raw files or folders of raw files of one scene and setting. The chart fills
    the frame.

    --measured compares raw frames of a real camera (further FILES of the same scene and setting may follow) with frames
    simulated from a sensor file, lamp, lens and exposure time. The chart is at --corners, or found by --detect.

    The exit status is 0 for either verdict. The verdict is the first line, and "agrees" in the JSON object.

    Example: photosite validate shot.dng simulated.dng --tolerance 1

    Example: photosite validate edge.dng simulated.dng --chart slanted-edge --image-quality

    Example: photosite validate --image-quality --measured lab.photographs.yaml --camera camera7.camera.yaml

    \b
    Example: photosite validate --measured shot*.nef
          --sensor mine.sensor.yaml --illuminant lamp.csv
          --corners 412,388 420,3391 2201,3377 2188,405 --f-number 8
          --fit fill_factor --report validation.html
    """
    from photosite.validation.validate import validate

    test = {name: camera.pop(name) for name in ("level", "tolerance_percent")}
    reading = {name: camera.pop(name) for name in options.READING}
    if measured:
        if options.is_given(ctx, "chart"):
            raise click.UsageError("--chart applies to two paths; use --scene with --measured", ctx)
        if image_quality:
            _validate_quality(ctx, [*measured, *paths], reading, test, as_json, camera)
            return
        if camera["camera_file"] is not None:
            raise click.UsageError("--camera requires --image-quality", ctx)
        _validate_measured(ctx, _frames([*measured, *paths], reading), test, as_json, camera)
        return
    if given := [name for name in camera if options.is_given(ctx, name)]:
        raise click.UsageError(f"{OptionSpelling(ctx.command).name(given[0])} applies to --measured only", ctx)
    if len(paths) != 2:
        raise click.UsageError(
            f"expected two paths, MEASURED and SIMULATED, or --measured and --sensor; paths given: {len(paths)}", ctx
        )
    shot, simulated = _frames(paths[:1], reading), _read(paths[1:], reading)[1]
    say_if_compiling()
    if image_quality:
        _compare_quality(shot, simulated, chart, test, as_json)
        return
    result = validate(shot, simulated, chart=chart, **test)
    show(as_json, result.to_dict(), lambda: _text(result.agrees, (*result.reasons, *result.notes), result))


def _frames(paths: Sequence[Path], reading: Mapping[str, Any]) -> list[RawFrame]:
    """Return the frames of files and folders; identical frames are an error that names their files."""
    from photosite.validation.validate import check_repeats

    files, frames = _read(paths, reading)
    check_repeats(frames, [str(file) for file in files])
    return frames


def _read(paths: Sequence[Path], reading: Mapping[str, Any]) -> tuple[list[Path], list[RawFrame]]:
    from photosite.frames.io.formats import raw_files, read_raw

    files = [file for path in paths for file in raw_files(path)]
    return files, [read_raw(file, **reading) for file in files]


def _validate_measured(
    ctx: click.Context, frames: Sequence[RawFrame], test: Mapping[str, Any], as_json: bool, camera: Mapping[str, Any]
) -> None:
    """Simulate the measured frames, compare, and print the result; `camera` has the options of `--measured`."""
    for name in ("sensor_name", "illuminant"):
        if camera[name] is None:
            raise click.UsageError(f"--measured requires {OptionSpelling(ctx.command).name(name)}", ctx)
    if (camera["corners"] is None) != camera["detect"]:
        raise click.UsageError("--measured requires either --corners (four times row,col) or --detect", ctx)
    say_if_compiling()
    result = _validated(frames, test, camera)
    if camera["report"] is not None:
        result.report(camera["report"])
        say(f"wrote {camera['report']}")
    before = _defaults_used(ctx)
    content = result.to_dict()
    content["notes"] = [*before, *content["notes"]]
    fitted = () if result.fit_summary is None else (result.fit_summary,)
    corners = "chart's corners: " + " ".join(f"{row:.1f},{col:.1f}" for row, col in result.corners)
    lines = (*fitted, *result.reasons, corners, *result.notes, *before, *result.validation.notes)
    show(as_json, content, lambda: _text(result.agrees, lines, result.validation))


def _validated(frames: Sequence[RawFrame], test: Mapping[str, Any], camera: Mapping[str, Any]) -> FrameValidation:
    from photosite.metrics.charts.color_checker import find_chart
    from photosite.optics.diffraction import DiffractionLimited
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.frame_validation import CaptureConditions, validate_frames
    from photosite.validation.lamp import load_lamp

    conditions = CaptureConditions(
        sensor=load_sensor(camera["sensor_name"]),
        optics=DiffractionLimited(f_number=camera["f_number"], focal_length_mm=camera["focal_length_mm"]),
        lamp=load_lamp(camera["illuminant"]),
        **{name: camera[name] for name in ("exposure_s", "luminance_cd_m2", "distance_m")},
    )
    if camera["black_level_dn"] is not None:
        frames = [replace(frame, black_level_dn=camera["black_level_dn"]) for frame in frames]
    # The comparison reads the frames with the sensor file's CFA.
    seen = replace(frames[0], cfa=conditions.sensor.array.cfa)
    corners = find_chart(seen) if camera["detect"] else camera["corners"]
    return validate_frames(frames, conditions, corners, fit=camera["fit"], seed=camera["seed"], **test)


def _compare_quality(
    shot: Sequence[RawFrame], simulated: Sequence[RawFrame], chart: str, test: Mapping[str, Any], as_json: bool
) -> None:
    from photosite.metrics.measure import measure
    from photosite.validation.quality_comparison import compare_quality

    _show_quality(compare_quality(*(measure(frames, chart) for frames in (shot, simulated)), **test), as_json)


_OF_QUALITY = {"camera_file", "seed", "report"}


def _validate_quality(
    ctx: click.Context,
    files: Sequence[Path],
    reading: Mapping[str, Any],
    test: Mapping[str, Any],
    as_json: bool,
    camera: Mapping[str, Any],
) -> None:
    """Compare the image quality of photographs with that of charts that are simulated with a camera file."""
    from photosite.camera.file import load_camera
    from photosite.studies.quality_validation import load_measured, validate_quality

    if len(files) != 1 or camera["camera_file"] is None:
        raise click.UsageError(
            "--image-quality with --measured requires one list of photographs or JSON of measure, and --camera", ctx
        )
    if given := [name for name in camera if name not in _OF_QUALITY and options.is_given(ctx, name)]:
        spelled = OptionSpelling(ctx.command).name(given[0])
        raise click.UsageError(f"with --image-quality, the camera file states the camera; omit {spelled}", ctx)
    setup = load_camera(camera["camera_file"])
    say_if_compiling()
    measured = load_measured(files[0], reading=reading, on_progress=lambda text: say(f"measuring {text}"))
    found = validate_quality(measured, setup.camera, seed=camera["seed"], on_progress=say, **test)
    if camera["report"] is not None:
        found.report(camera["report"])
        say(f"wrote {camera['report']}")
    _show_quality(found, as_json)


def _show_quality(found: QualityComparison, as_json: bool) -> None:
    counts = ", ".join(f"{name} {count}" for name, count in found.count.items())
    lines = listed(f"values {verdict(found.agrees)} ({counts})", found.notes)
    show(as_json, found.to_dict(), lambda: f"{lines}\n\n{tabular(found)}")


def _defaults_used(ctx: click.Context) -> list[str]:
    """Return a note of the defaults that influence the light level."""
    named = {"f_number": "f/{:g}", "focal_length_mm": "{:g} mm focal length", "distance_m": "{:g} m to the chart"}
    defaults = [text.format(ctx.params[name]) for name, text in named.items() if not options.is_given(ctx, name)]
    return [f"defaults used: {', '.join(defaults)}"] if defaults else []


def _text(agrees: bool, lines: Sequence[str], result: Validation) -> str:
    """Return the verdict, reasons and notes, patch means and color differences."""
    channels = result.measured.channels
    rows = [("patch", *(f"{c} {what}" for c in channels for what in ("measured", "simulated")))]
    for name, measured, simulated in zip(
        result.measured.names, result.measured.mean_dn, result.simulated.mean_dn, strict=True
    ):
        pairs = zip(measured, simulated, strict=True)
        rows.append((name, *(f"{mean:.1f}" for pair in pairs for mean in pair)))
    parts = [
        listed(f"measured and simulated {verdict(agrees)}", lines),
        "Mean above black, DN:\n" + table(rows, "<" + ">" * (2 * len(channels))),
    ]
    if result.color is not None:
        delta = result.color.delta_e_2000
        parts.append(f"delta E 2000 of the patches: mean {delta.mean():.2f}, largest {delta.max():.2f}")
    return "\n\n".join(parts)
