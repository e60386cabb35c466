"""Image quality of a camera that need not exist: its frames of every chart are simulated and measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.color.spectrum import Spectrum, energy_from_photons
from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.camera_quality import CameraQuality
from photosite.metrics.chart_image import ChartImage, chart_image
from photosite.metrics.charts.placed_chart import PlacedChart, filling_chart
from photosite.metrics.measure import ImageQuality, chart_signal, measure
from photosite.metrics.measurement import Result, View
from photosite.metrics.registry import ValueName, charts_measured, measurement, measurements
from photosite.optics.lens import Optics
from photosite.optics.point_spread import FieldPsf
from photosite.scene.scene import DEFAULT_DISTANCE_M, Scene
from photosite.scene.scene_request import OF_ANY_SIZE, SceneRequest, chart_options
from photosite.studies.estimate_columns import NO_PART, estimate_columns, interval_columns, with_all_names
from photosite.values.estimate import Estimate
from photosite.values.shown import Cell, Shown

VIEWED_PX: Mapping[View, tuple[int, int]] = {"middle": (900, 1200), "fine": (400, 400)}
"""Largest frames of views that do not need the whole field."""
_MOST_EXPOSURES, _SIGNAL_WITHIN = 4, 0.005
"""Exposures of which the last has the wanted signal, and how near it is."""
_MOST_FIELD_PX = 16_000_000
"""Pixels of whole fields up to which a camera's own number is simulated."""
_MOST_FIELD_CELLS = 75_000_000
"""Cells of whole fields of edges, of which a pixel has five, or three in a larger field."""


@dataclass(frozen=True)
class ChartConditions(Shown):
    """How simulated charts are photographed.

    Parameters
    ----------
    frames, seed
        Frames of each chart, one stack; 0: mean electrons without noise. Seed of their noise.
    illuminant, luminance_cd_m2
        Light of the charts, and their mean luminance.
    exposure_s
        Exposure time; None: just below saturation.
    signal
        Mean signal of the chart over saturation, as `photosite.metrics.measure.chart_signal` gives it: luminance is
        what makes it, and the measurements do not know it. None: the luminance is known.
    chart_options
        Options of the chart.
    fine_cells
        Cells across a pixel of frames that show responses. With 5, the 10-90 % rise of an edge of 1.3 pixels is 1.8 %
        too large, with 9 it is 0.6 %.
    """

    frames: int = 8
    seed: int = 0
    illuminant: str | float | Spectrum = "D65"
    luminance_cd_m2: float = 200.0
    exposure_s: float | None = None
    signal: float | None = None
    chart_options: Mapping[str, Any] = field(default_factory=dict)
    fine_cells: int = 5


