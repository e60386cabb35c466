"""Distortion and lateral colour in the gallery, on a checkerboard, with the places of its corners measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.distortion import Distortion, LateralColor
from photosite.optics.field_points import FieldPoints
from photosite.optics.lens import Lens
from photosite.report.style import styled
from photosite.scene import charts
from photosite.studies.gallery.panels import Panel, enlarged, pictures
from photosite.studies.gallery.through_a_camera import d200, shot

BASE = DiffractionLimited(f_number=5.6, focal_length_mm=24)
_ROWS, _COLS, _SQUARE = 200, 300, 20
_CORNER, _TIMES = (50, 75), 4


def lenses(corner_mm: float) -> dict[str, Lens]:
    """A straight lens, a barrel of 6 % at the frame's corner, and red and blue 0.6 % off green in magnification."""
    share = np.array([0.0, 0.4, 0.7, 0.9, 1.0, 1.1])
    barrel = Distortion.from_percent(FieldPoints(height_mm=share * corner_mm), -6.0 * share**2)
    end_mm = 1.1 * corner_mm
    shift_um = np.array([[6.0], [0.0], [-6.0]]) * end_mm
    color = LateralColor(np.array([450.0, 550.0, 650.0]), FieldPoints(height_mm=np.array([end_mm])), shift_um)
    return {
        "straight": Lens(BASE),
        "barrel, 6 % at the corner": Lens(BASE, distortion=barrel),
        "lateral colour, ±0.6 %": Lens(BASE, lateral_color=color),
    }


@styled()
def distortion() -> Figure:
    """A checkerboard through the three lenses, and the frame's upper left corner four times larger."""
    sensor = d200(_ROWS, _COLS)
    # Wider than the frame: a barrel draws in what lies beyond.
    rows, cols = _ROWS + 4 * _SQUARE, _COLS + 4 * _SQUARE
    board = charts.checkerboard("D65", 100, square=_SQUARE * 3, rows=rows * 3, cols=cols * 3)
    width_m = cols * sensor.pixel.width_um.value * 1e-6 / BASE.magnification(board.distance_m)
    board = replace(board, width_m=width_m)
    corner_mm = float(np.hypot(_ROWS, _COLS)) / 2 * sensor.pixel.width_um.value * 1e-3
    whole: list[Panel] = []
    for name, lens in lenses(corner_mm).items():
        camera = Camera(lens, sensor, cells_per_pixel=3)
        whole.append((name, shot(board, camera, "D65")))
    down, along = _CORNER
    return pictures([whole, [("its upper left corner, 4 times", enlarged(p[:down, :along], _TIMES)) for _, p in whole]])
