"""`photosite shoot`: the frames of a measurement protocol, from a virtual sensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, print_json, say, say_if_compiling

if TYPE_CHECKING:
    from photosite.sensor.model import Sensor


@click.command("shoot", cls=Command)
@options.sensor_option()
@options.size_options
@options.black_level_option("Black level in DN; without it, one at which dark frames do not clip at 0.")
@click.option("--no-pedestal", is_flag=True, help="Keep the sensor's own black level, even if dark frames clip at 0.")
@options.illuminant_option("D65")
@click.option(
    "--level",
    type=options.above(),
    default=1.3,
    metavar="X",
    help="Light level: signal of the brightest channel at the longest exposure time, relative to saturation.",
)
@click.option(
    "--photons", is_flag=True, help="Write the photons per pixel to the protocol, as from a calibrated photodiode."
)
@options.seed_option()
@click.option(
    "-o",
    "--output",
    type=options.output_folder,
    metavar="FOLDER",
    required=True,
    help="Folder to write; it must not exist or must be empty.",
)
@options.json_option
def command(
    sensor_name: str,
    rows: int | None,
    cols: int | None,
    black_level_dn: float | None,
    no_pedestal: bool,
    illuminant: str,
    level: float,
    photons: bool,
    seed: int,
    output: Path,
    as_json: bool,
) -> None:
    """Simulate a measurement: the dark frames and flat fields of a calibration.

    Simulates the 2008 paper's protocol: 190 dark frames from 1/8000 to 30 s, 150 dark frames at 1/8000 s, and 65 frames
    of a uniform field from 1/8000 to 1/25 s. Writes the frames (16-bit TIFF), protocol.yaml, nominal.sensor.yaml (the
    data known before the measurement) and truth.sensor.yaml (the expected result of the calibration). A full-size D200
    takes 8 GB; --rows and --cols make a smaller chip of the same pixels.

    The maps of a sensor file contain residual noise of the frames that they were measured on. If those frames were
    simulated, use another seed than theirs (default 0): the same seed repeats the noise in the maps, and the new frames
    are not independent of them.

    Example: photosite shoot --rows 648 --cols 968 -o stack && photosite calibrate stack
    """
    from photosite.studies.protocol import paper_d200_protocol
    from photosite.studies.virtual_lab import NOMINAL_NAME, PROTOCOL_NAME, TRUTH_NAME, virtual_lab

    if no_pedestal and black_level_dn is not None:
        raise click.UsageError("--no-pedestal keeps the sensor's own black level, so omit --black-level")
    sensor, note = prepared_sensor(sensor_name, rows, cols, black_level_dn, pedestal=not no_pedestal)
    protocol = paper_d200_protocol()
    if note:
        protocol = replace(protocol, name=f"{protocol.name}; {note}")
    say_if_compiling()
    if sensor.maps is not None and seed_is_default():
        say(
            f"the sensor's maps contain residual noise of their frames; if these were simulated with seed {seed}, pass "
            "another --seed, so that the new frames are independent"
        )
    lab = virtual_lab(sensor, protocol, illuminant=illuminant, level=level, seed=seed, photons_known=photons)
    if note:
        say(f"{note} (--no-pedestal keeps the sensor's own, --black-level sets another)")
    lab.write(output, Stages())
    if as_json:
        print_json(
            {
                "path": str(output),
                "protocol": str(output / PROTOCOL_NAME),
                "nominal_sensor": str(output / NOMINAL_NAME),
                "true_sensor": str(output / TRUTH_NAME),
                "frames": protocol.frame_count,
                "rows": sensor.array.rows,
                "cols": sensor.array.cols,
                "black_level_dn": sensor.readout.black_level_dn.value,
                "luminance_cd_m2": lab.light.mean_luminance_cd_m2(),
                "seed": seed,
            }
        )
    else:
        click.echo(f"wrote {protocol.frame_count} frames of {sensor.array.rows} x {sensor.array.cols} to {output}")


def seed_is_default() -> bool:
    """Return whether the current command was called without --seed."""
    source = click.get_current_context().get_parameter_source("seed")
    return source is click.core.ParameterSource.DEFAULT


def prepared_sensor(
    name: str, rows: int | None, cols: int | None, black_level: float | None, *, pedestal: bool = True
) -> tuple[Sensor, str]:
    """Return a sensor, with a black level at which dark frames do not clip unless one is given, and a note on it."""
    from photosite.studies.virtual_lab import dark_noise_dn, with_pedestal

    sensor = options.load_sensor_resized(name, rows, cols, black_level)
    raised = with_pedestal(sensor) if pedestal and black_level is None else sensor
    if raised is sensor:
        return sensor, ""
    own, high = (each.readout.black_level_dn.value for each in (sensor, raised))
    return raised, (
        f"black level raised from {own:g} to {high:g} DN: dark frames with {dark_noise_dn(sensor):.2f} DN of noise "
        "would clip at 0"
    )
