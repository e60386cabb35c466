"""`photosite convert`: spectral images and other scene files into other formats."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, show

_REPLACEMENT = click.Choice(["refuse", "zero"])


class BandRange(click.ParamType):  # type: ignore[type-arg]  # generic in newer releases only
    """Two wavelengths in nm, such as 400:780."""

    name = "range"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Parse FIRST:LAST."""
        try:
            first, last = map(float, value.split(":"))
        except ValueError:
            first = last = math.nan
        if not 0 < first <= last < math.inf:
            self.fail(f"must be FIRST:LAST in nm, such as 400:780, got '{value}'", param, ctx)
        return first, last

    def spell(self, value: Any) -> str:
        """Return a range as a user writes it."""
        return ":".join(f"{end:g}" for end in value)


_read_options = options.stacked(
    click.option(
        "--bands",
        "band_range_nm",
        type=BandRange(),
        metavar="FIRST:LAST",
        help="Read only the bands from FIRST to LAST nm, such as 400:780.",
    ),
    click.option("--illuminant", metavar="NAME", help="Light on reflectances: D65, A, 3200K, ..."),
    options.cube_options("Wavelengths of the bands, where the file does not state them: 400,410,... or 400:700:10."),
    click.option("--no-data", type=_REPLACEMENT, help="What to do with missing values.  [default: refuse]"),
    click.option("--negative", type=_REPLACEMENT, help="What to do with values below 0.  [default: refuse]"),
    click.option("--sort-bands", is_flag=True, help="Sort the bands by wavelength."),
    click.option(
        "--interleave",
        type=click.Choice(["bip", "bsq", "bil"]),
        help="Order of the axes of an HDF5 cube that does not state it: rows, columns, bands (bip), bands first (bsq) "
        "or second (bil).",
    ),
    click.option(
        "--out-of-gamut",
        type=click.Choice(["refuse", "clip"]),
        help="What to do with a display picture's colors that the method cannot represent.  [default: refuse]",
    ),
    click.option(
        "--method",
        type=click.Choice(["mallett-yuksel", "jakob-hanika"]),
        help="How a display picture's colors become spectra: weights of three reflectances, or a smooth reflectance "
        "for each color.  [default: mallett-yuksel]",
    ),
    click.option("--variable", metavar="NAME", help="The data set that holds the cube, where a file has several."),
    click.option(
        "--patch-cols",
        type=options.Whole(1),
        metavar="N",
        help="Patches in a row of a measured chart (CGATS, CSV, CxF).",
    ),
)
"""An option for each field of `photosite.scene.options.ReadOptions`."""


@click.command("convert", cls=Command)
@click.argument("source", type=click.Path(path_type=Path))
@options.scene_file_option
@_read_options
@options.json_option
def command(source: Path, output: Path, as_json: bool, **given: Any) -> None:
    """Reduce a spectral image to a scene of few basis spectra, and write it.

    Reads spectral cubes, ISET's scenes, measured charts and pictures; `photosite scenes list` lists the file formats.
    A cube is read twice, block by block: with .h5 as output, memory does not grow with it.

    Example: photosite convert field.hdr -o field.h5 --units W/sr/m2/nm
    """
    from photosite.scene.io.formats import convert_scene
    from photosite.scene.options import ReadOptions

    read_options = {name: value for name, value in given.items() if value is not None}
    begun = time.perf_counter()
    progress = Stages()
    progress.stage(f"reading {source}")
    done = convert_scene(source, output, progress=progress, **read_options)
    seconds = time.perf_counter() - begun
    scene = done.scene
    tolerance = ReadOptions(**read_options).tolerance if done.reduced else None
    facts = options.scene_facts(scene) | {
        "path": output,
        "bands": done.bands,
        "components": done.components,
        "tolerance": tolerance,
        "no_data_values": done.no_data_values,
        "negative_values": done.negative_values,
        "seconds": seconds,
    }
    error = f"RMS error {scene.relative_error:.2e} of the RMS radiance"
    how = f"{error}, measured over all samples (tolerance {tolerance:g})" if done.reduced else f"not reduced ({error})"
    lines = [
        f"wrote {output}: {scene.shape[0]} x {scene.shape[1]} samples, {done.bands} bands as {done.components} "
        f"spectra; {how}",
        f"{options.luminance_line(scene)}; {seconds:.1f} s",
    ]
    for count, what in ((done.no_data_values, "missing"), (done.negative_values, "negative")):
        if count:
            lines.append(f"{count} {what} values were read as 0")
    show(as_json, facts, lambda: "\n".join(lines))
