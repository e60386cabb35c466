"""
Pictures as scenes
==================

Measured reflectances of five patches, and the reflectances that two methods recover from their sRGB values. All have
the same color under D65; cyan is clipped to sRGB.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import as_seen, pictures

import photosite as ps

PATCHES = ("red", "green", "blue", "orange", "cyan")
grid = np.arange(380.0, 781.0, 10.0)
measured = ps.charts.macbeth_reflectance(grid)
chart = ps.charts.macbeth("D65", 100, wavelength_nm=grid)
regions = {region.name: region for region in chart.regions}
white = ps.Scene.uniform(chart.light(), grid, chart.distance_m)  # a perfect white in the chart's light
display = as_seen(chart, white.mean_luminance_cd_m2())  # cyan is clipped to sRGB
colours = np.stack([display[regions[name].r0, regions[name].c0] for name in PATCHES])[None]
methods = {
    "Mallett and Yuksel": ps.pictures.from_rgb(colours, wavelength_nm=grid),
    "Jakob and Hanika": ps.pictures.from_rgb(colours, wavelength_nm=grid, method="jakob-hanika", tolerance=1e-5),
}
figure, grid_axes = plt.subplots(3, 2, figsize=(7.36, 7.6), layout="constrained", sharex=True, sharey=True)
for number, (name, axes) in enumerate(zip(PATCHES, grid_axes.flat, strict=False)):
    axes.plot(grid, measured[list(regions).index(name)], color="black", label="measured", linewidth=1.8)
    for method, scene in methods.items():
        axes.plot(grid, scene.weights[:, 0, number] @ scene.reflectance, label=method, linewidth=1.2)
    axes.set_title(name)
    axes.set(xlim=(380, 780), ylim=(0, 1))
figure.supylabel("reflectance", fontsize=9)
figure.supxlabel("wavelength (nm)", fontsize=9)
grid_axes[2, 1].set_axis_off()
grid_axes[2, 1].legend(*axes.get_legend_handles_labels(), loc="center")

# %%
# A high dynamic range picture as a scene: the colors of the chart's first three rows as light, a tenth of the
# luminance from column to column. The display shows three luminances as white.

tiles = np.array([display[region.r0, region.c0] for region in chart.regions[:18]]).reshape(3, 6, 3) ** 2.2
tiles *= 10.0 ** -np.arange(6)[None, :, None]
lamps = ps.pictures.from_hdr(np.kron(tiles, np.ones((20, 20, 1))), white_luminance_cd_m2=1e5)
shown = [(f"display white at {white:,.0f} cd/m²", as_seen(lamps, white)) for white in (1e5, 1e3, 10.0)]
pictures(shown, cols=1, height_in=11.0)
plt.show()
