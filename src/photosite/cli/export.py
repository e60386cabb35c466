"""`photosite export`: noise profiles and EMVA 1288 files for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say, say_if_compiling

if TYPE_CHECKING:
    from photosite.calibration.result import Calibration
    from photosite.frames.frame_set import FrameSet
    from photosite.sensor.model import Sensor
    from photosite.sensor.noise_profile import NoiseProfile

SUFFIXES = {"darktable": (".json",), "libcamera": (".json",), "dng": (".dng",), "emva-xml": (".xml",), "emva": ()}


class _Source(NamedTuple):
    """A measurement or a sensor, and the options that apply to it."""

    name: str
    gain_setting: float | None
    sensor_name: str | None
    bits: int | None
    cfa: str | None


@click.command("export", cls=Command)
@click.argument("source", metavar="FOLDER|FILE|SENSOR")
@click.argument("form", metavar="FORMAT", type=click.Choice(list(SUFFIXES)))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    metavar="FILE",
    help="File to write; a folder for emva.",
)
@click.option(
    "--gain-setting", type=float, metavar="ISO", help="Gain setting to export, or that of a sensor file. Default: all."
)
@click.option("--into", type=click.Path(path_type=Path), metavar="FILE", help="For dng: the DNG file to copy.")
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
@click.option(
    "--sensor", "sensor_name", metavar="NAME|FILE", help="Known properties of the sensor that took the frames."
)
@click.option("--bits", type=click.IntRange(1, 16), help="Bit depth of the converter, for files that do not state it.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files that do not state it.")
@options.json_option
def command(
    source: str,
    form: str,
    output: Path,
    gain_setting: float | None,
    into: Path | None,
    maker: str,
    model: str | None,
    target: str,
    sensor_name: str | None,
    bits: int | None,
    cfa: str | None,
    as_json: bool,
) -> None:
    """Write a noise profile or an EMVA 1288 file for another program.

    The source is a measurement (folder, protocol, EMVA descriptor), which is calibrated, or a sensor (preset or file).
    Standard error lists what the format cannot hold.

    \b
    FORMAT is one of
      darktable  noiseprofiles.json: a, b of each gain setting (darktable --noiseprofiles FILE)
      libcamera  part of a Raspberry Pi tuning file: rpi.black_level and rpi.noise, of the lowest setting
      dng        a copy of the DNG file --into with its NoiseProfile tag
      emva-xml   EMVA 1288 results XML of a measurement, every parameter with its uncertainty
      emva       a folder with an EMVA 1288 descriptor and the frames of a measurement

    Example: photosite export stack darktable --gain-setting 100 --maker Acme --model X-1 -o noiseprofiles.json
    """
    measured = _Source(source, gain_setting, sensor_name, bits, cfa)
    if form == "emva":
        options.output_folder(str(output))
    else:
        options.output_file(*SUFFIXES[form])(str(output))
    if (form == "dng") != (into is not None):
        raise click.UsageError(
            "--into names the DNG file to copy; it is required for dng and invalid for other formats"
        )
    loss = _write(measured, form, output, into, maker, model, target)
    say(f"{form}: {loss}")
    if as_json:
        print_json({"format": form, "path": str(output), "loss": loss})
    else:
        click.echo(f"wrote {output}")


def _write(
    source: _Source, form: str, output: Path, into: Path | None, maker: str, model: str | None, target: str
) -> str:
    from photosite.frames.io.darktable import DARKTABLE_LOSS, write_darktable
    from photosite.frames.io.dng_noise_profile import DNG_LOSS, write_dng_profile
    from photosite.frames.io.libcamera import LIBCAMERA_LOSS, write_libcamera

    if form in ("emva", "emva-xml"):
        return _write_emva(source, form, output)
    if form == "darktable":
        write_darktable(_profiles(source), output, maker=maker, model=model)
        return DARKTABLE_LOSS
    if into is not None:
        write_dng_profile(_profile(source, _iso_of(into)), into, output)
        return DNG_LOSS
    lowest = _profiles(source)[0]
    if lowest.gain_setting is not None:
        say(f"gain setting {lowest.gain_setting:g} is assumed to be analogue gain 1")
    write_libcamera(lowest, output, target=target)
    return LIBCAMERA_LOSS


def _write_emva(source: _Source, form: str, output: Path) -> str:
    from photosite.calibration.calibrate import calibrate
    from photosite.calibration.export.emva_xml import EMVA_XML_LOSS, write_emva_results
    from photosite.frames.io.emva_descriptor import EMVA_FRAMES_LOSS, write_descriptor

    frames = _frames(source)
    if frames is None:
        raise click.UsageError(f"{form} needs a measurement, but '{source.name}' is a sensor")
    if source.gain_setting is not None:
        frames = frames.at_gain(source.gain_setting)
    if form == "emva":
        write_descriptor(frames, output, progress=Stages())
        return EMVA_FRAMES_LOSS
    say_if_compiling()
    write_emva_results(calibrate(frames, _sensor(source, frames), progress=Stages()), output)
    return EMVA_XML_LOSS


def _profiles(source: _Source) -> Sequence[NoiseProfile]:
    """Return the noise profiles by increasing gain setting, or only that of --gain-setting."""
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.sensor.noise_profile import profile_at_setting, sensor_noise_profile

    frames = _frames(source)
    if frames is None:
        return [sensor_noise_profile(load_sensor(source.name), gain_setting=source.gain_setting)]
    settings = frames.gain_settings
    say_if_compiling()
    if len(settings) == 1:
        setting = settings[0] if source.gain_setting is None else source.gain_setting
        from photosite.calibration.calibrate import calibrate

        return [_of(calibrate(frames, _sensor(source, frames), progress=Stages()), setting)]
    from photosite.calibration.gain_series.calibrate_series import calibrate_series

    series = calibrate_series(frames, _sensor(source, frames), progress=Stages())
    profiles = [_of(step.calibration, step.setting) for step in series.steps]
    return profiles if source.gain_setting is None else [profile_at_setting(profiles, source.gain_setting)]


def _of(calibration: Calibration, setting: float | None) -> NoiseProfile:
    from photosite.calibration.export.noise_profile import calibration_noise_profile

    return calibration_noise_profile(calibration, setting)


def _profile(source: _Source, iso: float | None) -> NoiseProfile:
    """Return the profile for a DNG file: that of --gain-setting, else of the file's ISO."""
    from photosite.sensor.noise_profile import profile_at_setting

    profiles = _profiles(source)
    return profiles[0] if len(profiles) == 1 else profile_at_setting(profiles, iso)


def _iso_of(path: Path) -> float | None:
    from photosite.frames.io.dng import read_dng_header

    metadata = read_dng_header(path).metadata
    iso = metadata.get("gain_setting", metadata.get("iso"))
    return float(iso) if isinstance(iso, int | float) else None


def _frames(source: _Source) -> FrameSet | None:
    """Return the measurement, or None if the source is a sensor: a preset or a sensor file."""
    from photosite.frames.open import open_frames
    from photosite.sensor.io.sensor_file import preset_names

    path = Path(source.name)
    if source.name in preset_names() and not path.exists():
        return None
    if path.suffix.lower() in (".yaml", ".yml") and path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            if any(line.startswith("photosite_sensor:") for line in file):
                return None
    return open_frames(path, bits=source.bits, cfa=source.cfa)


def _sensor(source: _Source, frames: FrameSet) -> Sensor | None:
    from photosite.sensor.io.sensor_file import load_sensor

    return frames.sensor if source.sensor_name is None else load_sensor(source.sensor_name)
