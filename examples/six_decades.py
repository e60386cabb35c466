"""
Six decades of luminance
========================

Gray patches from 35 000 to 0.035 cd/m², captured with a D200 at f/4 and three exposure times.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from drawing import d200, mean_on, panels, shoot

import photosite as ps

EXPOSURES = {"1/1000 s": 1 / 1000, "1/30 s": 1 / 30, "1 s": 1.0}
ROWS, COLS, MARGIN = 300, 480, 100  # pixels of the chart, and of the dark border that collects scattered light
lens = ps.DiffractionLimited(f_number=4, focal_length_mm=50)
camera = ps.Camera(lens, d200(ROWS + 2 * MARGIN, COLS + 2 * MARGIN))
scene = ps.charts.hdr_patches("D65", 3000.0)
width_m = COLS * camera.sensor.pixel.width_um.value * 1e-6 / lens.magnification(scene.distance_m)
scene = replace(scene, width_m=width_m)
inside = np.s_[MARGIN:-MARGIN, MARGIN:-MARGIN]
raws = {name: shoot(camera, scene, time_s) for name, time_s in EXPOSURES.items()}
panels([[(name, ps.develop(raw, exposure=1.0)[inside])] for name, raw in raws.items()])

# %%
# The raw values of the green pixels against the luminance of the patches. One exposure covers about three decades
# between full scale and noise. Light that diffraction scatters from the brightest patches exceeds the signal of the
# darkest ones.


def luminance_cd_m2(region):
    """Return the mean luminance of a region of the scene."""
    part = scene.weights[:, region.r0 : region.r1, region.c0 : region.c1]
    return replace(scene, weights=part, regions=(), width_m=None).mean_luminance_cd_m2()


figure, axes = plt.subplots(figsize=(7.36, 4.6), layout="constrained")
luminance = [luminance_cd_m2(region) for region in scene.regions]
regions = camera.image_regions(scene)
for (name, time_s), color, marker in zip(EXPOSURES.items(), ("C0", "C1", "C3"), "so^", strict=True):
    mean_dn = camera.mean_electrons(scene, time_s) * camera.sensor.system_gain_dn_per_e
    raw = raws[name]
    read_dn = [mean_on(raw.dn, camera, region) - raw.black_level_dn for region in regions]
    axes.loglog(luminance, [mean_on(mean_dn, camera, region) for region in regions], color=color, linewidth=1.0)
    axes.loglog(luminance, np.ma.masked_less_equal(read_dn, 0), marker, color=color, markersize=4.5, label=name)
axes.plot([], [], color="black", linewidth=1.0, label="expected signal, no noise")
axes.axhline(4095 - 64, color="gray", linestyle="--", linewidth=0.8)
axes.text(min(luminance), 2000, "full scale", color="gray")
axes.set(xlabel="patch luminance (cd/m²)", ylabel="green pixels above black level (DN)", ylim=(0.1, 12000))
axes.legend(loc="lower right")
plt.show()
