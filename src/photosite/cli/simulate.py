"""`photosite simulate`: one raw frame of a chart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.output import print_json, say_if_compiling
from photosite.exposure import format_exposure

if TYPE_CHECKING:
    from photosite.camera import Camera
    from photosite.frames.raw_frame import RawFrame


@click.command("simulate")
@options.sensor_option()
@options.size_options
@options.black_level_option("Black level in DN, instead of the sensor's.")
@options.scene_options
@options.lens_options
@click.option(
    "--exposure",
    type=options.exposure_time,
    metavar="SECONDS",
    default="1/3",
    help="Exposure time in s; 1/3 is read as such.",
)
@options.seed_option()
@options.output_option(*options.RAW_SUFFIXES, default="shot.dng", text="Raw frame to write: .dng, .tif, .png or .h5.")
@click.option(
    "--preview",
    type=options.output_file(*options.PICTURE_SUFFIXES),
    metavar="FILE",
    help="Also write a developed picture (PNG).",
)
@options.json_option
def command(
    sensor_name: str,
    rows: int | None,
    cols: int | None,
    black_level: float | None,
    scene_name: str,
    illuminant: str,
    luminance: float,
    distance: float,
    f_number: float,
    focal_length: float,
    exposure: float,
    seed: int,
    output: Path,
    preview: Path | None,
    as_json: bool,
) -> None:
    """Simulate a raw frame of a chart, seen through a diffraction-limited lens.

    The defaults are the paper's: a Nikon D200 with a 50 mm lens at f/8, a ColorChecker of 40 cd/m2 under tungsten
    light (CIE A), 1/3 s. The chart fills the frame. The same seed gives the same frame; the sensor's fixed pattern
    belongs to its serial and is the same in all frames.

    Where the ColorChecker's patches stand, for validate's --corners: their field reaches 62 P above and below the
    frame's middle and 94 P to its left and right, P = max(cols / 196, rows / 132) pixels (square ones). The D200's
    corners are 71.18,79.02 71.18,3792.98 2520.82,3792.98 2520.82,79.02.

    Example: photosite simulate --exposure 1/10 --seed 7 -o shot.dng --preview shot.png
    """
    from photosite.camera import Camera

    sensor = options.load_sensor_resized(sensor_name, rows, cols, black_level)
    camera = Camera(options.lens(f_number, focal_length), sensor)
    scene = options.scene(scene_name, illuminant, luminance, distance)
    say_if_compiling()
    raw = _balanced(camera.capture(scene, exposure, seed=seed), camera, illuminant)
    _save(raw, output, preview)
    if as_json:
        print_json(_facts(raw, output, preview) | {"scene": scene.name, "sensor": sensor.name, "seed": seed})
        return
    facts = _facts(raw, output, preview)
    click.echo(
        f"wrote {output}: {raw.shape[0]} x {raw.shape[1]} pixels of {sensor.name}, {scene.name}, "
        f"{format_exposure(exposure)} s; mean {facts['mean_dn']:.1f} DN, max {facts['max_dn']} DN, "
        f"{100 * facts['saturated_fraction']:.3g} % saturated"
    )
    if preview is not None:
        click.echo(f"wrote {preview}")


def _balanced(raw: RawFrame, camera: Camera, illuminant: str) -> RawFrame:
    """The frame with what gray reads under its light, which a DNG keeps as its white balance."""
    from photosite.scene.charts import uniform

    neutral = camera.as_shot_neutral(uniform(illuminant, 1.0))
    if neutral is None:
        return raw
    return replace(raw, metadata=MappingProxyType({**raw.metadata, "as_shot_neutral": neutral}))


def _save(raw: RawFrame, output: Path, preview: Path | None) -> None:
    """Both are made before either is written."""
    from photosite.develop.develop import develop
    from photosite.develop.picture import save_picture

    picture = None if preview is None else develop(raw)
    raw.save(output)
    if preview is not None and picture is not None:
        save_picture(picture, preview)


def _facts(raw: RawFrame, output: Path, preview: Path | None) -> dict[str, Any]:
    return {
        "path": str(output),
        "preview": None if preview is None else str(preview),
        "rows": raw.shape[0],
        "cols": raw.shape[1],
        "bits": raw.bits,
        "black_level_dn": raw.black_level_dn,
        "white_level_dn": raw.white_level_dn,
        "exposure_s": raw.exposure_s,
        "mean_dn": float(raw.dn.mean()),
        "max_dn": int(raw.dn.max()),
        "saturated_fraction": float((raw.dn >= raw.white_level_dn).mean()),
    }
