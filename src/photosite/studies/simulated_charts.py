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
from photosite.scene.scene import Scene
from photosite.scene.scene_request import OF_ANY_SIZE, SceneRequest, chart_options
from photosite.values.estimate import Estimate
from photosite.values.shown import Shown

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
) -> dict[str, float]:
    """Return values of image quality of simulated charts, for `sweep`.

    Parameters
    ----------
    camera, scene
        The camera; an even surface whose light and luminance the charts have, instead of `luminance_cd_m2` and
        `illuminant`.
    values
        Names such as "edge-sfr.mtf50.G", or "edge-sfr.mtf50" for every part.
    frames, luminance_cd_m2, illuminant, exposure_s
        As for `ChartConditions`.

    Returns
    -------
    dict
        Each value by its name, NaN where it is missing, and its standard uncertainty as "u(name)".

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
    found: dict[str, float] = {}
    for id in dict.fromkeys(name.measurement for name in wanted):
        chart = measurement(id).charts[0]
        conditions = ChartConditions(frames, 0, light, luminance_cd_m2, exposure_s)
        quality = measure_camera(camera, conditions, charts=[chart], only=[id])
        result = quality.charts[chart].results[id]
        for name in (each for each in wanted if each.measurement == id):
            matching = name.among(result.values) if isinstance(result, Result) else {}
            for part, estimate in (matching or {name.part or "": Estimate()}).items():
                key = str(replace(name, part=part or None))
                found[key] = math.nan if estimate.value is None else estimate.value
                found[f"u({key})"] = math.nan if estimate.value is None else estimate.standard_uncertainty or 0.0
    return found


def compared_quality(
    cameras: Mapping[str, Camera], values: Sequence[str], **conditions: Any
) -> dict[str, dict[str, float | None]]:
    """Return values of image quality of cameras by label, for comparisons: each has all names, None where missing.

    Parameters
    ----------
    cameras, values, **conditions
        Cameras by label; the arguments of `image_quality`.

    Examples
    --------
    >>> compared_quality({}, ["edge-sfr.mtf50"])
    {}
    """
    if not values:
        return {}
    found = {label: image_quality(camera, values=values, **conditions) for label, camera in cameras.items()}
    names = dict.fromkeys(name for each in found.values() for name in each)
    return {
        label: {name: each[name] if math.isfinite(each.get(name, math.nan)) else None for name in names}
        for label, each in found.items()
    }


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
    if view == "field":
        if rows * cols > _MOST_FIELD_PX:
            raise InputError("pixels of the field", value=rows * cols, expected=f"at most {_MOST_FIELD_PX}")
        if chart in OF_ANY_SIZE:
            cells = max(cells, 5 if 25 * rows * cols <= _MOST_FIELD_CELLS else 3)
            if cells**2 * rows * cols > _MOST_FIELD_CELLS:
                expected = f"at most {_MOST_FIELD_CELLS // cells**2} for {cells} x {cells} cells in each"
                raise InputError("pixels of the field", where=chart, value=rows * cols, expected=expected)
    else:
        most = shape or VIEWED_PX[view]
        tile = len(array.cfa), len(array.cfa[0])
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
