"""A ColorChecker under four lights, and under two lights at once."""

import numpy as np
from drawing import as_seen, save
from matplotlib.figure import Figure

import photosite as ps

LIGHTS = ("daylight 6500", "led 4000", "FL11", "A")
chart = ps.charts.macbeth("D65", 100)
figure = Figure(figsize=(8.8, 5.6), layout="constrained")
upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.35])
for axes, light in zip(upper.subplots(1, 4), LIGHTS, strict=True):
    axes.imshow(as_seen(chart.with_illuminant(light)), interpolation="antialiased")
    axes.set_title(light)
    axes.set_axis_off()

spectra, mixed = lower.subplots(1, 2)
grid = np.arange(380.0, 781.0, 2.0)
for light in LIGHTS:
    white = ps.charts.uniform(light, 100, wavelength_nm=grid)
    spectra.plot(grid, white.radiance(0, 0) * 1e-15, label=light, linewidth=1.2)
spectra.set(xlabel="wavelength (nm)", ylabel="radiance (10¹⁵ photons/s/sr/m²/nm)", xlim=(380, 780), ylim=(0, 20))
spectra.set_title("white of 100 cd/m²")
spectra.legend(loc="upper left")

window = ("daylight 6500", 150.0, ps.lights.gradient(1.0, 0.0))
lamp = ("A", 150.0, ps.lights.spot(0.6, 0.9, 0.35))
mixed.imshow(as_seen(ps.lights.mixed(chart, [window, lamp])), interpolation="antialiased")
mixed.set_title("daylight from the left, CIE A lamp on the right")
mixed.set_axis_off()
save(figure, "lights.png")
