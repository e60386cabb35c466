"""`photosite render`: a Mitsuba 3 scene file, or the built-in example, as a spectral scene."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json

_SUFFIXES = (".h5", ".exr", ".mat", ".tif", ".tiff", ".hdr")


def _value(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise click.BadParameter(f"must be NAME=VALUE, got '{text}'")
    return name, value


@click.command("render", cls=Command)
@click.argument("source", type=click.Path(path_type=Path), required=False)
@options.output_option(*_SUFFIXES, text="Scene to write: .h5 (photosite's own), .exr, .mat, .tif, .hdr (ENVI).")
@click.option(
    "--spp", type=click.IntRange(min=1), default=64, show_default=True, help="Paths per pixel and group of four bands."
)
@click.option("--rows", type=click.IntRange(min=1), metavar="N", help="Rows of the picture, instead of the scene's.")
@click.option("--cols", type=click.IntRange(min=1), metavar="N", help="Columns of the picture, instead of the scene's.")
@click.option(
    "--wavelengths",
    "wavelength_nm",
    type=options.wavelengths_of,
    metavar="NM",
    default="400:700:10",
    show_default=True,
    help="Centres of the bands in nm, in equal steps.",
)
@click.option(
    "--set",
    "parameters",
    type=_value,
    multiple=True,
    metavar="NAME=VALUE",
    help="Value of $NAME in the scene file; may be repeated.",
)
@click.option(
    "--unit", "unit_m", type=options.above(), default=1.0, metavar="M", help="Metres per unit of the scene file."
)
@click.option("--distance", "distance_m", type=options.above(), metavar="M", help="Distance from lens to scene in m.")
@click.option(
    "--luminance",
    "mean_luminance_cd_m2",
    type=options.above(),
    metavar="CD/M2",
    help="Mean luminance of the scene in cd/m2, for lights without an absolute scale.",
)
@click.option("--variant", default="scalar_spectral", show_default=True, help="Variant of Mitsuba.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, help="Seed of the paths.")
@options.json_option
def command(
    source: Path | None, output: Path, parameters: tuple[tuple[str, str], ...], as_json: bool, **options_given: Any
) -> None:
    """Render a Mitsuba 3 scene file (XML) to spectral radiance, and write it as a scene.

    Without a scene file, renders the built-in example. Needs the extra 'render'.

    Example: photosite render kitchen.xml -o kitchen.h5 --spp 256
    """
    from photosite.scene.io.files import write_scene
    from photosite.scene.render import EXAMPLE, render_mitsuba

    file = EXAMPLE if source is None else source
    progress = Stages()
    progress.stage(f"rendering {file}")
    begun = time.perf_counter()
    scene = render_mitsuba(file, parameters=dict(parameters), progress=progress, **options_given)
    seconds = time.perf_counter() - begun
    write_scene(scene, output)
    facts = {
        "path": str(output),
        "rows": scene.shape[0],
        "cols": scene.shape[1],
        "bands": scene.wavelength_nm.size,
        "components": len(scene.basis),
        "relative_error": scene.relative_error,
        "mean_luminance_cd_m2": scene.mean_luminance_cd_m2(),
        "distance_m": scene.distance_m,
        "width_m": scene.width_m,
        "seconds": seconds,
    }
    if as_json:
        print_json(facts)
        return
    width = "" if scene.width_m is None else f", {scene.width_m:.3g} m wide"
    click.echo(
        f"wrote {output}: {scene.shape[0]} x {scene.shape[1]} samples, {facts['bands']} bands as {facts['components']} "
        f"spectra; {facts['mean_luminance_cd_m2']:.4g} cd/m2 on average, {scene.distance_m:.3g} m away{width}; "
        f"{seconds:.1f} s"
    )
