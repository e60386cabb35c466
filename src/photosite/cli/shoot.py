"""`photosite shoot`: the frames of a measurement protocol, from a virtual sensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import Stages, say, say_if_compiling, show


@click.command("shoot", cls=Command)
@options.virtual_sensor_options
@click.option("--no-pedestal", is_flag=True, help="Keep the sensor's own black level, even if dark frames clip at 0.")
@options.virtual_light_options("Write the photons per pixel to the protocol, as from a calibrated photodiode.")
@options.seed_option()
@options.folder_option(options.output_folder, "Folder to write; it must not exist or must be empty.")
@click.option(
    "--captures", is_flag=True, help="Write the frames of each capture of a sensor with several, in a subfolder each."
)
@options.json_option
@click.pass_context
def command(
    ctx: click.Context,
    /,
    no_pedestal: bool,
    illuminant: str,
    seed: int,
    output: Path,
    captures: bool,
    as_json: bool,
    **chip: Any,
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
    from photosite.cli.memory_need import megapixels, shoot_bytes, warn_if_short
    from photosite.studies.protocol import paper_d200_protocol
    from photosite.studies.virtual_lab import NOMINAL_NAME, PROTOCOL_NAME, TRUTH_NAME, virtual_lab

    if no_pedestal and chip["black_level_dn"] is not None:
        raise click.UsageError("--no-pedestal keeps the sensor's own black level, so omit --black-level")
    light = {"level": chip.pop("level"), "photons_known": chip.pop("photons")}
    sensor, note = options.prepared_sensor(**chip, pedestal=not no_pedestal)
    protocol = paper_d200_protocol()
    if note:
        protocol = replace(protocol, name=f"{protocol.name}; {note}")
    size = megapixels(sensor.array.rows, sensor.array.cols)
    hint = "Use fewer --rows and --cols, or a machine with more memory"
    warn_if_short(f"a measurement of {size}", shoot_bytes(sensor), hint)
    say_if_compiling()
    if sensor.maps is not None and not options.is_given(ctx, "seed"):
        say(
            f"the sensor's maps contain residual noise of their frames; if these were simulated with seed {seed}, pass "
            "another --seed, so that the new frames are independent"
        )
    lab = virtual_lab(sensor, protocol, illuminant=illuminant, seed=seed, **light)
    if note:
        say(f"{note} (--no-pedestal keeps the sensor's own, --black-level sets another)")
    lab.write(output, Stages(), captures=captures)
    rows, cols, count = sensor.array.rows, sensor.array.cols, protocol.frame_count
    facts = {
        "path": output,
        "protocol": output / PROTOCOL_NAME,
        "nominal_sensor": output / NOMINAL_NAME,
        "true_sensor": output / TRUTH_NAME,
        "frames": count,
        "rows": rows,
        "cols": cols,
        "black_level_dn": sensor.readout.black_level_dn.value,
        "luminance_cd_m2": lab.light.mean_luminance_cd_m2(),
        "seed": seed,
    }
    show(as_json, facts, lambda: f"wrote {count} frames of {rows} x {cols} to {output}")
