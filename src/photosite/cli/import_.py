"""`photosite import`: show noise profiles of other programs, and convert them to sensor files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import say, show, table

if TYPE_CHECKING:
    from photosite.sensor.noise_profile import NoiseProfile


@click.command("import", cls=Command)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--model", help="Camera, for files that hold several.")
@click.option(
    "--mono", is_flag=True, help="For darktable: the camera has no color filters. Files from photosite state it."
)
@click.option("--gain-setting", type=float, metavar="ISO", help="Gain setting, for files that hold several.")
@options.sensor_option(text="Sensor for all properties that the profile does not hold. Required for -o.")
@options.file_option("-o", "--output", suffixes=options.SENSOR_SUFFIXES, text="Sensor file to write (YAML).")
@options.json_option
def command(
    file: Path,
    model: str | None,
    mono: bool,
    gain_setting: float | None,
    sensor_name: str | None,
    output: Path | None,
    as_json: bool,
) -> None:
    """Read a noise profile: darktable's JSON, a libcamera tuning file (JSON), or a DNG file's NoiseProfile.

    With -o and --sensor, writes a sensor file for simulation. Gain and dark noise are the profile's, with all dark
    noise as read noise and DSNU 0. Geometry, volts, spectra, well, PRNU and dark current are those of --sensor.

    Example: photosite import noiseprofiles.json --model "X-1" --gain-setting 400 --sensor nikon-d200 -o x1.sensor.yaml
    """
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.sensor.noise_profile import profile_at_setting

    if (output is None) != (sensor_name is None):
        raise click.UsageError("-o and --sensor are required together: --sensor has what the profile does not hold")
    profiles = _read(file, model, gain_setting, mono)
    if output is not None or gain_setting is not None:
        profiles = (profile_at_setting(profiles, gain_setting),)
    if output is not None and sensor_name is not None:
        base = load_sensor(sensor_name)
        profiles[0].sensor(base).save(output)
        for diagnostic in profiles[0].diagnostics(base):
            say(f"{diagnostic.id}: {diagnostic}")
    for note in dict.fromkeys(note for profile in profiles for note in profile.notes):
        say(note)
    content = {"profiles": [_as_dict(profile) for profile in profiles]}
    heading = ("setting", "channel", "slope", "offset", "K, DN/e⁻", "dark noise, DN", "black to white, DN", "camera")
    rows = [row for profile in profiles for row in _rows(profile)]
    show(as_json, content, lambda: table([heading, *rows], "><>>>><<"), sensor=output)


def _read(file: Path, model: str | None, gain_setting: float | None, mono: bool) -> tuple[NoiseProfile, ...]:
    from photosite.frames.io.darktable import read_darktable
    from photosite.frames.io.dng_noise_profile import read_dng_profile
    from photosite.frames.io.libcamera import is_libcamera, read_libcamera

    if file.suffix.lower() == ".dng":
        options.only_for("files of darktable", "model", "mono")
        return (read_dng_profile(file),)
    if is_libcamera(file):
        options.only_for("files of darktable", "model", "mono")
        return (read_libcamera(file),)
    return read_darktable(file, model, gain_setting, mono=mono)


def _rows(profile: NoiseProfile) -> list[tuple[str, ...]]:
    setting = "" if profile.gain_setting is None else f"{profile.gain_setting:g}"
    rows: list[tuple[str, ...]] = []
    for name, slope, offset in zip(profile.channels, profile.slope, profile.offset, strict=True):
        gain = dark = levels = ""
        if profile.white_level_dn is not None:
            levels = f"{profile.black_level_dn:g} to {profile.white_level_dn:g}"
            gain = f"{slope.value * profile.span_dn:.4g}"
            dark = f"{offset.value**0.5 * profile.span_dn:.4g}" if offset.value >= 0 else "offset < 0"
        fit = (f"{slope.value:.5g}", f"{offset.value:.5g}")
        rows.append((setting, name, *fit, gain, dark, levels, profile.camera))
    return rows


def _as_dict(profile: NoiseProfile) -> dict[str, Any]:
    return {
        "gain_setting": profile.gain_setting,
        "camera": profile.camera,
        "black_level_dn": profile.black_level_dn,
        "white_level_dn": profile.white_level_dn,
        "channels": {
            name: {"slope": slope.value, "offset": offset.value}
            for name, slope, offset in zip(profile.channels, profile.slope, profile.offset, strict=True)
        },
        "notes": list(profile.notes),
    }
