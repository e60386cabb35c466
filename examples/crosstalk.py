"""
Crosstalk between pixels
========================

Each of a pixel's four neighbors collects 4 % of the light of a red pixel, 2 % of a green one and 1 % of a blue one.
Colors lose saturation and edges lose sharpness. Both pictures use the color matrix of the sensor without crosstalk.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import crop, d200, mean_on, panels, shoot

import photosite as ps

LEAKS = {"R": 0.04, "G": 0.02, "B": 0.01}  # share of a pixel's light that each of its four neighbors collects
kernels = {name: [[0.0, k, 0.0], [k, 1 - 4 * k, k], [0.0, k, 0.0]] for name, k in LEAKS.items()}
lens = ps.DiffractionLimited(f_number=8, focal_length_mm=50)
chart = ps.charts.macbeth("D65", 100)
plain = d200(244, 363)
matrix = np.linalg.inv(ps.Camera(lens, plain).capture(chart, 1 / 100).color_matrix)  # of the sensor without crosstalk
shown, edges = [], []
for name, sensor in (("no crosstalk", plain), ("crosstalk", plain.with_(crosstalk={"optical": kernels}))):
    camera = ps.Camera(lens, sensor)
    picture = ps.develop(shoot(camera, chart), color_matrix=matrix)
    region = next(region for region in camera.image_regions(chart) if region.name == "red")
    mean_e = camera.mean_electrons(chart, 1 / 10)
    ratio = mean_on(mean_e, camera, region, "R") / mean_on(mean_e, camera, region)
    shown.append((f"{name}: R : G of the red patch is {ratio:.2f}", picture))
    edges.append(("edges, enlarged 6 times", crop(picture, np.s_[106:150], np.s_[34:94], 6)))
panels([shown, edges])
plt.show()
