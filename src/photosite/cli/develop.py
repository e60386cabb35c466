"""`photosite develop`: develop a raw frame into a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
import numpy as np

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import say, show

if TYPE_CHECKING:
    from photosite.develop.polarization import PolarizationPicture


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
    *("-o", "--output"),
    suffixes=(*options.PICTURE_SUFFIXES, ".h5"),
    required=True,
    text="Picture to write: .png or .jpg; with --polarization stokes a file of maps: .h5.",
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
    "exposure",
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
@click.option(
    "--bin",
    "factor",
    type=options.Whole(2),
    metavar="N",
    help="Average blocks of N x N pixels of one color first: quad-rggb becomes rggb.",
)
@click.option(
    "--polarization",
    type=click.Choice(["degree", "angle", "stokes"]),
    help="Of a frame with polarizers: a picture of the degree of linear polarization in gray, or of its angle as hue, "
    "with the degree as saturation; or the maps s0, s1, s2, dolp and aolp_deg as HDF5.",
)
@click.option("--color", metavar="NAME", help="Color of the channels for --polarization, such as G of G0 to G135.")
@options.sensor_option(
    text="Sensor that took the frame, for bits and mosaic that the file does not state, and for angles and extinction "
    "ratios of --polarization.  [default: ideal ones]"
)
@options.reading_options
@options.json_option
def command(
    raw: Path,
    output: Path,
    white_balance: str | list[float],
    exposure: str | float,
    depth: str,
    factor: int | None,
    polarization: PolarizationPicture | Literal["stokes"] | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Develop a raw frame into a picture (PNG or JPEG, sRGB).

    Steps: demosaic, white balance, the file's color matrix, sRGB encoding. Gray surfaces are gray if the file
    states the white of its light, as frames of `photosite simulate`, DNG and camera raw do. The picture is upright if
    the file states its orientation.

    \b
    Example: photosite develop shot.dng -o shot.png --white-balance none --depth 16
    Example: photosite develop polarized.h5 -o degree.png --polarization degree
    """
    from photosite.cli.memory_need import develop_bytes, megapixels, warn_if_short
    from photosite.develop.develop import develop, save_picture
    from photosite.frames.binning import bin_frame
    from photosite.frames.io.formats import read_raw
    from photosite.values.orientation import turned_upright

    if depth == "16" and output.suffix.lower() != ".png":
        raise click.UsageError("--depth 16 needs a picture in .png")
    if (output.suffix.lower() == ".h5") != (polarization == "stokes"):
        raise click.UsageError("--polarization stokes writes .h5, and nothing else does")
    if polarization is None:
        options.only_for("--polarization", "color")
    else:
        options.not_for("--polarization", "white_balance", "exposure", "demosaic")
    demosaic, color, sensor_name = (reading.pop(name) for name in ("demosaic", "color", "sensor_name"))
    sensor = options.sensor_or(None, sensor_name)
    frame = read_raw(raw, sensor=sensor, **reading)
    if factor is not None:
        frame = bin_frame(frame, factor)
    rows, cols = frame.shape
    warn_if_short(
        f"a picture of {megapixels(rows, cols)}", develop_bytes(rows * cols), "Use --bin, or a machine with more memory"
    )
    if polarization is not None:
        from photosite.develop.polarization import polarization_picture, save_stokes, stokes

        seen = stokes(frame, color, sensor)
        if polarization == "stokes":
            save_stokes(seen, output)
        else:
            save_picture(polarization_picture(seen, polarization), output, bits=int(depth))
        mean = float(np.nanmean(seen.dolp))
        facts = {"path": output, "rows": rows, "cols": cols, "polarization": polarization, "mean_degree": mean}
        show(as_json, facts, lambda: f"wrote {output}: {rows} x {cols} pixels, mean degree of polarization {mean:.4f}")
        return
    picture = develop(frame, white_balance=white_balance, exposure=exposure, demosaic=demosaic)
    picture = turned_upright(picture, frame.metadata.get("orientation"))
    rows, cols = picture.shape[:2]
    save_picture(picture, output, bits=int(depth))
    used = white_balance
    if frame.is_mosaic and used == "as-shot" and frame.as_shot_neutral is None:
        used = "gray-world"
        say("photosite: the file does not state the white of its light; the white balance is gray-world")
    facts = {"path": output, "rows": rows, "cols": cols, "depth": int(depth), "white_balance": used}
    show(as_json, facts, lambda: f"wrote {output}: {rows} x {cols} pixels, {depth} bits per channel")
