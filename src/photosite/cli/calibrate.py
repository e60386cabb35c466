"""`photosite calibrate`: a sensor's parameters from dark and flat frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.compilation import compile_statistics
from photosite.cli.output import Stages, held_warnings, many, not_listed, say, say_if_compiling, show, table
from photosite.errors import CalibrationError, PhotositeError, printable

if TYPE_CHECKING:
    from typing import TypeAlias

    from photosite.calibration.calibrate import AnyCalibration
    from photosite.calibration.gain_series.result import GainSeries
    from photosite.calibration.result import Calibration
    from photosite.calibration.setting import MapsWanted
    from photosite.frames.frame_set import FrameSet
    from photosite.sensor.model import Sensor

    _Frames: TypeAlias = FrameSet | dict[str, FrameSet] | list[FrameSet]


@click.command("calibrate", cls=Command)
@click.argument("paths", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="PATH...")
@options.sensor_option(
    text="Sensor as known before: pixel size, volts, spectra. Default: the sensor file of the protocol."
)
@options.file_option(
    *("-o", "--output"),
    suffixes=options.SENSOR_SUFFIXES,
    text="Sensor file to write (YAML); of several settings one each, mine.R.sensor.yaml for mine.sensor.yaml.",
)
@click.option(
    "--name",
    metavar="TEXT",
    help="Name of the sensor.  [default: that of --sensor or the protocol's sensor file; with a preset, the folder's]",
)
@options.file_option(
    "--report",
    suffixes=options.REPORT_SUFFIXES,
    text="Report to write: a data sheet as one self-contained HTML page or a PDF, by the suffix.",
)
@click.option(
    "--checkpoint",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Checkpoint folder; an interrupted run resumes from it.",
)
@options.reading_options
@options.black_level_option(" that the dark frames are compared with; by default the files'")
@options.unstated_exposure_option
@options.where_option
@click.option(
    "--linearize",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Table that undoes a tone curve (text or CSV): a linear value per line, or code and value, for each code "
    "from 0 on. Values that are not whole numbers are scaled to 16 bits. Default: none.",
)
@click.option("--dark", multiple=True, metavar="PATTERN", help="Dark frames of the folder, by file name: 'IMG_00*'.")
@click.option("--light", multiple=True, metavar="PATTERN", help="Light frames of the folder, by file name.")
@click.option(
    "--exposure-from-name",
    metavar="REGEX",
    help="Regular expression that finds the exposure time in the name of a file or its subfolder, in one group: "
    "'t([0-9.]+ms)'. A group named after a unit holds a number in it: '_(?P<us>[0-9]+)_'.",
)
@options.quantity(
    "--outlier-dark",
    unit="DN",
    text="List pixels of the mean dark frame that deviate from its mean by more. Default: a limit beyond which a "
    "normal distribution has a tenth of a pixel.",
)
@options.quantity(
    "--outlier-light",
    unit="PERCENT",
    text="The same for the mean light frame near half saturation, high-passed, in percent of the mean signal.",
)
@click.option(
    "--maps",
    is_flag=True,
    help="Also measure maps of offset, response, dark rate and read noise, defects, row and column noise; -o writes "
    "the maps beside the sensor file (HDF5).",
)
@click.option(
    "--pixel-gain",
    is_flag=True,
    help="Also measure the gain of each pixel (sCMOS), with --maps. It takes a hundred flat fields or more.",
)
@click.option(
    "--captures",
    metavar="NAME,NAME",
    help="Subfolders of PATH with the frames of each capture of one exposure, from the most to the least sensitive. "
    "Default: those of the sensor's captures, where PATH has all of them.",
)
@click.option(
    "--contribute",
    type=options.shared_folder,
    metavar="FOLDER",
    help="Write an anonymised entry that others can load into this folder of contributed cameras, and list it in the "
    "folder's index. Needs --license.",
)
@click.option(
    "--license",
    "license_id",
    metavar="SPDX",
    help="License of the entry: CC0-1.0, CC-BY-4.0, CC-BY-SA-4.0, PDDL-1.0, ODC-By-1.0, ODbL-1.0, Apache-2.0 or MIT.",
)
@click.option("--camera", metavar="TEXT", help="Maker and model for the entry.  [default: the name of the sensor]")
@click.option("--attribution", metavar="TEXT", help="Name to give in the entry as its source.  [default: none]")
@options.option(
    "--into",
    type=options.shared_folder,
    metavar="FOLDER",
    help="Calibrate each PATH as a camera and write NAME.json and, with a known sensor, NAME.sensor.yaml for each; an "
    "interrupted run is resumed.",
)
@options.workers_options()
@click.option("--all", "every", is_flag=True, help="Print all parameters with their methods, not ten of them.")
@options.json_option
def command(
    paths: tuple[Path, ...],
    sensor_name: str | None,
    maps: MapsWanted,
    pixel_gain: bool,
    into: Path | None,
    every: bool,
    as_json: bool,
    **given: Any,
) -> int:
    """Estimate a sensor's parameters, with standard uncertainties, from dark and flat frames.

    PATH is a folder of frames, a protocol (YAML), an EMVA 1288 descriptor or a file with many frames. Parameters that
    cannot be estimated are reported with the reason. Millivolts and the sensor file need the pixel size, the voltage
    swing and the spectral response, which frames do not show: they come from the sensor file named by the protocol or
    by --sensor.

    Frames that combine several captures of one exposure (high dynamic range) show knees of the photon transfer: the
    captures are then distinguished by their noise. Companded frames need a sensor file with the table,
    captures.combination.companding. The frames of each capture, in subfolders, show more.

    Flat fields of one exposure time may have levels of unknown light: each entry of a protocol, file of several frames,
    folder, or name before its number is a level.

    Frames of several gain settings (ISO) are calibrated as a series: each setting by itself, then the switch of the
    conversion gain and the two parts of the read noise. -o then writes one sensor file with all settings, for
    `photosite simulate --gain-setting 400`.

    Amplifiers of a chip that FITS files name (DETSEC) are also calibrated one by one; the chip has the mean of their
    gains.

    Settings that differ in camera, read mode, offset, binning, subframe, set-point temperature, filter, or amplifier or
    chip of a file, as the files state them, are listed and calibrated one by one; --report compares them in one page.
    -o writes a sensor file for each, named after its values: mine.R.sensor.yaml. --where chooses one setting. The exit
    status is 2 if any setting cannot be calibrated or, with -o, gives no sensor file; the others are shown and written.

    \b
    Frames are read from
      DNG, camera raw   NEF, CR2, CR3, ARW, RAF, ...; exposure and ISO from their metadata
      TIFF, PNG         8 or 16 bits (TIFF also 32), gray; pages of a TIFF are frames
      HDF5              datasets (rows, cols) or (frames, rows, cols) of uint8, uint16 or uint32;
                        attributes exposure_s, kind, gain_setting, bits, black_level_dn, cfa
      FITS              EXPTIME, GAIN, CCD-TEMP, IMAGETYP, BAYERPAT (needs the extra fits)

    \b
    Missing metadata are read from the name of the file or its subfolder
      dark, bias, d_012; light, flat, bright, b_012   dark or light
      10ms, 0.04s, 250us, 1-8000s, exp0.001           exposure time (1-8000s is 1/8000 s)
      iso400, gain_2.5; _-10C                         gain setting; temperature

    A protocol overrides metadata and file names. Without any of them, the level of the frames decides between dark and
    light, with a warning; --dark and --light override it.

    With --into, each PATH is a camera, and --processes or --dask share the cameras out. Otherwise they share out the
    frames, which pays where reading takes long. The results are the same.

    \b
    Example: photosite calibrate stack -o mine.sensor.yaml --report report.html
    Example: photosite calibrate cameras/* --sensor nikon-d200 --into results --processes 4
    """
    from photosite.calibration.calibrate import calibrate, calibration_kind, check_options
    from photosite.calibration.spatial.spatial_analysis import OutlierThresholds
    from photosite.cli.calibration_text import calibration_text
    from photosite.frames.conditions import label

    maps = "gain" if pixel_gain else maps
    if into is not None:
        if any(given[option] is not None for option in _OF_ONE_CAMERA):
            raise click.UsageError("--into takes --sensor, --maps, --pixel-gain and the options of reading frames only")
        say_if_compiling("site_planes._high_passed", compile_statistics)
        return _calibrate_cameras(paths, into, sensor_name, maps, given, as_json)
    if len(paths) > 1:
        raise click.UsageError("several cameras need --into")
    held = click.get_current_context().with_resource(held_warnings())
    outputs = _Outputs.of(given)
    frames, sensor = _open(paths[0], sensor_name, given)
    if isinstance(frames, list):
        say(f"photosite: {paths[0]} has {len(frames)} settings. Each is calibrated; --where chooses one")
        for each in frames:
            say(f"  {label(each.conditions)}: {many(each.frame_count, 'frame')}")
    for option, wanted in (("--name", given["name"]), ("-o", outputs.sensor), ("--contribute", outputs.entry)):
        if wanted is not None and sensor is None:
            hint = "give --sensor, a preset (sensors list) or a file (sensors new writes one)"
            raise click.UsageError(f"{option} needs pixel size, volts and spectra, which frames lack: {hint}")
    if given["name"] is not None and sensor is not None:
        sensor = sensor.with_(name=printable(given["name"]))
    outputs.check_new([label(each.conditions) for each in frames] if isinstance(frames, list) else (), maps=bool(maps))
    thresholds = given["outlier_dark"], given["outlier_light"]
    chosen = {
        "outliers": None if thresholds == (None, None) else OutlierThresholds(*thresholds),
        "maps": maps,
        **{name: given[name] for name in ("checkpoint", "processes", "scheduler")},
    }
    kind = calibration_kind(frames, sensor)
    check_options(kind, chosen)
    if kind in ("captures", "combined"):
        outputs.check_report_only()
    if kind == "settings" and outputs.entry is not None:
        raise click.UsageError("--contribute needs frames of one setting: choose it with --where")
    _check_memory(frames, maps, given["processes"])
    say_if_compiling("site_planes._high_passed", compile_statistics)
    result = calibrate(frames, sensor, progress=Stages(), **chosen)
    not_listed(held, result.warnings)
    written, failed = outputs.write(result)
    show(as_json, result.to_dict, lambda: calibration_text(result, every=every), **written)
    if failed and isinstance(frames, list):
        say(f"photosite: {len(failed)} of {len(frames)} settings failed: {'; '.join(failed)}")
    return 2 if failed else 0


def _check_memory(frames: _Frames, maps: MapsWanted, processes: int | None) -> None:
    """Warn if the memory is short."""
    from photosite.cli.memory_need import calibrate_bytes, megapixels, warn_if_short

    sets = [*frames.values()] if isinstance(frames, Mapping) else frames if isinstance(frames, list) else [frames]
    size = megapixels(sets[0].rows, sets[0].cols)
    less = "Omit --maps" if maps else "Use --processes 1" if processes != 1 else "Crop or bin the frames"
    need = calibrate_bytes(sets, processes, maps=maps)
    warn_if_short(f"a calibration of {size}", need, f"{less}, or use a machine with more memory")


def _check_memory_of_cameras(paths: tuple[Path, ...], maps: MapsWanted, given: Mapping[str, Any]) -> None:
    """Warn if the memory is short for as many cameras at a time as there are processes, all like the first."""
    from photosite.cli.memory_need import calibrate_bytes, megapixels, warn_if_short
    from photosite.engine.threads import cores
    from photosite.frames.open import open_frames

    try:
        frames = open_frames(paths[0], **{name: given[name] for name in _READING})
    except PhotositeError:  # it is reported as the result of this camera
        return
    together = min(cores() if given["processes"] is None else given["processes"], len(paths))
    what = f"{together} at a time of {len(paths)} calibrations of {megapixels(frames.rows, frames.cols)}"
    less = "Use fewer --processes" if together > 1 else "Omit --maps" if maps else "Crop or bin the frames"
    need = together * calibrate_bytes([frames], maps=maps)
    warn_if_short(what, need, f"{less}, or a machine with more memory")


_READING = *options.READING, "black_level_dn", "exposure_s", "where", "dark", "light", "exposure_from_name"
_OF_ONE_CAMERA = (
    *("output", "name", "report", "checkpoint", "linearize", "contribute", "license_id", "camera", "attribution"),
    *("outlier_dark", "outlier_light", "captures"),
)


@dataclass(frozen=True)
class _Outputs:
    """The files to write."""

    sensor: Path | None
    report: Path | None
    entry: _Contribution | None

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> _Outputs:
        """Return the files of the command's options."""
        named = (given[name] for name in ("contribute", "license_id", "camera", "attribution"))
        return cls(given["output"], given["report"], _contribution(*named))

    def check_report_only(self) -> None:
        """Raise a usage error for the sensor file or the entry of frames that show only part of what these hold."""
        for option, wanted in (("-o", self.sensor), ("--contribute", self.entry)):
            if wanted is not None:
                raise click.UsageError(f"{option} needs frames of one capture: several do not show all of a sensor")

    def check_new(self, settings: Sequence[str], *, maps: bool) -> None:
        """Raise an error for sensor files of several settings, and for maps, that would be overwritten."""
        from photosite.calibration.settings_result import setting_paths
        from photosite.sensor.io.sensor_file import check_maps_are_free, maps_path

        if self.sensor is None:
            return
        for path in setting_paths(self.sensor, settings).values() if settings else (self.sensor,):
            options.check_new(path)
            if maps:
                options.check_new(maps_path(path))
                check_maps_are_free(path)

    def write(self, result: AnyCalibration) -> tuple[dict[str, Path | Mapping[str, Path] | None], Sequence[str]]:
        """Write the files of a result; return them by their names in the JSON object, and the settings that failed."""
        from photosite.calibration.gain_series.result import GainSeries
        from photosite.calibration.result import Calibration
        from photosite.calibration.settings_result import SettingsCalibration
        from photosite.sensor.io.sensor_file import maps_path

        if not isinstance(result, Calibration | GainSeries | SettingsCalibration):
            self.check_report_only()
        if self.sensor is not None and isinstance(result, Calibration):
            _ = result.sensor  # raises before anything is written
        if self.report is not None:
            result.report(self.report)
        if isinstance(result, SettingsCalibration):
            if self.sensor is None:
                return {"report": self.report}, [*result.refused]
            try:
                sensors, missing = result.save(self.sensor)
            except CalibrationError as error:  # none of the settings has one
                say(f"photosite: {error}")
                return {"report": self.report}, [*result.settings, *result.refused]
            for name, reason in missing.items():
                say(f"photosite: no sensor file for {name}: {reason}")
            return {"sensors": sensors, "report": self.report}, [*missing]
        if not isinstance(result, Calibration | GainSeries):
            return {"report": self.report}, ()
        if self.sensor is not None:
            result.save(self.sensor)
        has_maps = isinstance(result, Calibration) and result.chip is not None
        beside = maps_path(self.sensor) if has_maps and self.sensor is not None else None
        entry = self.entry.write(result) if self.entry else None
        return {"sensor": self.sensor, "maps": beside, "report": self.report, "entry": entry}, ()


def _open(path: Path, sensor_name: str | None, given: Mapping[str, Any]) -> tuple[_Frames, Sensor | None]:
    """Return the frames, those of each capture, or those of each setting, and the sensor as known before."""
    from photosite.frames.linearization import linearize as linearized
    from photosite.frames.linearization import read_linearization
    from photosite.frames.open import capture_folders, open_frames, open_settings

    table = None if given["linearize"] is None else read_linearization(given["linearize"])
    reading = {name: given[name] for name in _READING}

    def linear(frames: FrameSet) -> FrameSet:
        return frames if table is None else linearized(frames, table)

    captures = given["captures"]
    named = () if captures is None else tuple(name.strip() for name in captures.split(","))
    sensor = options.sensor_or(None, sensor_name)
    if names := capture_folders(path, sensor, named):
        return {name: linear(open_frames(path / name, sensor=sensor, **reading)) for name in names}, sensor
    settings = [linear(each) for each in open_settings(path, sensor=sensor, **reading)]
    known = settings[0].sensor if sensor is None else sensor
    return (settings[0] if len(settings) == 1 else settings), known


@dataclass(frozen=True)
class _Contribution:
    """The options of an entry for a folder of contributed cameras."""

    folder: Path
    license_id: str
    camera: str | None
    attribution: str | None

    def write(self, result: Calibration | GainSeries) -> Path:
        """Write the entry and return its folder."""
        from photosite.library.contribute import contribute

        named = {"license_id": self.license_id, "camera": self.camera, "attribution": self.attribution}
        return contribute(result, self.folder, **named).folder


def _contribution(
    folder: Path | None, license_id: str | None, camera: str | None, attribution: str | None
) -> _Contribution | None:
    """Return the options of --contribute, checked before anything is computed; None without it."""
    from photosite.library.contribute import check_license

    if folder is None:
        if license_id or camera or attribution:
            raise click.UsageError("--license, --camera and --attribution belong to --contribute")
        return None
    return _Contribution(folder, check_license(license_id), camera, attribution)


def _calibrate_cameras(
    paths: tuple[Path, ...],
    into: Path,
    sensor_name: str | None,
    maps: MapsWanted,
    given: Mapping[str, Any],
    as_json: bool,
) -> int:
    """Calibrate several cameras, show a line for each, and return the exit status."""
    from photosite.calibration.export.cameras import ERROR, calibrate_cameras

    if given["scheduler"] is None:
        _check_memory_of_cameras(paths, maps, given)
    found = calibrate_cameras(
        paths,
        into,
        options.sensor_or(None, sensor_name),
        maps=maps,
        processes=given["processes"],
        scheduler=given["scheduler"],
        progress=partial(Stages(), unit="cameras"),
        **{name: given[name] for name in _READING},
    )
    failed = [name for name, result in found.items() if ERROR in result]
    rows = [("camera", "result"), *((name, _camera_line(result)) for name, result in found.items())]
    show(as_json, {"path": into, "cameras": found, "failed": failed}, lambda: table(rows, "<<"))
    if failed:
        say(f"photosite: {len(failed)} of {len(found)} cameras failed: {', '.join(failed)}")
    return 2 if failed else 0


def _camera_line(result: dict[str, Any]) -> str:
    """Return how the calibration of a camera went, in words."""
    from photosite.calibration.export.cameras import ERROR

    if ERROR in result:
        return f"failed: {result[ERROR]}"
    warnings = len(result["warnings"])
    return "calibrated" + (f", {warnings} warning{'s' * (warnings > 1)}" if warnings else "")
