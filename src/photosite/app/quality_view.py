"""The view of image quality: frames of a chart, simulated with a camera or taken by one, are measured."""

from __future__ import annotations

import base64
import io
import json
import shlex
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from photosite.app.copy_text import lens_lines, sensor_lines, source_name
from photosite.app.lens_state import LensState, lens
from photosite.app.places import Part, Places, Text
from photosite.app.state import LIGHT, SensorState, changed_sensor, light_name
from photosite.app.workers import Progress, steps
from photosite.camera.camera import Camera
from photosite.errors import InputError
from photosite.frames.io.formats import raw_files
from photosite.metrics.measurement import Result
from photosite.metrics.photographs import measure_files
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
    luminance_cd_m2: float | None = Field(
        200.0, gt=0, le=1e9, description="Mean luminance of the chart; null: not known, of frames that are measured."
    )
    illuminant: Text = Field("D65", description=LIGHT)
    measured: Annotated[tuple[Text, ...], Field(max_length=64)] = Field(
        (), description="Frames to measure, one stack: files and folders (file:NAME, upload:ID). None: simulated ones."
    )
    in_electrons: bool = Field(False, description="The sensor took the measured frames: values in electrons.")
    detect: bool = Field(False, description="Find the chart in the measured frames; else it fills them.")


def run_quality(request: QualityRequest, places: Places, progress: Progress | None = None) -> dict[str, Any]:
    """Return the sections of the measurements: values, figures as PNG in base64, and diagnostics."""
    light = light_name(request.illuminant, places)
    report = steps(progress)
    if request.measured:
        files = [file for path in _paths(request, places) for file in raw_files(path)]
        found = measure_files(
            files,
            request.chart,
            sensor=changed_sensor(request.sensor, places) if request.in_electrons else None,
            illuminant=light,
            luminance_cd_m2=request.luminance_cd_m2,
            detect=request.detect,
            on_progress=report,
        )
    else:
        camera = Camera(lens(request.lens, places), changed_sensor(request.sensor, places))
        conditions = ChartConditions(request.frames, 0, light, _luminance(request))
        found = measure_camera(camera, conditions, charts=[request.chart], on_progress=report).charts[request.chart]
    return {
        "chart": request.chart,
        "missing": [[name, each.reason] for name, each in found.results.items() if isinstance(each, Missing)],
        "sections": [_section(each) for each in found.results.values() if isinstance(each, Result)],
    }


def _paths(request: QualityRequest, places: Places) -> list[Path]:
    found = [places.path(name) for name in request.measured]
    if None in found:
        raise InputError("measured", value=request.measured[found.index(None)], expected="file:NAME or upload:ID")
    return [path for path in found if path is not None]


def _luminance(request: QualityRequest) -> float:
    if request.luminance_cd_m2 is None:
        raise InputError("luminance_cd_m2", value=None, expected="the mean luminance of the chart that is simulated")
    return request.luminance_cd_m2


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
    if request.measured:
        return _measured_code(request, places, light)
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


def _measured_code(request: QualityRequest, places: Places, light: str) -> tuple[str, str]:
    """Return the measurement of frames as Python code and as a command."""
    names = [source_name(name, places) for name in request.measured]
    lines = [
        "from pathlib import Path",
        "",
        "import photosite as ps",
        "from photosite.frames.io.formats import raw_files",
        "from photosite.metrics.photographs import measure_files",
        "",
        *(sensor_lines(request.sensor, places) if request.in_electrons else ("sensor = None",)),
        f"files = [file for name in {names!r} for file in raw_files(Path(name))]",
        f"quality = measure_files(files, {request.chart!r}, sensor=sensor, {light}, detect={request.detect})",
        "print(quality)",
    ]
    if request.in_electrons and (request.sensor.changed or request.sensor.gain_setting is not None):
        return "\n".join(lines) + "\n", ""
    words = ["photosite", "measure", *names, "--chart", request.chart]
    words += ["--illuminant", str(light_name(request.illuminant, places))]
    words += [] if request.luminance_cd_m2 is None else ["--luminance", repr(request.luminance_cd_m2)]
    words += ["--sensor", source_name(request.sensor.source, places)] if request.in_electrons else []
    return "\n".join(lines) + "\n", shlex.join([*words, *(["--detect"] if request.detect else [])]) + "\n"
