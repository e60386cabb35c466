"""
Distortion and lateral color
============================

A checkerboard through three lenses: without aberrations, with a barrel distortion of 6 % at the corner, and with
lateral color, so that red is 1 % smaller and blue 1 % larger than green. Fringes of one pixel in all three pictures
come from demosaicing; those of lateral color are four pixels wide at the corner.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawing import GAP, WIDTH, crop, d200, panels, shoot

import photosite as ps

ROWS, COLS, SQUARE = 480, WIDTH, 48
BASE = ps.DiffractionLimited(f_number=5.6, focal_length_mm=24)
sensor = d200(ROWS, COLS)
pixel_m = sensor.pixel.width_um.value * 1e-6
corner_mm = float(np.hypot(ROWS, COLS)) / 2 * pixel_m * 1e3
share = np.array([0.0, 0.4, 0.7, 0.9, 1.0, 1.1])
barrel = ps.optics.Distortion.from_percent(ps.optics.FieldPoints(height_mm=share * corner_mm), -6.0 * share**2)
fringes = ps.optics.LateralColor.from_magnification([450.0, 550.0, 650.0], [1.01, 1.0, 0.99])
lenses = {
    "no distortion": ps.Lens(BASE),
    "barrel, 6 % at the corner": ps.Lens(BASE, distortion=barrel),
    "lateral color, ±1 %": ps.Lens(BASE, lateral_color=fringes),
}
# The board is larger than the frame, because a barrel shows more of the scene.
rows, cols = ROWS + 4 * SQUARE, COLS + 4 * SQUARE
board = ps.charts.checkerboard("D65", 100, square=SQUARE, rows=rows, cols=cols)
board = replace(board, width_m=cols * pixel_m / BASE.magnification(board.distance_m))
whole = {name: ps.develop(shoot(ps.Camera(lens, sensor), board)) for name, lens in lenses.items()}
panels([[shown] for shown in whole.items()])

# %%
# The upper left corners, enlarged four times.

side = (WIDTH - 2 * GAP) // 3 // 4
panels([[(name, crop(picture, np.s_[:side], np.s_[:side], 4)) for name, picture in whole.items()]])
plt.show()
