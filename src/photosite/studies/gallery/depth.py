"""Scenes in depth in the gallery: where the lens is focused, and what its diaphragm makes of points of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.optics.lens import Lens
from photosite.optics.pupil import Pupil
from photosite.optics.wavefront import Wavefront
from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.pictures import from_rgb
from photosite.scene.planes import Plane, Planes
from photosite.scene.scene import Scene
from photosite.studies.gallery.panels import Panel, pictures
from photosite.studies.gallery.through_a_camera import d200, shot

_LENS = DiffractionLimited(f_number=4, focal_length_mm=50)
_ROWS, _COLS = 200, 300
_PIXEL_M = 6.05e-6
_SLAT, _PITCH = 10.0, 75.0
"""Width of a slat, and from one to the next, in samples."""

_COARSE_NM = np.arange(400.0, 701.0, 20.0)
_BOKEH_M = (3.0, 40.0)
"""Focus, and the lights."""


def planes() -> Planes:
    """Slats at 1.7 m, a ColorChecker at 2 m, dead leaves at 3 m; under daylight, the slats under a lamp."""
    slats = charts.uniform("A", 25, distance_m=1.7)
    weights = np.broadcast_to(slats.weights, (slats.weights.shape[0], _ROWS, _COLS))
    chart = charts.macbeth("D65", 60, distance_m=2.0, width_m=0.6 * _spanned_m(2.0))
    leaves = charts.dead_leaves("D65", 60, rows=_ROWS, cols=_COLS, contrast=10, distance_m=3.0)
    return Planes((Plane(replace(slats, weights=weights), _slats()), Plane(chart), Plane(leaves)))


def _slats() -> NDArray[np.float32]:
    """(rows, cols) opacity of slats that lean."""
    row, col = np.indices((_ROWS, _COLS)) + 0.5
    across = (col + row * 0.3) % _PITCH
    inside: NDArray[np.float32] = np.clip(np.minimum(across, _SLAT - across) + 0.5, 0.0, 1.0).astype(np.float32)
    return inside


def _spanned_m(distance_m: float) -> float:
    """Width of the object field at a distance."""
    return _COLS * _PIXEL_M / _LENS.magnification(distance_m)


@styled()
def focus() -> Figure:
    """The same three planes, with the focus on each of them."""
    scene, sensor = planes(), d200(_ROWS, _COLS)
    panels: list[Panel] = [
        (f"focus at {at:g} m, {what}", shot(scene, Camera(Lens(_LENS, focus_distance_m=at), sensor), "D65"))
        for at, what in ((1.7, "the slats"), (2.0, "the chart"), (3.0, "the leaves"))
    ]
    return pictures([panels])


def lights(distance_m: float) -> Scene:
    """Points of light of many colours before a dark sky, 0.03 % as bright as white."""
    random = np.random.default_rng(20)
    picture = np.full((_ROWS, _COLS, 3), 3e-4)
    for row, col in zip(random.integers(4, _ROWS - 6, 40), random.integers(4, _COLS - 6, 40), strict=True):
        picture[row : row + 2, col : col + 2] = random.uniform(0.1, 1.0, 3)
    return from_rgb(picture, "D65", 20.0, linear=True, wavelength_nm=_COARSE_NM, distance_m=distance_m)


@styled()
def bokeh() -> Figure:
    """Points of light far behind the focus, through a round opening, six blades and a mirror lens."""
    sensor, scene = d200(_ROWS, _COLS), lights(_BOKEH_M[1])
    pupils = {
        "round": Pupil(),
        "six blades": Pupil(blades=6, rotation_deg=15),
        "obscured by 0.5": Pupil(obscuration=0.5),
    }
    panels: list[Panel] = [
        (name, shot(scene, Camera(Lens(_LENS, Wavefront(pupil=pupil), _BOKEH_M[0]), sensor), "D65"))
        for name, pupil in pupils.items()
    ]
    return pictures([panels])
