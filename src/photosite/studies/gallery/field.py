"""A chart through a lens whose coma grows over the field, in the gallery: stars in the middle and in the corners."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from photosite.camera.camera import Camera
from photosite.optics.lens import Lens
from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.studies.gallery.lens_design import BASE, comatic_design
from photosite.studies.gallery.panels import Panel, enlarged, pictures
from photosite.studies.gallery.through_a_camera import shot

_STARS, _SIDE = (3, 5), 80
"""Of the chart; pixels that each spans."""
_TIMES = 3


def stars() -> Scene:
    """Siemens stars side by side, three samples a pixel."""
    side = _SIDE * 3
    star = charts.siemens_star("D65", 100, cycles=24, waveform="square", patches=False, rows=side, cols=side)
    return replace(star, weights=np.tile(star.weights, (1, *_STARS)))


@styled()
def coma_over_the_field() -> Figure:
    """The stars by the lens as it is on its axis and as it is over the field; the middle and a corner larger."""
    chip = load_sensor("vendor-1.4um")
    rows, cols = (count * _SIDE for count in _STARS)
    sensor = chip.with_(rows=rows, cols=cols, cfa=(("G",),), channels={"G": chip.channels["G"]})
    edge_mm = math.hypot(rows, cols) / 2 * sensor.pixel.width_um.value * 1e-3
    design = comatic_design(edge_mm, detail_um=sensor.pixel.width_um.value)
    scene, modes = stars(), len(design.low_rank.modes)
    error = design.low_rank.relative_error
    whole: list[Panel] = []
    for title, lens in (
        ("f/2.8, the middle's blur everywhere", Lens(BASE, blur=comatic_design(edge_mm, heights=1))),
        (f"coma and curvature, {modes} modes, RMS error {100 * error:.1f} %", Lens(BASE, blur=design)),
    ):
        camera = Camera(lens, sensor)
        whole.append((title, shot(scene, camera)))
    row, col = (count // 2 * _SIDE for count in _STARS)
    large: list[Panel] = []
    for _, picture in whole:
        parts = (picture[row : row + _SIDE, col : col + _SIDE], picture[-_SIDE:, -_SIDE:])
        large += [
            (name, enlarged(part[8:-8, 7:-8], _TIMES))
            for name, part in zip(("its middle, 3 times", "its lower right corner"), parts, strict=True)
        ]
    return pictures([whole, large])
