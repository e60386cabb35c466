"""Pictures of the gallery that a whole camera takes: a scene, a lens and a sensor, developed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera import Camera
from photosite.develop.develop import develop
from photosite.optics.lens import DiffractionLimited
from photosite.optics.spread import Optics
from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.scene import Scene
from photosite.sensor.file import load_sensor
from photosite.sensor.model import Sensor

SEED = 2008
_FULL = 0.6
"""Of the sensor's range, what the brightest half percent of pixels is brought to by the exposure."""


def exposure_for(camera: Camera, scene: Scene, share: float = _FULL) -> float:
    """Exposure at which the brightest half percent of pixels gains a share of what the sensor holds."""
    rate = camera.mean_electrons(scene, 1.0)
    return float(share * camera.sensor.saturation_capacity_e / np.quantile(rate, 0.995))


def d200(rows: int, cols: int) -> Sensor:
    """A D200 of fewer pixels, with a pedestal so that blacks do not clip."""
    return load_sensor("nikon-d200").with_(rows=rows, cols=cols, black_level_dn=64)


def shot(scene: Scene, optics: Optics, sensor: Sensor, light: str | None = None) -> NDArray[np.float32]:
    """(rows, cols, 3) picture of a scene, exposed for its brightest parts.

    Balanced so that gray under a light is gray; None: as the sensor reads it.
    """
    camera = Camera(optics, sensor)
    raw = camera.capture(scene, exposure_for(camera, scene), seed=SEED)
    neutral = None if light is None else camera.as_shot_neutral(charts.uniform(light, 1.0))
    return develop(raw, "none" if neutral is None else [1 / float(part) for part in neutral.split(",")])


def pictures(rows: list[list[tuple[str, NDArray[np.float32]]]], width_in: float) -> Figure:
    """Pictures under their titles, side by side, every one with its own pixels square."""
    tall = sum(max(picture.shape[0] / picture.shape[1] for _, picture in row) / len(row) for row in rows)
    figure = Figure(figsize=(width_in, width_in * tall + 0.28 * len(rows)))
    for r, part in enumerate(figure.subfigures(len(rows), 1, squeeze=False)[:, 0]):
        for axes, (title, picture) in zip(part.subplots(1, len(rows[r]), squeeze=False)[0], rows[r], strict=True):
            axes.imshow(picture, interpolation="nearest")
            axes.set_title(title)
            axes.set_axis_off()
    return figure


@styled()
def low_pass_filter() -> Figure:
    """A zone plate by a D200 at f/4: false colours, and what a four-spot filter of one pixel leaves of them."""
    plate = charts.zone_plate("D65", 100, highest=0.5, rows=900, cols=900)
    lens = DiffractionLimited(f_number=4, focal_length_mm=50)
    bare = d200(300, 300)
    pitch_um = bare.pixel.width_um.value
    split = bare.with_(optical_stack={"low_pass_filter": {"split_x_um": pitch_um, "split_y_um": pitch_um}})
    return pictures(
        [
            [
                ("without a low-pass filter", shot(plate, lens, bare, "D65")),
                (f"four spots, {pitch_um:g} µm apart", shot(plate, lens, split, "D65")),
            ]
        ],
        8.0,
    )


@styled()
def one_chart_in_four_lights() -> Figure:
    """The ColorChecker under four lights, as the sensor reads it and with gray made gray."""
    lens, sensor = DiffractionLimited(f_number=8, focal_length_mm=50), d200(198, 294)
    lights = {"CIE A": "A", "D65": "D65", "FL11, a fluorescent lamp": "FL11", "LED-B3, a white LED": "LED-B3"}
    scenes = {name: charts.macbeth(light, 100) for name, light in lights.items()}
    raw = [(name, shot(scene, lens, sensor)) for name, scene in scenes.items()]
    gray = [("gray made gray", shot(scenes[name], lens, sensor, light)) for name, light in lights.items()]
    return pictures([raw, gray], 11.0)
