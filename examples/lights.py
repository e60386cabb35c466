"""
Lights of a scene
=================

The reflectances of a ColorChecker under four lights, as an eye adapted to daylight sees them.
"""

import matplotlib.pyplot as plt
import numpy as np
from drawing import as_seen, pictures

import photosite as ps

LIGHTS = ("daylight 6500", "led 4000", "FL11", "A")
chart = ps.charts.macbeth("D65", 100)
pictures([(light, as_seen(chart.with_illuminant(light))) for light in LIGHTS], cols=2, height_in=5.4)

# %%
# The spectra of a white of 100 cd/m² under these lights.

grid = np.arange(380.0, 781.0, 2.0)
figure, axes = plt.subplots(figsize=(7.36, 4.2), layout="constrained")
for light in LIGHTS:
    white = ps.charts.uniform(light, 100, wavelength_nm=grid)
    axes.plot(grid, white.radiance(0, 0) * 1e-15, label=light, linewidth=1.2)
axes.set(xlabel="wavelength (nm)", ylabel="radiance (10¹⁵ photons/s/sr/m²/nm)", xlim=(380, 780), ylim=(0, 20))
axes.legend(loc="upper left")

# %%
# Daylight from the left and a CIE A lamp on the right: the spectrum of the light varies over the scene.

window = ("daylight 6500", 150.0, ps.lights.gradient(1.0, 0.0))
lamp = ("A", 150.0, ps.lights.spot(0.6, 0.9, 0.35))
mixed = ps.lights.mixed(chart, [window, lamp])
pictures([("daylight from the left, CIE A lamp on the right", as_seen(mixed))], cols=1, height_in=5.2)
plt.show()
