"""
Mosaics
=======

A ColorChecker under daylight (D65), taken by sensors that differ in their color filters only, with assumed spectral
responses. Left: the tile that repeats over the sensor; lines are the polarizers' direction. Right: the developed frame,
with the mean color difference CIEDE2000 from the chart's own colors. The stacked sensor has three layers in every
pixel. Monochrome sensors and those with polarizers alone give gray pictures.
"""

import warnings

import matplotlib.pyplot as plt
import numpy as np
from drawing import panels, shoot

import photosite as ps
from photosite.color.colorimetry import XYZ_FROM_SRGB, delta_e_2000
from photosite.metrics.charts.color_checker import chart_xyz_d65
from photosite.scene.charts.color_checker import MACBETH_NAMES
from photosite.sensor.assumed_channels import assumed_channels
from photosite.values.cfa import cfa_from, channel_names

warnings.simplefilter("ignore", ps.errors.PhotositeWarning)  # the chart is known up to 780 nm
SIZE = 132  # pixels of a picture's height
COLORS = {"R": (0.85, 0.2, 0.15), "G": (0.25, 0.65, 0.25), "B": (0.2, 0.3, 0.85), "Y": (0.95, 0.85, 0.2)}
COLORS |= {"Cy": (0.3, 0.8, 0.85), "W": (0.95,) * 3, "C": (0.95,) * 3, "M": (0.7,) * 3, "P": (0.7,) * 3}
COLORS |= {"Ir": (0.3, 0.1, 0.1)}


def drawn(cfa, stacked=False):
    """Draw a tile."""
    shown = np.ones((SIZE, SIZE, 3))
    side = SIZE // max(len(cfa), len(cfa[0]))
    if stacked:
        for k, name in enumerate(cfa[0]):
            shown[20 + 30 * k : 50 + 30 * k] = COLORS[name]
        return shown
    row, col = np.mgrid[:side, :side] - (side - 1) / 2
    for r, c in np.ndindex(len(cfa), len(cfa[0])):
        name = cfa[r][c]
        square = shown[r * side : r * side + side - 1, c * side : c * side + side - 1]
        square[:] = COLORS[name.rstrip("0123456789")]
        if name[-1].isdigit():
            angle = np.radians(int("".join(filter(str.isdigit, name))))
            lines = np.cos((row * np.cos(angle) + col * np.sin(angle)) * (2 * np.pi / 8)) > 0.5
            square[lines[: side - 1, : side - 1]] *= 0.4
    return shown


def color_difference(picture, camera, chart):
    """Return the mean CIEDE2000 of the patches, at the luminance of neutral 8."""
    linear = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    regions = {region.name: region for region in camera.image_regions(chart)}
    inside = [np.s_[r.r0 + 3 : r.r1 - 3, r.c0 + 3 : r.c1 - 3] for r in map(regions.get, MACBETH_NAMES)]
    seen = np.array([linear[part].mean(axis=(0, 1)) for part in inside]) @ XYZ_FROM_SRGB.T
    true = chart_xyz_d65("macbeth", MACBETH_NAMES)
    gray = MACBETH_NAMES.index("neutral 8")
    return delta_e_2000(seen * true[gray, 1] / seen[gray, 1], true).mean()


lens = ps.DiffractionLimited(f_number=4, focal_length_mm=12)
chart = ps.charts.macbeth("D65", 200)
tiles = ["rggb", "quad-rggb", "rgbw", "rccb", "ryycy", "rgb-ir", "x-trans", "polarization-rggb", "polarization"]
base = ps.load_sensor("sony-imx174").with_(rows=SIZE, cols=196, pitch_um=3.0, black_level_dn=64)
cells = []
for tile in [*tiles, "stacked"]:
    cfa = (("B", "G", "R"),) if tile == "stacked" else cfa_from(tile)
    channels = assumed_channels(channel_names(cfa), 0.7)
    size = {"cols": 3 * 196, "stacked": True} if tile == "stacked" else {}
    camera = ps.Camera(lens, base.with_(cfa=cfa, channels=channels, **size))
    picture = ps.develop(shoot(camera, chart), exposure=0.9)
    title = tile if tile == "polarization" else f"{tile}: {color_difference(picture, camera, chart):.1f}"
    gap = np.ones((SIZE, 10, 3))
    cells.append((title, np.hstack([drawn(cfa, tile == "stacked"), gap, np.clip(picture, 0, 1)])))
panels([cells[k : k + 2] for k in range(0, len(cells), 2)])
plt.show()
