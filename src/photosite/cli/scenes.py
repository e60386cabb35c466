"""`photosite scenes`: list the built-in scenes, and show scenes and scene files."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Group
from photosite.cli.output import listed, show, table

if TYPE_CHECKING:
    from photosite.scene.io.formats import Format
    from photosite.scene.scene import Scene


@click.group("scenes", cls=Group)
def command() -> None:
    """List the built-in scenes, or show scenes and scene files.

    Example: photosite scenes show siemens-star --picture star.png
    """


@command.command("list")
@options.json_option
def list_(as_json: bool) -> None:
    """List the built-in scenes with their options and defaults, and the file formats.

    Example: photosite scenes list --json
    """
    from photosite.scene.scene_request import BUILT_IN_SCENES, chart_function, chart_options

    scenes = {
        name: {
            "summary": (chart_function(name).__doc__ or "").strip().splitlines()[0],
            "options": {key: "inf" if value == math.inf else value for key, value in chart_options(name).items()},
        }
        for name in BUILT_IN_SCENES
    }
    show(as_json, {"scenes": scenes}, lambda: _scenes_text(scenes))


def _scenes_text(scenes: dict[str, dict[str, Any]]) -> str:
    from photosite.scene.io.formats import FORMATS

    def written(known: dict[str, Any]) -> str:
        texts = {
            key: "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
            for key, value in known.items()
        }
        return ", ".join(f"{key}={text}" for key, text in texts.items()) or "none"

    formats = [("format", "read", "written"), *map(_suffixes, FORMATS)]
    return "\n\n".join(
        [
            table([("scene", "description"), *((name, entry["summary"]) for name, entry in scenes.items())], "<<"),
            listed(
                "Options with their defaults (--scene-option NAME=VALUE):",
                (f"{name}: {written(entry['options'])}" for name, entry in scenes.items()),
            ),
            f"File formats (docs/howto/scenes.md):\n{table(formats, '<<<')}",
        ]
    )


def _suffixes(kind: Format) -> tuple[str, str, str]:
    """Return a format's name and the suffixes that are read and written."""
    from photosite.scene.io.formats import CHART

    written = " ".join(kind.writes) + (" (charts only)" if kind.writes and CHART in kind.holds else "")
    return kind.name, " ".join(kind.suffixes), written


@command.command("show")
@options.scene_argument
@options.file_option(
    "--picture",
    suffixes=options.PICTURE_SUFFIXES,
    text="Also write a preview as an eye adapted to the scene's light would see it (PNG).",
)
@options.json_option
def show_scene(picture: Path | None, as_json: bool, **given: Any) -> None:
    """Show a scene's samples, spectra, luminance and distance.

    Example: photosite scenes show cube.hdr --picture cube.png
    """
    from photosite.develop.develop import save_picture
    from photosite.scene.scene import preview
    from photosite.scene.scene_request import SceneRequest

    scene = options.request_of(SceneRequest(), given).scene()
    if picture is not None:
        save_picture(preview(scene), picture)
    facts = _facts(scene)
    spectra = f"{facts['spectra']} {'spectrum' if facts['spectra'] == 1 else 'spectra'}"
    width = "as wide as the frame" if scene.width_m is None else f"{scene.width_m:g} m wide"
    text = (
        f"{scene.name}: {facts['rows']} x {facts['cols']} samples, {spectra} over "
        f"{facts['first_nm']:g} to {facts['last_nm']:g} nm ({facts['wavelengths']} wavelengths)\n"
        f"{options.luminance_line(scene)}, darkest to brightest sample "
        f"{facts['darkest_cd_m2']:.3g} to {facts['brightest_cd_m2']:.3g} cd/m2\n"
        f"{scene.distance_m:g} m from the lens, {width}"
    )
    show(as_json, {**facts, "picture": None}, lambda: text, picture=picture)


@command.command("print")
@click.argument("name", metavar="NAME")
@options.file_option(
    *("-o", "--output"), suffixes=(".png", ".pdf"), required=True, text="Picture or page to write: .png or .pdf."
)
@click.option(
    *("--scene-option", "given"),
    type=options.name_and_value,
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the chart, such as cycles=72; may be repeated.",
)
@options.quantity("--width", "width_mm", unit="MM", default=200.0, text="Width on paper, in mm.")
@click.option("--dpi", "dots_per_inch", type=options.Whole(10, 4800), default=600, help="Dots per inch.")
@options.quantity(
    *("--brightest", "brightest"),
    unit="R",
    text="Reflectance of the brightest part of the chart, or its transmittance on film.  [default: 0.9; film: 1]",
)
@click.option("--film", is_flag=True, help="Film in front of a light: values are transmittances and densities.")
@options.json_option
def print_(
    name: str, output: Path, given: tuple[tuple[str, Any], ...], film: bool, as_json: bool, **paper: Any
) -> None:
    """Write a gray chart that prints at its size, and what its patches should reflect, or transmit on film.

    Print it at 100 %, matte, with the printer's color management for sRGB. Measure the patches: papers and inks differ.

    Example: photosite scenes print siemens-star --width 180 -o star.pdf
    """
    from photosite.report.printed_chart import dots, write_printed_chart
    from photosite.scene.scene_request import OF_ANY_SIZE, SceneRequest, chart_function, chart_options

    SceneRequest(name)  # an unknown name is an error that says so
    own = dict(given)
    if name in OF_ANY_SIZE and not own.keys() & {"rows", "cols"}:
        default = chart_options(name)
        cols = dots(paper["width_mm"], paper["dots_per_inch"])
        own |= {"rows": round(cols * default["rows"] / default["cols"]), "cols": cols}
    chart = chart_function(name).chart(**own)
    field, patches = write_printed_chart(replace(chart, transmissive=film or chart.transmissive), output, **paper)
    scale = "density" if field.transmissive else "lightness"
    content = {
        "brightest": {field.quantity: field.factor, scale: getattr(field, scale)},
        "patches": [{"name": each.name, each.quantity: each.factor, scale: getattr(each, scale)} for each in patches],
    }
    digits = 2 if field.transmissive else 1
    rows = [("patch", field.quantity, "density" if field.transmissive else "L*")]
    rows += [(each.name, f"{each.factor:.3g}", f"{getattr(each, scale):.{digits}f}") for each in patches]
    text = f"{name}, {paper['width_mm']:g} mm wide; {field.name}: {field}" + (
        f"\n{table(rows, '<>>')}" if patches else ""
    )
    show(as_json, content, lambda: text, output=output)


def _facts(scene: Scene) -> dict[str, Any]:
    from photosite.scene.scene import tristimulus

    luminance = tristimulus(scene)[..., 1]
    return options.scene_facts(scene) | {
        "name": scene.name,
        "spectra": len(scene.basis),
        "wavelengths": scene.wavelength_nm.size,
        "first_nm": float(scene.wavelength_nm[0]),
        "last_nm": float(scene.wavelength_nm[-1]),
        "darkest_cd_m2": float(luminance.min()),
        "brightest_cd_m2": float(luminance.max()),
        "regions": [region.name for region in scene.regions],
    }
