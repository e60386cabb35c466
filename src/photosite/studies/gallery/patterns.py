"""The patterns by formula in the gallery, as an eye would see them: no camera in between."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.report.style import styled
from photosite.scene import charts
from photosite.scene.preview import preview, tristimulus
from photosite.scene.scene import Scene

_D65 = (0.3127, 0.3290)
_N = 300
_DECADES = 6


@styled()
def patterns_plate() -> Figure:
    """Twelve of the patterns, a sample a pixel."""
    shown: list[tuple[str, NDArray[np.float32]]] = [
        ("slanted edge, 4 : 1", _seen(charts.slanted_edge(rows=_N, cols=_N))),
        ("slanted star, 8 edges", _seen(charts.edge_star(rows=_N, cols=_N))),
        ("Siemens star, 72 cycles, sine", _seen(charts.siemens_star(cycles=72, rows=_N, cols=_N))),
        ("Siemens star, 36 cycles, square", _seen(_square_star())),
        ("zone plate to 0.5 cycles/sample", _seen(charts.zone_plate(rows=_N, cols=_N))),
        ("bars, 0.04 cycles/sample, 30 degrees", _seen(_bars())),
        ("sweep, 0.01 to 0.5 cycles/sample", _seen(charts.frequency_sweep(lowest=0.01, rows=_N, cols=_N))),
        ("dead leaves", _seen(charts.dead_leaves(rows=_N, cols=_N, contrast=10))),
        ("points of 5 samples", _seen(charts.point_grid(pitch=30, diameter=5.0, rows=_N, cols=_N))),
        ("checkerboard, squares of 27.5", _seen(charts.checkerboard(square=27.5, rows=_N, cols=_N))),
        ("logarithmic ramp, 1 : 1000", _seen(charts.ramp(logarithmic=True, rows=_N, cols=_N))),
        ("36 greys, 6 decades (log scale)", _logarithmic(charts.hdr_patches(decades=_DECADES))),
    ]
    figure = Figure(figsize=(8.8, 7.0))
    for axes, (title, picture) in zip(figure.subplots(3, 4).flat, shown, strict=True):
        axes.imshow(picture, interpolation="antialiased")
        axes.set_title(title, fontsize=8)
        axes.set_axis_off()
    return figure


@styled()
def colour_charts_plate() -> Figure:
    """The two ColorCheckers, under daylight."""
    figure = Figure(figsize=(8.8, 3.4))
    shown = [
        ("ColorChecker Classic, measured reflectances", charts.macbeth("D65")),
        ("ColorChecker SG, raised from published colours", charts.color_checker_sg("D65")),
    ]
    for axes, (title, chart) in zip(figure.subplots(1, 2), shown, strict=True):
        axes.imshow(preview(chart, white_xy=_D65), interpolation="antialiased")
        axes.set_title(title, fontsize=9)
        axes.set_axis_off()
    return figure


def _square_star() -> Scene:
    return charts.siemens_star(cycles=36, waveform="square", patches=False, rows=_N, cols=_N)


def _bars() -> Scene:
    return charts.sinusoid(frequency=0.04, direction_deg=30, waveform="square", rows=_N, cols=_N)


def _seen(scene: Scene) -> NDArray[np.float32]:
    """The brightest sample is white."""
    return preview(scene, float(tristimulus(scene)[..., 1].max()), white_xy=_D65)


def _logarithmic(scene: Scene) -> NDArray[np.float32]:
    """White to black over the decades, black where the scene is."""
    luminance = tristimulus(scene)[..., 1].astype(np.float64)
    least = luminance.max() * 10.0 ** -(_DECADES * 1.1)
    share = 1 + np.log10(np.maximum(luminance, least) / luminance.max()) / (_DECADES * 1.1)
    if not math.isclose(float(share.max()), 1.0):
        raise AssertionError("the brightest patch is white")
    return np.repeat(share[:, :, None], 3, axis=2).astype(np.float32)
