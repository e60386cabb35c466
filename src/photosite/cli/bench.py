"""photosite bench."""

from __future__ import annotations

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import print_json, table


@click.command("bench", cls=Command)
@click.option("--quick", is_flag=True, help="Fewer repeats, smaller stacks, no scaling table; about a minute.")
@click.option("--case", "names", multiple=True, metavar="NAME", help="Only this case; may be given several times.")
@options.json_option
def command(quick: bool, names: tuple[str, ...], as_json: bool) -> None:
    """Time photosite on this machine, beside the plain way to do the same work.

    Each case runs in turn with its baseline in one process: transforms per wavelength in SciPy, NumPy's draws,
    NumPy's mean and variance, plain reads of the files. The memory is that of a fresh process without the baseline.

    Example: photosite bench --quick
    """
    from photosite.studies.bench.cases import run_cases
    from photosite.studies.bench.memory import memory
    from photosite.studies.bench.scaling import scaling

    cases = run_cases(names, quick, lambda name: click.echo(f"measuring {name} ...", err=True))
    whole = not (quick or names)
    if whole:
        click.echo("measuring how time and memory grow ...", err=True)
    laws, room = (scaling(), memory()) if whole else ((), None)
    if as_json:
        print_json(
            {
                "cases": {name: case.to_dict() for name, case in cases.items()},
                "scaling": {law.what: law.to_dict() for law in laws},
                "memory": room.to_dict() if room else {},
            }
        )
        return
    rows: list[tuple[str, ...]] = [("case", "seconds", "baseline", "ratio", "peak MB", "megapixels")]
    for name, case in cases.items():
        figures = (case.seconds, case.baseline_seconds, case.ratio, case.peak_mb, case.megapixels)
        rows.append((name, *(f"{figure:.{digits}f}" for figure, digits in zip(figures, (3, 3, 1, 0, 1), strict=True))))
    click.echo(table(rows, "<>>>>>"))
    for law in laws:
        points = ", ".join(f"{size:g}: {seconds:.3f} s" for size, seconds in zip(law.sizes, law.seconds, strict=True))
        click.echo(f"\n{law.what} ({law.unit})\n  {points}; exponent {law.exponent:.2f}")
    if room:
        points = ", ".join(
            f"{size:.0f}: {each:.1f}" for size, each in zip(room.megapixels, room.bytes_per_pixel, strict=True)
        )
        click.echo(f"\npeak memory of a stream of captures, bytes a pixel (by megapixels)\n  {points}")
