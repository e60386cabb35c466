"""`photosite simulate`: one raw frame of a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import say_if_compiling, show
from photosite.errors import InputError
from photosite.values.exposure import format_exposure

if TYPE_CHECKING:
    from photosite.camera.camera import Camera
    from photosite.camera.file import SetUp
    from photosite.frames.raw_frame import RawFrame
    from photosite.optics.lens import Optics
    from photosite.scene.planes import Planes
    from photosite.scene.scene import Scene
    from photosite.scene.scene_request import PlanesRequest, SceneRequest


@click.command("simulate", cls=Command)
@options.path_option(
    *("--camera", "camera_file"),
    text="Camera file (YAML): sensor, optics and scene together. Other options override it.",
)
@options.sensor_option(text="Preset or sensor file (YAML).  [default: nikon-d200]")
@options.size_options()
@options.gain_setting_option
@options.black_level_option("; by default the sensor's")
@options.scene_options
@options.path_option("--optics", "optics_file", text="Optics file (YAML, or ISETPARMS.txt).")
@options.lens_options(late=True)
@options.exposure_option(text="Exposure time in s, such as 0.01 or 1/100.  [default: 1/3]")
@click.option(
    "--cells",
    "cells_per_pixel",
    type=options.Whole(1),
    metavar="ODD",
    help="Cells across a pixel in which the image is computed; use 3 or more to measure edges.  [default: 1]",
)
@options.seed_option()
@options.file_option(
    *("-o", "--output"),
    suffixes=options.RAW_SUFFIXES,
    default="shot.dng",
    text="Raw frame to write: .dng, .tif, .png or .h5.",
)
@options.file_option("--preview", suffixes=options.PICTURE_SUFFIXES, text="Also write a developed picture (PNG).")
@options.json_option
def command(
    camera_file: Path | None,
    exposure_s: float | None,
    seed: int,
    output: Path,
    preview: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Simulate a raw frame of a scene.

    The defaults are the 2008 paper's: a Nikon D200 with a 50 mm lens at f/8, a ColorChecker of 40 cd/m2 under tungsten
    light (CIE A), 1/3 s. The same seed gives the same frame. The sensor's fixed pattern belongs to its serial and is
    the same in all frames.

    A scene is a built-in scene (`photosite scenes` lists them) or a file: a spectral cube, a render, a measured chart
    or a picture. A file may state its own light; --illuminant sets the light on reflectances and pictures, --luminance
    scales the scene. A lens is given by --f-number and --focal-length, or by --optics FILE. --camera FILE holds all of
    it.

    Corners of the ColorChecker for `photosite validate --corners`: its patches extend 62 P above and below the frame's
    center and 94 P to its left and right, with P = max(cols / 196, rows / 132) for square pixels. The D200's
    corners are 71.18,79.02 71.18,3792.98 2520.82,3792.98 2520.82,79.02.

    Example: photosite simulate --scene siemens-star --f-number 4 --exposure 1/10 -o shot.dng
    """
    set_up = _set_up(camera_file, given)
    camera, time_s = set_up.camera, set_up.exposure_s if exposure_s is None else exposure_s
    scene = set_up.seen.scene()
    say_if_compiling()
    raw = _with_white_balance(camera.capture(scene, time_s, seed=seed), camera, _light(set_up.scene, scene))
    _save(raw, output, preview)
    facts: dict[str, Any] = {
        "path": output,
        "preview": preview,
        "rows": raw.shape[0],
        "cols": raw.shape[1],
        "bits": raw.bits,
        "black_level_dn": raw.black_level_dn,
        "white_level_dn": raw.white_level_dn,
        "exposure_s": raw.exposure_s,
        "mean_dn": float(raw.dn.mean()),
        "max_dn": int(raw.dn.max()),
        "saturated_fraction": float((raw.dn >= raw.white_level_dn).mean()),
        "scene": scene.name,
        "sensor": camera.sensor.name,
        "gain_setting": camera.sensor.gain_setting,
        "seed": seed,
    }
    text = (
        f"wrote {output}: {raw.shape[0]} x {raw.shape[1]} pixels of {camera.sensor.name}, {scene.name}, "
        f"{format_exposure(time_s)} s; mean {facts['mean_dn']:.1f} DN, max {facts['max_dn']} DN, "
        f"{100 * facts['saturated_fraction']:.3g} % saturated"
    )
    show(as_json, facts, lambda: text, preview=preview)


def _set_up(camera_file: Path | None, given: dict[str, Any]) -> SetUp:
    """Return the camera file's set-up, or the paper's, changed by the options."""
    from photosite.camera.file import SetUp, load_camera

    base = SetUp() if camera_file is None else load_camera(camera_file)
    sensor = options.sensor_or(base.sensor, given["sensor_name"])
    if given["gain_setting"] is not None:
        sensor = sensor.at_gain_setting(given["gain_setting"])
    changes = {name: given[name] for name in ("rows", "cols", "black_level_dn") if given[name] is not None}
    return replace(
        base,
        sensor=sensor.with_(**changes),
        optics=_optics(base.optics, given),
        scene=_request(base.scene, given),
        cells_per_pixel=given["cells_per_pixel"] or base.cells_per_pixel,
    )


def _optics(base: Optics, given: dict[str, Any]) -> Optics:
    from photosite.optics.diffraction import DiffractionLimited

    changes = {name: given[name] for name in ("f_number", "focal_length_mm") if given[name] is not None}
    if given["optics_file"] is not None:
        from photosite.optics.io.formats import load_optics

        base = load_optics(given["optics_file"])
    if not changes:
        return base
    if given["optics_file"] is not None or not isinstance(base, DiffractionLimited):
        name, value = next(iter(changes.items()))
        hint = f"Omit {{{name}}}, or change the file"
        raise InputError("the optics file defines the lens", hint=hint, arguments={name: value})
    return replace(base, **changes)


def _request(base: SceneRequest | PlanesRequest, given: dict[str, Any]) -> SceneRequest | PlanesRequest:
    from photosite.scene.scene_request import SceneRequest

    if isinstance(base, SceneRequest):
        return options.request_of(base, given)
    if given["scene_source"] is not None:
        return options.request_of(SceneRequest(), given)
    if options.options_of_scene(given):
        hint = "Change light and place of each plane in the camera file"
        raise InputError("options cannot change a scene of planes", hint=hint)
    return base


def _light(request: SceneRequest | PlanesRequest, scene: Scene | Planes) -> Scene | None:
    """Return a field of the scene's light, where it is known from the request or from the scene's reflectances."""
    from photosite.scene.charts import uniform
    from photosite.scene.scene import Scene

    if request.light is not None:
        return uniform(request.light, 1.0)
    if isinstance(scene, Scene) and scene.reflectance is not None:
        return Scene.uniform(scene.light(), scene.wavelength_nm)
    return None


def _with_white_balance(raw: RawFrame, camera: Camera, light: Scene | None) -> RawFrame:
    """Return the frame with the camera's response to gray under its light, which a DNG stores as its white balance."""
    if light is None or (neutral := camera.as_shot_neutral(light)) is None:
        return raw
    return replace(raw, metadata={**raw.metadata, "as_shot_neutral": neutral})


def _save(raw: RawFrame, output: Path, preview: Path | None) -> None:
    """Write frame and preview; both are made before either is written."""
    from photosite.develop.develop import develop, save_picture

    picture = None if preview is None else develop(raw)
    raw.save(output)
    if preview is not None and picture is not None:
        save_picture(picture, preview)
