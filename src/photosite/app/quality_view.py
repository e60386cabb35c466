"""The view of image quality: frames of a chart that a camera would take are simulated and measured."""

from __future__ import annotations

import base64
import io
import json
import shlex
from typing import Any

from pydantic import Field

from photosite.app.copy_text import lens_lines, sensor_lines, source_name
from photosite.app.lens_state import LensState, lens
from photosite.app.places import Part, Places, Text
from photosite.app.state import LIGHT, SensorState, changed_sensor, light_name
from photosite.app.workers import Progress
from photosite.camera.camera import Camera
from photosite.metrics.measurement import Result
from photosite.report.figures.measurement import curve_figures, map_figure
from photosite.studies.simulated_charts import ChartConditions, measure_camera
from photosite.values.uncertain import Missing

_DPI = 110


class QualityRequest(Part):
    """A camera and a chart, as for `photosite measure --camera`."""

    sensor: SensorState = SensorState()
    lens: LensState = LensState(f_number=2.8)
    chart: Text = Field("slanted-edge", description="A chart of GET /api/charts.")
    frames: int = Field(4, ge=0, le=64, description="Frames of the chart; 0: mean electrons without noise.")
    luminance_cd_m2: float = Field(200.0, gt=0, le=1e9, description="Mean luminance of the chart.")
    illuminant: Text = Field("D65", description=LIGHT)


def run_quality(request: QualityRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the sections of the measurements: values, figures as PNG in base64, and diagnostics."""
    camera = Camera(lens(request.lens, places), changed_sensor(request.sensor, places))
    light = light_name(request.illuminant, places)
    conditions = ChartConditions(request.frames, 0, light, request.luminance_cd_m2)
    steps = 0

    def report(what: str) -> None:
        nonlocal steps
        steps += 1
        if progress is not None:
            progress(steps, steps + 1, what)

    found = measure_camera(camera, conditions, charts=[request.chart], on_progress=report).charts[request.chart]
    return {
        "chart": request.chart,
        "missing": [[name, each.reason] for name, each in found.results.items() if isinstance(each, Missing)],
        "sections": [_section(each) for each in found.results.values() if isinstance(each, Result)],
    }


def _section(result: Result) -> dict[str, Any]:
    figures = [*curve_figures(result), *map(map_figure, result.maps)]
    return {
        **({} if result.measurement is None else result.measurement.about),
        "rows": [list(row) for row in result.rows()],
        "figures": [_png(figure) for figure in figures],
        "diagnostics": [f"{entry.id}: {entry}" for entry in result.diagnostics],
    }


def _png(figure: Any) -> str:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI)
    return base64.b64encode(picture.getvalue()).decode()


def quality_code(request: QualityRequest, places: Places) -> tuple[str, str]:
    """Return the measurement as Python code and as a command, which takes unchanged sensors only."""
    illuminant = light_name(request.illuminant, places)
    light = f"illuminant={illuminant!r}, luminance_cd_m2={request.luminance_cd_m2!r}"
    lines = [
        "import photosite as ps",
        "from photosite.studies.simulated_charts import ChartConditions, measure_camera",
        "",
        *sensor_lines(request.sensor, places),
        *lens_lines(request.lens, places),
        f"conditions = ChartConditions({request.frames}, {light})",
        f"quality = measure_camera(ps.Camera(optics, sensor), conditions, charts=[{request.chart!r}])",
        "print(quality)",
    ]
    command = ""
    if not request.sensor.changed:
        source = request.lens.source
        optics = request.lens.fields if source is None else source_name(source, places)
        content: dict[str, Any] = {"photosite_camera": 1, "sensor": source_name(request.sensor.source, places)}
        if request.sensor.gain_setting is not None:
            content["gain_setting"] = request.sensor.gain_setting
        file = "\n".join(f"{name}: {json.dumps(value)}" for name, value in (content | {"optics": optics}).items())
        words = ["photosite", "measure", "--camera", "workbench.camera.yaml", "--chart", request.chart]
        words += ["--frames", str(request.frames), "--illuminant", f"{illuminant}"]
        words += ["--luminance", repr(request.luminance_cd_m2)]
        command = f"cat > workbench.camera.yaml <<'END'\n{file}\nEND\n{shlex.join(words)}\n"
    return "\n".join(lines) + "\n", command
