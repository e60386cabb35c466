"""`photosite validate --measured`: raw frames of a real camera against its simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photosite.cli import options
from photosite.cli.output import print_json, say, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.frames.raw_frame import RawFrame
    from photosite.validation.frame_validation import FrameValidation
    from photosite.validation.result import Validation

F = TypeVar("F", bound=Callable[..., Any])


def _corner(text: str) -> tuple[float, float]:
    """Return a corner from the text row,col."""
    try:
        row, col = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"must be row,col in pixels, such as 412,388, got '{text}'") from None
    return row, col


def only_with_measured(function: F) -> F:
    """Add the options of a camera and its scene, which apply with --measured only."""
    for option in (
        options.seed_option(),
        click.option(
            "--report",
            type=options.output_file(".html", ".pdf"),
            metavar="FILE",
            help="Report to write, .html or .pdf.",
        ),
        click.option(
            "--fit",
            type=click.Choice(["fill_factor", "light"]),
            help="Parameter to fit to the patch means: the fill factor or the light level.",
        ),
        click.option("--detect", is_flag=True, help="Find the chart; the report shows its outlines."),
        click.option(
            "--corners",
            nargs=4,
            type=_corner,
            metavar="R,C R,C R,C R,C",
            help="Outer corners of the dark skin, bluish green, black and white patches, row,col in pixels.",
        ),
        options.black_level_option("Black level of the frames in DN, for files without it."),
        click.option(
            "--exposure",
            "exposure_s",
            type=options.exposure_time,
            metavar="SECONDS",
            help="Exposure time in s, such as 0.01 or 1/3; overrides that of the files.",
        ),
        options.lens_options,
        click.option(
            "--distance",
            "distance_m",
            type=options.above(),
            default=1.2,
            metavar="M",
            help="Distance from lens to chart, in m.",
        ),
        click.option(
            "--luminance",
            "luminance_cd_m2",
            type=options.above(),
            metavar="CD/M2",
            help="Mean luminance of the patches, in cd/m2; overrides that of a lamp file.",
        ),
        click.option(
            "--illuminant",
            metavar="FILE|NAME",
            help="Lamp: CSV file of a spectroradiometer, CIE illuminant (A, D65, ...) or blackbody (3200K).",
        ),
        click.option(
            "--scene", "scene_name", type=click.Choice(["macbeth"]), default="macbeth", help="Chart in the frames."
        ),
        options.sensor_option(default=None),
        click.option(
            "--measured",
            multiple=True,
            type=click.Path(path_type=Path),
            metavar="FILES",
            help="Raw frames or folders of raw frames; several are one stack.",
        ),
    ):
        function = option(function)
    return function


def validate_measured(
    ctx: click.Context,
    frames: Sequence[RawFrame],
    level: float,
    tolerance_percent: float,
    as_json: bool,
    camera: Mapping[str, Any],
) -> None:
    """Simulate the measured frames, compare, and print the result.

    Parameters
    ----------
    ctx
        Context of the command.
    frames
        The measured frames.
    level, tolerance_percent, as_json
        Options of the command.
    camera
        Options of `only_with_measured` by name.

    Raises
    ------
    click.UsageError
        If a required option is missing, or two options contradict each other.
    PhotositeError
        If a file cannot be read, or frames and options do not match.
    """
    for name, option in (("sensor_name", "--sensor"), ("illuminant", "--illuminant")):
        if camera[name] is None:
            raise click.UsageError(f"--measured requires {option}", ctx)
    if (camera["corners"] is None) != camera["detect"]:
        raise click.UsageError("--measured requires either --corners (four times row,col) or --detect", ctx)
    say_if_compiling()
    result = _validated(frames, level, tolerance_percent, camera)
    if camera["report"] is not None:
        from photosite.report.validation import write_validation_report

        write_validation_report(result, camera["report"])
        say(f"wrote {camera['report']}")
    notes_before = _defaults_used(ctx)
    if as_json:
        found = result.to_dict()
        print_json(found | {"notes": [*notes_before, *found["notes"]]})
        return
    _show(result, notes_before)


def _validated(
    frames: Sequence[RawFrame], level: float, tolerance_percent: float, camera: Mapping[str, Any]
) -> FrameValidation:
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.find_chart import find_chart
    from photosite.validation.frame_validation import CaptureConditions, validate_frames
    from photosite.validation.lamp import load_lamp

    conditions = CaptureConditions(
        sensor=load_sensor(camera["sensor_name"]),
        optics=options.lens(camera["f_number"], camera["focal_length_mm"]),
        lamp=load_lamp(camera["illuminant"]),
        exposure_s=camera["exposure_s"],
        luminance_cd_m2=camera["luminance_cd_m2"],
        distance_m=camera["distance_m"],
    )
    if camera["black_level_dn"] is not None:
        frames = [replace(frame, black_level_dn=camera["black_level_dn"]) for frame in frames]
    # The comparison reads the frames with the sensor file's CFA.
    seen = replace(frames[0], cfa=conditions.sensor.array.cfa)
    corners = find_chart(seen) if camera["detect"] else camera["corners"]
    return validate_frames(
        frames,
        conditions,
        corners,
        fit=camera["fit"],
        level=level,
        tolerance_percent=tolerance_percent,
        seed=camera["seed"],
    )


def _defaults_used(ctx: click.Context) -> list[str]:
    """Return a note of the defaults that influence the light level."""
    named = {"f_number": "f/{:g}", "focal_length_mm": "{:g} mm focal length", "distance_m": "{:g} m to the chart"}
    defaults = [
        text.format(ctx.params[name])
        for name, text in named.items()
        if ctx.get_parameter_source(name) is click.core.ParameterSource.DEFAULT
    ]
    return [f"defaults used: {', '.join(defaults)}"] if defaults else []


def _show(result: FrameValidation, notes_before: Sequence[str]) -> None:
    click.echo("measured and simulated " + ("agree" if result.agrees else "differ"))
    fitted = () if result.fit_summary is None else (result.fit_summary,)
    corners = "chart's corners: " + " ".join(f"{row:.1f},{col:.1f}" for row, col in result.corners)
    notes = (*result.notes, *notes_before, *result.validation.notes)
    show((*fitted, *result.reasons, corners, *notes), result.validation)


def show(lines: Sequence[str], result: Validation) -> None:
    """Print reasons and notes, patch means and colour differences."""
    for line in lines:
        click.echo(f"  {line}")
    channels = result.measured.channels
    heading = ("patch", *(f"{c} {what}" for c in channels for what in ("measured", "simulated")))
    means = [
        (
            name,
            *(
                f"{mean[patch, k]:.1f}"
                for k in range(len(channels))
                for mean in (result.measured.mean_dn, result.simulated.mean_dn)
            ),
        )
        for patch, name in enumerate(result.measured.names)
    ]
    click.echo("\nMean above black, DN:")
    click.echo(table([heading, *means], "<" + ">" * (2 * len(channels))))
    if result.color is not None:
        delta = result.color.delta_e_2000
        click.echo(f"\ndelta E 2000 of the patches: mean {delta.mean():.2f}, largest {delta.max():.2f}")
