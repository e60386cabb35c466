"""
Optical low-pass filter
=======================

A zone plate of up to 1.5 cycles per pixel, D200 at f/4. Near half a cycle per pixel the color filter array turns
detail into false color; the low-pass filter has its zero there.
"""

import matplotlib.pyplot as plt
from drawing import d200, panels, shoot

import photosite as ps

plate = ps.charts.zone_plate("D65", 100, highest=0.5, rows=1089, cols=1089)
lens = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
bare = d200(363, 363)
pitch_um = bare.pixel.width_um.value
filtered = bare.with_(low_pass_filter={"split_x_um": pitch_um, "split_y_um": pitch_um})
shown = []
for title, sensor in (("no low-pass filter", bare), (f"four spots, {pitch_um:g} µm apart", filtered)):
    camera = ps.Camera(lens, sensor, cells_per_pixel=3)
    shown.append((title, ps.develop(shoot(camera, plate, 1 / 30), exposure=1.5)))
panels([shown])
plt.show()
