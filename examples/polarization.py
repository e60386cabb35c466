"""
Polarization
============

A field of light whose degree of polarization rises from left to right, and whose angle turns from top to bottom, on a
sensor with polarizers at 0, 45, 90 and 135 degrees. Degree and angle are measured from one noisy frame.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import shoot

import photosite as ps
from photosite.develop.polarization import stokes
from photosite.scene.scene import Scene
from photosite.sensor.assumed_channels import assumed_channels
from photosite.values.cfa import NAMED, channel_names

ROWS, COLS = 200, 300
cfa = NAMED["polarization"]
channels = assumed_channels(channel_names(cfa), 0.6)
blocked = {"wavelength_nm": [350, 400, 401, 699, 700, 1100], "transmittance": [0, 0, 1, 1, 0, 0]}
sensor = ps.load_sensor("sony-imx174").with_(
    rows=ROWS, cols=COLS, cfa=cfa, channels=channels, infrared_filter=blocked, black_level_dn=64
)
camera = ps.Camera(ps.DiffractionLimited(f_number=4, focal_length_mm=12), sensor)
grid = np.arange(400.0, 701.0, 10.0)
degree, angle_deg = np.meshgrid(np.linspace(0, 1, COLS), np.linspace(0, 180, ROWS))
field = Scene(np.ones((1, ROWS, COLS), np.float32), np.full((1, grid.size), 1e17), grid)
raw = shoot(camera, field.polarized(degree, angle_deg))
seen = stokes(raw, sensor=sensor)

figure, axes = plt.subplots(1, 3, figsize=(7.36, 2.2), layout="constrained")
shown = [
    ("raw frame, DN", raw.dn, "gray", None),
    ("degree", seen.dolp, "viridis", (0, 1)),
    ("angle, degrees", seen.aolp_deg, "twilight", (0, 180)),
]
for ax, (title, values, colors, limits) in zip(axes, shown, strict=True):
    image = ax.imshow(values, cmap=colors, clim=limits)
    ax.set_title(title, loc="left")
    ax.set_axis_off()
    figure.colorbar(image, ax=ax, shrink=0.8)
plt.show()
