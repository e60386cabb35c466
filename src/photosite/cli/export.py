"""`photosite export`: noise profiles, EMVA 1288 files and maps for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command, writes_file
from photosite.cli.output import Stages, say, say_if_compiling, show
from photosite.errors import InputError
from photosite.files.small_files import read_small
from photosite.files.yaml import LARGEST_BYTES

if TYPE_CHECKING:
    from photosite.calibration.gain_series.result import GainSeries
    from photosite.calibration.result import Calibration
    from photosite.frames.frame_set import FrameSet
    from photosite.sensor.noise_profile import NoiseProfile

MAP_SUFFIXES: dict[str, tuple[str, ...]] = {
    "smite": (".mat",),
    "smap": (".mat",),
    "accent": (".calb",),
    "gdsc": (".tif", ".tiff"),
    "ome": (".tif", ".tiff"),
    "pyme": (),
    "decode": (),
}
"""Forms of maps, as in `photosite.sensor.io.camera_maps`; those without suffixes are folders."""
SUFFIXES = {
    "darktable": (".json",),
    "libcamera": (".json",),
    "dng": (".dng",),
    "emva-xml": (".xml",),
    "emva": (),
    **MAP_SUFFIXES,
}


def _is_sensor_file(path: Path) -> bool:
    content = read_small(path, "a sensor file or a protocol", LARGEST_BYTES)
    return any(line.startswith(b"photosite_sensor:") for line in content.splitlines())


_FORMAT_OF = {"maker": "darktable", "model": "darktable", "target": "libcamera"}
"""Parameters that apply to one format."""


@writes_file
def _target(text: str) -> Path:
    """The path; the format decides whether it is a file or a folder."""
    return Path(text)


@click.command("export", cls=Command)
@click.argument("source", metavar="FOLDER|FILE|SENSOR")
@click.argument("form", metavar="FORMAT", type=click.Choice(list(SUFFIXES)))
@click.option(
    "-o",
    "--output",
    type=_target,
    metavar="FILE",
    required=True,
    help="File to write; a folder for emva, pyme and decode.",
)
@options.quantity("--gain-setting", unit="ISO", text="Gain setting to export, or that of a sensor file. Default: all.")
@options.path_option("--into", text="For dng: the DNG file to copy.")
@click.option("--maker", default="photosite", help="For darktable: the camera's maker, as its raw files state it.")
@click.option(
    "--model", help="For darktable: the camera's model, as its raw files state it. Default: the sensor's name."
)
@click.option(
    "--target",
    type=click.Choice(["bcm2835", "pisp"]),
    default="bcm2835",
    help="For libcamera: bcm2835 (up to Pi 4) or pisp (Pi 5).",
)
@options.quantity(
    "--exposure",
    "exposure_s",
    unit="s",
    zero=True,
    text="Exposure time of frames that state none; for maps, of the frames to analyze.  [default: 0]",
)
@click.option("--pixel-gain", is_flag=True, help="For maps of a measurement: measure the gain of each pixel.")
@options.sensor_option(text="Known properties of the sensor that took the frames.")
@options.reading_options
@options.where_option
@options.json_option
def command(
    source: str,
    form: str,
    output: Path,
    gain_setting: float | None,
    into: Path | None,
    exposure_s: float | None,
    pixel_gain: bool,
    sensor_name: str | None,
    as_json: bool,
    **reading: Any,
) -> None:
    """Write a noise profile, an EMVA 1288 file, or maps of offset, variance and gain for another program.

    The source is a measurement (folder, protocol, EMVA descriptor), which is calibrated, or a sensor (preset or file).
    Standard error lists what the format cannot hold.

    \b
    FORMAT is one of
      darktable  noiseprofiles.json: a, b of each gain setting (darktable --noiseprofiles FILE)
      libcamera  part of a Raspberry Pi tuning file: rpi.black_level and rpi.noise, of the lowest setting
      dng        a copy of the DNG file --into with its NoiseProfile tag
      emva-xml   EMVA 1288 results XML of a measurement, every parameter with its uncertainty
      emva       a folder with an EMVA 1288 descriptor and the frames of a measurement
      smite, smap, accent, gdsc, ome, pyme, decode
                 maps of a measurement, or of a sensor file with maps, for localization microscopy

    Example: photosite export stack darktable --gain-setting 100 --maker Acme --model X-1 -o noiseprofiles.json
    """
    if not SUFFIXES[form]:
        options.output_folder(str(output))
    else:
        options.output_file(*SUFFIXES[form])(str(output))
    if (form == "dng") != (into is not None):
        raise click.UsageError(
            "--into names the DNG file to copy; it is required for dng and invalid for other formats"
        )
    for name, of_form in _FORMAT_OF.items():
        if form != of_form:
            options.only_for(f"the format {of_form}", name)
    if form == "emva":
        options.not_for("the format emva, which holds frames", "sensor_name")
    if form not in MAP_SUFFIXES:
        options.only_for("maps", "pixel_gain")
    maker, model, target = (reading.pop(name) for name in ("maker", "model", "target"))
    measured = _Source(source, gain_setting, sensor_name, reading, exposure_s, for_maps=form in MAP_SUFFIXES)
    if form in MAP_SUFFIXES:
        loss = _write_maps(measured, form, output, exposure_s or 0.0, pixel_gain=pixel_gain)
    elif form.startswith("emva"):
        loss = _write_emva(measured, form, output)
    elif into is not None:
        loss = _write_dng(measured, into, output)
    elif form == "darktable":
        from photosite.frames.io.darktable import DARKTABLE_LOSS, write_darktable

        write_darktable(measured.profiles(), output, maker=maker, model=model)
        loss = DARKTABLE_LOSS
    else:
        loss = _write_libcamera(measured, output, target)
    say(f"{form}: {loss}")
    show(as_json, {"format": form, "path": output, "loss": loss}, lambda: f"wrote {output}")


@dataclass(frozen=True)
class _Source:
    """A measurement or a sensor, and the options that apply to it."""

    name: str
    gain_setting: float | None
    sensor_name: str | None
    reading: dict[str, Any]
    exposure_s: float | None
    for_maps: bool

    def frames(self) -> FrameSet | None:
        """Return the measurement, or None if the source is a sensor: a preset or a sensor file."""
        from photosite.frames.open import open_frames
        from photosite.sensor.io.sensor_file import preset_names

        path = Path(self.name)
        is_preset = self.name in preset_names() and not path.exists()
        may_be_sensor = path.suffix.lower() in options.SENSOR_SUFFIXES and path.is_file()
        if is_preset or (may_be_sensor and _is_sensor_file(path)):
            of_frames = () if self.for_maps else ("exposure_s",)
            options.not_for("a sensor, which has no frames", "sensor_name", *self.reading, *of_frames)
            return None
        known = options.sensor_or(None, self.sensor_name)
        return open_frames(path, sensor=known, exposure_s=self.exposure_s or None, **self.reading)

    def calibrated(self, frames: FrameSet) -> Calibration | GainSeries:
        """Return the calibration of a measurement of one capture."""
        from photosite.calibration.calibrate import calibrate
        from photosite.calibration.gain_series.result import GainSeries
        from photosite.calibration.result import Calibration

        found = calibrate(frames, options.sensor_or(frames.sensor, self.sensor_name), progress=Stages())
        if not isinstance(found, Calibration | GainSeries):
            raise InputError("frames", where=frames.source, value="combined captures", expected="frames of one capture")
        return found

    def profiles(self) -> Sequence[NoiseProfile]:
        """Return the noise profiles by increasing gain setting, or only that of --gain-setting."""
        from photosite.calibration.export.noise_profile import calibration_noise_profile
        from photosite.calibration.gain_series.result import GainSeries
        from photosite.sensor.io.sensor_file import load_sensor
        from photosite.sensor.noise_profile import profile_at_setting, sensor_noise_profile

        frames = self.frames()
        if frames is None:
            own = load_sensor(self.name).with_(maps=None)  # a profile has no fixed pattern
            if not own.gain_settings:
                return [sensor_noise_profile(own, gain_setting=self.gain_setting or own.gain_setting)]
            settings = own.all_gain_settings if self.gain_setting is None else (self.gain_setting,)
            return [sensor_noise_profile(own.at_gain_setting(each), gain_setting=each) for each in settings]
        say_if_compiling()
        stated = frames.gain_settings[0]
        if len(frames.gain_settings) == 1 and stated is not None and self.gain_setting is not None:
            frames = frames.at_gain(self.gain_setting)
        found = self.calibrated(frames)
        if not isinstance(found, GainSeries):
            return [calibration_noise_profile(found, stated if self.gain_setting is None else self.gain_setting)]
        profiles = [calibration_noise_profile(step.calibration, step.setting) for step in found.steps]
        return profiles if self.gain_setting is None else [profile_at_setting(profiles, self.gain_setting)]


def _write_maps(source: _Source, form: str, output: Path, exposure_s: float, *, pixel_gain: bool) -> str:
    from photosite.calibration.calibrate import calibrate
    from photosite.calibration.result import Calibration
    from photosite.sensor.io.camera_maps import MAP_FORMS, write_camera_maps
    from photosite.sensor.io.sensor_file import load_measured_chip, load_sensor
    from photosite.values.uncertain import Missing

    frames = source.frames()
    if frames is None:
        options.not_for("a sensor, which has no frames", "pixel_gain")
        chip = load_measured_chip(load_sensor(source.name))
        if chip is None:
            hint = "Calibrate its frames with --maps"
            raise InputError("the sensor has no maps", where=source.name, hint=hint)
    else:
        say_if_compiling()
        if source.gain_setting is not None:
            frames = frames.at_gain(source.gain_setting)
        sensor = options.sensor_or(frames.sensor, source.sensor_name)
        found = calibrate(frames, sensor, maps="gain" if pixel_gain else True, progress=Stages())
        if not isinstance(found, Calibration):
            raise click.UsageError("maps are of one gain setting and capture; choose it with --gain-setting")
        if found.chip is None:
            raise InputError("the frames give no maps", where=frames.source, hint=found.no_maps_reason)
        if isinstance(gains := found.pixel_gains, Missing):
            raise InputError("the frames give no map of the gain", where=frames.source, hint=gains.reason)
        chip = found.chip
    write_camera_maps(chip, output, form, exposure_s=exposure_s)
    return MAP_FORMS[form].loss


def _write_dng(source: _Source, into: Path, output: Path) -> str:
    """Write the profile of --gain-setting, else that of the DNG file's ISO."""
    from photosite.frames.io.dng import read_dng_header
    from photosite.frames.io.dng_noise_profile import DNG_LOSS, write_dng_profile
    from photosite.sensor.noise_profile import profile_at_setting

    metadata = read_dng_header(into).metadata
    iso = metadata.get("gain_setting", metadata.get("iso"))
    profiles = source.profiles()
    several = len(profiles) > 1
    profile = (
        profile_at_setting(profiles, float(iso) if isinstance(iso, int | float) else None) if several else profiles[0]
    )
    write_dng_profile(profile, into, output)
    return DNG_LOSS


