"""The views that run a computation as a job: planning of a measurement, sweeps, and those of other files."""

from __future__ import annotations

import base64
import io
import json
import math
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field

from photosite.app.calibrate_results import ReportRequest, write_report
from photosite.app.calibrate_view import (
    CalibrationRequest,
    FolderRequest,
    calibration_code,
    list_frames,
    run_calibration,
)
from photosite.app.compare_view import (
    Comparison,
    ValidationRequest,
    compare,
    compare_code,
    run_validation,
    validation_code,
)
from photosite.app.copy_text import exposure_text, lens_lines, sensor_lines, source_name
from photosite.app.lens_state import LensState, lens
from photosite.app.places import Part, Places, Text
from photosite.app.quality_values import QualityValues
from photosite.app.quality_view import QualityRequest, quality_code, run_quality
from photosite.app.state import LIGHT, SensorState, changed_sensor, light_name
from photosite.app.workers import Progress
from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.metrics.registry import axis_label
from photosite.report.numbers import format_duration
from photosite.report.style import new_figure, styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.studies.gray_surface import snr
from photosite.studies.planning import Design, Want, plan_frames, precision_curves
from photosite.studies.sensor_comparison import sensor_figures
from photosite.studies.simulated_charts import image_quality
from photosite.studies.sweep import sweep
from photosite.studies.virtual_lab import with_pedestal

_WANTS = "Standard uncertainty of each parameter: 2% of its value, or a number in its unit."


@dataclass(frozen=True)
class JobView:
    """A view: its name in the API, its request, its computation, and its Python code and command.

    The command is empty where no command can do it.
    """

    name: str
    summary: str
    request: type[BaseModel]
    compute: Callable[..., dict[str, Any]]
    code: Callable[..., tuple[str, str]]


class PlanRequest(Part):
    """The precision that a calibration shall reach."""

    sensor: SensorState = SensorState()
    wants: dict[Text, Text] = Field({"system_gain_dn_per_e": "0.5%"}, min_length=1, max_length=12, description=_WANTS)
    longest_dark_s: float = Field(5.0, gt=0, le=1e5, description="Longest exposure time of a dark frame in s.")
    longest_flat_s: float = Field(1 / 20, gt=0, le=1e5, description="Longest exposure time of a flat field in s.")
    illuminant: Text = Field("D65", description=LIGHT)
    seconds_per_frame: float = Field(1.0, ge=0, le=3600, description="Time to read and save a frame, in s.")


