"""A scene as a spectral cube's file and back, in the gallery."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from photosite.report.style import BLACK, styled
from photosite.scene import charts
from photosite.scene.io.files import open_cube, read_scene, write_scene
from photosite.scene.lights import gradient, mixed, spot
from photosite.scene.preview import preview
from photosite.scene.scene import Scene
from photosite.studies.gallery.panels import Panel, curves_below, pictures

_D65 = (0.3127, 0.3290)
_BANDS_NM = (450.0, 550.0, 650.0)
_PATCHES = {"blue": "#383D96", "green": "#469449", "red": "#AF363C", "white": BLACK}
_BELOW_IN = 3.2


def room() -> Scene:
    """A ColorChecker with daylight from the left and a lamp's light on the right: no one light, so no few spectra."""
    window, lamp = ("daylight 6500", 200.0, gradient(1.0, 0.0)), ("A", 150.0, spot(0.6, 0.9, 0.35))
    return mixed(charts.macbeth("D65", 100), [window, lamp])


@styled()
def cube_round_trip() -> Figure:
    """The scene that a cube is read back as, three bands, and spectra written and read."""
    scene = room()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "room.tif"
        write_scene(scene, file)
        bands = open_cube(file).shape[2]
        size = file.stat().st_size
        back = read_scene(file)
        weights = np.array(back.weights)  # those of some files are mapped
    panels: list[Panel] = [(f"read: {len(weights)} spectra", preview(back, white_xy=_D65))]
    for wavelength_nm in _BANDS_NM:
        band = int(np.argmin(np.abs(back.wavelength_nm - wavelength_nm)))
        values = np.tensordot(back.basis[:, band], weights, axes=1)
        shown = np.clip(values / np.quantile(values, 0.99), 0, 1) ** (1 / 2.2)
        panels.append((f"band of {wavelength_nm:g} nm", shown.astype(np.float32)))
    figure = pictures([panels], below_in=_BELOW_IN)
    axes = curves_below(figure, _BELOW_IN)
    for region in scene.regions:
        if region.name in _PATCHES:
            row, col = (region.r0 + region.r1) // 2, (region.c0 + region.c1) // 2
            written, read = (place.radiance(row, col) * 1e-15 for place in (scene, back))
            axes.plot(scene.wavelength_nm, written, color=_PATCHES[region.name], label=region.name)
            axes.plot(back.wavelength_nm[::2], read[::2], "o", color=_PATCHES[region.name])
    axes.plot([], [], "o", color=BLACK, label="read back")
    axes.set(xlabel="wavelength, nm", ylabel="10¹⁵ photons/s/sr/m²/nm", xlim=(400, 700), ylim=(0, 8.2))
    error = 100 * back.relative_error
    axes.set_title(
        f"{bands} bands, {size / 2**20:.1f} MB, as {len(weights)} spectra: RMS error {error:.3f} %", fontsize=9
    )
    axes.legend(loc="upper center", ncols=5)
    return figure
