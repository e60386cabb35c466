"""`photosite simulate`: one raw frame of a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import print_json, say_if_compiling
from photosite.cli.words import told_in_options
from photosite.errors import InputError
from photosite.values.exposure import format_exposure

if TYPE_CHECKING:
    from photosite.camera.camera import Camera
    from photosite.camera.file import SetUp
    from photosite.frames.raw_frame import RawFrame
    from photosite.optics.protocols import Optics
    from photosite.scene.planes import Planes
    from photosite.scene.request import PlanesRequest, SceneRequest
    from photosite.scene.scene import Scene


@click.command("simulate", cls=Command)
@click.option(
    "--camera",
    "camera_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Camera file (YAML): sensor, optics and scene in one place; other options go before it.",
)
@options.sensor_option(default=None)
@options.size_options
@options.black_level_option("Black level in DN, instead of the sensor's.")
@options.scene_options
@click.option(
    "--optics",
    "optics_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Optics file (YAML, or ISETPARMS.txt).",
)
@click.option("--f-number", type=options.above(), metavar="N", help="f-number of a perfect lens.  [default: 8]")
@click.option(
    "--focal-length", "focal_length_mm", type=options.above(), metavar="MM", help="Focal length in mm.  [default: 50]"
)
@click.option(
    "--exposure",
    "exposure_s",
    type=options.exposure_time,
    metavar="SECONDS",
    help="Exposure time in s.  [default: 1/3]",
)
@click.option(
    "--cells",
    "cells_per_pixel",
    type=click.IntRange(1),
    metavar="ODD",
    help="Cells across a pixel on which the scene is laid: 3 or more for edges that are to be measured.  [default: 1]",
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
    camera_file: Path | None, exposure_s: float | None, seed: int, output: Path, preview: Path | None, **told: Any
) -> None:
    """Simulate a raw frame of a scene.

    The defaults are the paper's: a Nikon D200 with a 50 mm lens at f/8, a ColorChecker of 40 cd/m2 under tungsten
    light (CIE A), 1/3 s. The same seed gives the same frame; the sensor's fixed pattern belongs to its serial and is
    the same in all frames.

    A scene is a formula's name (photosite scenes lists them) or a file: a spectral cube, a render, a measured chart or
    a picture. Files have their own light, where they say so; --illuminant lights reflectances and pictures, --luminance
    scales. A lens is --f-number and --focal-length, or --optics FILE. --camera FILE holds all of it.

    Where the ColorChecker's patches stand, for validate's --corners: their field reaches 62 P above and below the
    frame's middle and 94 P to its left and right, P = max(cols / 196, rows / 132) pixels (square ones). The D200's
    corners are 71.18,79.02 71.18,3792.98 2520.82,3792.98 2520.82,79.02.

    Example: photosite simulate --scene siemens-star --f-number 4 --exposure 1/10 -o shot.dng
    """
    as_json = told.pop("as_json")
    set_up = _set_up(camera_file, told)
    camera, time_s = set_up.camera, set_up.exposure_s if exposure_s is None else exposure_s
    scene = _scene(set_up.seen)
    say_if_compiling()
    raw = _balanced(camera.capture(scene, time_s, seed=seed), camera, _light(set_up.scene, scene))
    _save(raw, output, preview)
    facts = _facts(raw, output, preview)
    if as_json:
        print_json(facts | {"scene": scene.name, "sensor": camera.sensor.name, "seed": seed})
        return
    click.echo(
        f"wrote {output}: {raw.shape[0]} x {raw.shape[1]} pixels of {camera.sensor.name}, {scene.name}, "
        f"{format_exposure(time_s)} s; mean {facts['mean_dn']:.1f} DN, max {facts['max_dn']} DN, "
        f"{100 * facts['saturated_fraction']:.3g} % saturated"
    )
    if preview is not None:
        click.echo(f"wrote {preview}")


def _set_up(camera_file: Path | None, told: dict[str, Any]) -> SetUp:
    """The camera file's set-up, or the paper's, with what the options say put in its place."""
    from photosite.camera.file import SetUp, load_camera

    base = SetUp() if camera_file is None else load_camera(camera_file)
    sensor = base.sensor
    if told["sensor_name"] is not None:
        sensor = options.load_sensor_resized(told["sensor_name"], None, None)
    changes = {"rows": told["rows"], "cols": told["cols"], "black_level_dn": told["black_level_dn"]}
    return replace(
        base,
        sensor=sensor.with_(**{name: value for name, value in changes.items() if value is not None}),
        optics=_optics(base.optics, told),
        scene=_request(base.scene, told),
        cells_per_pixel=base.cells_per_pixel if told["cells_per_pixel"] is None else told["cells_per_pixel"],
    )


def _optics(base: Optics, told: dict[str, Any]) -> Optics:
    from photosite.optics.diffraction import DiffractionLimited

    marks = {"f_number": told["f_number"], "focal_length_mm": told["focal_length_mm"]}
    marks = {name: value for name, value in marks.items() if value is not None}
    if told["optics_file"] is not None:
        from photosite.optics.io.formats import load_optics

        base = load_optics(told["optics_file"])
    if not marks:
        return base
    if told["optics_file"] is not None or not isinstance(base, DiffractionLimited):
        option = "--" + next(iter(marks)).removesuffix("_mm").replace("_", "-")
        raise InputError(f"{option} is said by the lens's file; leave one of them out, or change the file")
    return replace(base, **marks)


def _request(base: SceneRequest | PlanesRequest, told: dict[str, Any]) -> SceneRequest | PlanesRequest:
    from photosite.scene.request import SceneRequest

    if isinstance(base, SceneRequest):
        return options.request_of(base, told)
    if told["scene_source"] is not None:
        return options.request_of(SceneRequest(), told)
    if options.said_of_scene(told):
        raise InputError("a scene of planes says the light and place of each in its camera file; change them there")
    return base


def _scene(request: SceneRequest | PlanesRequest) -> Scene | Planes:
    """What is seen; where options could mend it, errors name them."""
    from photosite.scene.request import SceneRequest

    if not isinstance(request, SceneRequest):  # a plane's light and units are said in the camera file alone
        return request.scene()
    with told_in_options():
        return request.scene()


def _light(request: SceneRequest | PlanesRequest, scene: Scene | Planes) -> Scene | None:
    """A field of the scene's light, where it is known: as it was asked for, or as the scene's reflectances tell."""
    from photosite.scene.charts import uniform
    from photosite.scene.scene import Scene

    if request.light is not None:
        return uniform(request.light, 1.0)
    if isinstance(scene, Scene) and scene.reflectance is not None:
        return Scene.uniform(scene.light(), scene.wavelength_nm)
    return None


def _balanced(raw: RawFrame, camera: Camera, light: Scene | None) -> RawFrame:
    """The frame with what gray reads under its light: a DNG keeps it as its white balance."""
    if light is None or (neutral := camera.as_shot_neutral(light)) is None:
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
