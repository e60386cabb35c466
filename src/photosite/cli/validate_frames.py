"""`photosite validate --measured`: raw frames of a real camera against a simulation of it."""

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
    from photosite.validation.frames_result import FrameValidation
    from photosite.validation.result import Validation

F = TypeVar("F", bound=Callable[..., Any])


def _corner(text: str) -> tuple[float, float]:
    """A corner, row,col."""
    try:
        row, col = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"expected row,col in pixels, as in 412,388, not '{text}'") from None
    return row, col


def only_with_measured(function: F) -> F:
    """The options of a camera and its scene, which two paths have no use for."""
    for option in (
        options.seed_option(),
        click.option(
            "--report",
            type=options.output_file(".html", ".pdf"),
            metavar="FILE",
            help="Report to write: one self-contained HTML page, or a PDF, by the file's ending.",
        ),
        click.option(
            "--fit",
            type=click.Choice(["fill_factor", "light"]),
            help="What the patch means determine: the fill factor, or the level of the light. Either takes up whatever "
            "scales all patches alike.",
        ),
        click.option(
            "--detect", is_flag=True, help="Look for the chart; the outlines in the report show what was found."
        ),
        click.option(
            "--corners",
            nargs=4,
            type=_corner,
            metavar="R,C R,C R,C R,C",
            help="Outer corners of the dark skin, bluish green, black and white patch, in pixels (row,col).",
        ),
        options.black_level_option("Black level of the frames in DN, for files that do not say."),
        click.option(
            "--exposure",
            "exposure_s",
            type=options.exposure_time,
            metavar="SECONDS",
            help="Exposure time in s, instead of the files'; 1/3 is read as such.",
        ),
        options.lens_options,
        click.option(
            "--distance", "distance_m", type=options.above(), default=1.2, metavar="M", help="From lens to chart, in m."
        ),
        click.option(
            "--luminance",
            "luminance_cd_m2",
            type=options.above(),
            metavar="CD/M2",
            help="Mean luminance of the patches; a lamp's file with absolute values says it, too.",
        ),
        click.option(
            "--illuminant",
            metavar="FILE|NAME",
            help="Lamp: CSV of a spectroradiometer (the heading says the unit), CIE illuminant, or blackbody (3200K).",
        ),
        click.option("--scene", "scene_name", type=click.Choice(["macbeth"]), default="macbeth", help="The chart."),
        options.sensor_option(default=None),
        click.option(
            "--measured",
            multiple=True,
            type=click.Path(path_type=Path),
            metavar="FILES",
            help="Raw frames, or folders of them; several are one stack: averaged, and repeats that tell noise.",
        ),
    ):
        function = option(function)
    return function


def validate_measured(
    ctx: click.Context,
    frames: Sequence[RawFrame],
    level: float,
    tolerance: float,
    as_json: bool,
    camera: Mapping[str, Any],
) -> None:
    """Simulate what was measured, compare, and say what came out.

    Parameters
    ----------
    ctx
        The command's.
    frames
        The measured frames.
    level, tolerance, as_json
        Of the command.
    camera
        The options of `only_with_measured` by name.

    Raises
    ------
    click.UsageError
        If an option that is needed is missing, or two contradict each other.
    PhotositeError
        If a file cannot be read, or frames and options do not go together.
    """
    for name, option in (("sensor_name", "--sensor"), ("illuminant", "--illuminant")):
        if camera[name] is None:
            raise click.UsageError(f"--measured needs {option} as well", ctx)
    if (camera["corners"] is None) != camera["detect"]:
        raise click.UsageError("where is the chart? give --corners (four of row,col) or --detect, one of the two", ctx)
    say_if_compiling()
    result = _validated(frames, level, tolerance, camera)
    if camera["report"] is not None:
        from photosite.report.validation import write_validation_report

        write_validation_report(result, camera["report"])
        say(f"wrote {camera['report']}")
    taken = _taken_as_usual(ctx)
    if as_json:
        found = result.to_dict()
        print_json(found | {"notes": [*taken, *found["notes"]]})
        return
    _show(result, taken)


def _validated(
    frames: Sequence[RawFrame], level: float, tolerance: float, camera: Mapping[str, Any]
) -> FrameValidation:
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.validation.find_chart import find_chart
    from photosite.validation.frames_result import Told
    from photosite.validation.lamp import lamp_from
    from photosite.validation.real_frames import validate_frames

    told = Told(
        sensor=load_sensor(camera["sensor_name"]),
        optics=options.lens(camera["f_number"], camera["focal_length_mm"]),
        lamp=lamp_from(camera["illuminant"]),
        exposure_s=camera["exposure_s"],
        luminance_cd_m2=camera["luminance_cd_m2"],
        distance_m=camera["distance_m"],
    )
    if camera["black_level_dn"] is not None:
        frames = [replace(frame, black_level_dn=camera["black_level_dn"]) for frame in frames]
    # By the sensor file's filters: a file may not say, and the comparison reads the frames by them.
    seen = replace(frames[0], cfa=told.sensor.array.cfa)
    corners = find_chart(seen) if camera["detect"] else camera["corners"]
    return validate_frames(
        frames,
        told,
        corners,
        fit=camera["fit"],
        level=level,
        tolerance_percent=tolerance,
        seed=camera["seed"],
    )


def _taken_as_usual(ctx: click.Context) -> list[str]:
    """What was not said of the camera's place and lens, and bears on the level."""
    named = {"f_number": "f/{:g}", "focal_length_mm": "{:g} mm focal length", "distance_m": "{:g} m to the chart"}
    usual = [
        text.format(ctx.params[name])
        for name, text in named.items()
        if ctx.get_parameter_source(name) is click.core.ParameterSource.DEFAULT
    ]
    return [f"not given, and taken as usual: {', '.join(usual)}"] if usual else []


def _show(result: FrameValidation, taken: Sequence[str]) -> None:
    click.echo("measured and simulated " + ("agree" if result.agrees else "differ"))
    fitted = () if result.fit_in_words is None else (result.fit_in_words,)
    corners = "chart's corners: " + " ".join(f"{row:.1f},{col:.1f}" for row, col in result.corners)
    notes = (*result.notes, *taken, *result.validation.notes)
    show((*fitted, *result.reasons, corners, *notes), result.validation)


def show(lines: Sequence[str], result: Validation) -> None:
    """Print what stands under the verdict: reasons and notes, patch means, colour differences."""
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
