"""Options that several commands share, and the types of their values."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from photosite.cli.command import NameValueOption, OptionSpelling, overwrites, writes_file
from photosite.errors import FileError, InputError
from photosite.values.exposure import parse_exposure
from photosite.values.limits import LIMITS_OF_OTHERS

if TYPE_CHECKING:
    from photosite.scene.flicker import Flicker
    from photosite.scene.motion import Motion
    from photosite.scene.scene import Scene
    from photosite.scene.scene_request import SceneRequest
    from photosite.sensor.model import Sensor

F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")
REPORT_SUFFIXES = (".html", ".pdf")
SENSOR_SUFFIXES = (".yaml", ".yml")


# Types of values


class Whole(click.IntRange):
    """Whole numbers from a lowest to a highest one; help and errors state the limits in words."""

    name = "integer"
    largest = 10**9
    """The highest number where none is stated."""

    def __init__(self, lowest: int, highest: int = largest) -> None:
        super().__init__(lowest, highest)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Parse a number within the limits."""
        try:
            return int(super().convert(value, param, ctx))
        except click.BadParameter:
            limits = self._describe_range() or f"{self.min} or more"
            if limits.endswith("more") and str(value).strip().isdecimal() and len(str(value).strip()) > 9:
                limits = f"{self.min} to {self.max}"
            self.fail(f"must be a whole number, {limits}, got {value}", param, ctx)

    def _describe_range(self) -> str:
        if self.max in (None, self.largest):  # 1 or more, which needs no explanation
            return ""
        power = math.log2(self.max + 1)
        return f"{self.min} to " + (f"2^{power:.0f}-1" if power >= 32 else str(self.max))


def exposure_time(text: str) -> float:
    """Parse an exposure time: 0.005, 1/200 or 5ms."""
    try:
        return parse_exposure(text)
    except InputError as error:
        raise click.BadParameter(str(error).removeprefix("exposure_s ")) from None


def exposure_time_or_auto(text: str) -> float | str:
    """Parse an exposure time, or auto."""
    return text if text == "auto" else exposure_time(text)


def above(limit: float = 0.0, *, or_equal: bool = False) -> Callable[[str | float], float]:
    """Return a parser of finite numbers above a limit, or at it."""
    wanted = f"{limit:g} or more" if or_equal else f"above {limit:g}"

    def number(text: str | float) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and (value > limit or (or_equal and value == limit))):
            raise click.BadParameter(f"must be a number {wanted}, got '{text}'")
        smallest, largest = LIMITS_OF_OTHERS
        if value and not smallest <= abs(value) <= largest:
            raise click.BadParameter(f"must be a number {wanted}, from {smallest:g} to {largest:g}, got '{text}'")
        return value

    return number


def flicker_of(text: str) -> Flicker:
    """Parse the flicker of a light.

    100Hz:0.2 is the depth of a sine, 250Hz:duty=0.3 that of pulses, each also with :phase=90, and 100Hz:table=1,2,1 is
    a table over one period.
    """
    from photosite.scene.flicker import PulseFlicker, SineFlicker, TableFlicker

    frequency, _, rest = text.partition(":")
    size, _, phase = rest.partition(":phase=")
    try:
        hertz, phase_deg = float(frequency.lower().removesuffix("hz")), float(phase or 0.0)
        kind, _, numbers = size.rpartition("=")
        table = [float(part) for part in numbers.split(",")]
        if kind not in ("", "duty", "table") or (kind == "table" and phase) or (kind != "table" and len(table) > 1):
            raise ValueError
    except ValueError:
        raise click.BadParameter(f"must be 100Hz:0.2, 250Hz:duty=0.3 or 100Hz:table=1,2,1, got '{text}'") from None
    try:
        if kind == "table":
            return TableFlicker(hertz, table)
        return PulseFlicker(hertz, table[0], phase_deg) if kind else SineFlicker(hertz, table[0], phase_deg)
    except InputError as error:
        raise click.BadParameter(str(error)) from None


