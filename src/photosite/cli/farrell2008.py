"""`photosite reproduce farrell2008`: the 2008 paper, from its calibration to its applications."""

from __future__ import annotations

from pathlib import Path

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say_if_compiling


@click.command("farrell2008", cls=Command)
@options.seed_option(2008)
@click.option(
    "-o",
    "--output",
    type=options.output_folder,
    metavar="FOLDER",
    default="farrell2008",
    help="Folder for the page, results.json and the figures.",
)
@click.option("--only", "keys", multiple=True, metavar="CHAPTER", help="Only this chapter; may be given several times.")
@options.json_option
def command(seed: int, output: Path, keys: tuple[str, ...], as_json: bool) -> None:
    """The 2008 paper, from its calibration to its applications.

    Farrell, Okincha and Parmar, "Sensor calibration and simulation": every table and figure beside what the paper
    reports, and the differences in words. The paper's frames were never published; virtual cameras stand in for the
    real ones, and the simulation is not told what they are. A few minutes on two cores.

    Example: photosite reproduce farrell2008 -o farrell2008
    """
    from photosite.files.atomic import atomic_folder
    from photosite.studies.farrell2008.page.write import FIGURES_NAME, PAGE_NAME, RESULTS_NAME, write_study
    from photosite.studies.farrell2008.study import reproduce

    stages = Stages()
    say_if_compiling()
    with atomic_folder(output) as place:
        study = reproduce(seed, keys or None, stages)
        stages.stage("drawing the figures and writing the page")
        write_study(study, place)
    if as_json:
        print_json(study.to_dict())
        return
    seconds = sum(study.seconds.values())
    click.echo(f"page: {output / PAGE_NAME}\nnumbers: {output / RESULTS_NAME}\nfigures: {output / FIGURES_NAME}")
    click.echo(f"{seconds:.0f} s")