def plan(request: PlanRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the plan with the fewest frames, and the time that taking them needs."""
    sensor = changed_sensor(request.sensor, places)
    raised = sensor if "black_level_dn" in request.sensor.changes else with_pedestal(sensor)
    found = plan_frames(
        raised,
        _wants(request),
        design=Design(request.longest_dark_s, request.longest_flat_s),
        illuminant=light_name(request.illuminant, places),
    )
    frames, ratios = precision_curves(found)
    seconds = sum(group.frames * (group.exposure_s + request.seconds_per_frame) for group in found.groups)
    return {
        **found.to_dict(),
        "seconds": seconds,
        "duration": format_duration(seconds),
        "black_level_dn": raised.readout.black_level_dn.value,
        "precision": {
            "frames": frames,
            "expected_over_wanted": {name: [_finite(each) for each in values] for name, values in ratios.items()},
        },
    }


def _wants(request: PlanRequest) -> dict[str, Want]:
    wants = [Want.parse(f"{name}={value}") for name, value in request.wants.items()]
    return {want.parameter: want for want in wants}


def plan_code(request: PlanRequest, places: Places) -> tuple[str, str]:
    """Return the plan as Python code and as a command, which takes unchanged sensors only."""
    illuminant = light_name(request.illuminant, places)
    lines = [
        "import photosite as ps",
        "from photosite.studies.planning import Design, Want, plan_frames",
        "from photosite.studies.virtual_lab import with_pedestal",
        "",
        *sensor_lines(request.sensor, places),
        *([] if "black_level_dn" in request.sensor.changes else ["sensor = with_pedestal(sensor)"]),
        f"texts = {[f'{name}={value}' for name, value in request.wants.items()]!r}",
        "wants = {want.parameter: want for want in map(Want.parse, texts)}",
        f"design = Design({request.longest_dark_s!r}, {request.longest_flat_s!r})",
        f"plan = plan_frames(sensor, wants, design=design, illuminant={illuminant!r})",
        "print(plan.to_dict())",
    ]
    command = ""
    if not request.sensor.changed:
        words = ["photosite", "plan", "--sensor", source_name(request.sensor.source, places)]
        if request.sensor.gain_setting is not None:
            words += ["--gain-setting", repr(request.sensor.gain_setting)]
        for name, value in request.wants.items():
            words += ["--want", f"{name}={value}"]
        words += ["--longest-flat", exposure_text(request.longest_flat_s)]
        words += ["--longest-dark", exposure_text(request.longest_dark_s), "--illuminant", illuminant]
        command = shlex.join(words)
    return "\n".join(lines) + "\n", command


class Range(Part):
    """Values of a field, evenly spaced or in equal factors."""

    field: Text
    first: float
    last: float
    count: int = Field(9, ge=1, le=200)
    logarithmic: bool = False

    @property
    def values(self) -> list[float]:
        """The values, six digits each; whole numbers where the field needs them."""
        if self.logarithmic:
            if not (self.first > 0 and self.last > 0):
                raise InputError(self.field, value=(self.first, self.last), expected="above 0 for equal factors")
            found = np.geomspace(self.first, self.last, self.count)
        else:
            found = np.linspace(self.first, self.last, self.count)
        if self.field in _WHOLE:
            return [int(value) for value in dict.fromkeys(found.round())]
        return list(dict.fromkeys(float(f"{value:.6g}") for value in found))


_WHOLE = ("bits", "rows", "cols")
_MOST_POINTS = 1600


class SweepRequest(Part):
    """A measure of a camera over the values of one or two of its fields."""

    sensor: SensorState = SensorState()
    lens: LensState = LensState(f_number=2.8)
    ranges: Annotated[tuple[Range, ...], Field(min_length=1, max_length=2)] = (
        Range(field="pixel_width_um", first=1, last=8, count=15),
    )
    measure: Literal["snr", "sensor_figures", "image_quality"] = Field("snr", description="As for `photosite sweep`.")
    luminance_cd_m2: float = Field(5.0, gt=0, le=1e9, description="Luminance of the surface, or mean of the charts.")
    exposure_s: float | None = Field(
        1 / 60, gt=0, le=1e5, description="Exposure time in s. null: just below saturation, for image_quality."
    )
    illuminant: Text = Field("D65", description=LIGHT)
    values: QualityValues = ()
    frames: int = Field(4, ge=0, le=64, description="Frames of each chart; 0: mean electrons without noise.")


def run_sweep(request: SweepRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the columns of `sweep`, labels and units of image quality, notes, and its figure as PNG in base64."""
    values = _values(request)
    if (points := math.prod(map(len, values.values()))) > _MOST_POINTS:
        raise InputError("values", value=points, expected=f"at most {_MOST_POINTS} cameras")
    camera = Camera(lens(request.lens, places), changed_sensor(request.sensor, places))
    arguments, done = _arguments(request, places), 0

    def report(_: str = "") -> None:
        if progress is not None:
            progress(done, points, "cameras")

    if request.measure == "image_quality":
        arguments["on_progress"] = report  # where the job can be cancelled, too
    measure = partial(_MEASURES[request.measure][0], **arguments)

    def counted(*changed: Any) -> Any:
        nonlocal done
        found = measure(*changed)
        done += 1
        report()
        return found

    found = sweep(camera, values, counted, scene=_scene(request, places), progress=False)
    picture = io.BytesIO()
    with styled():
        figure, axes = new_figure()
        found.plot(ax=axes)
        figure.savefig(picture, format="png", dpi=150)
    columns = {name: [_finite(value) for value in column] for name, column in found.to_dict().items()}
    return {
        "fields": list(found.fields),
        "measured": list(found.values),
        "labels": {} if request.measure != "image_quality" else {name: axis_label(name) for name in found.values},
        "columns": columns,
        "notes": list(found.notes),
        "png": base64.b64encode(picture.getvalue()).decode(),
    }


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _values(request: SweepRequest) -> dict[str, list[float]]:
    if len({entry.field for entry in request.ranges}) < len(request.ranges):
        raise InputError("field", value=request.ranges[0].field, expected="two different fields")
    return {entry.field: entry.values for entry in request.ranges}


_MEASURES: dict[str, tuple[Callable[..., Any], str]] = {
    "snr": (snr, "gray_surface"),
    "sensor_figures": (sensor_figures, "sensor_comparison"),
    "image_quality": (image_quality, "simulated_charts"),
}
"""Functions of the measures, and their modules in `photosite.studies`."""


def _arguments(request: SweepRequest, places: Places) -> dict[str, Any]:
    """Return the arguments of the measure."""
    quality = request.measure == "image_quality"
    if quality and not request.values:
        raise InputError("values", value=request.values, expected="at least one value of image quality")
    if not quality and request.exposure_s is None:
        raise InputError("exposure_s", value=None, expected=f"a time in s for {request.measure}")
    light = {"exposure_s": request.exposure_s, "illuminant": light_name(request.illuminant, places)}
    of_surface = {} if request.measure == "sensor_figures" else {"luminance_cd_m2": request.luminance_cd_m2}
    return ({"values": request.values, "frames": request.frames} if quality else {}) | of_surface | light


def _scene(request: SweepRequest, places: Places) -> Scene | None:
    """Return the surface whose light the charts have, where it is varied."""
    if request.measure != "image_quality" or "mean_luminance_cd_m2" not in _values(request):
        return None
    return charts.uniform(light_name(request.illuminant, places), request.luminance_cd_m2)


def sweep_code(request: SweepRequest, places: Places) -> tuple[str, str]:
    """Return the sweep as Python code and as a sweep file with its command, which takes unchanged sensors only."""
    illuminant = light_name(request.illuminant, places)
    arguments = _arguments(request, places)
    function, where = _MEASURES[request.measure]
    scene = f"scene = ps.charts.uniform({illuminant!r}, {request.luminance_cd_m2!r})"
    varied = _scene(request, places) is not None
    lines = [
        "from functools import partial",
        "import photosite as ps",
        f"from photosite.studies.{where} import {function.__name__}",
        "",
        *sensor_lines(request.sensor, places),
        *lens_lines(request.lens, places),
        f"values = {_values(request)!r}",
        f"measure = partial({function.__name__}, {', '.join(f'{name}={each!r}' for name, each in arguments.items())})",
        *([scene] if varied else []),
        f"table = ps.studies.sweep(ps.Camera(optics, sensor), values, measure{', scene=scene' if varied else ''})",
        "print(table)",
        "table.plot()",
    ]
    command = ""
    if not request.sensor.changed:
        camera: dict[str, Any] = {"sensor": source_name(request.sensor.source, places)}
        if request.sensor.gain_setting is not None:
            camera["gain_setting"] = request.sensor.gain_setting
        source = request.lens.source
        camera["optics"] = request.lens.fields if source is None else source_name(source, places)
        time_s = arguments.pop("exposure_s")
        measured = arguments | ({} if time_s is None else {"exposure": exposure_text(time_s)})
        content = {
            "photosite_sweep": 1,
            "camera": camera,
            "values": _values(request),
            "measure": {request.measure: measured},
        }
        file = "\n".join(f"{name}: {json.dumps(value)}" for name, value in content.items())
        command = f"cat > workbench.sweep.yaml <<'END'\n{file}\nEND\n"
        command += "photosite sweep workbench.sweep.yaml -o workbench.csv\n"
    return "\n".join(lines) + "\n", command


def no_code(request: BaseModel, places: Places) -> tuple[str, str]:
    """Return no code, for requests that list something or follow a result."""
    return "", ""


VIEWS = (
    JobView("comparison", "Compare cameras in the same light.", Comparison, compare, compare_code),
    JobView(
        "validation",
        "Compare measured frames with their simulation.",
        ValidationRequest,
        run_validation,
        validation_code,
    ),
    JobView("plan", "Find the fewest frames that reach a precision.", PlanRequest, plan, plan_code),
    JobView("frames-of-folder", "List the frames of a folder, in groups.", FolderRequest, list_frames, no_code),
    JobView("calibration", "Calibrate a sensor.", CalibrationRequest, run_calibration, calibration_code),
    JobView("report", "Write the report of a calibration.", ReportRequest, write_report, no_code),
    JobView("sweep", "Measure a camera over values of its fields.", SweepRequest, run_sweep, sweep_code),
    JobView("quality", "Measure the image quality of a camera.", QualityRequest, run_quality, quality_code),
)
"""The views with a job; the server adds the requests of each."""
