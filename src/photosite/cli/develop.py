"""`photosite develop`: develop a raw frame into a picture."""

from __future__ import annotations

from pathlib import Path

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import print_json


def white_balance_of(text: str) -> str | list[float]:
    """Parse a name, or three gains such as 2.1,1,1.4."""
    if "," not in text:
        return text
    try:
        return [float(gain) for gain in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"expected a name or three gains such as 2.1,1,1.4, not '{text}'") from None


def brightness_of(text: str) -> str | float:
    """Parse auto, or a factor above 0."""
    return text if text == "auto" else options.above()(text)


@click.command("develop", cls=Command)
@click.argument("raw", type=click.Path(path_type=Path))
@options.output_option(*options.PICTURE_SUFFIXES, text="Picture to write (.png).")
@click.option(
    "--white-balance",
    type=white_balance_of,
    metavar="BALANCE",
    default="gray-world",
    help="gray-world, none, or gains for R, G and B: 2.1,1,1.4.",
)
@click.option(
    "--brightness",
    type=brightness_of,
    metavar="FACTOR",
    default="auto",
    help="auto, or a factor for the linear picture.",
)
@click.option("--depth", type=click.Choice(["8", "16"]), default="8", help="Bits per channel of the picture.")
@click.option("--bits", type=click.IntRange(1, 16), help="Bit depth of the converter, for files that do not state it.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files that do not state it.")
@options.json_option
def command(
    raw: Path,
    output: Path,
    white_balance: str | list[float],
    brightness: str | float,
    depth: str,
    bits: int | None,
    cfa: str | None,
    as_json: bool,
) -> None:
    """Develop a raw frame (DNG, camera raw, TIFF, PNG, HDF5 or FITS) into a picture (PNG, sRGB).

    Steps: bilinear demosaic, white balance, the file's colour matrix, sRGB encoding.

    Example: photosite develop shot.dng -o shot.png --white-balance none --depth 16
    """
    from photosite.develop.develop import develop
    from photosite.develop.picture import save_picture
    from photosite.frames.io.read import read_raw

    frame = read_raw(raw, bits=bits, cfa=cfa)
    picture = develop(frame, white_balance=white_balance, exposure=brightness)
    save_picture(picture, output, bits=int(depth))
    if as_json:
        print_json({"path": str(output), "rows": frame.shape[0], "cols": frame.shape[1], "depth": int(depth)})
    else:
        click.echo(f"wrote {output}: {frame.shape[0]} x {frame.shape[1]} pixels, {depth} bits per channel")
