"""`photosite render`: a Mitsuba 3 scene file, or the built-in example, as a spectral scene."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, show


@click.command("render", cls=Command)
@click.argument("source", type=click.Path(path_type=Path), required=False)
@options.scene_file_option
@click.option("--spp", type=options.Whole(1), default=64, help="Paths per pixel and group of four bands.")
@click.option("--rows", type=options.Whole(1), metavar="N", help="Rows of the picture, instead of the scene's.")
@click.option("--cols", type=options.Whole(1), metavar="N", help="Columns of the picture, instead of the scene's.")
@options.wavelengths_option("Centers of the bands in nm, in equal steps.", default="400:700:10")
@click.option(
    "--set",
    "parameters",
    type=options.name_and_text,
    multiple=True,
    metavar="NAME=VALUE",
    help="Value of $NAME in the scene file; may be repeated.",
)
@options.quantity("--unit", "unit_m", unit="M", default=1.0, text="Meters per unit of the scene file.")
@options.distance_option()
@options.luminance_option("Mean luminance of the scene in cd/m2, for lights without an absolute scale.")
@click.option("--variant", default="scalar_spectral", help="Variant of Mitsuba.")
@click.option("--seed", type=options.Whole(0, 2**32 - 1), default=0, help="Seed of the paths.")
@options.json_option
def command(
    source: Path | None, output: Path, parameters: tuple[tuple[str, str], ...], as_json: bool, **options_given: Any
) -> None:
    """Render a Mitsuba 3 scene file (XML) to spectral radiance, and write it as a scene.

    Without a scene file, renders the built-in example. Needs the extra 'render'.

    Example: photosite render kitchen.xml -o kitchen.h5 --spp 256
    """
    from photosite.scene.io.formats import write_scene
    from photosite.scene.render import EXAMPLE, render_mitsuba

    file = EXAMPLE if source is None else source
    progress = Stages()
    progress.stage(f"rendering {file}")
    begun = time.perf_counter()
    scene = render_mitsuba(file, parameters=dict(parameters), progress=progress, **options_given)
    seconds = time.perf_counter() - begun
    write_scene(scene, output)
    bands, components = scene.wavelength_nm.size, len(scene.basis)
    counts = {"path": output, "bands": bands, "components": components, "seconds": seconds}
    width = "" if scene.width_m is None else f", {scene.width_m:.3g} m wide"
    text = (
        f"wrote {output}: {scene.shape[0]} x {scene.shape[1]} samples, {bands} bands as {components} spectra; "
        f"{scene.mean_luminance_cd_m2():.4g} cd/m2 on average, {scene.distance_m:.3g} m away{width}; {seconds:.1f} s"
    )
    show(as_json, options.scene_facts(scene) | counts, lambda: text)
