"""Defocused points of light through three apertures."""

import numpy as np
from drawing import d200, panels, photograph, save

import photosite as ps

ROWS, COLS = 200, 300
random = np.random.default_rng(20)
picture = np.full((ROWS, COLS, 3), 3e-4)  # a dark sky
for row, col in zip(random.integers(4, ROWS - 6, 40), random.integers(4, COLS - 6, 40), strict=True):
    picture[row : row + 2, col : col + 2] = random.uniform(0.1, 1.0, 3)
lights = ps.pictures.from_rgb(
    picture, "D65", 20.0, linear=True, wavelength_nm=np.arange(400.0, 701.0, 20.0), distance_m=40.0
)
pupils = {
    "round aperture": ps.Pupil(),
    "six blades": ps.Pupil(blades=6, rotation_deg=15),
    "central obscuration of 0.5": ps.Pupil(obscuration=0.5),
}
base = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
shown = []
for name, pupil in pupils.items():
    lens = ps.Lens(base, ps.Wavefront(pupil=pupil), focus_distance_m=3.0)
    shown.append((name, photograph(ps.Camera(lens, d200(ROWS, COLS)), lights, "D65")))
figure, _ = panels([shown])
save(figure, "bokeh.jpg")
