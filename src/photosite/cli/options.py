"""Options that several commands share, and the types they parse to."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photosite.errors import FileError, InputError
from photosite.values.exposure import parse_exposure

if TYPE_CHECKING:
    from photosite.optics.diffraction import DiffractionLimited
    from photosite.scene.request import SceneRequest
    from photosite.scene.scene import Scene
    from photosite.sensor.model import Sensor

F = TypeVar("F", bound=Callable[..., Any])

RAW_SUFFIXES = (".dng", ".tif", ".tiff", ".png", ".h5", ".hdf5")
PICTURE_SUFFIXES = (".png",)


def exposure_time(text: str) -> float:
    """Seconds, from a number or from 1/8000."""
    try:
        return parse_exposure(text)
    except InputError as error:
        raise click.BadParameter(str(error)) from None


def above(limit: float = 0.0, *, or_equal: bool = False) -> Callable[[str | float], float]:
    """A finite number above a limit, or at it."""
    wanted = f"{limit:g} or more" if or_equal else f"above {limit:g}"

    def number(text: str | float) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value) and (value > limit or (or_equal and value == limit)):
            return value
        raise click.BadParameter(f"expected a number {wanted}, not '{text}'")

    return number


def wavelengths_of(text: str) -> list[float]:
    """Numbers in nm: 400,410,420 or first:last:step."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = round((last - first) / step)
            if step <= 0 or not 1 <= count <= 100_000 or abs(first + count * step - last) > 1e-6 * step:
                raise ValueError
            return [first + k * step for k in range(count + 1)]
        return [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise click.BadParameter(f"expected 400,410,420 or first:last:step such as 400:700:10, not '{text}'") from None


def bands_of(text: str) -> tuple[float, float]:
    """Two wavelengths in nm: 400:780."""
    try:
        first, last = map(float, text.split(":"))
    except ValueError:
        first = last = math.nan
    if not 0 < first <= last < math.inf:
        raise click.BadParameter(f"expected FIRST:LAST in nm, such as 400:780, not '{text}'")
    return first, last


def output_file(*suffixes: str) -> Callable[[str], Path]:
    """A file to be written, by the endings it may have; it and its folder are checked before anything is computed."""

    def checked(text: str) -> Path:
        path = Path(text)
        _check_place(path)
        if path.is_dir():
            raise FileError(path, "cannot be written: it is a folder; name a file in it")
        if path.suffix.lower() not in suffixes:
            raise FileError(path, f"cannot be written: its name must end in {' or '.join(suffixes)}")
        return path

    return checked


def output_folder(text: str) -> Path:
    """A folder to be written: it must not exist, or be empty."""
    path = Path(text)
    _check_place(path)
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise FileError(path, "exists already and is not an empty folder; choose another name")
    return path


def shared_folder(text: str) -> Path:
    """A folder to be written, or to be added to where it exists."""
    path = Path(text)
    _check_place(path)
    if path.exists() and not path.is_dir():
        raise FileError(path, "cannot be written: it is a file, not a folder")
    return path


def _check_place(path: Path) -> None:
    if not path.absolute().parent.is_dir():
        raise FileError(path, f"cannot be written: there is no folder {path.parent}")
    if not os.access(path.absolute().parent, os.W_OK):
        raise FileError(path, f"cannot be written: the folder {path.parent} is read-only")


def sensor_option(default: str | None = "nikon-d200") -> Callable[[F], F]:
    """--sensor."""
    return click.option(
        "--sensor", "sensor_name", default=default, metavar="NAME|FILE", help="Preset or sensor file (YAML)."
    )


def size_options(function: F) -> F:
    """--rows and --cols, for a smaller chip of the same pixels."""
    function = click.option("--cols", type=click.IntRange(1), help="Columns of a smaller (or larger) chip.")(function)
    return click.option("--rows", type=click.IntRange(1), help="Rows of a smaller (or larger) chip.")(function)


def black_level_option(text: str) -> Callable[[F], F]:
    """--black-level, with what leaving it out means."""
    return click.option("--black-level", "black_level_dn", type=above(or_equal=True), metavar="DN", help=text)


def lens_options(function: F) -> F:
    """--f-number and --focal-length, of a lens limited by diffraction."""
    function = click.option(
        "--focal-length", "focal_length_mm", type=above(), default=50.0, metavar="MM", help="Focal length in mm."
    )(function)
    return click.option("--f-number", type=above(), default=8.0, metavar="N", help="f-number.")(function)


LUMINANCE_HELP = (
    "Mean luminance wanted, in cd/m2: of a chart's patches (macbeth, color-checker-sg, hdr-patches, measured charts, "
    "and these saved as .h5), of all samples of any other scene."
)


def patches_luminance(scene: Scene) -> float | None:
    """Mean luminance of a chart's patches; None of a scene that is no chart of patches."""
    return scene.said_luminance_cd_m2() if scene.patches and scene.regions else None


def luminance_line(scene: Scene) -> str:
    """A scene's mean luminance, and what it is the mean of."""
    over_all = f"{scene.mean_luminance_cd_m2():.4g} cd/m2"
    patches = patches_luminance(scene)
    if patches is None:
        return f"mean luminance {over_all}"
    return f"mean luminance {patches:.4g} cd/m2 of the patches, {over_all} of all samples"


def scene_options(function: F) -> F:
    """--scene and what is said of it; None where nothing is."""
    source = click.option(
        "--scene",
        "scene_source",
        metavar="NAME|FILE",
        help="What is seen: a formula's name, or a scene's file; photosite scenes lists them.  [default: macbeth]",
    )
    return source(_said_of_scene(function))


def scene_argument(function: F) -> F:
    """The scene as the command's argument, and what is said of it."""
    return click.argument("scene_source", metavar="NAME|FILE")(_said_of_scene(function))


def _said_of_scene(function: F) -> F:
    for option in (
        click.option(
            "--tolerance",
            type=above(),
            metavar="T",
            help="Of a file's reduction to few spectra: largest RMS error, relative to the RMS.  [default: 0.001]",
        ),
        click.option(
            "--wavelengths",
            "wavelength_nm",
            type=wavelengths_of,
            metavar="START:STOP:STEP",
            help="Of a formula's scene, or of a file's bands where it does not say, in nm: 400:700:10 or 400,410,...",
        ),
        click.option(
            "--units", metavar="UNIT", help="What a scene's file holds, where it does not say, or says wrong."
        ),
        click.option(
            "--width", "width_m", type=above(), metavar="M", help="Width of the scene, in m; else it fills the frame."
        ),
        click.option(
            "--distance", "distance_m", type=above(), metavar="M", help="From lens to scene, in m.  [default: 1.2]"
        ),
        click.option(
            "--luminance",
            "mean_luminance_cd_m2",
            type=above(),
            metavar="CD/M2",
            help=f"{LUMINANCE_HELP}  [default: 40; a file's own]",
        ),
        click.option(
            "--illuminant",
            metavar="NAME",
            help="CIE illuminant (A, D65, FL2, ...), blackbody (3200K), daylight or white LED ('daylight 5600', "
            "'led 4000'), or a CSV file of a light.  [default: A; a picture's D65; another file's own]",
        ),
        click.option(
            "--scene-option",
            "scene_options",
            type=name_and_value,
            multiple=True,
            metavar="NAME=VALUE",
            help="An option of the scene's formula (contrast=10; photosite scenes lists them), or of how a file is "
            "read (no_data=zero, band_range_nm=[400,780], sort_bands=true, variable=NAME, "
            "a picture's method=jakob-hanika; docs/scenes.md); "
            "may be repeated.",
        ),
    ):
        function = option(function)
    return function


def request_of(base: SceneRequest, told: Mapping[str, Any]) -> SceneRequest:
    """What is asked for: a base, with what the options of a scene say put in its place."""
    if told["scene_source"] is not None:  # another scene, which the base's light and place are for
        base = base.instead(told["scene_source"])
    given = said_of_scene(told)
    if given:  # errors may be of these, and not of the camera file
        base = replace(base, place=None)
    return replace(base, **{**given, "options": {**base.options, **given.get("options", {})}})


def said_of_scene(told: Mapping[str, Any]) -> dict[str, Any]:
    """What the options say of a scene, by the fields of a `SceneRequest`."""
    said = {
        "illuminant": told["illuminant"],
        "mean_luminance_cd_m2": told["mean_luminance_cd_m2"],
        "distance_m": told["distance_m"],
        "width_m": told["width_m"],
        "units": told["units"],
        "wavelength_nm": told["wavelength_nm"],
        "tolerance": told["tolerance"],
        "options": dict(told["scene_options"]) or None,
    }
    return {name: value for name, value in said.items() if value is not None}


def name_and_value(text: str) -> tuple[str, Any]:
    """NAME=VALUE, the value read as YAML has it: a number, a list, true, or text."""
    from photosite.files.yaml import parse_yaml

    name, sign, value = text.partition("=")
    if not sign or not name.strip():
        raise click.BadParameter(f"expected NAME=VALUE, such as contrast=10, not '{text}'")
    if value.strip() == "inf":  # YAML's is .inf
        return name.strip().replace("-", "_"), math.inf
    return name.strip().replace("-", "_"), parse_yaml(value, f"--scene-option {name}")


def illuminant_option(default: str) -> Callable[[F], F]:
    """--illuminant."""
    return click.option(
        "--illuminant", default=default, metavar="NAME", help="CIE illuminant (A, D65, ...) or blackbody (3200K)."
    )


def seed_option(default: int = 0) -> Callable[[F], F]:
    """--seed."""
    return click.option("--seed", type=click.IntRange(0, 2**64 - 1), default=default, help="Key of the temporal noise.")


def json_option(function: F) -> F:
    """--json."""
    return click.option(
        "--json", "as_json", is_flag=True, help="Print one JSON object on standard output, nothing else there."
    )(function)


def output_option(*suffixes: str, text: str, default: str | None = None) -> Callable[[F], F]:
    """-o / --output, a file; required where it has no default."""
    return click.option(
        "-o",
        "--output",
        type=output_file(*suffixes),
        metavar="FILE",
        default=default,
        required=default is None,
        help=text,
    )


def load_sensor_resized(name: str, rows: int | None, cols: int | None, black_level: float | None = None) -> Sensor:
    """The sensor asked for, with the size and black level asked for."""
    from photosite.sensor.io.sensor_file import load_sensor

    changes: dict[str, Any] = {"rows": rows, "cols": cols, "black_level_dn": black_level}
    return load_sensor(name).with_(**{name: value for name, value in changes.items() if value is not None})


def lens(f_number: float, focal_length: float) -> DiffractionLimited:
    """The lens asked for."""
    from photosite.optics.diffraction import DiffractionLimited

    return DiffractionLimited(f_number=f_number, focal_length_mm=focal_length)
