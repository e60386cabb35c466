"""Lights and pictures in the gallery: one chart under many lights, and spectra that colours are raised to."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.color.illuminants import illuminant
from photosite.color.spectrum import integration_weights
from photosite.color.srgb import XYZ_FROM_SRGB
from photosite.color.tristimulus import color_matching_functions
from photosite.report.style import BLACK, BLUE, ORANGE, VERMILION, styled
from photosite.scene import charts
from photosite.scene.lights import gradient, mixed, spot
from photosite.scene.pictures import PICTURE_WAVELENGTH_NM, from_hdr, from_rgb
from photosite.scene.preview import preview
from photosite.scene.scene import Scene

_D65 = (0.3127, 0.3290)
_PATCHES = ("red", "green", "blue", "orange", "cyan")


@styled()
def lights_plate() -> Figure:
    """A ColorChecker under four lights and under two at once, as an eye adapted to daylight sees it; the spectra."""
    chart = charts.macbeth("D65", 100)
    lights = [("daylight 6500", BLUE), ("led 4000", BLACK), ("FL11", ORANGE), ("A", VERMILION)]
    figure = Figure(figsize=(8.8, 5.6))
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.35], squeeze=False)[:, 0]
    for axes, (light, _) in zip(upper.subplots(1, 4), lights, strict=True):
        axes.imshow(preview(chart.with_illuminant(light), white_xy=_D65), interpolation="antialiased")
        axes.set_title(light, fontsize=9)
        axes.set_axis_off()
    spectra, room = lower.subplots(1, 2)
    grid = np.arange(380.0, 781.0, 2.0)
    for light, color in lights:
        values = illuminant(light, grid)
        spectra.plot(grid, values / values.mean(), color=color, label=light, linewidth=1.2)
    spectra.set(xlabel="wavelength, nm", ylabel="energy, in parts of its mean", xlim=(380, 780), ylim=(0, 9))
    spectra.legend(loc="upper left")
    window = ("daylight 6500", 150.0, gradient(1.0, 0.0))
    lamp = ("A", 150.0, spot(0.6, 0.9, 0.35))
    room.imshow(preview(mixed(chart, [window, lamp]), white_xy=_D65), interpolation="antialiased")
    room.set_title("window on the left, lamp on the right", fontsize=9)
    room.set_axis_off()
    return figure


@styled()
def pictures_plate() -> Figure:
    """Reflectances that a colour is raised to, two ways, beside measured ones; and a picture of six decades."""
    figure = Figure(figsize=(8.8, 5.6))
    upper, lower = figure.subfigures(2, 1, height_ratios=[1.3, 1], squeeze=False)[:, 0]
    grid = PICTURE_WAVELENGTH_NM
    measured = charts.macbeth_reflectance(grid)[[charts.MACBETH_NAMES.index(name) for name in _PATCHES]]
    picture = _linear_srgb(measured)[None]
    raised = {
        "Mallett and Yuksel": (from_rgb(picture, linear=True), BLUE),
        "Jakob and Hanika": (from_rgb(picture, linear=True, method="jakob-hanika", tolerance=1e-5), VERMILION),
    }
    for number, axes in enumerate(upper.subplots(1, len(_PATCHES), sharey=True)):
        axes.plot(grid, measured[number], color=BLACK, label="measured", linewidth=1.8)
        for name, (scene, color) in raised.items():
            assert scene.reflectance is not None
            axes.plot(grid, scene.weights[:, 0, number] @ scene.reflectance, color=color, label=name, linewidth=1.2)
        axes.set_title(_PATCHES[number], fontsize=9)
        axes.set(xlim=(380, 780), ylim=(0, 1), xticks=(400, 600))
    upper.axes[0].set_ylabel("reflectance")
    upper.legend(*upper.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    bright = _lamps()
    for axes, white in zip(lower.subplots(1, 3), (1e5, 1e3, 10.0), strict=True):
        axes.imshow(preview(bright, white, white_xy=_D65), interpolation="antialiased")
        axes.set_title(f"white at {white:,.0f} cd/m²", fontsize=9)
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        axes.spines[:].set_visible(True)  # where tiles are as white as the page
    return figure


def _linear_srgb(reflectance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) linear sRGB of reflectances under D65, none below 0 (cyan lies a little outside)."""
    grid = PICTURE_WAVELENGTH_NM
    weights = color_matching_functions(grid) * integration_weights(grid) * illuminant("D65", grid)
    tristimulus = reflectance @ (weights / weights[1].sum()).T
    linear: NDArray[np.float64] = np.clip(tristimulus @ np.linalg.inv(XYZ_FROM_SRGB).T, 0.0, 1.0)
    return linear


def _lamps() -> Scene:
    """A ColorChecker's colours as glowing tiles, a decade darker from column to column."""
    chart = charts.macbeth_reflectance(PICTURE_WAVELENGTH_NM)[:18]
    tiles = _linear_srgb(chart).reshape(3, 6, 3) * 10.0 ** -np.arange(6)[None, :, None]
    return from_hdr(np.kron(tiles, np.ones((20, 20, 1))), 1e5)