def motion_of(text: str) -> Motion:
    """Parse a motion: rows and columns per second, then degrees per second, then relative growth per second."""
    from photosite.scene.motion import Motion

    try:
        rows, cols, *turn = (float(part) for part in text.split(","))
        return Motion(rows, cols, *turn)
    except (ValueError, TypeError, InputError):
        expected = "ROWS,COLS, ROWS,COLS,DEGREES or ROWS,COLS,DEGREES,GROWTH per second"
        raise click.BadParameter(f"must be {expected}, got '{text}'") from None


def wavelengths_of(text: str) -> list[float]:
    """Parse wavelengths in nm: 400,410,420 or first:last:step."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = round((last - first) / step)
            if step <= 0 or not 1 <= count <= 10_000 or abs(first + count * step - last) > 1e-6 * step:
                raise ValueError
            return [first + k * step for k in range(count + 1)]
        return [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise click.BadParameter(f"must be 400,410,420 or first:last:step such as 400:700:10, got '{text}'") from None


def name_and_text(text: str) -> tuple[str, str]:
    """Parse NAME=VALUE, the value as text."""
    name, sign, value = text.partition("=")
    if not sign or not name.strip():
        raise click.BadParameter(f"must be NAME=VALUE, such as contrast=10, got '{text}'")
    return name.strip(), value


def name_and_value(text: str) -> tuple[str, Any]:
    """Parse NAME=VALUE, the value as in YAML: a number, a list, true, or text."""
    from photosite.files.yaml import parse_yaml

    name, value = name_and_text(text)
    if value.strip() == "inf":  # YAML writes .inf
        return name.replace("-", "_"), math.inf
    parsed = parse_yaml(value, f"option {name}")
    return name.replace("-", "_"), list(parsed) if isinstance(parsed, list) else parsed


def output_file(*suffixes: str) -> Callable[[str], Path]:
    """Return a parser of files to write; suffix and folder are checked before anything is computed.

    An existing file is an error without `--force`, which every command with such a parameter has.
    """

    @writes_file
    def checked(text: str) -> Path:
        path = Path(text)
        _check_place(path)
        if path.is_dir():
            raise FileError(path, "cannot be written: it is a folder", hint="Name a file in it")
        if path.suffix.lower() not in suffixes:
            either = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
            raise FileError(path, f"cannot be written: its name must end in {either}")
        check_new(path)
        return path

    return checked


def check_new(path: Path) -> None:
    """Raise `FileError` for a file to write that exists, unless the command has --force."""
    if path.exists() and not overwrites():
        raise FileError(path, "the file exists already", hint="Choose another name, or add --force to overwrite it")


@writes_file
def scene_file(text: str) -> Path:
    """Parse a scene file to write, in any format of `photosite.scene.io.formats` that holds whole scenes."""
    from photosite.scene.io.formats import suffixes_of_scenes

    return output_file(*suffixes_of_scenes())(text)


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


# Options


def stacked(*options: Callable[[Any], Any]) -> Callable[[F], F]:
    """Add several options, in the order of the help."""

    def add(function: F) -> F:
        for option in reversed(options):
            function = option(function)
        return function

    return add


def option(*names: str, default: Any = None, **settings: Any) -> Callable[[F], F]:
    """Add an option; a default of None is left out, because click takes it for a value of a required option."""
    return click.option(*names, **settings, **({} if default is None else {"default": default}))


def quantity(*names: str, unit: str, text: str, default: float | None = None, zero: bool = False) -> Callable[[F], F]:
    """Add an option for a finite number above 0; with `zero`, for 0 too."""
    return option(*names, type=above(or_equal=zero), metavar=unit, default=default, help=text)


def path_option(*names: str, text: str, required: bool = False) -> Callable[[F], F]:
    """Add an option for a path that is not checked."""
    return click.option(*names, type=click.Path(path_type=Path), metavar="FILE", required=required, help=text)


def file_option(
    *names: str, suffixes: tuple[str, ...], text: str, default: str | None = None, required: bool = False
) -> Callable[[F], F]:
    """Add an option for a file to write."""
    kind = output_file(*suffixes)
    return option(*names, type=kind, metavar="FILE", default=default, required=required, help=text)


def folder_option(kind: Callable[[str], Path], text: str, default: str | None = None) -> Callable[[F], F]:
    """Add -o / --output, a folder to write."""
    return option("-o", "--output", type=kind, metavar="FOLDER", default=default, required=default is None, help=text)


scene_file_option = option(
    *("-o", "--output"),
    type=scene_file,
    metavar="FILE",
    required=True,
    help="Scene to write: .h5 (photosite's own), or another format that `photosite scenes list` lists as written.",
)


def sensor_option(default: str | None = None, *, text: str = "Preset or sensor file (YAML).") -> Callable[[F], F]:
    """Add --sensor."""
    return option("--sensor", "sensor_name", default=default, metavar="NAME|FILE", help=text)


class SensorOption(NameValueOption):
    """--sensor-option NAME=VALUE: fields of the sensor file."""

    def carries(self, field: str) -> bool:
        """Return whether it is a field of a sensor."""
        from photosite.sensor.io.sensor_file import load_sensor

        return field in load_sensor("nikon-d200").field_names


class LensOption(NameValueOption):
    """--lens-option NAME=VALUE: fields of the diffraction-limited lens without an option of their own."""

    def carries(self, field: str) -> bool:
        """Return whether it is a field of the lens."""
        return field in ("transmittance", "falloff")


sensor_fields_option = click.option(
    "--sensor-option",
    "sensor_fields",
    cls=SensorOption,
    type=name_and_value,
    multiple=True,
    metavar="NAME=VALUE",
    help="A field of the sensor file, in any of its units (read_noise_e=3, prnu_percent=0.5, serial='2', "
    "telegraph_noise={fraction: 0.01, amplitude_e: 20}); may be repeated.",
)

where_option = click.option(
    "--where",
    multiple=True,
    metavar="NAME=VALUE",
    help="Frames of one setting, where files state several: filter=R, binning=2x2, read_mode, offset_setting, "
    "subframe, set_temperature_c, camera, serial_number, part, gain_setting, unit (number in a file of several). May "
    "be repeated, with another name; upper and lower case are the same.",
)
"""The option of `open_settings` and `open_frames` that selects frames by their conditions."""

lens_fields_option = click.option(
    "--lens-option",
    "lens_fields",
    cls=LensOption,
    type=name_and_value,
    multiple=True,
    metavar="NAME=VALUE",
    help="transmittance (0 to 1) or falloff (none, cos4) of a diffraction-limited lens; may be repeated.",
)


def size_options(rows: int | None = None, cols: int | None = None) -> Callable[[F], F]:
    """Add --rows and --cols, for a chip of another size with the same pixels."""
    where = "of the chip, instead of the sensor's." if rows is None else "of the virtual chip."
    return stacked(
        option("--rows", type=Whole(1), metavar="N", default=rows, help=f"Rows {where}"),
        option("--cols", type=Whole(1), metavar="N", default=cols, help=f"Columns {where}"),
    )


gain_setting_option = quantity(
    "--gain-setting",
    unit="ISO",
    text="Gain setting of a sensor file with several.  [default: that of the file's first values]",
)


def black_level_option(text: str) -> Callable[[F], F]:
    """Add --black-level; `text` says for what, or what happens without it."""
    return quantity("--black-level", "black_level_dn", unit="DN", zero=True, text=f"Black level in DN{text}.")


def virtual_sensor_options(function: F) -> F:
    """Add the options of a virtual sensor whose dark frames do not clip, for `prepared_sensor`."""
    level = black_level_option("; by default one at which dark frames do not clip at 0")
    return stacked(sensor_option("nikon-d200"), gain_setting_option, size_options(), sensor_fields_option, level)(
        function
    )


def virtual_light_options(photons: str) -> Callable[[F], F]:
    """Add the options of the light in a virtual measurement; `photons` is the help of --photons."""
    return stacked(
        click.option("--illuminant", default="D65", metavar="NAME", help=ILLUMINANT_HELP),
        quantity(
            "--level",
            unit="X",
            default=1.3,
            text="Light level: signal of the brightest channel at the longest exposure time, relative to saturation.",
        ),
        click.option("--photons", is_flag=True, help=photons),
    )


ILLUMINANT_HELP = "CIE illuminant (A, D65, ...) or blackbody (3200K)."


def _corner(text: str) -> tuple[float, float]:
    """Parse row,col."""
    if text[:1] == "-" and not text[1:2].isdecimal():
        raise click.BadParameter(f"must be four corners row,col row,col row,col row,col, got fewer before {text}")
    try:
        row, col = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"must be row,col in pixels, such as 412,388, got '{text}'") from None
    return row, col


def corners_option(text: str) -> Callable[[F], F]:
    """Add --corners, four times row,col."""
    return click.option("--corners", nargs=4, type=_corner, metavar="R,C R,C R,C R,C", help=text)


READING = ("bits", "cfa", "region", "layout")
"""Names of the options that `reading_options` adds, which are those of `read_raw` and `open_frames`."""


def number_options(kind: str = "files", default: str = "") -> Callable[[F], F]:
    """Add --bits and --cfa, for frames that do not state them."""
    text = f"for {kind} that do not state it.{default}"
    return stacked(
        click.option("--bits", type=Whole(1, 16), metavar="N", help=f"Bit depth, {text}"),
        click.option("--cfa", metavar="TILE", help=f"Color filter array (rggb, RRGG/RRGG/GGBB/GGBB, ...), {text}"),
    )


reading_options = stacked(
    number_options(),
    click.option(
        "--region",
        metavar="SECTION",
        help="Pixels with light, for files that do not state them. '[1:1920,1:1080]' is columns, then rows, from 1 on, "
        "as in IRAF; 0:1080,0:1920 is rows, then columns, as in NumPy.",
    ),
    click.option(
        "--layout",
        metavar="LAYOUT",
        help="Pixels of headerless files: 3280x2464,uint16,little,offset=0,stride=6560 or "
        "4056x3040,packed=mipi12,stride=6112. Also packed=mipi10, packed=nikon12, packed=d100, uint8, big.",
    ),
)
"""The options of `READING`."""


def lens_options(*, late: bool = False) -> Callable[[F], F]:
    """Add --f-number and --focal-length, of a diffraction-limited lens; with `late`, the command sets the defaults."""

    def lens_option(*names: str, unit: str, text: str, default: float) -> Callable[[F], F]:
        text += f"  [default: {default:g}]" if late else ""
        return quantity(*names, unit=unit, text=text, default=None if late else default)

    return stacked(
        lens_option("--f-number", unit="N", text="f-number of a diffraction-limited lens.", default=8.0),
        lens_option("--focal-length", "focal_length_mm", unit="MM", text="Focal length in mm.", default=50.0),
    )


def exposure_option(
    name: str = "--exposure", argument: str = "exposure_s", *, text: str, default: str | None = None
) -> Callable[[F], F]:
    """Add an exposure time, by default --exposure."""
    return option(name, argument, type=exposure_time, metavar="TIME", default=default, help=text)


unstated_exposure_option = exposure_option(text="Exposure time of frames that state none: 20ms, 1/60, 0.5 (seconds).")


def tolerance_percent_option(default: float, text: str) -> Callable[[F], F]:
    """Add --tolerance of a comparison."""
    return quantity("--tolerance", "tolerance_percent", unit="PERCENT", default=default, zero=True, text=text)


level_option = quantity("--level", unit="P", default=0.05, text="False-alarm rate of the verdict where there is noise.")


def seed_option(default: int = 0) -> Callable[[F], F]:
    """Add --seed."""
    return option("--seed", type=Whole(0, 2**64 - 1), default=default, help="Key of the temporal noise.")


def workers_options(processes: int = 1) -> Callable[[F], F]:
    """Add --processes and --dask, of which a call gives one, for work that is the same on any number of workers."""

    def one_of_both(function: F) -> F:
        @wraps(function)
        def checked(*args: Any, **given: Any) -> Any:
            context = click.get_current_context()
            if given["scheduler"] is not None and is_given(context, "processes"):
                raise click.UsageError(
                    "--processes does not apply to --dask, whose workers do the work; omit one", context
                )
            return function(*args, **given)

        return cast(F, checked)

    return stacked(
        click.option(
            "--processes",
            type=Whole(1, 1024),
            metavar="N",
            default=processes,
            help="Local processes; the result is the same.",
        ),
        click.option(
            "--dask",
            "scheduler",
            metavar="ADDRESS",
            help="Dask scheduler, such as tcp://10.0.0.1:8786, whose workers do the work instead (needs the extra "
            "distributed).",
        ),
        one_of_both,
    )


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object, and nothing else.")


# Scenes

LUMINANCE_HELP = (
    "Mean luminance of the scene in cd/m2: of a chart's patches (macbeth, color-checker-sg, hdr-patches, measured "
    "charts, and these saved as .h5), of all samples of any other scene."
)


def luminance_option(text: str = LUMINANCE_HELP, default: float | None = None) -> Callable[[F], F]:
    """Add --luminance."""
    return quantity("--luminance", "mean_luminance_cd_m2", unit="CD/M2", default=default, text=text)


def values_option() -> Callable[[F], F]:
    """Add --value, for names of image quality."""
    text = "A value of image quality of simulated charts as a column, such as edge-sfr.mtf50; may be repeated."
    return click.option("--value", "values", multiple=True, metavar="NAME", help=text)


def distance_option(text: str = "Distance from lens to scene in m.", default: float | None = None) -> Callable[[F], F]:
    """Add --distance."""
    return quantity("--distance", "distance_m", unit="M", default=default, text=text)


def wavelengths_option(text: str, default: str | None = None) -> Callable[[F], F]:
    """Add --wavelengths."""
    return option("--wavelengths", "wavelength_nm", type=wavelengths_of, metavar="NM", default=default, help=text)


def cube_options(wavelengths: str) -> Callable[[F], F]:
    """Add the options of reading a scene file that all commands have; `wavelengths` is the help of --wavelengths."""
    return stacked(
        luminance_option(f"{LUMINANCE_HELP}  [default: the file's own; 40 for built-in scenes]"),
        distance_option("Distance from lens to scene in m.  [default: a file's own, or 1.2]"),
        quantity(
            "--width", "width_m", unit="M", text="Width of the scene in m; without it, the scene fills the frame."
        ),
        click.option(
            "--units",
            metavar="UNITS",
            help="Units of the values of a scene file; they override the file's. W/sr/m2/nm, photons/s/sr/m2/nm, "
            "reflectance, percent, reflectance/10000, relative; for a Radiance picture: radiance.",
        ),
        wavelengths_option(wavelengths),
        quantity(
            "--tolerance",
            unit="T",
            text="Largest RMS error of the reduction of a scene file to few basis spectra, relative to the RMS.  "
            "[default: 0.001]",
        ),
    )


class SceneOption(NameValueOption):
    """--scene-option NAME=VALUE: options of a built-in scene, and of reading a scene file."""

    def carries(self, field: str) -> bool:
        """Return whether it is an option of a scene."""
        from photosite.scene.options import ReadOptions
        from photosite.scene.scene_request import BUILT_IN_SCENES, chart_options

        return field in ReadOptions.model_fields or any(field in chart_options(name) for name in BUILT_IN_SCENES)


_OPTIONS_OF_SCENE = stacked(
    click.option(
        "--scene-option",
        "options",
        cls=SceneOption,
        type=name_and_value,
        multiple=True,
        metavar="NAME=VALUE",
        help="An option of the built-in scene (contrast=10; `photosite scenes list` lists them), or of reading a file "
        "(no_data=zero, band_range_nm=[400,780], sort_bands=true, variable=NAME, method=jakob-hanika; "
        "docs/howto/spectral-cubes.md); may be repeated.",
    ),
    click.option(
        "--illuminant",
        metavar="NAME",
        help="CIE illuminant (A, D65, FL2, ...), blackbody (3200K), daylight or white LED ('daylight 5600', "
        "'led 4000'), sunlight to 4000 nm ('sunlight'), or a CSV file of a spectrum.  [default: A; a picture's D65; "
        "another file's own]",
    ),
    cube_options(
        "Wavelengths in nm of a built-in scene, or of the bands of a file that does not state them: 400:700:10 or "
        "400,410,..."
    ),
)

scene_options = stacked(
    click.option(
        "--scene",
        "scene_source",
        metavar="NAME|FILE",
        help="A built-in scene or a scene file; `photosite scenes list` lists them.  [default: macbeth]",
    ),
    _OPTIONS_OF_SCENE,
)
"""--scene and the options of the scene."""

scene_argument = stacked(click.argument("scene_source", metavar="NAME|FILE"), _OPTIONS_OF_SCENE)
"""The scene as the command's argument, and its options."""


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


