"""Reflectance spectra recovered from sRGB colors, and a high dynamic range picture as a scene."""

import numpy as np
from drawing import as_seen, save
from matplotlib.figure import Figure

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
figure = Figure(figsize=(8.8, 5.6), layout="constrained")
upper, lower = figure.subfigures(2, 1, height_ratios=[1.3, 1])
for number, (name, axes) in enumerate(zip(PATCHES, upper.subplots(1, len(PATCHES), sharey=True), strict=True)):
    axes.plot(grid, measured[list(regions).index(name)], color="black", label="measured", linewidth=1.8)
    for method, scene in methods.items():
        axes.plot(grid, scene.weights[:, 0, number] @ scene.reflectance, label=method, linewidth=1.2)
    axes.set_title(name)
    axes.set(xlim=(380, 780), ylim=(0, 1), xticks=(400, 600))
upper.axes[0].set_ylabel("reflectance")
upper.supxlabel("wavelength (nm)", fontsize=9)
upper.legend(*upper.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)

# The colors of the chart's first three rows as light, a tenth of the luminance from column to column.
tiles = np.array([display[region.r0, region.c0] for region in chart.regions[:18]]).reshape(3, 6, 3) ** 2.2
tiles *= 10.0 ** -np.arange(6)[None, :, None]
lamps = ps.pictures.from_hdr(np.kron(tiles, np.ones((20, 20, 1))), white_luminance_cd_m2=1e5)
for axes, white_cd_m2 in zip(lower.subplots(1, 3), (1e5, 1e3, 10.0), strict=True):
    axes.imshow(as_seen(lamps, white_cd_m2), interpolation="antialiased")
    axes.set_title(f"display white at {white_cd_m2:,.0f} cd/m²")
    axes.set(xticks=[], yticks=[])
save(figure, "pictures.png")
