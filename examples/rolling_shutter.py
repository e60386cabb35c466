"""
Rolling shutter, motion and flicker
===================================

A rolling shutter exposes one row after the other, here in 21 ms. A pan skews a wheel, a turn bends its spokes, and a
long exposure blurs it along its motion. Below: a wall under lamps at 100 Hz, a sine of depth 0.4 (left) and an LED that
is on for a fifth of the period (middle), and the means of their rows (right) with the closed form of the sine.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawing import d200, panels

import photosite as ps

SIZE, LINE_S = 176, 120e-6
lens = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
camera = ps.Camera(lens, d200(SIZE, SIZE, line_time_us=1e6 * LINE_S), cells_per_pixel=3)
y, x = np.mgrid[-2:2:1024j, -2:2:1024j]  # twice the frame, for what a pan brings into view
wheel = (np.hypot(y, x) < 0.8) & ((np.cos(8 * np.arctan2(y, x)) > 0.3) | (np.hypot(y, x) > 0.65))
side_m = 2 * SIZE * 6.05e-6 / lens.magnification(1.0)
light = ps.charts.uniform("D65", 3000)
scene = replace(light, weights=np.where(wheel, 0.05, 0.9)[None].astype(np.float32), width_m=side_m, distance_m=1.0)


def picture(raw, white):
    """Return the greens of a frame, which are in every row, at twice their width."""
    greens = np.stack([row[1 - r % 2 :: 2] for r, row in enumerate(raw.dn)]) - raw.black_level_dn
    return np.repeat(np.clip(greens / white, 0, 1), 2, axis=1) ** (1 / 2.2)


moving = {
    "at rest": (ps.scenes.Motion(), 1 / 1500),
    "panned: 2500 pixels/s": (ps.scenes.Motion(cols_per_s=2500), 1 / 1500),
    "turned: 2500 degrees/s": (ps.scenes.Motion(rotation_deg_per_s=2500), 1 / 1500),
    "panned, 1/150 s": (ps.scenes.Motion(cols_per_s=2500), 1 / 150),
}
shown = []
for title, (motion, exposure_s) in moving.items():
    # The exposure of the middle row is about time 0, when the wheel is in the middle.
    start_s = -SIZE / 2 * LINE_S - exposure_s / 2
    dimmed = replace(scene, basis=scene.basis / (1500 * exposure_s))
    raw = camera.capture(ps.scenes.DynamicScene(dimmed, motion=motion), exposure_s, start_s=start_s, seed=2008)
    shown.append((title, picture(raw, np.percentile(raw.dn, 99) - raw.black_level_dn)))
panels([shown])

exposure_s = 1 / 400
wall = ps.charts.uniform("D65", 400)
lamps = {
    "100 Hz, depth 0.4": ps.scenes.SineFlicker(100, depth=0.4),
    "LED, 100 Hz, duty 0.2": ps.scenes.PulseFlicker(100, duty=0.2),
}
figure, axes = plt.subplots(1, 3, figsize=(7.36, 2.7), layout="constrained")
steady_e = camera.mean_electrons(wall, exposure_s)
for (title, lamp), axis in zip(lamps.items(), axes, strict=False):
    raw = camera.capture(ps.scenes.DynamicScene(wall, flicker=lamp), exposure_s, seed=2008)
    mean_e = camera.mean_electrons(ps.scenes.DynamicScene(wall, flicker=lamp), exposure_s)
    axis.imshow(picture(raw, raw.dn.max() - raw.black_level_dn), cmap="gray", vmin=0, vmax=1)
    axis.set_title(title)
    axis.set_axis_off()
    axes[2].plot((mean_e / steady_e).mean(axis=1), label=title)
middle_s = np.arange(SIZE) * LINE_S + exposure_s / 2
wave = 1 + 0.4 * np.sinc(100 * exposure_s) * np.cos(2 * np.pi * 100 * middle_s)
axes[2].plot(wave, "k--", label="1 + depth · sinc(f T) · cos(2π f t)")
axes[2].set(xlabel="row", ylim=(0, 7.5), title="light, relative to its mean")
axes[2].legend(fontsize=7)
plt.show()
