"""`photosite validate`: measured raw frames against simulated frames or against a simulation from a sensor file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import print_json, say_if_compiling
from photosite.cli.validate_frames import only_with_measured, show, validate_measured

if TYPE_CHECKING:
    from photosite.frames.raw_frame import RawFrame


@click.command("validate", cls=Command)
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path), metavar="MEASURED SIMULATED | FILES")
@click.option("--chart", default="macbeth", help="Chart that fills the frames; only with two paths.")
@click.option("--level", type=options.above(), default=0.05, help="False-alarm rate of the verdict.")
@click.option(
    "--tolerance",
    "tolerance_percent",
    type=options.above(or_equal=True),
    default=0.0,
    metavar="PERCENT",
    help="Relative tolerance of means and noise, in percent; with 0, every difference beyond the noise counts.",
)
@click.option("--bits", type=click.IntRange(1, 16), help="Bit depth, for files without it.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files without it.")
@only_with_measured
@options.json_option
@click.pass_context
def command(
    ctx: click.Context,
    /,
    paths: tuple[Path, ...],
    chart: str,
    level: float,
    tolerance_percent: float,
    bits: int | None,
    cfa: str | None,
    as_json: bool,
    measured: tuple[Path, ...],
    **camera: object,
) -> None:
    """Compare raw frames of a chart with simulated frames: patch means, noise, colours, and a verdict.

    Two paths, MEASURED and SIMULATED, are raw files or folders of raw files of one scene and setting. The chart fills
    the frame.

    --measured compares raw frames of a real camera (further FILES of the same scene and setting may follow) with frames
    simulated from a sensor file, lamp, lens and exposure time. The chart is at --corners, or found by --detect.

    The exit status is 0 for either verdict. The verdict is the first line, and "agrees" in the JSON object.

    Example: photosite validate shot.dng simulated.dng --tolerance 1

    \b
    Example: photosite validate --measured shot*.nef
          --sensor mine.sensor.yaml --illuminant lamp.csv
          --corners 412,388 420,3391 2201,3377 2188,405 --f-number 8
          --fit fill_factor --report validation.html
    """
    given = [name for name in (*camera, "measured") if _is_given(ctx, name)]
    if measured:
        if _is_given(ctx, "chart"):
            raise click.UsageError("--chart applies to two paths; use --scene with --measured", ctx)
        frames = _measured((*measured, *paths), bits, cfa)
        validate_measured(ctx, frames, level, tolerance_percent, as_json, camera)
        return
    if given:
        option = "--" + {"scene_name": "scene", "sensor_name": "sensor"}.get(given[0], given[0]).replace("_", "-")
        raise click.UsageError(f"{option} applies to --measured only", ctx)
    if len(paths) != 2:
        raise click.UsageError(
            f"expected two paths, MEASURED and SIMULATED, or --measured and --sensor; paths given: {len(paths)}",
            ctx,
        )
    _compare_two(paths[0], paths[1], chart, level, tolerance_percent, bits, cfa, as_json)


def _is_given(ctx: click.Context, name: str) -> bool:
    return ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def _compare_two(
    measured: Path,
    simulated: Path,
    chart: str,
    level: float,
    tolerance_percent: float,
    bits: int | None,
    cfa: str | None,
    as_json: bool,
) -> None:
    from photosite.validation.validate import validate

    measured_raw, simulated_raw = _measured([measured], bits, cfa), _read(_files(simulated), bits, cfa)
    say_if_compiling()
    result = validate(
        measured_raw,
        simulated_raw,
        chart=chart,
        level=level,
        tolerance_percent=tolerance_percent,
    )
    if as_json:
        print_json(result.to_dict())
    else:
        click.echo("measured and simulated " + ("agree" if result.agrees else "differ"))
        show((*result.reasons, *result.notes), result)


def _measured(paths: Sequence[Path], bits: int | None, cfa: str | None) -> list[RawFrame]:
    """Return the frames of files and folders; identical frames are an error that names their files."""
    from photosite.validation.repeats import check_repeats

    files = [file for path in paths for file in _files(path)]
    frames = _read(files, bits, cfa)
    check_repeats(frames, [str(file) for file in files])
    return frames


def _read(files: Sequence[Path], bits: int | None, cfa: str | None) -> list[RawFrame]:
    from photosite.frames.io.read import read_raw

    return [read_raw(file, bits=bits, cfa=cfa) for file in files]


def _files(path: Path) -> list[Path]:
    from photosite.errors import FileError
    from photosite.frames.io.read import SUFFIXES

    if not path.is_dir():
        return [path]
    files = sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
    if not files:
        raise FileError(path, "has no raw frames (DNG, camera raw, TIFF, PNG)")
    return files