def _write_libcamera(source: _Source, output: Path, target: str) -> str:
    from photosite.frames.io.libcamera import LIBCAMERA_LOSS, write_libcamera

    lowest = source.profiles()[0]
    if lowest.gain_setting is not None:
        say(f"gain setting {lowest.gain_setting:g} is assumed to be analog gain 1")
    write_libcamera(lowest, output, target=target)
    return LIBCAMERA_LOSS


def _write_emva(source: _Source, form: str, output: Path) -> str:
    from photosite.calibration.export.emva_xml import EMVA_XML_LOSS, write_emva_results
    from photosite.calibration.result import Calibration
    from photosite.frames.io.emva_descriptor import EMVA_FRAMES_LOSS, write_descriptor

    frames = source.frames()
    if frames is None:
        raise click.UsageError(f"{form} needs a measurement, but '{source.name}' is a sensor")
    if source.gain_setting is not None:
        frames = frames.at_gain(source.gain_setting)
    if form == "emva":
        write_descriptor(frames, output, progress=Stages())
        return EMVA_FRAMES_LOSS
    say_if_compiling()
    found = source.calibrated(frames)
    if not isinstance(found, Calibration):
        raise click.UsageError("emva-xml holds one gain setting; choose it with --gain-setting")
    write_emva_results(found, output)
    return EMVA_XML_LOSS
