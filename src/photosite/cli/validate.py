"""`photosite validate`: measured against simulated raw frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.output import print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.frames.raw_frame import RawFrame
    from photosite.validation.result import Validation


@click.command("validate")
@click.argument("measured", type=click.Path(path_type=Path))
@click.argument("simulated", type=click.Path(path_type=Path))
@click.option("--chart", default="macbeth", help="Chart that fills the frames.")
@click.option("--level", type=options.above(), default=0.05, help="Share of false alarms allowed to the verdict.")
@click.option(
    "--tolerance",
    type=options.above(or_equal=True),
    default=0.0,
    metavar="PERCENT",
    help="Difference of means and noise let pass; with 0 any that the noise resolves counts.",
)
@click.option("--bits", type=click.IntRange(1, 16), help="Bits of the converter, for files that do not say.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files that do not say.")
@options.json_option
def command(
    measured: Path,
    simulated: Path,
    chart: str,
    level: float,
    tolerance: float,
    bits: int | None,
    cfa: str | None,
    as_json: bool,
) -> None:
    """Compare measured with simulated raw frames of a chart: patch means, noise and colours, and a verdict.

    Each of the two is a raw file, or a folder of raw files of one scene and setting. Exit status 0 whatever the
    verdict; the verdict is the first line, and "agrees" in the JSON object.

    Example: photosite validate shot.dng simulated.dng --tolerance 1
    """
    from photosite.validation.validate import validate

    measured_raw, simulated_raw = (_frames(path, bits, cfa) for path in (measured, simulated))
    say_if_compiling()
    result = validate(
        measured_raw,
        simulated_raw,
        chart=chart,
        level=level,
        tolerance_percent=tolerance,
    )
    if as_json:
        print_json(result.to_dict())
    else:
        _show(result)


def _frames(path: Path, bits: int | None, cfa: str | None) -> list[RawFrame]:
    from photosite.errors import FileError
    from photosite.frames.read import SUFFIXES, read_raw

    if not path.is_dir():
        return [read_raw(path, bits=bits, cfa=cfa)]
    files = sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
    if not files:
        raise FileError(path, "holds no raw frames (DNG, camera raw, TIFF, PNG)")
    return [read_raw(file, bits=bits, cfa=cfa) for file in files]


def _show(result: Validation) -> None:
    click.echo("measured and simulated " + ("agree" if result.agrees else "differ"))
    for line in (*result.reasons, *result.notes):
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
