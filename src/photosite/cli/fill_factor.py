"""`photosite reproduce fill-factor`: does the fit of the fill factor find the hidden one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.studies.farrell2008.recovery import Recovery


@click.command("fill-factor", cls=Command)
@click.option("--seeds", type=click.IntRange(1), default=100, help="Cameras of each kind; seeds 0, 1, ...")
@options.json_option
def command(seeds: int, as_json: bool) -> None:
    """How often the 2008 paper's fit of the fill factor finds the hidden one.

    Each seed is another virtual D200 and another of the vendor's cameras: another fill factor near the paper's, another
    chip, another noise, a lamp on another side. Found is the share within two standard errors, and pull the error in
    standard errors. 100 seeds take two minutes.

    Example: photosite reproduce fill-factor --seeds 10
    """
    from photosite.studies.farrell2008.recovery import recovery_study

    stages = Stages()
    say_if_compiling()
    stages.stage(f"fitting the fill factor of {seeds} cameras of each kind")
    found = recovery_study(range(seeds), progress=lambda done, total: stages(done, total, "fits"))
    if as_json:
        print_json({recovery.case.key: recovery.to_dict() for recovery in found})
        return
    heading = ("camera", "seeds", "found", "in 95 % interval", "standard error", "mean pull", "rms pull", "largest")
    click.echo(table([heading, *(_line(recovery) for recovery in found)], "<>>>>>>>"))


def _line(recovery: Recovery) -> tuple[str, ...]:
    known = recovery.to_dict()
    return (
        recovery.case.title,
        str(known["seeds"]),
        f"{100 * known['found']:.0f} %",
        f"{100 * known['in_interval_95']:.0f} %",
        f"{100 * known['mean_relative_standard_error']:.2f} %",
        f"{known['mean_pull']:+.2f}",
        f"{known['rms_pull']:.2f}",
        f"{known['largest_pull']:.2f}",
    )
