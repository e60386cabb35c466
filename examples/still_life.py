"""
A rendered still life
=====================

Mitsuba 3 renders a still life under a lamp of 3200 K in 31 bands. Above: as an eye adapted to the lamp sees it.
Below: captured with a D200 at f/4 and white-balanced. Needs the extra ``render``.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import crop, d200, panels, shoot

import photosite as ps
from photosite.scene.scene import preview

scene = ps.render.example_scene(rows=240, cols=360, spp=24)
seen = preview(scene, white_xy=(0.4234, 0.3990))  # adapted to the lamp, a blackbody of 3200 K
lens = ps.DiffractionLimited(f_number=4, focal_length_mm=4.4)  # short, so that few pixels span the scene
camera = ps.Camera(lens, d200(240, 360))
neutral = camera.as_shot_neutral(ps.charts.uniform("3200K", 1.0))
picture = ps.develop(shoot(camera, scene), [1 / float(part) for part in neutral.split(",")])
shown = {"the scene": seen, "Nikon D200, 240 x 360 pixels, f/4": picture}
panels([[(f"{title}, enlarged twice", crop(part, np.s_[:], np.s_[:], 2))] for title, part in shown.items()])
plt.show()
