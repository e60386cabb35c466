"""`photosite reproduce fill-factor`: how well the fit of the fill factor recovers the true value."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.studies.farrell2008.fill_factor import Recovery


@click.command("fill-factor", cls=Command)
@click.option("--seeds", type=click.IntRange(1), default=100, help="Virtual cameras of each kind, with seeds 0, 1, ...")
@options.json_option
def command(seeds: int, as_json: bool) -> None:
    """Test the fit of the fill factor on virtual cameras.

    Each seed gives another virtual D200 and another vendor camera: another fill factor near the paper's, other fixed
    pattern and noise, a lamp in another direction. `found` is the share of fits within two standard errors of the
    truth,
    `pull` the error in standard errors. 100 seeds take two minutes.

    Example: photosite reproduce fill-factor --seeds 10
    """
    from photosite.studies.farrell2008.fill_factor import recovery_study

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
    figures = recovery.to_dict()
    return (
        recovery.case.title,
        str(figures["seeds"]),
        f"{100 * figures['found']:.0f} %",
        f"{100 * figures['in_interval_95']:.0f} %",
        f"{100 * figures['mean_relative_standard_error']:.2f} %",
        f"{figures['mean_pull']:+.2f}",
        f"{figures['rms_pull']:.2f}",
        f"{figures['largest_pull']:.2f}",
    )
