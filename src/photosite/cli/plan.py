"""`photosite plan`: frames for a precision, or the precision of a protocol."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from photosite.cli import options
from photosite.cli.command import Group, OptionSpelling
from photosite.cli.output import say, show, table, tabular, working

if TYPE_CHECKING:
    from photosite.camera.camera import Camera
    from photosite.frames.frame_settings import Kind
    from photosite.sensor.model import Sensor
    from photosite.studies.measurement_planning import MeasurementPlan
    from photosite.studies.planning import Plan
    from photosite.studies.protocol import ShootingProtocol

_NAMED = ("paper-d200",)


@click.group("plan", cls=Group, invoke_without_command=True)
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
@click.pass_context
def command(
    ctx: click.Context,
    /,
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

    `photosite plan measure` plans a measurement of image quality.

    Example: photosite plan --rows 1000 --cols 1500 --want prnu_percent=2% --want system_gain_dn_per_e=0.5%
    """
    if ctx.invoked_subcommand is not None:
        if own := [name for name in ctx.params if options.is_given(ctx, name)]:
            option = OptionSpelling(ctx.command).name(own[0])
            raise click.UsageError(f"{option} before 'measure' plans a calibration; omit it, or give it after", ctx)
        return
    with working(ctx.command_path):
        _plan_calibration(wants, protocol, steps, illuminant, photons, as_json, given)


def _plan_calibration(
    wants: tuple[str, ...],
    protocol: str | None,
    steps: tuple[str, ...],
    illuminant: str,
    photons: bool,
    as_json: bool,
    given: dict[str, Any],
) -> None:
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


@command.command("measure")
@click.option(
    "--want",
    "wants",
    multiple=True,
    required=True,
    metavar="VALUE=X",
    help="Half width of the 95 % interval to reach, in the unit of the value (edge-sfr.mtf50.G=0.01, "
    "noise.snr_18_db=0.2dB) or relative (2%); without a part (.G), for every part; repeatable.",
)
@click.option(
    *("--camera", "camera_file"),
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Camera file.  [default: --sensor behind --f-number and --focal-length]",
)
@options.sensor_option("nikon-d200")
@options.lens_options()
@click.option(
    "--chart", "charts", multiple=True, metavar="NAME", help="Chart to plan with; may be repeated.  [default: all]"
)
@options.quantity("--width", "width_mm", unit="MM", default=200.0, text="Width of the chart in mm.")
@options.option(
    "--illuminant", default="D65", metavar="NAME|FILE", help=f"Light of the chart: {options.ILLUMINANT_HELP}"
)
@options.quantity("--luminance", "luminance_cd_m2", unit="CD/M2", default=200.0, text="Mean luminance of the chart.")
@options.exposure_option(text="Exposure time.  [default: just below saturation]")
@click.option(
    *("--set", "settings"),
    type=options.name_and_value,
    multiple=True,
    metavar="NAME=VALUE",
    help="An option of the measurement, such as order=1; may be repeated.",
)
@options.seed_option()
@options.json_option
@click.pass_context
def measure(
    ctx: click.Context,
    /,
    wants: tuple[str, ...],
    charts: tuple[str, ...],
    width_mm: float,
    settings: tuple[tuple[str, Any], ...],
    as_json: bool,
    **given: Any,
) -> None:
    """Find chart, distance, exposure and frames with which a value of image quality reaches a 95 % interval.

    Charts are simulated with the camera in several sizes, and measured. The part of the interval that more frames do
    not reduce (fixed pattern, the chart's size) is stated apart. `photosite measure --list --json` lists the values.

    Example: photosite plan measure --want edge-sfr.mtf50.G=0.02 --width 300
    """
    from photosite.studies.measurement_planning import Planner
    from photosite.studies.simulated_charts import ChartConditions

    light = {name: given[name] for name in ("seed", "illuminant", "luminance_cd_m2", "exposure_s")}
    planner = Planner(_camera(ctx, given), ChartConditions(**light), width_mm, say)
    plans = [planner.plan(want, charts, dict(settings)) for want in wants]
    content = {"plans": [plan.to_dict() for plan in plans]}
    show(as_json, content, lambda: "\n\n".join(map(_measurement_text, plans)))


def _camera(ctx: click.Context, given: dict[str, Any]) -> Camera:
    from photosite.camera.camera import Camera
    from photosite.camera.file import load_camera
    from photosite.optics.diffraction import DiffractionLimited
    from photosite.sensor.io.sensor_file import load_sensor

    if given["camera_file"] is not None:
        options.not_for("a camera file", "sensor_name", "f_number", "focal_length_mm")
        return load_camera(given["camera_file"]).camera
    lens = DiffractionLimited(f_number=given["f_number"], focal_length_mm=given["focal_length_mm"])
    return Camera(lens, load_sensor(given["sensor_name"]))


def _measurement_text(plan: MeasurementPlan) -> str:
    from photosite.report.numbers import format_number
    from photosite.values.exposure import format_exposure

    title = f"{plan.want.name} to {plan.want.text} (half width of the 95 % interval)"
    lines = [f"{title}: measured on {', '.join(plan.measured_on)}"]
    best, farthest = plan.best, plan.farthest
    if best is None or farthest is None:
        return "\n\n".join(["\n".join([*lines, plan.advice]), tabular(plan)])
    more = ", extrapolated" if best.extrapolated else ""
    frames = f"{best.frames} frame{'' if best.frames == 1 else 's'}{more}"
    lines += [
        f"take {frames} of {best.chart}, {plan.width_mm:g} mm wide and {best.cols} pixels across",
        f"distance: {format_number(best.distance_m, 3)} m (magnification {best.magnification:.3g}); "
        + f"up to {format_number(farthest.distance_m, 3)} m, {farthest.cols} pixels across, with "
        f"{farthest.frames} frame{'' if farthest.frames == 1 else 's'}",
        f"light: {plan.luminance_cd_m2:g} cd/m2 and {format_exposure(best.exposure_s)} s, the brightest parts at "
        f"{best.signal_percent:.0f} % of saturation",
        f"expected: {best.value:.4g} ±{best.half_width:.2g}, of which ±{best.systematic:.2g} remains with any number",
    ]
    if best.print_dpi is not None:
        lines.append(f"print the chart with {math.ceil(best.print_dpi / 10) * 10} dots per inch or more")
    return "\n\n".join(["\n".join(lines), tabular(plan)])
