"""
Depth of field
==============

Slats at 1.7 m, a ColorChecker at 2 m and dead leaves at 3 m, through 50 mm at f/2.8, focused on each. A plane in
front covers those behind it, with soft edges where it is out of focus.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawing import WIDTH, d200, panels, shoot

import photosite as ps

ROWS, COLS = 420, WIDTH
LENS = ps.DiffractionLimited(f_number=2.8, focal_length_mm=50)
sensor = d200(ROWS, COLS)

row, col = np.indices((ROWS, COLS)) + 0.5
across = (col + 0.3 * row) % 180.0  # slats 24 samples wide, every 180 samples
opacity = np.clip(np.minimum(across, 24.0 - across) + 0.5, 0.0, 1.0).astype(np.float32)
wood = ps.charts.uniform("A", 25, distance_m=1.7)
wood = replace(wood, weights=np.broadcast_to(wood.weights, (len(wood.weights), ROWS, COLS)))

field_m = COLS * sensor.pixel.width_um.value * 1e-6 / LENS.magnification(2.0)
chart = ps.charts.macbeth("D65", 60, distance_m=2.0, width_m=0.6 * field_m)
leaves = ps.charts.dead_leaves("D65", 60, rows=ROWS, cols=COLS, contrast=10, distance_m=3.0)
scene = ps.scenes.Planes((ps.scenes.Plane(wood, opacity), ps.scenes.Plane(chart), ps.scenes.Plane(leaves)))
daylight = ps.Camera(LENS, sensor).as_shot_neutral(ps.charts.uniform("D65", 1.0))  # the light of chart and leaves
neutral = [float(part) for part in daylight.split(",")]
shown = []
for distance_m, what in ((1.7, "slats"), (2.0, "chart"), (3.0, "leaves")):
    camera = ps.Camera(ps.Lens(LENS, focus_distance_m=distance_m), sensor)
    shown.append(
        [
            (
                f"focused at {distance_m:g} m, on the {what}",
                ps.develop(shoot(camera, scene), [1 / part for part in neutral]),
            )
        ]
    )
panels(shown)
plt.show()
