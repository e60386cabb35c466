"""`photosite simulate`: raw frames of a scene."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.compilation import compile_captures, compile_exposure
from photosite.cli.output import Stages, say, say_if_compiling, show
from photosite.errors import InputError
from photosite.frames.io.format_table import DEEP_SUFFIXES, WRITTEN_SUFFIXES
from photosite.values.exposure import format_exposure

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from photosite.camera.camera import Camera
    from photosite.camera.file import SetUp
    from photosite.frames.raw_frame import RawFrame
    from photosite.optics.lens import Optics
    from photosite.scene.scene_request import PlanesRequest, SceneRequest
    from photosite.sensor.model import Sensor


@click.command("simulate", cls=Command)
@options.path_option(
    *("--camera", "camera_file"),
    text="Camera file (YAML): sensor, optics and scene together. Other options override it.",
)
@options.sensor_option(text="Preset or sensor file (YAML).  [default: nikon-d200]")
@options.size_options()
@options.gain_setting_option
@options.sensor_fields_option
@options.black_level_option("; by default the sensor's")
@click.option(
    "--bin", "factor", type=options.Whole(2), metavar="N", help="Blocks of N x N pixels of one color are read as one."
)
@click.option(
    "--bin-kind",
    type=click.Choice(["charge", "sum", "mean"]),
    default="charge",
    help="How the pixels of a block are added with --bin: in the pixel, or as digital numbers.",
)
@options.scene_options
@options.path_option("--optics", "optics_file", text="Optics file (YAML, or ISETPARMS.txt).")
@options.lens_options(late=True)
@options.lens_fields_option
@click.option(
    "--exposure",
    "exposure_s",
    type=options.exposure_time_or_auto,
    metavar="TIME|auto",
    help="Exposure time: 0.01, 1/100 or 10ms; auto puts the bright parts just below saturation.  [default: 1/3]",
)
@click.option(
    "--cells",
    "cells_per_pixel",
    type=options.Whole(1),
    metavar="ODD",
    help="Cells across a pixel in which the image is computed; use 3 or more to measure edges.  [default: 1]",
)
@click.option(
    "--temperature",
    "temperature_c",
    type=click.FloatRange(-273.15),
    metavar="C",
    help="Sensor temperature in degrees Celsius, for the dark current; by default that of the sensor file.",
)
@options.seed_option()
@click.option(
    "--frames",
    type=options.Whole(1, 2**32),
    default=1,
    metavar="N",
    help="Frames of the same scene, with independent noise; with several, their number is added to the file names.",
)
@click.option(
    "--flicker",
    type=options.flicker_of,
    metavar="HZ:DEPTH",
    help="Flicker of the light: 100Hz:0.2 is a sine of depth 0.2, 250Hz:duty=0.3 an LED with pulse width modulation, "
    "both also with :phase=90 in degrees; 100Hz:table=1,2,1 is a table over one period.",
)
@options.quantity(
    "--line-time",
    "line_time_us",
    unit="US",
    text="Line time of a rolling shutter in microseconds, instead of the sensor's shutter.",
)
@click.option(
    "--motion",
    type=options.motion_of,
    metavar="ROWS,COLS",
    help="Motion of the image, pixels per second down and to the right; a third number is a rotation in degrees/s, a "
    "fourth the relative growth per second.",
)
@options.quantity(
    "--fps", unit="N", text="Frames per second: frame n starts at n / N seconds. By default all frames start at time 0."
)
@options.file_option(
    *("-o", "--output"),
    suffixes=WRITTEN_SUFFIXES,
    default="shot.dng",
    text=f"Raw frame to write: {', '.join(WRITTEN_SUFFIXES)}.",
)
@options.file_option(
    "--preview", suffixes=options.PICTURE_SUFFIXES, text="Also write a developed picture: .png or .jpg."
)
@options.file_option(
    "--clean", suffixes=DEEP_SUFFIXES, text="Also write the noise-free mosaic in DN, 32-bit floats: .tif or .h5."
)
@click.option(
    "--captures",
    is_flag=True,
    help="Also write each capture of a sensor with several, such as shot.small.dng beside shot.dng.",
)
@options.json_option
def command(
    camera_file: Path | None, seed: int, frames: int, output: Path, captures: bool, as_json: bool, **given: Any
) -> None:
    """Simulate raw frames of a scene.

    The defaults are the 2008 paper's: a Nikon D200 with a 50 mm lens at f/8, a ColorChecker of 40 cd/m2 under tungsten
    light (CIE A), 1/3 s. The same seed gives the same frame. The sensor's fixed pattern belongs to its serial and is
    the same in all frames.

    A scene is a built-in scene (`photosite scenes list` lists them) or a file: a spectral cube, a render, a measured
    chart or a picture. A file may state its own light; --illuminant sets the light on reflectances and pictures,
    --luminance scales the scene. A lens is given by --f-number and --focal-length, or by --optics FILE. --camera FILE
    holds all of it.

    Corners of the ColorChecker for `photosite validate --corners`: its patches extend 62 P above and below the frame's
    center and 94 P to its left and right, with P = max(cols / 196, rows / 132) for square pixels. Where that would cut
    patches (124 P > rows or 188 P > cols, as for 4:3 sensors), P = min(cols / 196, rows / 132). The D200's corners are
    71.18,79.02 71.18,3792.98 2520.82,3792.98 2520.82,79.02.

    With --flicker or --motion, each row of a rolling shutter (--line-time) is exposed at its own time. --fps makes a
    video.

    \b
    Example: photosite simulate --scene siemens-star --f-number 4 --exposure 1/10 -o shot.dng
    Example: photosite simulate --exposure auto --frames 8 --clean clean.tif -o noisy.tif
    Example: photosite simulate --flicker 100Hz:0.3 --line-time 15 --luminance 2000 --exposure 1/500 -o bands.dng
    """
    from photosite.files.writing import date_of_files
    from photosite.frames.io.clean_mosaic import write_clean_mosaic
    from photosite.scene.dynamic_scene import DynamicScene
    from photosite.sensor.capture_readout import captures_of

    exposure_s, temperature_c, fps = (given.pop(name) for name in ("exposure_s", "temperature_c", "fps"))
    flicker, motion, preview, clean = (given.pop(name) for name in ("flicker", "motion", "preview", "clean"))
    set_up = _set_up(camera_file, given)
    camera, time_s = set_up.camera, set_up.exposure_s if exposure_s is None else exposure_s
    _check_format(camera.sensor, output)
    parts = captures_of(camera.sensor).names if captures else ()
    paths = [output] if frames == 1 else [_numbered(output, n, frames) for n in range(frames)]
    for path in paths:
        for name in ("", *parts):
            options.check_new(_capture_path(path, name))
    _check_memory(camera.sensor, set_up.cells_per_pixel, preview is not None)
    if camera.sensor.captures:
        say_if_compiling("charge._convert_charge", compile_captures)
    else:
        say_if_compiling("pixel_model._expose_drawn", compile_exposure)
    scene = set_up.seen.scene()
    seen = scene if flicker is None and motion is None else DynamicScene(scene, flicker, motion)
    per_second = camera.mean_electrons(scene, 1.0, progress=Stages())
    time_s = camera.auto_exposure_s(per_second) if isinstance(time_s, str) else time_s
    suggested_s = camera.auto_exposure_s(per_second) if per_second.any() else None
    if seen is scene:
        mean = np.multiply(per_second, np.float32(time_s), out=per_second)
    else:
        mean = camera.mean_electrons(seen, time_s)
    del per_second
    taken = date_of_files().replace(tzinfo=None, microsecond=0)
    progress = Stages()
    video = None if fps is None else camera.record(seen, frames, fps, time_s, seed=seed, temperature_c=temperature_c)
    for number, path in enumerate(paths):
        still = partial(camera.expose, mean, time_s, seed=seed, frame=number, scene=scene, temperature_c=temperature_c)
        raw = still() if video is None else next(video)
        at = taken if fps is None else taken + timedelta(seconds=number / fps)
        raw = replace(raw, metadata={**raw.metadata, "date_time": at.isoformat()})
        raw = _with_white_balance(raw, camera, set_up.scene.light)
        _save(raw, path, preview if number == 0 else None)
        for name in parts:
            raw.capture(name, camera.sensor).save(_capture_path(path, name))
        if number == 0:
            first = raw
            if clean is not None:
                write_clean_mosaic(camera.clean_dn(mean), raw, clean)
        progress(number + 1, frames)
    facts = _facts(first, camera, paths) | {
        "captures": {name: [str(_capture_path(path, name)) for path in paths] for name in parts}
    }
    facts |= {"preview": preview, "clean": clean, "scene": scene.name, "seed": seed}
    facts["suggested_exposure_s"] = suggested_s
    if (hint := _exposure_hint(camera, mean, facts["saturated_fraction"], suggested_s)) is not None:
        say(f"photosite: hint: {hint}")
    show(as_json, facts, lambda: _text(facts), preview=preview, clean=clean)


def _facts(first: RawFrame, camera: Camera, paths: list[Path]) -> dict[str, Any]:
    """Return what the frames are, by the first of them."""
    return {
        "path": paths[0],
        "paths": [str(path) for path in paths],
        "rows": first.shape[0],
        "cols": first.shape[1],
        "bits": first.bits,
        "black_level_dn": first.black_level_dn,
        "white_level_dn": first.white_level_dn,
        "exposure_s": first.exposure_s,
        "mean_dn": float(first.dn.mean()),
        "max_dn": int(first.dn.max()),
        "saturated_fraction": float((first.dn >= first.white_level_dn).mean()),
        "sensor": camera.sensor.name,
        "gain_setting": camera.sensor.gain_setting,
    }


def _text(facts: dict[str, Any]) -> str:
    paths = facts["paths"]
    names = paths[0] if len(paths) == 1 else f"{len(paths)} frames, {paths[0]} to {Path(paths[-1]).name}"
    return (
        f"wrote {names}: {facts['rows']} x {facts['cols']} pixels of {facts['sensor']}, {facts['scene']}, "
        f"{format_exposure(facts['exposure_s'])} s; mean {facts['mean_dn']:.1f} DN, max {facts['max_dn']} DN, "
        f"{100 * facts['saturated_fraction']:.3g} % saturated"
    )


_SATURATED_HINT = 0.02
"""Saturated fraction of the pixels above which another exposure time is suggested."""
_BLACK_HINT = 0.01
"""Fraction of the saturation capacity that the 99.5th percentile of the pixels stays below where a frame is black."""


def _exposure_hint(
    camera: Camera, mean: NDArray[np.float32], saturated: float, suggested_s: float | None
) -> str | None:
    """Return what to do with a frame that is mostly saturated or black; None for others."""
    if suggested_s is None:
        return "the frame is black: the scene sends no light to the sensor"
    what = f"--exposure {format_exposure(suggested_s)} (or auto) puts the bright parts just below saturation"
    if saturated > _SATURATED_HINT:
        return f"{100 * saturated:.3g} % of the pixels are saturated; {what}"
    if np.count_nonzero(mean < _BLACK_HINT * camera.sensor.saturation_capacity_e) > 0.995 * mean.size:
        return f"the frame is almost black; {what}"
    return None


def _check_memory(sensor: Sensor, cells_per_pixel: int, preview: bool) -> None:
    """Warn if the memory is short; keep no free memory for a large frame."""
    from photosite.cli.memory_need import megapixels, simulate_bytes, warn_if_short
    from photosite.engine.lazy_maps import is_large
    from photosite.engine.process import return_large_arrays

    if is_large((sensor.array.rows, sensor.array.cols)):
        return_large_arrays()

    what = f"a frame of {megapixels(sensor.array.rows, sensor.array.cols)}"
    wider = "Use fewer --cells" if cells_per_pixel > 1 else "Use fewer --rows and --cols"
    less = "Omit --preview" if preview else wider
    need = simulate_bytes(sensor, cells_per_pixel, preview=preview)
    warn_if_short(what, need, f"{less}, or a machine with more memory")


def _check_format(sensor: Sensor, output: Path) -> None:
    """Reject a file that does not hold the frames, before anything is computed."""
    from photosite.frames.io.formats import check_holds

    check_holds(output, sensor.output_bits, sensor.array.cfa)


def _numbered(path: Path, number: int, count: int) -> Path:
    """Return the path of one of several frames: shot.dng becomes shot-01.dng."""
    return path.with_name(f"{path.stem}-{number + 1:0{len(str(count))}d}{path.suffix}")


def _capture_path(path: Path, name: str) -> Path:
    """Return the path of a capture of a frame: shot.dng becomes shot.small.dng."""
    return path.with_name(f"{path.stem}.{name}{path.suffix}") if name else path


def _set_up(camera_file: Path | None, given: dict[str, Any]) -> SetUp:
    """Return the camera file's set-up, or the paper's, changed by the options."""
    from photosite.camera.file import SetUp, load_camera

    base = SetUp() if camera_file is None else load_camera(camera_file)
    sensor = options.sensor_or(base.sensor, given["sensor_name"])
    changes = {name: given[name] for name in ("rows", "cols", "black_level_dn", "line_time_us")}
    sensor = options.changed_sensor(sensor, given["gain_setting"], given["sensor_fields"], changes)
    if given["factor"] is None:
        options.only_for("--bin", "bin_kind")
    else:
        sensor = sensor.binned(given["factor"], given["bin_kind"])
    return replace(
        base,
        sensor=sensor,
        optics=_optics(base.optics, given),
        scene=_request(base.scene, given),
        cells_per_pixel=given["cells_per_pixel"] or base.cells_per_pixel,
    )


def _optics(base: Optics, given: dict[str, Any]) -> Optics:
    from photosite.optics.diffraction import DiffractionLimited

    changes = {name: given[name] for name in ("f_number", "focal_length_mm") if given[name] is not None}
    changes |= dict(given["lens_fields"])
    if unknown := [name for name in changes if name not in DiffractionLimited.__dataclass_fields__]:
        expected = ", ".join(DiffractionLimited.__dataclass_fields__)
        raise InputError("lens_fields", value=unknown[0], expected=f"one of {expected}")
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
        hint = "Set the light and position of each plane in the camera file"
        raise InputError("the options of a scene do not apply to planes", hint=hint)
    return base


def _with_white_balance(raw: RawFrame, camera: Camera, light: Any) -> RawFrame:
    """Return the frame with the white of the light that the options state, unless the scene gave one."""
    from photosite.scene.charts import uniform

    if light is None or "as_shot_neutral" in raw.metadata:
        return raw
    neutral = camera.as_shot_neutral(uniform(light, 1.0))
    return raw if neutral is None else replace(raw, metadata={**raw.metadata, "as_shot_neutral": neutral})


def _save(raw: RawFrame, output: Path, preview: Path | None) -> None:
    """Write frame and preview; both are made before either is written."""
    from photosite.develop.develop import develop, save_picture

    picture = None if preview is None else develop(raw)
    raw.save(output)
    if preview is not None and picture is not None:
        save_picture(picture, preview)
