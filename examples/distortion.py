"""A checkerboard through a straight lens, a lens with barrel distortion, and one with lateral color."""

from dataclasses import replace

import numpy as np
from drawing import crop, d200, panels, photograph, save

import photosite as ps

ROWS, COLS, SQUARE = 200, 300, 20
BASE = ps.DiffractionLimited(f_number=5.6, focal_length_mm=24)
sensor = d200(ROWS, COLS)
pixel_m = sensor.pixel.width_um.value * 1e-6
corner_mm = float(np.hypot(ROWS, COLS)) / 2 * pixel_m * 1e3

share = np.array([0.0, 0.4, 0.7, 0.9, 1.0, 1.1])
heights = ps.FieldPoints(height_mm=share * corner_mm)
barrel = ps.Distortion.from_percent(heights, -6.0 * share**2)
edge = ps.FieldPoints(height_mm=np.array([1.1 * corner_mm]))
shift_um = np.array([[6.0], [0.0], [-6.0]]) * 1.1 * corner_mm  # 0.6 % of the image height
lenses = {
    "no distortion": ps.Lens(BASE),
    "barrel, 6 % at the corner": ps.Lens(BASE, distortion=barrel),
    "lateral color, ±0.6 %": ps.Lens(
        BASE, lateral_color=ps.LateralColor(np.array([450.0, 550.0, 650.0]), edge, shift_um)
    ),
}
# The board is larger than the frame, because a barrel shows more of the scene.
rows, cols = ROWS + 4 * SQUARE, COLS + 4 * SQUARE
board = ps.charts.checkerboard("D65", 100, square=3 * SQUARE, rows=3 * rows, cols=3 * cols)
board = replace(board, width_m=cols * pixel_m / BASE.magnification(board.distance_m))
whole = [(name, photograph(ps.Camera(lens, sensor, cells_per_pixel=3), board, "D65")) for name, lens in lenses.items()]
corners = [("upper left corner, enlarged 4 times", crop(picture, np.s_[:50], np.s_[:75], 4)) for _, picture in whole]
figure, _ = panels([whole, corners])
save(figure, "distortion.png")
