"""
Coma that grows over the field
==============================

A lens whose coma and field curvature grow towards the corners, on green pixels of 1.4 µm. Point spreads are given
along one radius, as a lens-design program exports them. Above: a point of light in the center and at the lower right
corner, and Siemens stars at the same places.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawing import crop, panels, shoot

import photosite as ps

BASE = ps.DiffractionLimited(f_number=2.8, focal_length_mm=50)
SPACING_UM, SAMPLES, NM = 0.55, 61, 550.0
SIDE, ROWS, COLS = 80, 240, 400  # pixels of a star and of the frame


def point_spread(height):
    """Return the point spread at a relative image height: 1.6 waves of coma and 0.5 of field curvature at 1."""
    rim = (np.arange(96) + 0.5) / 48 - 1
    r2 = rim[:, None] ** 2 + rim**2
    waves = 1.6 * height * (r2 - 2 / 3) * rim + 0.5 * height**2 * r2
    field = np.where(r2 <= 1, np.exp(2j * np.pi * waves), 0)
    at_um = (np.arange(SAMPLES) - SAMPLES // 2) * SPACING_UM
    kernel = np.exp(-2j * np.pi * at_um[:, None] * rim / (2 * BASE.f_number * NM * 1e-3))
    psf = np.abs(kernel @ field @ kernel.T) ** 2
    return psf / psf.sum()


chip = ps.load_sensor("vendor-1.4um")
green = chip.with_(rows=ROWS, cols=COLS, cfa=(("G",),), channels={"G": chip.channels["G"]})
pixel_um = green.pixel.width_um.value
heights = np.linspace(0, 1, 9)
psf = np.stack([point_spread(height) for height in heights])[:, None]
edge_mm = float(np.hypot(ROWS, COLS)) / 2 * pixel_um * 1e-3
design = ps.optics.LensDesign(
    np.array([NM]), psf, SPACING_UM, 0 * heights, heights * edge_mm, detail_um=pixel_um, nodes=17
)
camera = ps.Camera(ps.Lens(BASE, blur=design), green)

star = ps.charts.siemens_star("D65", 100, cycles=24, waveform="square", patches=False, rows=3 * SIDE, cols=3 * SIDE)
stars = replace(star, weights=np.tile(star.weights, (1, ROWS // SIDE, COLS // SIDE)))
points = ps.charts.point_grid("D65", 1, rows=ROWS, cols=COLS, pitch=SIDE)
places = {"center": (np.s_[88:152], np.s_[168:232]), "lower right corner": (np.s_[168:232], np.s_[328:392])}
light = np.sqrt(camera.mean_electrons(points, 1.0))
near = {name: tuple(slice(part.start + 18, part.stop - 18) for part in place) for name, place in places.items()}
parts = [(f"point, {name}", light[place]) for name, place in near.items()]
picture = ps.develop(shoot(camera, stars), "none")
panels(
    [
        [(f"{title}, square root", crop(part / part.max(), np.s_[:], np.s_[:], 13)) for title, part in parts],
        [(f"star, {name}", crop(picture, *place, 5)) for name, place in places.items()],
    ]
)

# %%
# The camera does not store a point spread for every pixel. It stores a few *modes* and their weights over the field;
# the point spread at a place is the weighted sum of the modes. The first mode is the mean point spread, the others
# are changes whose sum is zero. Red is positive, blue negative.

low_rank = design.low_rank
figure, grid = plt.subplots(2, 4, figsize=(7.36, 4.4), layout="constrained")
for k, (above, below) in enumerate(grid.T):
    mode, weights = low_rank.modes[k].reshape(SAMPLES, SAMPLES), low_rank.weights[k].reshape(17, 17)
    inside = np.s_[SAMPLES // 2 - 15 : SAMPLES // 2 + 16]
    above.imshow(mode[inside, inside], cmap="RdBu_r", vmin=-abs(mode).max(), vmax=abs(mode).max())
    below.imshow(weights, cmap="RdBu_r", vmin=-abs(weights).max(), vmax=abs(weights).max())
    above.set_title(f"mode {k + 1}")
    below.set_title("its weight over the field")
    for axes in (above, below):
        axes.set(xticks=[], yticks=[])
figure.suptitle(f"4 of {len(low_rank.modes)} modes; RMS error of the sum {100 * low_rank.relative_error:.1f} %")
plt.show()
