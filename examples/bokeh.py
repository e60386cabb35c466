"""
Points of light out of focus
============================

Points of light at 40 m through a 50 mm lens at f/2 that is focused at 3 m. Each point becomes a picture of the
aperture, about 64 pixels wide: a disc, a polygon of six blades, or a ring around a central obscuration of half the
diameter.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import WIDTH, d200, panels, shoot

import photosite as ps

ROWS = 330
random = np.random.default_rng(20)
picture = np.full((ROWS, WIDTH, 3), 3e-5)  # a dark sky
for row, col in zip(random.integers(4, ROWS - 6, 40), random.integers(4, WIDTH - 6, 40), strict=True):
    picture[row : row + 2, col : col + 2] = random.uniform(0.1, 1.0, 3)
grid = np.arange(400.0, 701.0, 50.0)
lights = ps.pictures.from_rgb(picture, "D65", 20.0, linear=True, wavelength_nm=grid, distance_m=40.0)
pupils = {
    "round aperture": ps.optics.Pupil(),
    "six blades": ps.optics.Pupil(blades=6, rotation_deg=15),
    "central obscuration of 0.5": ps.optics.Pupil(obscuration=0.5),
}
base = ps.DiffractionLimited(f_number=2, focal_length_mm=50)
shown = []
for name, pupil in pupils.items():
    lens = ps.Lens(base, ps.optics.Wavefront(pupil=pupil), focus_distance_m=3.0)
    shown.append([(name, ps.develop(shoot(ps.Camera(lens, d200(ROWS, WIDTH)), lights)))])
panels(shown)
plt.show()
