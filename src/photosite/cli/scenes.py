"""`photosite scenes`: list the built-in scenes, and show scenes and scene files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.output import print_json, table

if TYPE_CHECKING:
    from photosite.scene.scene import Scene


@click.group("scenes", cls=Group, invoke_without_command=True)
@options.json_option
@click.pass_context
def command(ctx: click.Context, as_json: bool) -> None:
    """List the built-in scenes, or show scenes and scene files.

    Without a subcommand, lists the built-in scenes with their options and defaults, and the file formats.

    Example: photosite scenes show siemens-star --picture star.png
    """
    if ctx.invoked_subcommand is None:
        _list(as_json)


@command.command("list")
@options.json_option
def list_(as_json: bool) -> None:
    """List the built-in scenes with their options, as without a subcommand.

    Example: photosite scenes list --json
    """
    _list(as_json)


def _list(as_json: bool) -> None:
    from photosite.scene.built_in import BUILT_IN_SCENES, chart_function, chart_options
    from photosite.scene.io.formats import FORMATS

    scenes = {
        name: ((chart_function(name).__doc__ or "").strip().splitlines()[0], chart_options(name))
        for name in BUILT_IN_SCENES
    }
    if as_json:
        listed = {
            name: {"summary": line, "options": {key: _json(value) for key, value in known.items()}}
            for name, (line, known) in scenes.items()
        }
        print_json({"scenes": listed})
        return
    rows = [(name, line) for name, (line, _) in scenes.items()]
    click.echo(table([("scene", "description"), *rows], "<<"))
    click.echo("\nOptions with their defaults (--scene-option NAME=VALUE):")
    for name, (_, known) in scenes.items():
        click.echo(f"  {name}: {', '.join(f'{key}={_written(value)}' for key, value in known.items()) or 'none'}")
    click.echo("\nFile formats (docs/scenes.md):")
    for kind in FORMATS:
        click.echo(f"  {kind.name}: {' '.join(kind.suffixes)}")


def _json(value: Any) -> Any:
    """A default in JSON: infinity is the text that --scene-option takes."""
    return "inf" if value == math.inf else value


def _written(value: Any) -> str:
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


@command.command("show")
@options.scene_argument
@click.option(
    "--picture",
    type=options.output_file(*options.PICTURE_SUFFIXES),
    metavar="FILE",
    help="Also write a preview as an eye adapted to the scene's light would see it (PNG).",
)
@options.json_option
def show(picture: Path | None, as_json: bool, **given: Any) -> None:
    """Show a scene's samples, spectra, luminance and distance.

    Example: photosite scenes show cube.hdr --picture cube.png
    """
    from photosite.develop.picture import save_picture
    from photosite.scene.preview import preview
    from photosite.scene.scene_request import SceneRequest

    scene = options.request_of(SceneRequest(), given).scene()
    if picture is not None:
        save_picture(preview(scene), picture)
    facts = _facts(scene)
    if as_json:
        print_json(facts | {"picture": None if picture is None else str(picture)})
        return
    click.echo(
        f"{scene.name}: {facts['rows']} x {facts['cols']} samples, "
        f"{facts['spectra']} {'spectrum' if facts['spectra'] == 1 else 'spectra'} over "
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
