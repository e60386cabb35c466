"""
Veiling glare
=============

A ColorChecker beside a window that is a hundred times as bright as the white patch. A lens with veiling glare
scatters 1 % of all light, uniformly or as exp(−distance / 1.2 mm). The titles give the contrast of the chart's white
and black patches on the green pixels of the raw frame. The contrast of the chart itself is 26; without glare, the
diffraction of the window lowers it.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawing import WIDTH, d200, mean_on, panels

import photosite as ps

EXPOSURE_S, DARK = 1 / 15, 92  # columns of the scene to the right of the window, outside the picture
chart = ps.charts.macbeth("D65", 40)
white = next(region for region in chart.regions if region.name == "white")
beside = np.zeros((len(chart.weights), chart.shape[0], 92 + DARK), np.float32)
beside[:, 12:-12, 32:84] = 100 * chart.weights[:, white.r0, white.c0, None, None]
scene = replace(chart, weights=np.concatenate([chart.weights, beside], axis=2))
sensor = d200(336, round(WIDTH * scene.shape[1] / (scene.shape[1] - DARK)))
glares = {
    "no glare": None,
    "1 %, uniform": ps.optics.VeilingGlare(0.01),
    "1 %, near the source": ps.optics.VeilingGlare(0.01, spread_m=1.2e-3),
}
shown = []
for name, glare in glares.items():
    lens = ps.Lens(ps.DiffractionLimited(f_number=4, focal_length_mm=50), veiling_glare=glare)
    camera = ps.Camera(lens, sensor)
    mean_e = camera.mean_electrons(scene, EXPOSURE_S)
    green = {region.name: mean_on(mean_e, camera, region) for region in camera.image_regions(scene)}
    raw = camera.expose(mean_e, EXPOSURE_S, seed=2008, scene=scene)
    picture = ps.develop(raw, exposure=1.0)[:, :WIDTH]
    shown.append([(f"{name}; white : black = {green['white'] / green['black']:.1f}", picture)])
panels(shown)
plt.show()
