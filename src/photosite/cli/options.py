"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from photosite.cli.command import NameValueOption
from photosite.errors import FileError, InputError
from photosite.values.exposure import parse_exposure

if TYPE_CHECKING:
    from photosite.optics.diffraction import DiffractionLimited
    from photosite.scene.scene import Scene
    from photosite.scene.scene_request import SceneRequest
    from photosite.sensor.model import Sensor

F = TypeVar("F", bound=Callable[..., Any])

RAW_SUFFIXES = (".dng", ".tif", ".tiff", ".png", ".h5", ".hdf5")
PICTURE_SUFFIXES = (".png",)


def exposure_time(text: str) -> float:
    """Parse seconds: a number, or a fraction such as 1/8000."""
    try:
        return parse_exposure(text)
    except InputError as error:
        raise click.BadParameter(str(error).removeprefix("exposure_s ")) from None


def above(limit: float = 0.0, *, or_equal: bool = False) -> Callable[[str | float], float]:
    """Return a parser of finite numbers above a limit, or at it."""
    wanted = f"{limit:g} or more" if or_equal else f"above {limit:g}"

    def number(text: str | float) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value) and (value > limit or (or_equal and value == limit)):
            return value
        raise click.BadParameter(f"must be a number {wanted}, got '{text}'")

    return number


def wavelengths_of(text: str) -> list[float]:
    """Parse wavelengths in nm: 400,410,420 or first:last:step."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = round((last - first) / step)
            if step <= 0 or not 1 <= count <= 100_000 or abs(first + count * step - last) > 1e-6 * step:
                raise ValueError
            return [first + k * step for k in range(count + 1)]
        return [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise click.BadParameter(f"must be 400,410,420 or first:last:step such as 400:700:10, got '{text}'") from None


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


def output_file(*suffixes: str) -> Callable[[str], Path]:
    """Return a parser of files to write; suffix and folder are checked before anything is computed."""

    def checked(text: str) -> Path:
        path = Path(text)
        _check_place(path)
        if path.is_dir():
            raise FileError(path, "cannot be written: it is a folder", hint="Name a file in it")
        if path.suffix.lower() not in suffixes:
            raise FileError(path, f"cannot be written: its name must end in {_either(suffixes)}")
        return path

    return checked


def _either(suffixes: tuple[str, ...]) -> str:
    """Return the suffixes as in a sentence: .a, .b or .c."""
    return " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))


def output_folder(text: str) -> Path:
    """Parse a folder to write, which does not exist or is empty."""
    path = Path(text)
    _check_place(path)
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise FileError(path, "exists and is not an empty folder", hint="Choose another name")
    return path


def shared_folder(text: str) -> Path:
    """Parse a folder to write, or to add files to where it exists."""
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


def sensor_option(default: str | None = "nikon-d200", *, shown: str | None = None) -> Callable[[F], F]:
    """Add --sensor; `shown` is a default that is applied later."""
    text = "Preset or sensor file (YAML)." + ("" if shown is None else f"  [default: {shown}]")
    return click.option("--sensor", "sensor_name", default=default, metavar="NAME|FILE", help=text)


def size_options(function: F) -> F:
    """Add --rows and --cols, for a chip of another size with the same pixels."""
    function = click.option("--cols", type=click.IntRange(1), help="Columns of the chip, instead of the sensor's.")(
        function
    )
    return click.option("--rows", type=click.IntRange(1), help="Rows of the chip, instead of the sensor's.")(function)


def black_level_option(text: str) -> Callable[[F], F]:
    """Add --black-level; `text` says what happens without it."""
    return click.option("--black-level", "black_level_dn", type=above(or_equal=True), metavar="DN", help=text)


def lens_options(function: F) -> F:
    """Add --f-number and --focal-length, of a diffraction-limited lens."""
    function = click.option(
        "--focal-length",
        "focal_length_mm",
        type=above(),
        default=50.0,
        metavar="MM",
        help="Focal length in mm.",
    )(function)
    return click.option("--f-number", type=above(), default=8.0, metavar="N", help="f-number.")(function)


LUMINANCE_HELP = (
    "Mean luminance of the scene in cd/m2: of a chart's patches (macbeth, color-checker-sg, hdr-patches, measured "
    "charts, and these saved as .h5), of all samples of any other scene."
)


def patches_luminance(scene: Scene) -> float | None:
    """Return the mean luminance of a chart's patches; None for other scenes."""
    return scene.nominal_luminance_cd_m2() if scene.patches and scene.regions else None


def luminance_line(scene: Scene) -> str:
    """Return a scene's mean luminance as text, with what it is the mean of."""
    over_all = f"{scene.mean_luminance_cd_m2():.4g} cd/m2"
    patches = patches_luminance(scene)
    if patches is None:
        return f"mean luminance {over_all}"
    return f"mean luminance {patches:.4g} cd/m2 of the patches, {over_all} of all samples"


