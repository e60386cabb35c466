"""
Spectral cubes
==============

A scene under two lights, written as a TIFF with one page per band and read back. The reader keeps the fewest basis
spectra that reproduce the radiance to 0.1 % RMS.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from drawing import as_seen, pictures

import photosite as ps

PATCHES = {"blue": "#383D96", "green": "#469449", "red": "#AF363C", "white": "black"}
window = ("daylight 6500", 200.0, ps.lights.gradient(1.0, 0.0))
lamp = ("A", 150.0, ps.lights.spot(0.6, 0.9, 0.35))
scene = ps.lights.mixed(ps.charts.macbeth("D65", 100), [window, lamp])
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "scene.tif"
    ps.write_scene(scene, file)
    size_mb = file.stat().st_size / 1e6
    back = ps.read_scene(file)
    weights = np.array(back.weights)

shown = [(f"read back: {len(weights)} basis spectra", as_seen(back))]
for wavelength_nm in (450.0, 550.0, 650.0):
    band = int(np.argmin(np.abs(back.wavelength_nm - wavelength_nm)))
    values = np.tensordot(back.basis[:, band], weights, axes=1)
    shown.append((f"band at {wavelength_nm:g} nm", np.clip(values / np.quantile(values, 0.99), 0, 1) ** (1 / 2.2)))
pictures(shown, cols=2, height_in=5.4)

# %%
# Lines were written, points were read.

figure, axes = plt.subplots(figsize=(7.36, 4.4), layout="constrained")
for region in scene.regions:
    if region.name in PATCHES:
        row, col = (region.r0 + region.r1) // 2, (region.c0 + region.c1) // 2
        color = PATCHES[region.name]
        axes.plot(scene.wavelength_nm, scene.radiance(row, col) * 1e-15, color=color, label=region.name)
        axes.plot(back.wavelength_nm[::2], back.radiance(row, col)[::2] * 1e-15, "o", color=color)
axes.plot([], [], "o", color="black", label="read back")
axes.set(xlabel="wavelength (nm)", ylabel="radiance (10¹⁵ photons/s/sr/m²/nm)", xlim=(400, 700), ylim=(0, 8.2))
axes.set_title(
    f"{len(back.wavelength_nm)} bands, {size_mb:.1f} MB, kept as {len(weights)} spectra: "
    f"RMS error {100 * back.relative_error:.3f} %"
)
axes.legend(loc="upper center", ncols=5)
plt.show()
