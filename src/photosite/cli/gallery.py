"""`photosite reproduce gallery`: pictures of what scenes, lenses and sensors do."""

from __future__ import annotations

from pathlib import Path

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say_if_compiling


@click.command("gallery", cls=Command)
@click.option(
    "-o",
    "--output",
    type=options.output_folder,
    metavar="FOLDER",
    default="gallery",
    help="Folder for the page and its pictures; it must not exist, or be empty.",
)
@click.option("--only", "keys", multiple=True, metavar="PICTURE", help="Only this picture; may be given several times.")
@options.json_option
def command(output: Path, keys: tuple[str, ...], as_json: bool) -> None:
    """Pictures of what scenes, lenses and sensors do, and a page that shows them.

    A picture whose extra is missing is left out, and the command says so. About two minutes on two cores.

    Example: photosite reproduce gallery -o gallery
    """
    from photosite.errors import InputError
    from photosite.files.atomic import atomic_folder
    from photosite.studies.gallery.page import PAGE_NAME, Entry, chosen, write_page, write_picture

    entries = chosen(keys or None)
    stages = Stages()
    say_if_compiling()
    drawn: list[Entry] = []
    left_out: list[tuple[Entry, str]] = []
    with atomic_folder(output) as place:
        for entry in entries:
            stages.stage(entry.title)
            try:
                write_picture(entry, place)
            except InputError as error:
                if entry.extra is None:
                    raise
                left_out.append((entry, str(error)))
                continue
            drawn.append(entry)
        write_page(drawn, place, left_out)
    for entry, reason in left_out:
        click.echo(f"left out: {entry.title}: {reason}", err=True)
    if as_json:
        print_json(
            {
                "page": str(output / PAGE_NAME),
                "pictures": [str(output / entry.file_name) for entry in drawn],
                "left_out": {entry.key: reason for entry, reason in left_out},
            }
        )
        return
    click.echo(f"page: {output / PAGE_NAME}\npictures: {len(drawn)}")
