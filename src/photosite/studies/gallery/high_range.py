"""Six decades of light through a camera, in the gallery: where it saturates, and where noise ends it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.camera.camera import Camera
from photosite.optics.diffraction import DiffractionLimited
from photosite.report.style import BLACK, BLUE, GRAY, ORANGE, VERMILION, styled
from photosite.scene import charts
from photosite.scene.preview import tristimulus
from photosite.scene.scene import Scene
from photosite.studies.gallery.panels import Panel, curves_below, pictures
from photosite.studies.gallery.through_a_camera import SEED, d200, taken
from photosite.values.cfa import channel_mask

_EXPOSURES = {"1/1000 s": 1 / 1000, "1/30 s": 1 / 30, "1 s": 1.0}
_MEAN_CD_M2 = 3000.0
_BELOW_IN = 3.6
_FULL_DN = 4095 - 64
_SHAPE, _MARGIN = (190, 302), 100
"""Pixels of the chart's picture, and of the dark all round it, where what diffraction scatters may end."""


def patch_levels(camera: Camera, scene: Scene, exposure_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of the green pixels in each patch over black, in DN: of a raw frame, and of light alone."""
    raw = camera.capture(scene, exposure_s, seed=SEED)
    light = camera.mean_electrons(scene, exposure_s) * camera.sensor.system_gain_dn_per_e
    green = channel_mask(raw.cfa, "G", raw.dn.shape)
    read, expected = [], []
    for region in camera.image_regions(scene):
        inside = (slice(region.r0, region.r1), slice(region.c0, region.c1))
        read.append(float(raw.dn[inside][green[inside]].mean()) - raw.black_level_dn)
        expected.append(float(light[inside][green[inside]].mean()))
    return np.array(read), np.array(expected)


def chart_amid_dark(camera: Camera) -> Scene:
    """36 greys over six decades, as wide as the frame less its margins."""
    scene = charts.hdr_patches("D65", _MEAN_CD_M2)
    width_m = _SHAPE[1] * camera.sensor.pixel.width_um.value * 1e-6 / camera.optics.magnification(scene.distance_m)
    return replace(scene, width_m=width_m)


@styled()
def six_decades() -> Figure:
    """Greys from 1 to a millionth at three exposures, and what the raw frames read."""
    camera = Camera(DiffractionLimited(f_number=4, focal_length_mm=50), d200(*(n + 2 * _MARGIN for n in _SHAPE)))
    scene = chart_amid_dark(camera)
    density = np.array([float(region.name.split()[1]) for region in scene.regions])
    luminance = float(tristimulus(scene)[..., 1].max()) * 10**-density
    shown = (slice(_MARGIN, -_MARGIN), slice(_MARGIN, -_MARGIN))
    panels: list[Panel] = [
        (name, taken(camera, scene, time_s, "D65", 1.0)[shown]) for name, time_s in _EXPOSURES.items()
    ]
    figure = pictures([panels], below_in=_BELOW_IN)
    axes = curves_below(figure, _BELOW_IN)
    for (name, exposure_s), color, marker in zip(_EXPOSURES.items(), (BLUE, ORANGE, VERMILION), "so^", strict=True):
        read, expected = patch_levels(camera, scene, exposure_s)
        axes.loglog(luminance, expected, color=color, linewidth=1.0)
        axes.loglog(luminance[read > 0], read[read > 0], marker, color=color, markersize=4.5, label=f"read, {name}")
    axes.plot([], [], color=BLACK, linewidth=1.0, label="light alone, mean")
    axes.axhline(_FULL_DN, color=GRAY, linewidth=0.8, linestyle="--")
    axes.text(luminance.min(), _FULL_DN * 0.5, "full scale", color=GRAY, fontsize=9)
    axes.set(xlabel="luminance of the patch, cd/m²", ylabel="green pixels over black, DN", ylim=(0.1, 12000))
    axes.legend(loc="lower right")
    return figure
