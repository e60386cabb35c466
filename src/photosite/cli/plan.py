"""`photosite plan`: frames for a precision, or the precision of a protocol."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Command
from photosite.cli.output import show, table

if TYPE_CHECKING:
    from photosite.frames.frame_settings import Kind
    from photosite.sensor.model import Sensor
    from photosite.studies.planning import Plan
    from photosite.studies.protocol import ShootingProtocol

_NAMED = ("paper-d200",)


@click.command("plan", cls=Command)
@options.virtual_sensor_options
@click.option(
    "--want",
    "wants",
    multiple=True,
    metavar="PARAMETER=X",
    help="Standard uncertainty to reach, relative (prnu_percent=2%) or in its unit (read_noise_e=0.05); repeatable.",
)
@click.option(
    "--protocol",
    metavar="NAME|FILE",
    help=f"Protocol to evaluate: {', '.join(_NAMED)}, or a protocol file (YAML) whose frame files exist.",
)
@click.option(
    "--step",
    "steps",
    multiple=True,
    metavar="KIND:EXPOSURE:FRAMES",
    help="Step of the protocol to evaluate, such as dark:1/8000:50 or light:1/50:5; repeatable.",
)
@options.virtual_light_options("The light will be metered, so that the photons per pixel are known.")
@options.exposure_option(
    *("--longest-flat", "longest_flat"), default="1/20", text="Longest exposure time of a flat field in s."
)
@options.exposure_option(
    *("--longest-dark", "longest_dark"), default="5", text="Longest exposure time of a dark frame in s."
)
@options.json_option
def command(
    wants: tuple[str, ...],
    protocol: str | None,
    steps: tuple[str, ...],
    illuminant: str,
    photons: bool,
    as_json: bool,
    **given: Any,
) -> None:
    """Find how many frames a precision needs, or what precision a protocol reaches.

    The sensor is an assumption: a similar preset, or a file. With --want, the command searches the fewest frames: dark
    frames at one exposure, a dark series, and flat fields in up to 16 equal steps to 1.25 times saturation, never fewer
    than a calibration needs. With --protocol or --step, it prints the expected uncertainty of every parameter. Nothing
    is simulated: the uncertainty propagation of the calibration is applied to the expected signals. A real setup adds
    its own variation.

    Example: photosite plan --rows 1000 --cols 1500 --want prnu_percent=2% --want system_gain_dn_per_e=0.5%
    """
    from photosite.studies.planning import Design, Want, plan_frames, plan_protocol
    from photosite.studies.virtual_lab import virtual_lab

    if sum(map(bool, (wants, protocol, steps))) != 1:
        raise click.UsageError("give one of --want, --protocol and --step")
    if wants:
        options.only_for("--protocol and --step", "level")
    else:
        options.only_for("--want", "longest_flat", "longest_dark")
    wanted = {want.parameter: want for want in map(Want.parse, wants)}
    level, longest = given.pop("level"), (given.pop("longest_dark"), given.pop("longest_flat"))
    sensor, note = options.prepared_sensor(**given)
    if wanted:
        design = Design(*longest)
        plan = plan_frames(sensor, wanted, design=design, illuminant=illuminant, metered=photons)
    else:
        shooting = _protocol(protocol, steps)
        plan = plan_protocol(virtual_lab(sensor, shooting, illuminant=illuminant, level=level, photons_known=photons))
    show(as_json, plan.to_dict() | ({"note": note} if note else {}), lambda: _text(plan, sensor, note))


def _protocol(named: str | None, steps: tuple[str, ...]) -> ShootingProtocol:
    from photosite.errors import FileError
    from photosite.frames.io.protocol import read_protocol
    from photosite.studies.planning import step_from
    from photosite.studies.protocol import ShootingProtocol, Step, paper_d200_protocol

    if steps:
        return ShootingProtocol("steps", tuple(map(step_from, steps)))
    if named in _NAMED:
        return paper_d200_protocol()
    path = Path(str(named))
    found = read_protocol(path)
    counts: dict[tuple[Kind, float], int] = {}
    for entry in found.frame_files(path):
        kind, exposure_s = entry.settings.kind, entry.settings.exposure_s
        if kind is None or exposure_s is None:
            problem = f"a plan needs kind and exposure of {entry.path}"
            raise FileError(path, problem, entry.line, hint="State them in the protocol")
        counts[kind, exposure_s] = counts.get((kind, exposure_s), 0) + 1
    steps_found = (Step(kind, exposure_s, count) for (kind, exposure_s), count in counts.items())
    return ShootingProtocol(found.name or path.name, tuple(steps_found))


def _text(plan: Plan, sensor: Sensor, note: str) -> str:
    from photosite.report.numbers import format_duration, format_number
    from photosite.studies.planning import LEAST_IN_WORDS, PLANNED_LABELS, setting_text
    from photosite.values.exposure import format_exposure

    exposed = format_duration(sum(group.frames * group.exposure_s for group in plan.groups))
    size = f"{sensor.array.rows} x {sensor.array.cols} pixels"
    lines = [f"{plan.protocol.frame_count} frames of {sensor.name}, {size}; {exposed} of exposure"]
    if note:
        lines.append(note)
    if plan.least:
        lines.append(f"the minimum of a calibration ({LEAST_IN_WORDS}) reaches the wanted precision")
    groups = [("frames", "exposure", "light")]
    for group in plan.groups:
        text = format_exposure(group.exposure_s)
        exposure = text if "/" in text else f"{group.exposure_s:.4g}"
        groups.append((str(group.frames), f"{exposure} s", setting_text(group, sensor.saturation_capacity_e)))
    wanted = {want.parameter: f"wanted: {want.text}" for want in plan.wants}
    rows = [("parameter", "expected", "uncertainty", "relative", "unit", "name", "")]
    for name, entry in plan.estimates.items():
        if entry.standard_uncertainty is None:
            continue
        value, uncertainty = entry.value or 0.0, entry.standard_uncertainty
        known = uncertainty < abs(value)  # a relative uncertainty of a value near 0 is meaningless
        relative = f"{100 * uncertainty / abs(value):.2g} %" if known else ""
        expected = format_number(value, 4) if known else "0"
        shown = PLANNED_LABELS[name]
        number = format_number(uncertainty, 2)
        rows.append((shown.label, expected, number, relative, shown.unit, name, wanted.get(name, "")))
    return "\n\n".join(["\n".join(lines), table(groups, ">><"), table(rows, "<>>><<<")])
