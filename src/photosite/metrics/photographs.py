"""Photographs of several charts: a file that lists them, and all their values as those of one camera.

photosite_photographs: 1
name: Phone, serial number 7
sensor: google-pixel-4a               # preset or file, for values in electrons
illuminant: D65                       # of all photographs
photographs:
  - chart: slanted-edge
    frames: edge-*.dng                # or a list: one stack of one scene and setting
  - chart: slanted-edge
    name: corner                      # where a chart is listed twice
    frames: corner.dng
    corners: [[100, 80], [100, 900], [700, 900], [700, 80]]
    luminance_cd_m2: 120
    only: [edge-sfr]
    options: {edge-sfr: {order: 1}}
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from photosite.errors import FileError, InputError, did_you_mean
from photosite.files.yaml import check_version, line_at, line_of, read_yaml, validated
from photosite.frames.io.protocol import matching_files
from photosite.metrics.camera_quality import CameraQuality
from photosite.metrics.chart_image import ToneCurveName, chart_image
from photosite.metrics.measure import ImageQuality, measure
from photosite.metrics.registry import charts_measured
from photosite.metrics.tone_curve import ToneCurve
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.values.region import Corners
from photosite.values.validated import Section

VERSION_KEY = "photosite_photographs"

_PLACING = ("corners", "detect", "illuminant", "luminance_cd_m2", "chart_options")


class _Photograph(Section):
    chart: str
    frames: str | Annotated[list[str], Field(min_length=1)]
    name: str | None = None
    corners: Corners | None = None
    detect: bool = False
    illuminant: str | float | None = None
    luminance_cd_m2: float | None = None
    tone_curve: str = "file"
    only: tuple[str, ...] = ()
    options: dict[str, dict[str, Any]] = Field(default_factory=dict)
    chart_options: dict[str, Any] = Field(default_factory=dict)


class _File(Section):
    photosite_photographs: Literal[1]
    name: str | None = None
    sensor: str | None = None
    illuminant: str | float | None = None
    photographs: Annotated[list[_Photograph], Field(min_length=1)]


def measure_files(
    files: Sequence[Path],
    chart: str,
    *,
    sensor: Sensor | None = None,
    tone_curve: str = "file",
    reading: Mapping[str, Any] | None = None,
    **given: Any,
) -> ImageQuality:
    """Measure image quality on files of frames, as `photosite.measure` does.

    Parameters
    ----------
    files, chart, sensor
        As for `photosite.measure`.
    tone_curve
        "file", "srgb", "linear" or "chart", or the JSON file of a tone curve that was measured.
    reading
        Arguments of `photosite.read_raw`.
    **given
        Other arguments of `photosite.measure`.

    Raises
    ------
    InputError
        As `photosite.measure` does.
    """
    named = tone_curve in get_args(ToneCurveName)
    decoded: Any = tone_curve if named else "file"
    image = chart_image(files, sensor=sensor, tone_curve=decoded, **(reading or {}))
    own: Any = "file" if named else tone_curve if tone_curve == "chart" else ToneCurve.load(Path(tone_curve))
    return measure(image, chart, tone_curve=own, **given)


def measure_photographs(
    path: str | PathLike[str],
    *,
    reading: Mapping[str, Any] | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> CameraQuality:
    """Measure image quality on photographs of several charts.

    Parameters
    ----------
    path
        A YAML file with the fields listed at the top of this module. Paths and patterns of frames are relative to it.
    reading
        Arguments of `photosite.read_raw`, for files that do not state them.
    on_progress
        Called with the name of each photograph and measurement.

    Returns
    -------
    CameraQuality
        Results by the name of the photograph, which is that of its chart if none is given.

    Raises
    ------
    FileError
        If the file is invalid, with the line, or frames are missing or cannot be read.
    """
    file = Path(path)
    data = read_yaml(file, "a list of photographs")
    check_version(file, data, VERSION_KEY)
    content: _File = validated(_File, data, file)
    sensor = None if content.sensor is None else load_sensor(_beside(file, content.sensor))
    planned: dict[str, tuple[_Photograph, list[Path]]] = {}
    for index, entry in enumerate(content.photographs):
        line = line_at(data, ("photographs", index, "chart"))
        if entry.chart not in (known := charts_measured()):
            hint = did_you_mean(entry.chart, known)
            raise FileError(file, "chart", line, value=entry.chart, expected="one that is measured", hint=hint)
        name = entry.name or entry.chart
        if name in planned:
            hint = "Add a name to one of the photographs"
            raise FileError(file, f"two photographs are called {name}", line, hint=hint)
        patterns = [entry.frames] if isinstance(entry.frames, str) else entry.frames
        planned[name] = entry, [found for pattern in patterns for found in matching_files(file, pattern, line)]
    results: dict[str, ImageQuality] = {}
    for index, (name, (entry, files)) in enumerate(planned.items()):
        placing = {key: value for key in _PLACING if (value := getattr(entry, key)) is not None}
        if content.illuminant is not None:
            placing.setdefault("illuminant", content.illuminant)
        try:
            results[name] = measure_files(
                files,
                entry.chart,
                sensor=sensor,
                tone_curve=_beside(file, entry.tone_curve),
                reading=reading,
                only=entry.only,
                options=entry.options,
                on_progress=None if on_progress is None else _named(on_progress, name),
                **placing,
            )
        except FileError:
            raise
        except InputError as error:
            raise error.within(f"photograph {name}").in_file(file, line_of(data["photographs"], index)) from None
    return CameraQuality(content.name or file.name, results)


def _beside(file: Path, stated: str) -> str:
    """Return a name, or the path of a file relative to another one."""
    beside = file.parent / stated
    return str(beside) if beside.is_file() else stated


def _named(on_progress: Callable[[str], None], name: str) -> Callable[[str], None]:
    return lambda id: on_progress(f"{name}: {id}")
