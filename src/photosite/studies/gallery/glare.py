"""Veiling glare in the gallery: a chart beside a window a hundred times as bright."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Lens
from photosite.optics.veiling_glare import VeilingGlare
from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.studies.gallery.panels import Panel, pictures
from photosite.studies.gallery.through_a_camera import d200, taken
from photosite.values.cfa import channel_mask

_BASE = DiffractionLimited(f_number=4, focal_length_mm=50)
_EXPOSURE_S = 1 / 15
_DARK, _SHAPE = 92, (140, 306)
"""Columns beyond the window that the picture does not show, of the scene; pixels that it shows."""
_GLARES: dict[str, VeilingGlare | None] = {
    "no glare": None,
    "1 %, even": VeilingGlare(0.01),
    "1 % near its source": VeilingGlare(0.01, spread_m=0.5e-3),
}


def chart_by_a_window() -> Scene:
    """A ColorChecker of 40 cd/m2; to its right a white a hundred times as bright as the chart's, and then darkness."""
    chart = charts.macbeth("D65", 40)
    white = next(region for region in chart.regions if region.name == "white")
    window = 100 * chart.weights[:, white.r0, white.c0]
    rows = chart.shape[0]
    beside = np.zeros((window.size, rows, 92 + _DARK), np.float32)
    beside[:, 12 : rows - 12, 32:84] = window[:, None, None]
    return replace(chart, weights=np.concatenate([chart.weights, beside], axis=2))


def white_over_black(camera: Camera, scene: Scene) -> float:
    """Mean electrons of green pixels on the ColorChecker's white over those on its black."""
    electrons = camera.mean_electrons(scene, _EXPOSURE_S)
    green = channel_mask(camera.sensor.array.cfa, "G", electrons.shape)
    mean = {}
    for region in camera.image_regions(scene):
        inside = (slice(region.r0, region.r1), slice(region.c0, region.c1))
        mean[region.name] = float(electrons[inside][green[inside]].mean())
    return mean["white"] / mean["black"]


@styled()
def veiling_glare() -> Figure:
    """The chart beside the window through three lenses that differ in glare only."""
    scene = chart_by_a_window()
    rows, cols = _SHAPE
    sensor = d200(rows, round(cols * scene.shape[1] / (scene.shape[1] - _DARK)))
    panels: list[Panel] = []
    for label, glare in _GLARES.items():
        camera = Camera(Lens(_BASE, veiling_glare=glare), sensor)
        title = f"{label}; white : black = {white_over_black(camera, scene):.1f}"
        panels.append((title, taken(camera, scene, _EXPOSURE_S, "D65", 1.0)[:, :cols]))
    return pictures([panels])
