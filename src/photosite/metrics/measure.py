"""Measuring image quality: every measurement that frames of a chart support."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage, Frames, ToneCurveName, chart_image
from photosite.metrics.charts.placed_chart import PlacedChart, placed_chart
from photosite.metrics.image_checks import image_diagnostics
from photosite.metrics.measurement import COLUMNS, Measured, Result
from photosite.metrics.registry import ValueName, charts_measured, measurement, measurements
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, patch_diagnostics
from photosite.metrics.tone_curve import ToneCurve
from photosite.sensor.model import Sensor
from photosite.values.diagnostic import Diagnosed, Diagnostic
from photosite.values.shown import Cell, Reported, ResultTable, Tabular
from photosite.values.uncertain import Missing


@dataclass(frozen=True, eq=False)
class ImageQuality(Tabular, Diagnosed, Reported):
    """All results of frames of a chart.

    Parameters
    ----------
    image, chart
        The frames, and the chart in them.
    results
        By the id of the measurement; `Missing` where the frames do not show what it needs.
    image_diagnostics
        Limitations of the frames, whatever is measured on them.

    Examples
    --------
    >>> import numpy as np
    >>> y, x = np.mgrid[:128, :128] + 0.5
    >>> found = measure(100 + 300 / (1 + np.exp(-(x - 64 + 0.09 * (y - 64)) / 0.8)), "slanted-edge")
    >>> round(found["edge-sfr"]["mtf50"].value, 2)
    0.14
    """

    image: ChartImage
    chart: PlacedChart
    results: Mapping[str, Measured]
    image_diagnostics: tuple[Diagnostic, ...] = ()

    def __getitem__(self, name: str) -> Result:
        """Return the result of a measurement by its id.

        Raises
        ------
        InputError
            If there is none, with the reason.
        """
        found = self.results.get(name)
        if isinstance(found, Missing):
            raise InputError(name, expected="measured", hint=found.reason)
        if found is None:
            raise InputError("measurement", value=name, expected=f"one of {', '.join(self.results)}")
        return found

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:  # type: ignore[override]  # of all results
        """Diagnostics of the frames and of all results."""
        results = (found for found in self.results.values() if isinstance(found, Result))
        return (*self.image_diagnostics, *(entry for found in results for entry in found.diagnostics))

    def to_dict(self) -> dict[str, Any]:
        """Return everything, for JSON."""
        light = self.chart.illuminant
        chart = {
            "name": self.chart.name,
            "corners": [list(corner) for corner in self.chart.corners],
            "found": self.chart.found,
            "options": dict(self.chart.options),
            "illuminant": light if isinstance(light, str | int | float) else None,
            "luminance_cd_m2": self.chart.scene.mean_luminance_cd_m2() if self.chart.known_light else None,
        }
        return {
            "frames": len(self.image.frames),
            "origin": self.image.origin,
            "exposure_s": self.image.exposure_s,
            "signal": chart_signal(self.image, self.chart),
            "tone_curve": self.image.tone,
            "diagnostics": [entry.to_dict() for entry in self.image_diagnostics],
            "chart": chart,
            "results": {
                name: found.to_dict() if isinstance(found, Result) else {"id": name, **found.to_dict()}
                for name, found in self.results.items()
            },
        }

    def with_results(self, other: ImageQuality) -> ImageQuality:
        """Return these results and those of other frames of the chart; image and chart are these."""
        return replace(self, results={**self.results, **other.results})

    def only(self, names: Sequence[ValueName]) -> ImageQuality:
        """Return the results with the named values only."""
        kept: dict[str, Measured] = {}
        for id, found in self.results.items():
            own = [name for name in names if name.measurement == id]
            if own and isinstance(found, Result):
                chosen = {(name.quantity, part) for name in own for part in name.among(found.values)}
                found = replace(found, values={key: each for key, each in found.values.items() if key in chosen})
            if own:
                kept[id] = found
        return replace(self, results=kept)

    @property
    def table(self) -> ResultTable:
        """All values, a row for each."""
        return self._table()

    def _table(self) -> ResultTable:
        rows: list[tuple[Cell, ...]] = []
        for name, found in self.results.items():
            if isinstance(found, Result):
                rows += [(name, *row) for row in found.rows()]
            else:
                rows.append((name, "", "", None, None, None, "", found.reason))
        return ResultTable(f"Image quality of {self.chart.name}", ("measurement", *COLUMNS), rows)


def chart_signal(image: ChartImage, chart: PlacedChart) -> float | None:
    """Return the mean signal of a chart over saturation, of the sharp channel; None where saturation is not known."""
    if not math.isfinite(image.white):
        return None
    regions = chart.patches or (chart.region,)
    means = [float(image.pixels(region, image.sharp_channel).mean()) for region in regions]
    return sum(means) / len(means) / (image.white - image.black)


def measure(
    frames: Frames,
    chart: str | PlacedChart,
    *,
    only: Collection[str] = (),
    options: Mapping[str, Mapping[str, Any]] | None = None,
    sensor: Sensor | None = None,
    tone_curve: ToneCurveName | Literal["chart"] | ToneCurve = "file",
    on_progress: Callable[[str], None] | None = None,
    **placing: Any,
) -> ImageQuality:
    """Measure image quality on frames of a chart.

    Parameters
    ----------
    frames
        Raw frames, several of one scene and setting, files, a picture, or mean electrons, as for
        `photosite.metrics.chart_image.chart_image`.
    chart
        Name of a built-in scene, or a chart that was placed before.
    only
        Ids of measurements; empty: all that the chart supports.
    options
        Options of measurements by id, such as `{"edge-sfr": {"order": 1}}`.
    sensor
        Source of the system gain.
    tone_curve
        Of pictures: as for `photosite.metrics.chart_image.chart_image`; or that of the gray patches of the "chart"; or
        one that was measured.
    on_progress
        Called with the id of each measurement before it starts.
    **placing
        Where the chart is and its light: the arguments `corners`, `detect`, `illuminant`, `luminance_cd_m2` and
        `options` of `photosite.metrics.charts.placed_chart.placed_chart`; `chart_options` for the last.

    Raises
    ------
    InputError
        If frames, chart or an option are invalid, or nothing is measured on the chart.

    Examples
    --------
    >>> import numpy as np
    >>> y, x = np.mgrid[:128, :128] + 0.5
    >>> edge = 100 + 300 / (1 + np.exp(-(x - 64 + 0.09 * (y - 64)) / 0.8))
    >>> result = measure(edge, "slanted-edge", only=["edge-sfr"], options={"edge-sfr": {"order": 1}})
    >>> list(result.results)
    ['edge-sfr']
    """
    measured = tone_curve == "chart" or isinstance(tone_curve, ToneCurve)
    named: Any = "file" if measured else tone_curve
    image = chart_image(frames, sensor=sensor, tone_curve=named)
    if sensor is not None and image.sensor is None:
        image = replace(image, sensor=sensor)
    if isinstance(chart, str):
        chart_options = placing.pop("chart_options", None)
        chart = placed_chart(image, chart, options=chart_options, **placing)
    elif placing:
        raise InputError(next(iter(placing)), expected="omitted for a chart that is placed")
    if measured:
        curve = tone_curve if isinstance(tone_curve, ToneCurve) else ToneCurve.of_chart(image, chart)
        image = curve.applied(image)
    chosen = {name: measurement(name) for name in only} or {
        name: entry for name, entry in measurements().items() if not entry.charts or chart.name in entry.charts
    }
    if not any(entry.charts for entry in chosen.values()):
        expected = f"one that is measured: {', '.join(charts_measured())}"
        raise InputError("chart", value=chart.name, expected=expected)
    for name in options or {}:
        if name not in chosen:
            raise InputError("options", value=name, expected=f"of a measurement that is made: {', '.join(chosen)}")
    found: dict[str, Measured] = {}
    for name, entry in chosen.items():
        if on_progress is not None:
            on_progress(name)
        given = entry.options(**(options or {}).get(name, {}))  # an invalid option is an error, not a missing result
        try:
            found[name] = entry(image, chart, **given.given())
        except InputError as error:
            found[name] = Missing(str(error))
    uneven = patch_diagnostics(image, chart) if chart.name in GRAY_CHARTS else ()
    return ImageQuality(image, chart, found, (*image_diagnostics(image), *uneven))
