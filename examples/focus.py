"""Three planes in depth, focused on each: slats in front, a ColorChecker, and dead leaves behind."""

from dataclasses import replace

import numpy as np
from drawing import d200, panels, photograph, save

import photosite as ps

ROWS, COLS = 200, 300
LENS = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
sensor = d200(ROWS, COLS)

row, col = np.indices((ROWS, COLS)) + 0.5
across = (col + 0.3 * row) % 75.0  # slats 10 samples wide, every 75 samples
opacity = np.clip(np.minimum(across, 10.0 - across) + 0.5, 0.0, 1.0).astype(np.float32)
wood = ps.charts.uniform("A", 25, distance_m=1.7)
wood = replace(wood, weights=np.broadcast_to(wood.weights, (len(wood.weights), ROWS, COLS)))

field_m = COLS * sensor.pixel.width_um.value * 1e-6 / LENS.magnification(2.0)
chart = ps.charts.macbeth("D65", 60, distance_m=2.0, width_m=0.6 * field_m)
leaves = ps.charts.dead_leaves("D65", 60, rows=ROWS, cols=COLS, contrast=10, distance_m=3.0)
scene = ps.Planes((ps.Plane(wood, opacity), ps.Plane(chart), ps.Plane(leaves)))
shown = [
    (
        f"focused at {distance_m:g} m, on the {what}",
        photograph(ps.Camera(ps.Lens(LENS, focus_distance_m=distance_m), sensor), scene, "D65"),
    )
    for distance_m, what in ((1.7, "slats"), (2.0, "chart"), (3.0, "leaves"))
]
figure, _ = panels([shown])
save(figure, "focus.jpg")
