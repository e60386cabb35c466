"""Pictures that a whole camera takes: a scene, a lens and a sensor, developed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.camera.dng_profile import color_matrix
from photosite.develop.develop import develop
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.planes import Planes
from photosite.scene.scene import Scene
from photosite.sensor.io.sensor_file import load_sensor
from photosite.sensor.model import Sensor
from photosite.studies.gallery.panels import pictures
from photosite.values.cfa import channel_mask

SEED = 2008
_FULL = 0.6
"""Of the sensor's range, what the brightest half percent of pixels is brought to by the exposure."""


def exposure_for(camera: Camera, scene: Scene | Planes, share: float = _FULL) -> float:
    """Exposure at which the brightest half percent of pixels gains a share of what the sensor holds."""
    return _exposure_of(camera, camera.mean_electrons(scene, 1.0), share)


def _exposure_of(camera: Camera, electrons_per_s: NDArray[np.float32], share: float) -> float:
    return float(share * camera.sensor.saturation_capacity_e / np.quantile(electrons_per_s, 0.995))


def d200(rows: int, cols: int) -> Sensor:
    """A D200 of fewer pixels, with a pedestal so that blacks do not clip."""
    return load_sensor("nikon-d200").with_(rows=rows, cols=cols, black_level_dn=64)


def taken(
    camera: Camera,
    scene: Scene | Planes,
    exposure_s: float,
    light: str | None = None,
    display: float | str = "auto",
) -> NDArray[np.float32]:
    """(rows, cols, 3) picture of a scene.

    Balanced so that gray under a light is gray; None: as the sensor reads it. `display`: the exposure of `develop`.
    """
    return _developed(camera, camera.mean_electrons(scene, exposure_s), exposure_s, light, display)


def _developed(
    camera: Camera,
    electrons: NDArray[np.float32],
    exposure_s: float,
    light: str | None,
    display: float | str,
    colors_of: Sensor | None = None,
) -> NDArray[np.float32]:
    raw = camera.expose(electrons, exposure_s, seed=SEED)
    if colors_of is not None:
        raw = replace(raw, color_matrix=color_matrix(colors_of))
    return develop(raw, "none" if light is None else gray_gains(camera.sensor, light), exposure=display)


def gray_gains(sensor: Sensor, light: str) -> list[float]:
    """Gains for red, green and blue with which an even gray reads alike in all three, crosstalk included."""
    rows, cols = (4 * side for side in (len(sensor.array.cfa), len(sensor.array.cfa[0])))
    small = Camera(DiffractionLimited(f_number=8, focal_length_mm=50), sensor.with_(rows=rows, cols=cols))
    even = small.mean_electrons(charts.uniform(light, 100), 1.0)
    return [float(even.max() / even[channel_mask(sensor.array.cfa, name, even.shape)].mean()) for name in "RGB"]


def shot(
    scene: Scene | Planes, camera: Camera, light: str | None = None, colors_of: Sensor | None = None
) -> NDArray[np.float32]:
    """(rows, cols, 3) picture of a scene, exposed for its brightest parts; through another sensor's matrix if named."""
    rate = camera.mean_electrons(scene, 1.0)
    exposure_s = _exposure_of(camera, rate, _FULL)
    return _developed(camera, rate * np.float32(exposure_s), exposure_s, light, "auto", colors_of)


@styled()
def one_chart_in_four_lights() -> Figure:
    """The ColorChecker under four lights, as the sensor reads it and with gray made gray."""
    camera = Camera(DiffractionLimited(f_number=8, focal_length_mm=50), d200(150, 222))
    lights = {"CIE A": "A", "D65": "D65", "FL11, fluorescent": "FL11", "LED-B3, a white LED": "LED-B3"}
    scenes = {name: charts.macbeth(light, 100) for name, light in lights.items()}
    raw = [(name, shot(scene, camera)) for name, scene in scenes.items()]
    gray = [("gray made gray", shot(scenes[name], camera, light)) for name, light in lights.items()]
    return pictures([raw, gray])
