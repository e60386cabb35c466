"""`photosite reproduce`: studies that verify photosite, and the experiments of the 2008 paper."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.farrell2008 import command as farrell2008
from photosite.cli.fill_factor import command as fill_factor
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.studies.coverage.study import Coverage, CoverageStudy

SENSORS, QUICK_SENSORS = 500, 50

CONDITION_NAMES = (
    "bright-mono-12",
    "bright-cfa-12",
    "bright-mono-8",
    "bright-cfa-10",
    "bright-mono-16",
    "dim-mono-12",
    "dim-cfa-14",
    "few-mono-12",
    "few-cfa-12",
    "clipped-mono-12",
)
"""Names in `photosite.studies.coverage.conditions`, copied so that --help stays fast; a test compares the two."""


@click.group("reproduce", cls=Group)
def command() -> None:
    """Run a study of photosite on virtual cameras.

    Example: photosite reproduce coverage --quick
    """


command.add_command(farrell2008)
command.add_command(fill_factor)


@command.command("coverage")
@click.option("--sensors", type=click.IntRange(1), help=f"Virtual sensors per condition.  [default: {SENSORS}]")
@click.option(
    "--condition",
    "conditions",
    multiple=True,
    metavar="NAME",
    help=f"Study this condition only; repeatable. One of {', '.join(CONDITION_NAMES)}.",
)
@click.option("--quick", is_flag=True, help=f"Use {QUICK_SENSORS} sensors, which detect large errors only.")
@click.option("--processes", type=click.IntRange(1), default=2, help="Number of worker processes.")
@options.json_option
def coverage(sensors: int | None, conditions: tuple[str, ...], quick: bool, processes: int, as_json: bool) -> None:
    """Count how often 95 % intervals contain the truth.

    Virtual sensors are drawn, shot and calibrated under several conditions: bright and dim light, few frames, clipped
    dark frames, monochrome and Bayer, 8 to 16 bits. For every parameter the table lists the share of intervals that
    contain the truth (covered), the mean error over the mean standard uncertainty (bias), and the root mean square of
    error over uncertainty (width; 1 is correct). With 500 sensors the standard error of a coverage of 95 % is 1 %; that
    takes ten minutes on two cores.

    A parameter is flagged where a deviation is significant: a coverage, or a mean error beyond a tenth of the
    uncertainty, that correct intervals show in fewer than one study in 1000. Failed calibrations are counted, and are
    not in the table.

    Example: photosite reproduce coverage --quick --condition few-mono-12
    """
    from photosite.studies.coverage.conditions import condition
    from photosite.studies.coverage.study import coverage_study

    if quick and sensors is not None:
        raise click.UsageError("give one of --quick and --sensors")
    for name in conditions:
        condition(name)
    stages = Stages()
    say_if_compiling()
    count = sensors or (QUICK_SENSORS if quick else SENSORS)
    stages.stage(f"measuring {count} virtual sensors per condition")
    study = coverage_study(
        conditions, sensors=count, processes=processes, progress=lambda done, total: stages(done, total, "sensors")
    )
    if as_json:
        print_json(study.to_dict())
        return
    _show(study)


def _show(study: CoverageStudy) -> None:
    from photosite.studies.coverage.conditions import CONDITIONS
    from photosite.studies.coverage.study import FALSE_ALARM

    for name in dict.fromkeys([*(row.condition for row in study.rows), *study.refused]):
        click.echo(f"\n{name}: {CONDITIONS[name].summary}")
        refusals = study.refused.get(name, ())
        if refusals:
            count = sum(entry.sensors for entry in refusals)
            click.echo(f"{count} of {study.sensors} calibrations failed with an error and are not in the table:")
            for entry in refusals:
                click.echo(f"  {entry.sensors}, for example: {entry.example}")
        rows = [row for row in study.rows if row.condition == name]
        if rows:
            heading = ("parameter", "sensors", "covered", "bias", "width", "")
            click.echo(table([heading, *(_line(row) for row in rows)], "<>>>><"))
    flagged = sum(not row.passes for row in study.rows)
    click.echo(
        f"\n{flagged} of {len(study.rows)} lines are flagged. Each test flags correct intervals in fewer than 1 of "
        f"{1 / FALSE_ALARM:.0f} studies of {study.sensors} sensors."
    )


def _line(row: Coverage) -> tuple[str, ...]:
    remarks = list(row.remarks)
    if row.exact and not row.wrong:
        remarks.append(f"{row.exact} exact")
    if row.exact == row.estimated:
        return row.parameter, str(row.estimated), "", "", "", "; ".join(remarks)
    numbers = (f"{100 * row.covered:.1f} %", f"{row.bias:+.2f}", f"{row.width:.2f}")
    return row.parameter, str(row.estimated), *numbers, "; ".join(remarks)
