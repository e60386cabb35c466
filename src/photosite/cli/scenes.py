"""`photosite scenes`: which scenes there are, what a scene's file says, and what it looks like."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.output import print_json, table
from photosite.cli.words import told_in_options

if TYPE_CHECKING:
    from photosite.scene.scene import Scene


@click.group("scenes", cls=Group, invoke_without_command=True)
@options.json_option
@click.pass_context
def command(ctx: click.Context, as_json: bool) -> None:
    """List the scenes by formula, or look at scenes and their files.

    Without a subcommand, lists the formulas with their options and defaults.

    Example: photosite scenes show siemens-star --picture star.png
    """
    if ctx.invoked_subcommand is None:
        _list(as_json)


@command.command("list")
@options.json_option
def list_(as_json: bool) -> None:
    """List the scenes by formula with their options, as without a subcommand.

    Example: photosite scenes list --json
    """
    _list(as_json)


def _list(as_json: bool) -> None:
    from photosite.scene.io.files import FORMATS
    from photosite.scene.request import FORMULAS, formula, formula_options

    told = {name: ((formula(name).__doc__ or "").strip().splitlines()[0], formula_options(name)) for name in FORMULAS}
    if as_json:
        listed = {
            name: {"summary": line, "options": {key: _json(value) for key, value in known.items()}}
            for name, (line, known) in told.items()
        }
        print_json({"scenes": listed})
        return
    rows = [(name, line) for name, (line, _) in told.items()]
    click.echo(table([("scene", "what it is"), *rows], "<<"))
    click.echo("\nOptions of each, with their defaults (--scene-option NAME=VALUE):")
    for name, (_, known) in told.items():
        click.echo(f"  {name}: {', '.join(f'{key}={_written(value)}' for key, value in known.items()) or 'none'}")
    click.echo("\nFiles (docs/scenes.md):")
    for kind in FORMATS:
        click.echo(f"  {kind.name}: {' '.join(kind.suffixes)}")


def _json(value: Any) -> Any:
    """A default as JSON has it: infinity is the text that --scene-option takes."""
    return "inf" if value == math.inf else value


def _written(value: Any) -> str:
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


@command.command("show")
@options.scene_argument
@click.option(
    "--picture",
    type=options.output_file(*options.PICTURE_SUFFIXES),
    metavar="FILE",
    help="Also write what an eye adapted to its light would see (PNG).",
)
@options.json_option
def show(picture: Path | None, as_json: bool, **told: Any) -> None:
    """Tell what a scene is: samples, spectra, light, distance.

    Example: photosite scenes show cube.hdr --picture cube.png
    """
    from photosite.develop.picture import save_picture
    from photosite.scene.preview import preview
    from photosite.scene.request import SceneRequest

    with told_in_options():
        scene = options.request_of(SceneRequest(), told).scene()
    if picture is not None:
        save_picture(preview(scene), picture)
    facts = _facts(scene)
    if as_json:
        print_json(facts | {"picture": None if picture is None else str(picture)})
        return
    click.echo(
        f"{scene.name}: {facts['rows']} x {facts['cols']} samples, {facts['spectra']} spectra over "
        f"{facts['first_nm']:g} to {facts['last_nm']:g} nm ({facts['wavelengths']} wavelengths)\n"
        f"{options.luminance_line(scene)}, darkest to brightest sample "
        f"{facts['darkest_cd_m2']:.3g} to {facts['brightest_cd_m2']:.3g} cd/m2\n"
        f"{scene.distance_m:g} m from the lens, "
        + ("as wide as the frame" if scene.width_m is None else f"{scene.width_m:g} m wide")
    )
    if picture is not None:
        click.echo(f"wrote {picture}")


def _facts(scene: Scene) -> dict[str, Any]:
    from photosite.scene.preview import tristimulus

    luminance = tristimulus(scene)[..., 1]
    return {
        "name": scene.name,
        "rows": scene.shape[0],
        "cols": scene.shape[1],
        "spectra": len(scene.basis),
        "wavelengths": scene.wavelength_nm.size,
        "first_nm": float(scene.wavelength_nm[0]),
        "last_nm": float(scene.wavelength_nm[-1]),
        "mean_luminance_cd_m2": scene.mean_luminance_cd_m2(),
        "patches_luminance_cd_m2": options.patches_luminance(scene),
        "darkest_cd_m2": float(luminance.min()),
        "brightest_cd_m2": float(luminance.max()),
        "distance_m": scene.distance_m,
        "width_m": scene.width_m,
        "regions": [region.name for region in scene.regions],
    }
