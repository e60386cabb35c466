"""`photosite import`: noise profiles and maps of other programs, also into sensor files."""

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
@click.argument("files", metavar="[maps] FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--model", help="Camera, for files that hold several.")
@click.option(
    "--mono", is_flag=True, help="For darktable: the camera has no color filters. Files from photosite state it."
)
@click.option("--gain-setting", type=float, metavar="ISO", help="Gain setting, for files that hold several.")
@options.quantity(
    "--gain",
    "gain_dn_per_e",
    unit="DN/e-",
    text="For maps: gain of all pixels, where no map has it. Default: that of PYME's or DECODE's settings.",
)
@click.option(
    "--electrons",
    "in_electrons",
    is_flag=True,
    help="For maps: the variance is in electrons². Default: of PYME's files.",
)
@options.sensor_option(text="Sensor for all properties that the files do not hold. Required for -o.")
@options.file_option("-o", "--output", suffixes=options.SENSOR_SUFFIXES, text="Sensor file to write (YAML).")
@options.json_option
def command(
    files: tuple[Path, ...],
    sensor_name: str | None,
    output: Path | None,
    as_json: bool,
    **choices: Any,
) -> None:
    """Read a noise profile (darktable, libcamera, DNG), or maps of offset, variance and gain of a microscope camera.

    With -o and --sensor, writes a sensor file for simulation. Of a profile, all dark noise is read noise and DSNU is 0.
    Maps of `import maps` are MATLAB (smite, SMAP, or one variable each), TIFF (GDSC SMLM, OME, PYME, or one map each),
    .calb (Accent) and .npy files, or a folder of them (PYME, DECODE); each is known by its name, or its variable's.
    Their sensor file has the maps beside it, and simulated frames the chip's pattern. Geometry, volts, spectra and all
    else are those of --sensor.

    Example: photosite import noiseprofiles.json --model "X-1" --gain-setting 400 --sensor nikon-d200 -o x1.sensor.yaml
    """
    from photosite.sensor.io.camera_maps import is_of_maps
    from photosite.sensor.io.sensor_file import load_sensor
    from photosite.sensor.noise_profile import profile_at_setting

    if (output is None) != (sensor_name is None):
        raise click.UsageError("-o and --sensor are required together: --sensor has what the files do not hold")
    if files[0] == Path("maps") and len(files) > 1:
        options.not_for("maps", "model", "mono", "gain_setting")
        _import_maps(files[1:], choices["gain_dn_per_e"], choices["in_electrons"], sensor_name, output, as_json)
        return
    if files == (Path("maps"),) and not files[0].exists():
        raise click.UsageError("name the files or the folder of the maps: photosite import maps FILE...")
    if len(files) > 1:
        raise click.UsageError("a noise profile is one file; several maps are read by: photosite import maps FILE...")
    if is_of_maps(files[0]):
        raise click.UsageError(f"{files[0]} is no noise profile; maps are read by: photosite import maps {files[0]}")
    options.only_for("maps", "gain_dn_per_e", "in_electrons")
    (file,), model, gain_setting, mono = files, choices["model"], choices["gain_setting"], choices["mono"]
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


def _import_maps(
    files: tuple[Path, ...],
    gain_dn_per_e: float | None,
    in_electrons: bool,
    sensor_name: str | None,
    output: Path | None,
    as_json: bool,
) -> None:
    """Show the maps in files, and write a sensor file with them."""
    import numpy as np

    from photosite.sensor.io.camera_maps import read_camera_maps, sensor_of_chip
    from photosite.sensor.io.sensor_file import load_sensor, write_sensor

    maps = read_camera_maps(files, gain_dn_per_e=gain_dn_per_e, in_electrons=in_electrons)
    if output is not None and sensor_name is not None:
        chip = maps.chip()
        write_sensor(sensor_of_chip(chip, load_sensor(sensor_name)), output, chip)
    for note in maps.notes:
        say(note)
    facts: dict[str, dict[str, float]] = {}
    for name in ("offset_dn", "variance_dn2", "gain_dn_per_e", "dark_rate_dn_per_s"):
        if (values := getattr(maps, name)) is not None:
            low, median, high = np.percentile(values, (1, 50, 99)).tolist()
            facts[name] = {"median": median, "percentile_1": low, "percentile_99": high}
    shape = next(values.shape for name in facts if (values := getattr(maps, name)) is not None)
    rows = [("map", "median", "1 %", "99 %"), *((name, *(f"{x:.5g}" for x in f.values())) for name, f in facts.items())]
    content = {"rows": shape[0], "cols": shape[1], "maps": facts, "notes": list(maps.notes)}
    show(as_json, content, lambda: f"{table(rows, '<>>>')}\n{shape[0]} x {shape[1]} pixels", sensor=output)


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
