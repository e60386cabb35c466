"""`photosite reproduce gallery`: pictures of what scenes, lenses and sensors do."""

from __future__ import annotations

from pathlib import Path

import click

from photosite.cli import options
from photosite.cli.output import Stages, print_json, say_if_compiling


@click.command("gallery")
@click.option(
    "-o",
    "--output",
    type=options.output_folder,
    metavar="FOLDER",
    default="gallery",
    help="Folder for the page and its pictures.",
)
@click.option("--only", "keys", multiple=True, metavar="PICTURE", help="Only this picture; may be given several times.")
@options.json_option
def command(output: Path, keys: tuple[str, ...], as_json: bool) -> None:
    """Pictures of what scenes, lenses and sensors do, and a page that shows them.

    The renders need the extra 'render'. A minute or two on two cores.

    Example: photosite reproduce gallery -o gallery
    """
    from photosite.atomic import atomic_folder
    from photosite.studies.gallery.page import PAGE_NAME, chosen, write_page, write_picture

    entries = chosen(keys or None)
    stages = Stages()
    say_if_compiling()
    with atomic_folder(output) as place:
        for entry in entries:
            stages.stage(entry.title)
            write_picture(entry, place)
        write_page(entries, place)
    if as_json:
        print_json({"page": str(output / PAGE_NAME), "pictures": [f"{output / entry.key}.png" for entry in entries]})
        return
    click.echo(f"page: {output / PAGE_NAME}\npictures: {len(entries)}")
