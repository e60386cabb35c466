"""`photosite reproduce`: studies that check what photosite promises."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.farrell2008 import command as farrell2008
from photosite.cli.fill_factor import command as fill_factor
from photosite.cli.gallery import command as gallery
from photosite.cli.output import Stages, print_json, say_if_compiling, table

if TYPE_CHECKING:
    from photosite.studies.coverage import Coverage, CoverageStudy

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
"""Those of `photosite.studies.virtual_sensors`, which --help does not wait for; a test holds the two together."""


@click.group("reproduce", cls=Group)
def command() -> None:
    """Run a study anew.

    Example: photosite reproduce coverage --quick
    """


command.add_command(farrell2008)
command.add_command(fill_factor)
command.add_command(gallery)


@command.command("coverage")
@click.option("--sensors", type=click.IntRange(1), help=f"Virtual sensors under each condition.  [default: {SENSORS}]")
@click.option(
    "--condition",
    "names",
    multiple=True,
    metavar="NAME",
    help=f"Only this one; may be given several times. One of {', '.join(CONDITION_NAMES)}.",
)
@click.option("--quick", is_flag=True, help=f"{QUICK_SENSORS} sensors instead: a look, not a test. Not with --sensors.")
@click.option("--processes", type=click.IntRange(1), default=2, help="Processes that share the work.")
@options.json_option
def coverage(sensors: int | None, names: tuple[str, ...], quick: bool, processes: int, as_json: bool) -> None:
    """Whether 95 % intervals hold the truth 95 times in 100.

    Virtual sensors are drawn, shot and calibrated under a grid of conditions: bright and dim light, few frames, darks
    that clip, monochrome and Bayer, 8 to 16 bits. For every parameter the table says how often the interval holds the
    truth (covered), the mean error over the mean standard uncertainty (bias), and the root mean square of errors over
    their uncertainties (width: 1 where they are honest). With 500 sensors a share of 95 % is known to 1 %; that takes
    ten minutes on two cores.

    A parameter is marked where the number of sensors can tell that something is wrong: a share that honest intervals
    have in fewer than one study in 1000, or a mean error beyond a tenth of the uncertainty by more than as rare a
    chance. Sensors whose calibration is refused are counted, and not in the table.

    Example: photosite reproduce coverage --quick --condition few-mono-12
    """
    from photosite.studies.coverage import coverage_study
    from photosite.studies.virtual_sensors import condition

    if quick and sensors is not None:
        raise click.UsageError(f"--quick is --sensors {QUICK_SENSORS}: give one of the two")
    for name in names:
        condition(name)
    stages = Stages()
    say_if_compiling()
    count = sensors or (QUICK_SENSORS if quick else SENSORS)
    stages.stage(f"measuring {count} virtual sensors under each condition")
    study = coverage_study(
        names, sensors=count, processes=processes, progress=lambda done, total: stages(done, total, "sensors")
    )
    if as_json:
        print_json(study.to_dict())
        return
    _show(study)


def _show(study: CoverageStudy) -> None:
    from photosite.studies.coverage import FALSE_ALARM
    from photosite.studies.virtual_sensors import CONDITIONS

    for name in dict.fromkeys([*(row.condition for row in study.rows), *study.refused]):
        click.echo(f"\n{name}: {CONDITIONS[name].summary}")
        refusals = study.refused.get(name, ())
        if refusals:
            count = sum(entry.sensors for entry in refusals)
            click.echo(
                f"{count} of {study.sensors} sensors were refused, not measured wrong, and are not in the table:"
            )
            for entry in refusals:
                click.echo(f"  {entry.sensors}, for one: {entry.example}")
        rows = [row for row in study.rows if row.condition == name]
        if rows:
            heading = ("parameter", "sensors", "covered", "bias", "width", "")
            click.echo(table([heading, *(_line(row) for row in rows)], "<>>>><"))
    marked = sum(not row.holds for row in study.rows)
    click.echo(
        f"\n{marked} of {len(study.rows)} lines are marked; one of honest intervals is in fewer than 1 study of "
        f"{1 / FALSE_ALARM:.0f} for its share, and for its mean error likewise. {study.sensors} sensors tell no more."
    )


def _line(row: Coverage) -> tuple[str, ...]:
    remarks = list(row.remarks)
    if row.exact and not row.wrong:
        remarks.append(f"{row.exact} exact")
    if row.exact == row.estimated:
        return row.parameter, str(row.estimated), "", "", "", "; ".join(remarks)
    numbers = (f"{100 * row.covered:.1f} %", f"{row.bias:+.2f}", f"{row.width:.2f}")
    return row.parameter, str(row.estimated), *numbers, "; ".join(remarks)
