"""A ColorChecker beside a bright window, with and without veiling glare."""

from dataclasses import replace

import numpy as np
from drawing import d200, mean_on, panels, photograph, save

import photosite as ps

EXPOSURE_S, DARK = 1 / 15, 92  # columns of the scene to the right of the window, outside the picture
ROWS, COLS = 140, 306
chart = ps.charts.macbeth("D65", 40)
white = next(region for region in chart.regions if region.name == "white")
beside = np.zeros((len(chart.weights), chart.shape[0], 92 + DARK), np.float32)
beside[:, 12:-12, 32:84] = 100 * chart.weights[:, white.r0, white.c0, None, None]
scene = replace(chart, weights=np.concatenate([chart.weights, beside], axis=2))
sensor = d200(ROWS, round(COLS * scene.shape[1] / (scene.shape[1] - DARK)))


glares = {
    "no glare": None,
    "1 %, uniform": ps.VeilingGlare(0.01),
    "1 %, near the source": ps.VeilingGlare(0.01, spread_m=0.5e-3),
}
shown = []
for name, glare in glares.items():
    lens = ps.Lens(ps.DiffractionLimited(f_number=4, focal_length_mm=50), veiling_glare=glare)
    camera = ps.Camera(lens, sensor)
    mean_e = camera.mean_electrons(scene, EXPOSURE_S)
    green = {region.name: mean_on(mean_e, camera, region) for region in camera.image_regions(scene)}
    ratio = green["white"] / green["black"]
    picture = photograph(camera, scene, "D65", EXPOSURE_S, 1.0)[:, :COLS]
    shown.append((f"{name}; white : black = {ratio:.1f}", picture))
figure, _ = panels([shown])
save(figure, "glare.png")