def scene_facts(scene: Scene) -> dict[str, Any]:
    """Return a scene's properties for JSON."""
    return {
        "rows": scene.shape[0],
        "cols": scene.shape[1],
        "mean_luminance_cd_m2": scene.mean_luminance_cd_m2(),
        "sample_luminance_cd_m2": scene.sample_luminance_cd_m2(),
        "relative_error": scene.relative_error,
        "distance_m": scene.distance_m,
        "width_m": scene.width_m,
    }


def luminance_line(scene: Scene) -> str:
    """Return a scene's mean luminance as text, with what it is the mean of."""
    mean = f"mean luminance {scene.mean_luminance_cd_m2():.4g} cd/m2"
    if not (scene.patches and scene.regions):
        return mean
    return f"{mean} of the patches, {scene.sample_luminance_cd_m2():.4g} cd/m2 of all samples"


# Sensors


def prepared_sensor(
    sensor_name: str,
    rows: int | None,
    cols: int | None,
    black_level_dn: float | None = None,
    gain_setting: float | None = None,
    sensor_fields: Sequence[tuple[str, Any]] = (),
    *,
    pedestal: bool = True,
) -> tuple[Sensor, str]:
    """Return a sensor, with a black level at which dark frames do not clip unless one is given, and a note on it."""
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.studies.virtual_lab import dark_noise_dn, with_pedestal

    changes = {"rows": rows, "cols": cols, "black_level_dn": black_level_dn}
    sensor = changed_sensor(load_sensor(sensor_name), gain_setting, sensor_fields, changes)
    stated = black_level_dn is not None or "black_level_dn" in dict(sensor_fields)
    raised = with_pedestal(sensor) if pedestal and not stated else sensor
    if raised is sensor:
        return sensor, ""
    own, high = (each.readout.black_level_dn.value for each in (sensor, raised))
    return raised, (
        f"black level raised from {own:g} to {high:g} DN: dark frames with {dark_noise_dn(sensor):.2f} DN of noise "
        "would clip at 0"
    )