def measure_camera(
    camera: Camera,
    conditions: ChartConditions | None = None,
    *,
    charts: Collection[str] = (),
    only: Collection[str] = (),
    options: Mapping[str, Mapping[str, Any]] | None = None,
    name: str | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> CameraQuality:
    """Simulate frames of charts with a camera, and measure them.

    Parameters
    ----------
    camera, conditions
        The camera, and how the charts are photographed.
    charts, only, options
        Charts and measurements; empty: all that are registered. Options of measurements, as for `measure`.
    name
        Of the camera, for the report.
    on_progress
        Called with the name of each chart and measurement.

    Raises
    ------
    InputError
        If a chart or measurement is unknown, no measurement is left, or options are of one that is not made.

    Examples
    --------
    >>> import photosite as ps
    >>> sensor = ps.load_sensor("nikon-d200").with_(rows=264, cols=392, black_level_dn=64)
    >>> camera = ps.Camera(ps.DiffractionLimited(f_number=8, focal_length_mm=50), sensor)
    >>> found = measure_camera(camera, ChartConditions(frames=2), charts=["macbeth"], only=["noise"])
    >>> 30 < found.charts["macbeth"]["noise"]["snr_18_db", "G"].value < 40
    True
    """
    known = charts_measured()
    for chart in charts:
        if chart not in known:
            raise InputError("charts", value=chart, expected=f"one of {', '.join(known)}")
    for key in (*only, *(options or {})):
        measurement(key)  # an unknown one is an error that says so
    conditions = conditions or ChartConditions()
    found: dict[str, ImageQuality] = {}
    for chart in charts or known:
        chosen = {
            key: entry for key, entry in measurements().items() if chart in entry.charts and (not only or key in only)
        }
        for view in ("middle", "fine", "field"):
            ids = [key for key, entry in chosen.items() if entry.view == view]
            if not ids:
                continue
            if on_progress is not None:
                on_progress(f"{chart}: simulating")
            try:
                seen = seen_chart(camera, chart, view, conditions)
                image, placed = seen.image(seen.frames(conditions.frames, conditions.seed)), seen.placed
            except InputError as error:
                if charts or error.where != chart:
                    raise
                if on_progress is not None:
                    on_progress(f"left out: {error}")
                continue
            own = {key: value for key, value in (options or {}).items() if key in ids}
            quality = measure(image, placed, only=ids, options=own, on_progress=on_progress)
            before = found.get(chart)
            found[chart] = quality if before is None else before.with_results(quality)
    if not found:
        raise InputError("only", value=tuple(only), expected="a measurement of the charts")
    made = {key for quality in found.values() for key in quality.results}
    for key in options or {}:
        if key not in made:
            raise InputError("options", value=key, expected=f"of a measurement that is made: {', '.join(sorted(made))}")
    return CameraQuality(name or camera.sensor.name or "camera", found)


def image_quality(
    camera: Camera,
    scene: Scene | None = None,
    *,
    values: Sequence[str],
    frames: int = 4,
    luminance_cd_m2: float = 200.0,
    illuminant: str | float = "D65",
    exposure_s: float | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> dict[str, Estimate]:
    """Return values of image quality of simulated charts, for `sweep` and comparisons.

    Parameters
    ----------
    camera, scene
        The camera; an even surface whose light and luminance the charts have, instead of `luminance_cd_m2` and
        `illuminant`.
    values
        Names such as "edge-sfr.mtf50.G", or "edge-sfr.mtf50" for every part.
    frames, luminance_cd_m2, illuminant, exposure_s
        As for `ChartConditions`.
    on_progress
        Called with the name of each chart and measurement.

    Returns
    -------
    dict
        Each value by its name, with the reason where it is missing.

    Raises
    ------
    InputError
        If a name is unknown, or the scene is not an even surface.
    """
    light: str | float | Spectrum = illuminant
    if scene is not None:
        if np.ptp(scene.weights, axis=(1, 2)).any():
            raise InputError("scene", value=scene.name, expected="an even surface, whose light the charts have")
        light = Spectrum(scene.wavelength_nm, energy_from_photons(scene.light(), scene.wavelength_nm))
        luminance_cd_m2 = scene.mean_luminance_cd_m2()
    wanted = [ValueName.parse(name) for name in values]
    found: dict[str, Estimate] = {}
    for id in dict.fromkeys(name.measurement for name in wanted):
        chart = measurement(id).charts[0]
        conditions = ChartConditions(frames, 0, light, luminance_cd_m2, exposure_s)
        quality = measure_camera(camera, conditions, charts=[chart], only=[id], on_progress=on_progress)
        result = quality.charts[chart].results[id]
        reason = NO_PART if isinstance(result, Result) else result.reason
        for name in (each for each in wanted if each.measurement == id):
            matching = name.among(result.values) if isinstance(result, Result) else {}
            for part, estimate in (matching or {name.part or "": Estimate(reason=reason)}).items():
                found[str(replace(name, part=part or None))] = estimate
    return found


def compared_quality(
    cameras: Mapping[str, Camera],
    values: Sequence[str],
    on_progress: Callable[[str], None] | None = None,
    **conditions: Any,
) -> dict[str, dict[str, Estimate]]:
    """Return values of image quality of cameras by label, for comparisons: each has all names.

    Parameters
    ----------
    cameras, values, **conditions
        Cameras by label; the arguments of `image_quality`.
    on_progress
        Called with the label of a camera and the name of each chart and measurement.

    Examples
    --------
    >>> compared_quality({}, ["edge-sfr.mtf50"])
    {}
    """
    if not values:
        return {}

    def quality(label: str, camera: Camera) -> dict[str, Estimate]:
        def say(text: str) -> None:
            if on_progress is not None:
                on_progress(f"{label}: {text}")

        try:
            return image_quality(camera, values=values, on_progress=say, **conditions)
        except InputError as error:
            raise error.within(label) from None

    for name in values:
        ValueName.parse(name)
    found = [quality(label, camera) for label, camera in cameras.items()]
    return dict(zip(cameras, with_all_names(found), strict=True))


def quality_to_dict(quality: Mapping[str, Mapping[str, Estimate]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Return values of image quality by label and name, for JSON: label, unit, value, interval or reason."""
    return {
        camera: {
            name: {"label": (value := ValueName.parse(name)).label, "unit": value.unit} | estimate.to_dict()
            for name, estimate in each.items()
        }
        for camera, each in quality.items()
    }


def quality_cells(quality: Mapping[str, Estimate]) -> dict[str, Cell]:
    """Return values of image quality as cells of a table by column; None where there is none."""
    columns = (estimate_columns(name, each) for name, each in quality.items())
    return {name: None if math.isnan(x) else x for each in columns for name, x in each.items()}


def brief_columns(quality: Mapping[str, Mapping[str, Estimate]]) -> list[str]:
    """Return the columns of values and their 95 % intervals."""
    names = next(iter(quality.values()), {})
    return [column for name in names for column in (name, *interval_columns(name)[1:])]


@dataclass(frozen=True, eq=False)
class SeenChart(Shown):
    """A chart that fills the frame of a camera.

    Parameters
    ----------
    camera
        The camera, with the rows and columns that are simulated.
    chart, options, scene
        Built-in scene by name, its own options, and the scene.
    mean_electrons, exposure_s
        Of the frames.
    conditions
        How the chart is photographed.
    """

    camera: Camera
    chart: str
    options: Mapping[str, Any]
    scene: Scene
    mean_electrons: NDArray[np.float32]
    exposure_s: float
    conditions: ChartConditions

    def frames(self, count: int, seed: int) -> list[RawFrame]:
        """Return frames with independent temporal noise."""
        return [
            self.camera.expose(self.mean_electrons, self.exposure_s, seed=seed, frame=number, scene=self.scene)
            for number in range(count)
        ]

    def image(self, frames: Sequence[RawFrame] = ()) -> ChartImage:
        """Return frames as an image; mean electrons without frames."""
        given: Any = list(frames) or self.mean_electrons
        return chart_image(given, sensor=self.camera.sensor)

    @cached_property
    def placed(self) -> PlacedChart:
        """The chart in the frames."""
        shape = self.mean_electrons.shape
        known = self.conditions.signal is None
        found = filling_chart(self.chart, self.scene, (shape[0], shape[1]), self.options, known_light=known)
        return replace(found, illuminant=self.conditions.illuminant)


def _blurs_alike(optics: Optics, distance_m: float) -> bool:
    """Return whether a lens blurs and places all parts of the field alike, so that a part of it shows the responses."""
    return optics.mapping(distance_m) is None and not isinstance(optics.point_spread(distance_m), FieldPsf)


def _too_large(chart: str, pixels: int, most: int) -> InputError:
    hint = "Give the sensor fewer rows and cols: the middle of the field"
    return InputError("pixels of the field", where=chart, value=pixels, expected=f"at most {most}", hint=hint)


def seen_chart(
    camera: Camera,
    chart: str,
    view: View,
    conditions: ChartConditions,
    *,
    shape: tuple[int, int] | None = None,
    distance_m: float | None = None,
) -> SeenChart:
    """Return a chart that fills the frame of a camera.

    Parameters
    ----------
    camera, chart, view, conditions
        The camera; the built-in scene; what the frame must show; light and exposure time of the chart.
    shape
        Rows and columns of the middle of the frame that the chart fills, at most; None: those of the view.
    distance_m
        From the lens to the chart; None: that of built-in scenes.
    """
    array = camera.sensor.array
    rows, cols = array.rows, array.cols
    cells = camera.cells_per_pixel
    tile = len(array.cfa), len(array.cfa[0])
    if view == "field":
        if chart in OF_ANY_SIZE and _blurs_alike(camera.optics, distance_m or DEFAULT_DISTANCE_M):
            part = min(1.0, math.sqrt(_MOST_FIELD_CELLS / max(cells, 5) ** 2 / (rows * cols)))
            rows, cols = (int(part * size) // step * step for size, step in zip((rows, cols), tile, strict=True))
        if rows * cols > _MOST_FIELD_PX:
            raise _too_large(chart, rows * cols, _MOST_FIELD_PX)
        if chart in OF_ANY_SIZE:
            cells = max(cells, 5 if 25 * rows * cols <= _MOST_FIELD_CELLS else 3)
            if cells**2 * rows * cols > _MOST_FIELD_CELLS:
                raise _too_large(chart, rows * cols, _MOST_FIELD_CELLS // cells**2)
    else:
        most = shape or VIEWED_PX[view]
        sizes = zip((rows, cols), most, tile, strict=True)
        rows, cols = (min(size, limit) // step * step for size, limit, step in sizes)
        cells = max(cells, conditions.fine_cells) if view == "fine" else cells
    seen = Camera(camera.optics, camera.sensor.with_(rows=rows, cols=cols), camera.integration, cells)
    known = chart_options(chart)
    options: dict[str, Any] = {}
    if (view == "fine" and {"rows", "cols"} <= known.keys()) or chart in OF_ANY_SIZE:
        options = {"rows": rows * cells, "cols": cols * cells}
        if "supersampling" in known:  # a texture whose finest details are those of the pixels
            options |= {"supersampling": 2, "smallest_radius": float(cells)}
    options = {**conditions.chart_options, **options}
    light = {"illuminant": conditions.illuminant, "mean_luminance_cd_m2": conditions.luminance_cd_m2}
    place = {} if distance_m is None else {"distance_m": distance_m}
    scene = SceneRequest(chart, {**light, **place, **options}).scene()
    if conditions.exposure_s is not None and conditions.signal is None:
        auto_s = conditions.exposure_s
    else:
        auto_s = seen.auto_exposure_s(seen.mean_electrons(scene, 1.0))
    time_s = auto_s if conditions.exposure_s is None else conditions.exposure_s
    scene = scene if auto_s == time_s else scene.scaled(auto_s / time_s)  # near the signal, and not saturated
    found = SeenChart(seen, chart, options, scene, seen.mean_electrons(scene, time_s), time_s, conditions)
    for _ in range(_MOST_EXPOSURES if conditions.signal is not None else 0):
        signal = chart_signal(found.image(found.frames(1, conditions.seed)), found.placed)
        if not signal or conditions.signal is None or abs(signal / conditions.signal - 1.0) < _SIGNAL_WITHIN:
            break
        scene = found.scene.scaled(conditions.signal / signal)
        found = replace(found, scene=scene, mean_electrons=seen.mean_electrons(scene, time_s))
    return found
