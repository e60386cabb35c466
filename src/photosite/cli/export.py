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


class _Asked(NamedTuple):
    """The options of the command."""

    source: str
    setting: float | None
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
    help="What to write; emva: a folder.",
)
@click.option("--gain-setting", type=float, metavar="ISO", help="Of several gain settings, or of a sensor file: which.")
@click.option(
    "--into", type=click.Path(path_type=Path), metavar="FILE", help="dng: the DNG file to copy with the profile in it."
)
@click.option("--maker", default="photosite", help="darktable: the camera's maker as its raw files say it.")
@click.option("--model", help="darktable: the camera's model as its raw files say it.")
@click.option("--target", type=click.Choice(["bcm2835", "pisp"]), default="bcm2835", help="libcamera: Pi 4 or Pi 5.")
@click.option("--sensor", "sensor_name", metavar="NAME|FILE", help="What is known of the sensor of these frames.")
@click.option("--bits", type=click.IntRange(1, 16), help="Bits of the converter, for files that do not say.")
@click.option("--cfa", help="Colour filter array (rggb, ...), for files that do not say.")
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
    What a format cannot hold is said on standard error.

    \b
    FORMAT is
      darktable  noiseprofiles.json: a, b of each gain setting (darktable --noiseprofiles FILE)
      libcamera  part of a Raspberry Pi tuning file: rpi.black_level and rpi.noise, of the lowest setting
      dng        a copy of the DNG file --into with its NoiseProfile tag
      emva-xml   EMVA 1288 results XML of a measurement, every figure with its uncertainty
      emva       a folder with an EMVA 1288 descriptor and the frames of a measurement

    Example: photosite export stack darktable --maker Acme --model X-1 -o noiseprofiles.json
    """
    asked = _Asked(source, gain_setting, sensor_name, bits, cfa)
    if form == "emva":
        options.output_folder(str(output))
    else:
        options.output_file(*SUFFIXES[form])(str(output))
    if (form == "dng") != (into is not None):
        raise click.UsageError("--into names the DNG file that gets the profile: dng needs it, no other format does")
    loss = _write(asked, form, output, into, maker, model, target)
    say(f"{form}: {loss}")
    if as_json:
        print_json({"format": form, "path": str(output), "loss": loss})
    else:
        click.echo(f"wrote {output}")


def _write(
    asked: _Asked, form: str, output: Path, into: Path | None, maker: str, model: str | None, target: str
) -> str:
    from photosite.frames.io import noise_profiles
    from photosite.frames.io.dng_noise_profile import DNG_LOSS, write_dng_profile

    if form in ("emva", "emva-xml"):
        return _write_emva(asked, form, output)
    if form == "darktable":
        noise_profiles.write_darktable(_profiles(asked), output, maker=maker, model=model)
        return noise_profiles.DARKTABLE_LOSS
    if into is not None:
        write_dng_profile(_profile(asked, _iso_of(into)), into, output)
        return DNG_LOSS
    lowest = _profiles(asked)[0]
    if lowest.gain_setting is not None:
        say(f"gain setting {lowest.gain_setting:g} is taken as analogue gain 1")
    noise_profiles.write_libcamera(lowest, output, target=target)
    return noise_profiles.LIBCAMERA_LOSS


def _write_emva(asked: _Asked, form: str, output: Path) -> str:
    from photosite.calibration.calibrate import calibrate
    from photosite.calibration.export.emva_xml import EMVA_XML_LOSS, write_emva_results
    from photosite.frames.io.emva_descriptor import EMVA_FRAMES_LOSS, write_descriptor

    frames = _frames(asked)
    if frames is None:
        raise click.UsageError(f"{form} is of a measurement, and '{asked.source}' is a sensor")
    if asked.setting is not None:
        frames = frames.at_gain(asked.setting)
    if form == "emva":
        write_descriptor(frames, output, progress=Stages())
        return EMVA_FRAMES_LOSS
    say_if_compiling()
    write_emva_results(calibrate(frames, _sensor(asked, frames), progress=Stages()), output)
    return EMVA_XML_LOSS


def _profiles(asked: _Asked) -> Sequence[NoiseProfile]:
    """The noise profiles of the source, by rising gain setting; the one asked for where one was."""
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.sensor.noise_profile import profile_at_setting, sensor_noise_profile

    frames = _frames(asked)
    if frames is None:
        return [sensor_noise_profile(load_sensor(asked.source), gain_setting=asked.setting)]
    settings = frames.gain_settings
    say_if_compiling()
    if len(settings) == 1:
        setting = settings[0] if asked.setting is None else asked.setting
        from photosite.calibration.calibrate import calibrate

        return [_of(calibrate(frames, _sensor(asked, frames), progress=Stages()), setting)]
    from photosite.calibration.gain_series.calibrate_series import calibrate_series

    series = calibrate_series(frames, _sensor(asked, frames), progress=Stages())
    profiles = [_of(step.calibration, step.setting) for step in series.steps]
    return profiles if asked.setting is None else [profile_at_setting(profiles, asked.setting)]


def _of(calibration: Calibration, setting: float | None) -> NoiseProfile:
    from photosite.calibration.export.noise_profile import calibration_noise_profile

    return calibration_noise_profile(calibration, setting)


def _profile(asked: _Asked, iso: float | None) -> NoiseProfile:
    """The one profile for a DNG file: of the setting asked for, else of the file's own ISO."""
    from photosite.sensor.noise_profile import profile_at_setting

    profiles = _profiles(asked)
    return profiles[0] if len(profiles) == 1 else profile_at_setting(profiles, iso)


def _iso_of(path: Path) -> float | None:
    from photosite.frames.io.dng import read_dng_header

    metadata = read_dng_header(path).metadata
    iso = metadata.get("gain_setting", metadata.get("iso"))
    return float(iso) if isinstance(iso, int | float) else None


def _frames(asked: _Asked) -> FrameSet | None:
    """The measurement, or None where the source is a sensor: a preset's name or a sensor file."""
    from photosite.frames.open import open_frames
    from photosite.sensor.io.sensor_file import preset_names

    path = Path(asked.source)
    if asked.source in preset_names() and not path.exists():
        return None
    if path.suffix.lower() in (".yaml", ".yml") and path.is_file():
        with path.open(encoding="utf-8", errors="replace") as file:
            if any(line.startswith("photosite_sensor:") for line in file):
                return None
    return open_frames(path, bits=asked.bits, cfa=asked.cfa)


def _sensor(asked: _Asked, frames: FrameSet) -> Sensor | None:
    from photosite.sensor.io.sensor_file import load_sensor

    return frames.sensor if asked.sensor_name is None else load_sensor(asked.sensor_name)
