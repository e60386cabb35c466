"""`photosite convert`: spectral images and other scene files into other formats."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json

_SUFFIXES = (".h5", ".mat", ".tif", ".tiff", ".hdr", ".exr")


def _read_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add an option for each field of `photosite.scene.options.ReadOptions`."""
    for option in (
        click.option(
            "--patch-cols",
            type=click.IntRange(1),
            metavar="N",
            help="Patches in a row of a measured chart (CGATS, CSV).",
        ),
        click.option("--variable", metavar="NAME", help="The data set that holds the cube, where a file has several."),
        click.option(
            "--method",
            type=click.Choice(["mallett-yuksel", "jakob-hanika"]),
            help="How a display picture's colours become spectra: weights of three reflectances, or a smooth "
            "reflectance for each colour.  [default: mallett-yuksel]",
        ),
        click.option(
            "--out-of-gamut",
            type=click.Choice(["refuse", "clip"]),
            help="What to do with a display picture's colours that the method cannot represent.  [default: refuse]",
        ),
        click.option(
            "--interleave",
            type=click.Choice(["bip", "bsq", "bil"]),
            help="Order of the axes of an HDF5 cube that does not state it: rows, columns, bands (bip), bands first "
            "(bsq) or second (bil).",
        ),
        click.option("--sort-bands", is_flag=True, help="Sort the bands by wavelength."),
        click.option(
            "--negative",
            type=click.Choice(["refuse", "zero"]),
            help="What to do with values below 0.  [default: refuse]",
        ),
        click.option(
            "--no-data",
            type=click.Choice(["refuse", "zero"]),
            help="What to do with missing values.  [default: refuse]",
        ),
        click.option("--width", "width_m", type=options.above(), metavar="M", help="Width of the scene in m."),
        click.option(
            "--distance", "distance_m", type=options.above(), metavar="M", help="Distance from lens to scene in m."
        ),
        click.option(
            "--luminance", "mean_luminance_cd_m2", type=options.above(), metavar="CD/M2", help=options.LUMINANCE_HELP
        ),
        click.option("--illuminant", metavar="NAME", help="Light on reflectances: D65, A, 3200K, ..."),
        click.option(
            "--wavelengths",
            "wavelength_nm",
            type=options.wavelengths_of,
            metavar="NM",
            help="Wavelengths of the bands, where the file does not state them: 400,410,... or 400:700:10.",
        ),
        click.option(
            "--bands",
            "band_range_nm",
            type=options.BandRange(),
            metavar="FIRST:LAST",
            help="Read only the bands from FIRST to LAST nm, such as 400:780.",
        ),
        click.option(
            "--units",
            metavar="UNITS",
            help="Units of the values; they override the file's. W/sr/m2/nm, photons/s/sr/m2/nm, reflectance, percent, "
            "reflectance/10000, relative; for a Radiance picture: radiance.",
        ),
        click.option(
            "--tolerance",
            type=options.above(),
            metavar="T",
            help="Largest RMS error of the reduction of a cube, relative to the RMS.  [default: 0.001]",
        ),
    ):
        function = option(function)
    return function


@click.command("convert", cls=Command)
@click.argument("source", type=click.Path(path_type=Path))
@options.output_option(*_SUFFIXES, text="Scene to write: .h5 (photosite's own), .mat, .tif, .hdr (ENVI), .exr.")
@_read_options
@options.json_option
def command(source: Path, output: Path, as_json: bool, **given: Any) -> None:
    """Reduce a spectral image to a scene of few basis spectra, and write it.

    Reads ENVI, MATLAB, HDF5, TIFF, OpenEXR and ISET files, measured charts (CGATS, CSV), and pictures (PNG, JPEG,
    TIFF, Radiance). A cube is read twice, block by block: with .h5 as output, memory does not grow with it.

    Example: photosite convert field.hdr -o field.h5 --units W/sr/m2/nm
    """
    from photosite.scene.io.convert import convert
    from photosite.scene.options import ReadOptions

    read_options = {name: value for name, value in given.items() if value is not None}
    begun = time.perf_counter()
    progress = Stages()
    progress.stage(f"reading {source}")
    done = convert(source, output, progress=progress, **read_options)
    seconds = time.perf_counter() - begun
    scene = done.scene
    tolerance = ReadOptions(**read_options).tolerance if done.reduced else None
    facts = {
        "path": str(output),
        "rows": scene.shape[0],
        "cols": scene.shape[1],
        "bands": done.bands,
        "components": done.components,
        "tolerance": tolerance,
        "relative_error": scene.relative_error,
        "mean_luminance_cd_m2": scene.mean_luminance_cd_m2(),
        "patches_luminance_cd_m2": options.patches_luminance(scene),
        "no_data_values": done.no_data_values,
        "negative_values": done.negative_values,
        "distance_m": scene.distance_m,
        "width_m": scene.width_m,
        "seconds": seconds,
    }
    if as_json:
        print_json(facts)
        return
    error = f"RMS error {scene.relative_error:.2e} of the RMS radiance"
    how = f"{error}, measured over all samples (tolerance {tolerance:g})" if done.reduced else f"not reduced ({error})"
    click.echo(
        f"wrote {output}: {scene.shape[0]} x {scene.shape[1]} samples, {done.bands} bands as {done.components} "
        f"spectra; {how}"
    )
    click.echo(f"{options.luminance_line(scene)}; {seconds:.1f} s")
    for count, what in ((done.no_data_values, "missing"), (done.negative_values, "negative")):
        if count:
            click.echo(f"{count} {what} values were read as 0")
