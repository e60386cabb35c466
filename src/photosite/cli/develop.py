"""`photosite develop`: develop a raw frame into a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import say, show


def white_balance_of(text: str) -> str | list[float]:
    """Parse a name, or gains such as 2.1,1,1.4."""
    if "," not in text:
        return text
    try:
        return [float(gain) for gain in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"must be a name or gains such as 2.1,1,1.4, got '{text}'") from None


def brightness_of(text: str) -> str | float:
    """Parse auto, or a factor above 0."""
    return text if text == "auto" else options.above()(text)


@click.command("develop", cls=Command)
@click.argument("raw", type=click.Path(path_type=Path))
@options.file_option(
    "-o", "--output", suffixes=options.PICTURE_SUFFIXES, required=True, text="Picture to write: .png or .jpg."
)
@click.option(
    "--white-balance",
    type=white_balance_of,
    metavar="BALANCE",
    default="as-shot",
    help="as-shot (the light's white that the file states, else gray-world), gray-world, none, or gains for R, G and "
    "B: 2.1,1,1.4.",
)
@click.option(
    "--brightness",
    type=brightness_of,
    metavar="FACTOR",
    default="auto",
    help="auto, or a factor for the linear picture.",
)
@click.option(
    "--depth", type=click.Choice(["8", "16"]), default="8", help="Bits per channel of the picture; .jpg has 8."
)
@click.option(
    "--demosaic",
    type=click.Choice(["bilinear", "malvar", "menon"]),
    default="bilinear",
    help="bilinear for every mosaic; malvar or menon for Bayer mosaics, sharper.",
)
@options.reading_options()
@options.json_option
def command(
    raw: Path,
    output: Path,
    white_balance: str | list[float],
    brightness: str | float,
    depth: str,
    demosaic: Any,
    as_json: bool,
    **reading: Any,
) -> None:
    """Develop a raw frame (DNG, camera raw, TIFF, PNG, HDF5 or FITS) into a picture (PNG or JPEG, sRGB).

    Steps: demosaic, white balance, the file's color matrix, sRGB encoding. Gray surfaces are gray if the file
    states the white of its light, as frames of `photosite simulate`, DNG and camera raw do.

    Example: photosite develop shot.dng -o shot.png --white-balance none --depth 16
    """
    from photosite.develop.develop import develop, save_picture
    from photosite.frames.io.formats import read_raw

    if depth == "16" and output.suffix.lower() != ".png":
        raise click.UsageError("--depth 16 needs a picture in .png")
    frame = read_raw(raw, **reading)
    rows, cols = frame.shape
    save_picture(
        develop(frame, white_balance=white_balance, exposure=brightness, demosaic=demosaic), output, bits=int(depth)
    )
    used = white_balance
    if frame.is_mosaic and used == "as-shot" and frame.as_shot_neutral is None:
        used = "gray-world"
        say("photosite: the file does not state the white of its light; the white balance is gray-world")
    facts = {"path": output, "rows": rows, "cols": cols, "depth": int(depth), "white_balance": used}
    show(as_json, facts, lambda: f"wrote {output}: {rows} x {cols} pixels, {depth} bits per channel")