def changed_sensor(
    sensor: Sensor, gain_setting: float | None, fields: Sequence[tuple[str, Any]], changes: Mapping[str, Any]
) -> Sensor:
    """Return a sensor with --gain-setting, --sensor-option, and the changes of other options that are not None."""
    from photosite.sensor.gain_table import changed_at_setting

    given = {name: value for name, value in changes.items() if value is not None}
    return changed_at_setting(sensor, gain_setting, {**dict(fields), **given})


def sensor_or(default: T, name: str | None) -> Sensor | T:
    """Return the sensor of --sensor, or the default where it is not given."""
    if name is None:
        return default
    from photosite.sensor.io.sensor_file import load_sensor

    return load_sensor(name)


def is_given(ctx: click.Context, name: str) -> bool:
    """Return whether a parameter of a command was given on the command line."""
    return ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def only_for(what: str, *names: str) -> None:
    """Raise a usage error if one of these parameters was given to the current command: they apply to `what` only."""
    _refuse(names, f"applies to {what} only")


def not_for(what: str, *names: str) -> None:
    """Raise a usage error if one of these parameters was given to the current command: they do not apply to `what`."""
    _refuse(names, f"does not apply to {what}")


def _refuse(names: Sequence[str], problem: str) -> None:
    context = click.get_current_context()
    for name in names:
        if is_given(context, name):
            raise click.UsageError(f"{OptionSpelling(context.command).name(name)} {problem}; omit it", context)
