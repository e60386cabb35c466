"""`photosite reproduce farrell2008`: the experiments of the 2008 paper."""

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
@click.option("--only", "chapters", multiple=True, metavar="CHAPTER", help="Run this chapter only; repeatable.")
@options.json_option
def command(seed: int, output: Path, chapters: tuple[str, ...], as_json: bool) -> None:
    """Reproduce the experiments of the 2008 paper.

    Farrell, Okincha and Parmar, "Sensor calibration and simulation": every table and figure beside the values of the
    paper, with the differences in words. The paper's frames were never published, so virtual cameras replace the real
    ones; the simulation does not know their hidden parameters. A few minutes on two cores.

    Example: photosite reproduce farrell2008 -o farrell2008
    """
    from photosite.files.atomic import atomic_folder
    from photosite.studies.farrell2008.page.page import FIGURES_NAME, PAGE_NAME, RESULTS_NAME, write_study
    from photosite.studies.farrell2008.study import reproduce

    stages = Stages()
    say_if_compiling()
    with atomic_folder(output) as place:
        study = reproduce(seed, chapters or None, stages)
        stages.stage("drawing the figures and writing the page")
        write_study(study, place)
    if as_json:
        print_json(study.to_dict())
        return
    seconds = sum(study.seconds.values())
    click.echo(f"page: {output / PAGE_NAME}\nnumbers: {output / RESULTS_NAME}\nfigures: {output / FIGURES_NAME}")
    click.echo(f"{seconds:.0f} s")
