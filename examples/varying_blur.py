"""Siemens stars through a lens whose coma grows over the field, given as point spreads along one radius."""

from dataclasses import replace

import numpy as np
from drawing import auto_exposure_s, crop, panels, save

import photosite as ps

BASE = ps.DiffractionLimited(f_number=2.8, focal_length_mm=50)
SPACING_UM, SAMPLES, NM = 0.55, 61, 550.0
SIDE, ROWS, COLS = 80, 240, 400  # pixels of a star and of the frame


def point_spread(height):
    """Return the point spread at a relative image height: 0.8 waves of coma and 0.3 of field curvature at 1."""
    rim = (np.arange(96) + 0.5) / 48 - 1
    r2 = rim[:, None] ** 2 + rim**2
    waves = 0.8 * height * (r2 - 2 / 3) * rim + 0.3 * height**2 * r2
    field = np.where(r2 <= 1, np.exp(2j * np.pi * waves), 0)
    at_um = (np.arange(SAMPLES) - SAMPLES // 2) * SPACING_UM
    kernel = np.exp(-2j * np.pi * at_um[:, None] * rim / (2 * BASE.f_number * NM * 1e-3))
    psf = np.abs(kernel @ field @ kernel.T) ** 2
    return psf / psf.sum()


def design(heights, edge_mm, pixel_um):
    """Return a lens from point spreads at some relative image heights."""
    psf = np.stack([point_spread(height) for height in heights])[:, None]
    return ps.LensDesign(np.array([NM]), psf, SPACING_UM, 0 * heights, heights * edge_mm, detail_um=pixel_um, nodes=17)


chip = ps.load_sensor("vendor-1.4um")
green = chip.with_(rows=ROWS, cols=COLS, cfa=(("G",),), channels={"G": chip.channels["G"]})
pixel_um = green.pixel.width_um.value
edge_mm = float(np.hypot(ROWS, COLS)) / 2 * pixel_um * 1e-3
samples = {"rows": 3 * SIDE, "cols": 3 * SIDE}
star = ps.charts.siemens_star("D65", 100, cycles=24, waveform="square", patches=False, **samples)
scene = replace(star, weights=np.tile(star.weights, (1, ROWS // SIDE, COLS // SIDE)))
varying = design(np.linspace(0, 1, 9), edge_mm, pixel_um)
lenses = {
    "blur of the center everywhere": design(np.zeros(1), edge_mm, pixel_um),
    f"coma and field curvature: {len(varying.low_rank.modes)} modes, "
    f"RMS error {100 * varying.low_rank.relative_error:.1f} %": varying,
}
whole, parts = [], []
for title, blur in lenses.items():
    camera = ps.Camera(ps.Lens(BASE, blur=blur), green)
    picture = ps.develop(camera.capture(scene, auto_exposure_s(camera, scene), seed=2008), "none")
    whole.append((title, picture))
    parts.append(("center, enlarged 3 times", crop(picture, np.s_[88:152], np.s_[168:232], 3)))
    parts.append(("lower right corner", crop(picture, np.s_[-72:-8], np.s_[-72:-8], 3)))
figure, _ = panels([whole, parts])
save(figure, "varying-blur.png")
