"""Validation of a camera file by measurements: image quality of photographs against that of simulated charts."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from photosite.camera.camera import Camera
from photosite.errors import FileError, InputError
from photosite.metrics.measurement import Measured, Result
from photosite.metrics.photographs import measure_photographs
from photosite.metrics.registry import measurement
from photosite.studies.simulated_charts import ChartConditions, measure_camera
from photosite.validation.quality_comparison import QualityComparison, compare_results
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing

_FINE_CELLS = 9


@dataclass(frozen=True)
class MeasuredChart(Shown):
    """Image quality that was measured on a photograph of a chart.

    Parameters
    ----------
    chart
        Name of the built-in scene.
    conditions
        Number of frames, light and exposure time; the signal where the luminance is not known.
    results
        By the id of the measurement, without the quantities that are those of the photograph.
    """

    chart: str
    conditions: ChartConditions
    results: Mapping[str, Measured]


def load_measured(
    path: str | PathLike[str],
    *,
    reading: Mapping[str, Any] | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> dict[str, MeasuredChart]:
    """Return the image quality of photographs by their names.

    Parameters
    ----------
    path
        A list of photographs (YAML), which are measured, or the JSON that `photosite measure --json` printed.
    reading, on_progress
        As for `photosite.metrics.photographs.measure_photographs`.

    Raises
    ------
    FileError
        If the file cannot be read or is neither.
    """
    file = Path(path)
    if file.suffix.lower() != ".json":
        found = measure_photographs(file, reading=reading, on_progress=on_progress).to_dict()["charts"]
    else:
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise FileError(file, f"cannot be read: {error}") from None
        try:
            found = content.get("charts") or {content["chart"]["name"]: content}
            return {name: _from_dict(entry) for name, entry in found.items()}
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            expected = "the JSON of photosite measure"
            raise FileError(file, "content", expected=expected, hint=f"{type(error).__name__}: {error}") from None
    return {name: _from_dict(entry) for name, entry in found.items()}


def _from_dict(content: Mapping[str, Any]) -> MeasuredChart:
    chart = content["chart"]
    results: dict[str, Measured] = {}
    for id, entry in content["results"].items():
        if content["origin"] != "raw":
            results[id] = Missing(f"simulated frames are raw, those of the photograph are '{content['origin']}'")
            continue
        if "values" not in entry:
            results[id] = Missing(entry["reason"])
            continue
        made = measurement(id)
        values = {
            (each["quantity"], each["part"]): _estimate(each)
            for each in entry["values"]
            if each["quantity"] not in made.of_photograph
        }
        if values:
            results[id] = Result(values, measurement=made, options=entry["options"])
    if chart["illuminant"] is None:
        raise InputError("illuminant", where=chart["name"], expected="a name, a temperature or a file of the spectrum")
    light = {name: chart[name] for name in ("illuminant", "luminance_cd_m2") if chart[name] is not None}
    signal = None if "luminance_cd_m2" in light else content["signal"]
    return MeasuredChart(
        chart["name"],
        ChartConditions(
            content["frames"], exposure_s=content["exposure_s"], signal=signal, chart_options=chart["options"], **light
        ),
        results,
    )


def _estimate(entry: Mapping[str, Any]) -> Estimate:
    value = entry.get("signed_value", entry["value"])
    interval = entry.get("interval_95")
    return Estimate(
        value,
        entry["standard_uncertainty"],
        entry.get("reason"),
        entry.get("upper_limit_95"),
        interval_95=None if interval is None else (interval[0], interval[1]),
    )


def validate_quality(
    measured: Mapping[str, MeasuredChart],
    camera: Camera,
    *,
    level: float = 0.05,
    tolerance_percent: float = 0.0,
    seed: int = 0,
    on_progress: Callable[[str], None] | None = None,
) -> QualityComparison:
    """Compare the image quality of photographs with that of charts that are simulated with a camera.

    The simulated charts have the number of frames, light and exposure time of the photographs. Where the luminance is
    not known, it is the one that gives the signal of the photograph. Charts fill the simulated frames.

    Parameters
    ----------
    measured
        By the name of the photograph.
    camera
        The camera that is validated.
    level, tolerance_percent
        False-alarm rate of the table, and tolerance relative to simulated values, as for
        `photosite.validation.quality_comparison.compare_quality`.
    seed
        Of the simulated frames.
    on_progress
        Called with the name of each photograph and measurement.

    Raises
    ------
    InputError
        If nothing was measured on raw frames, or a setting is invalid.
    """
    sides: dict[str, tuple[Mapping[str, Measured], Mapping[str, Measured]]] = {}
    notes = []
    for number, (name, each) in enumerate(measured.items()):
        wanted = {id: found for id, found in each.results.items() if isinstance(found, Result)}
        if not wanted:
            reasons = dict.fromkeys(found.reason for found in each.results.values() if isinstance(found, Missing))
            notes.append(f"{name} is not compared: {next(iter(reasons), 'its values are not those of a camera')}")
            continue
        simulated = measure_camera(
            camera,
            replace(each.conditions, seed=seed + number, fine_cells=_FINE_CELLS),
            charts=[each.chart],
            only=list(wanted),
            options={id: found.options for id, found in wanted.items() if found.options},
            on_progress=on_progress,
        )
        made = simulated.charts[each.chart].results
        sides[name] = (wanted, {id: _of_camera(found) for id, found in made.items()})
    if not sides:
        raise InputError("measured", expected="values of raw frames", hint="; ".join(notes))
    return replace(compare_results(sides, level=level, tolerance_percent=tolerance_percent), notes=tuple(notes))


def _of_camera(found: Measured) -> Measured:
    if isinstance(found, Missing) or found.measurement is None:
        return found
    left_out = found.measurement.of_photograph
    return replace(found, values={key: value for key, value in found.values.items() if key[0] not in left_out})