class SceneOption(NameValueOption):
    """--scene-option NAME=VALUE: options of a built-in scene, and of reading a scene file."""

    def carries(self, field: str) -> bool:
        """Return whether it is an option of a scene."""
        from photosite.scene.built_in import BUILT_IN_SCENES, chart_options
        from photosite.scene.options import ReadOptions

        return field in ReadOptions.model_fields or any(field in chart_options(name) for name in BUILT_IN_SCENES)


def scene_options(function: F) -> F:
    """Add --scene and the options of the scene."""
    source = click.option(
        "--scene",
        "scene_source",
        metavar="NAME|FILE",
        help="A built-in scene or a scene file; `photosite scenes` lists them.  [default: macbeth]",
    )
    return source(_options_of_scene(function))


def scene_argument(function: F) -> F:
    """Add the scene as the command's argument, and its options."""
    return click.argument("scene_source", metavar="NAME|FILE")(_options_of_scene(function))


def _options_of_scene(function: F) -> F:
    for option in (
        click.option(
            "--tolerance",
            type=above(),
            metavar="T",
            help="Largest RMS error of the reduction of a scene file to few basis spectra, relative to the RMS.  "
            "[default: 0.001]",
        ),
        click.option(
            "--wavelengths",
            "wavelength_nm",
            type=wavelengths_of,
            metavar="START:STOP:STEP",
            help="Wavelengths in nm of a built-in scene, or of the bands of a file that does not state them: "
            "400:700:10 or 400,410,...",
        ),
        click.option("--units", metavar="UNIT", help="Units of the values of a scene file; they override the file's."),
        click.option(
            "--width",
            "width_m",
            type=above(),
            metavar="M",
            help="Width of the scene in m; without it, the scene fills the frame.",
        ),
        click.option(
            "--distance",
            "distance_m",
            type=above(),
            metavar="M",
            help="Distance from lens to scene in m.  [default: 1.2]",
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
            "'led 4000'), or a CSV file of a spectrum.  [default: A; a picture's D65; another file's own]",
        ),
        click.option(
            "--scene-option",
            "options",
            cls=SceneOption,
            type=name_and_value,
            multiple=True,
            metavar="NAME=VALUE",
            help="An option of the built-in scene (contrast=10; `photosite scenes` lists them), or of reading a file "
            "(no_data=zero, band_range_nm=[400,780], sort_bands=true, variable=NAME, method=jakob-hanika; "
            "docs/scenes.md); may be repeated.",
        ),
    ):
        function = option(function)
    return function


def request_of(base: SceneRequest, given: Mapping[str, Any]) -> SceneRequest:
    """Return the scene that the command line asks for; its options override those of a base."""
    if given["scene_source"] is not None:
        base = base.instead(given["scene_source"])
    options = options_of_scene(given)
    if not options:
        return base
    # Errors can now be in the command line, so they no longer name the camera file.
    return replace(base, place=None, options={**base.options, **options})


def options_of_scene(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a scene that are given."""
    from photosite.scene.scene_request import FIELDS, merged_options

    own = {name: given[name] for name in FIELDS.values() if given[name] is not None}
    return merged_options(own, dict(given["options"]))


def name_and_value(text: str) -> tuple[str, Any]:
    """Parse NAME=VALUE, the value as in YAML: a number, a list, true, or text."""
    from photosite.files.yaml import parse_yaml

    name, sign, value = text.partition("=")
    if not sign or not name.strip():
        raise click.BadParameter(f"must be NAME=VALUE, such as contrast=10, got '{text}'")
    if value.strip() == "inf":  # YAML writes .inf
        return name.strip().replace("-", "_"), math.inf
    parsed = parse_yaml(value, f"--scene-option {name}")
    return name.strip().replace("-", "_"), list(parsed) if isinstance(parsed, list) else parsed


def illuminant_option(default: str) -> Callable[[F], F]:
    """Add --illuminant."""
    return click.option(
        "--illuminant", default=default, metavar="NAME", help="CIE illuminant (A, D65, ...) or blackbody (3200K)."
    )


def seed_option(default: int = 0) -> Callable[[F], F]:
    """Add --seed."""
    return click.option("--seed", type=click.IntRange(0, 2**64 - 1), default=default, help="Key of the temporal noise.")


def json_option(function: F) -> F:
    """Add --json."""
    return click.option("--json", "as_json", is_flag=True, help="Print one JSON object, and nothing else.")(function)


def output_option(*suffixes: str, text: str, default: str | None = None) -> Callable[[F], F]:
    """Add -o / --output, a file; it is required where it has no default."""
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
    """Return a sensor with the given size and black level."""
    from photosite.sensor.io.sensor_file import load_sensor

    changes: dict[str, Any] = {"rows": rows, "cols": cols, "black_level_dn": black_level}
    return load_sensor(name).with_(**{name: value for name, value in changes.items() if value is not None})


def lens(f_number: float, focal_length: float) -> DiffractionLimited:
    """Return a diffraction-limited lens."""
    from photosite.optics.diffraction import DiffractionLimited

    return DiffractionLimited(f_number=f_number, focal_length_mm=focal_length)
