"""Figures of a mapped chip: distribution of temporal noise, defect map, and blinking pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.calibration.chip_maps.noise_shape import tukey_density, tukey_reach
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise, Trace
from photosite.report.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION, WIDTH_IN, new_figure, styled
from photosite.sensor.chip import DefectKind, Defects

_PER_POINT = 2  # bins of the histogram per point
_NORMAL_QUARTILE = 0.6744897501960817


@styled()
def noise_histogram_figure(noise: TemporalNoise) -> Figure:
    """Draw the histogram of all deviations from the pixels' means, with the normal and the Tukey lambda distribution.

    The density is logarithmic; tails heavier than normal lie above the dashed line. The normal distribution has the
    quartiles of the histogram. The Tukey lambda distribution has its shape and standard deviation, and is drawn if the
    shape differs significantly from normal. If it has a largest deviation, its label states the number of values
    beyond.
    """
    figure, axes = new_figure()
    bins = len(noise.residual_count) // _PER_POINT * _PER_POINT
    count = noise.residual_count[:bins].reshape(-1, _PER_POINT).sum(axis=1)
    x = noise.residual_dn[:bins].reshape(-1, _PER_POINT).mean(axis=1)
    width, total = float(x[1] - x[0]), float(count.sum())
    filled = count > 0
    density = count[filled] / (total * width)
    bars = np.minimum(np.sqrt(count[filled]), 0.999 * count[filled]) / (total * width)
    low, high = _quantiles(noise, np.array([0.25, 0.75]))
    sigma = (high - low) / (2 * _NORMAL_QUARTILE)
    normal = np.linspace(x[filled][0], x[filled][-1], 600)
    dots: dict[str, Any] = {"fmt": "o", "color": BLUE, "markersize": 3.2, "elinewidth": 0.8}
    axes.errorbar(x[filled], density, bars, label="values", zorder=2, **dots)
    bell = np.exp(-0.5 * (normal / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    label = f"normal, {sigma:.3g} DN from quartiles"
    axes.plot(normal, bell, color=BLACK, linestyle="--", label=label, zorder=3)
    if noise.shape.tukey_lambda.value is not None and not noise.shape.shape_is_normal:
        _draw_tukey(axes, noise.shape.tukey_lambda.value, x, count)
    axes.set_yscale("log")
    axes.set_ylim(0.4 / (total * width), 3.0 * float(density.max()))
    reach = 1.05 * max(-x[filled][0], x[filled][-1], 5 * sigma)
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("deviation from the pixel's mean (DN)")
    axes.set_ylabel("density (1/DN)")
    axes.legend(loc="lower center")
    return figure


def _draw_tukey(axes: Axes, shape: float, x: NDArray[np.float64], count: NDArray[np.int64]) -> None:
    """Draw the Tukey lambda distribution with the standard deviation of the values, and its ends, if it has any."""
    spread = float(np.sqrt(count @ x**2 / count.sum()))
    reach = tukey_reach(shape, spread)
    label = f"Tukey lambda, shape {shape:.3f}".replace("-", "−")
    if (beyond := int(count[np.abs(x) > reach].sum())) > 0:
        label += f": ends at ±{reach:.3g} DN, {beyond} values beyond"
        for end in (-reach, reach):
            axes.axvline(end, color=ORANGE, linestyle=":", linewidth=0.9, zorder=1)
    axes.plot(*tukey_density(shape, spread), color=ORANGE, label=label, zorder=4)


def _quantiles(noise: TemporalNoise, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quantiles of the histogram, linear within a bin."""
    width = noise.residual_dn[1] - noise.residual_dn[0]
    below = np.cumsum(noise.residual_count) / noise.residual_count.sum()
    return np.asarray(np.interp(p, below, noise.residual_dn + width / 2))


_DEFECT_MARKS = {
    DefectKind.HOT: ("hot", VERMILION, "o"),
    DefectKind.OFFSET: ("offset", ORANGE, "D"),
    DefectKind.DEAD: ("dead", BLACK, "x"),
    DefectKind.RESPONSE: ("response", BLUE, "+"),
    DefectKind.BLINKING: ("blinking", GREEN, "^"),
    DefectKind.NOISY: ("noisy", PURPLE, "v"),
}

_MOST = 4000  # largest number of pixels drawn of a kind, in order of deviation


@styled()
def defect_map_figure(defects: Defects, shape: tuple[int, int]) -> Figure:
    """Draw a marker for each defective pixel on the area of a chip of (rows, cols) pixels, row 0 at the top.

    The legend gives the number of each kind. Of more than 4000 pixels of a kind, those with the largest deviation are
    drawn, and the legend gives both numbers.
    """
    rows, cols = shape
    height = min(max((WIDTH_IN - 2.4) * rows / cols, 2.2), 7.0)
    figure = Figure(figsize=(WIDTH_IN, height + 0.9))
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.grid(visible=False)
    for kind, (name, color, marker) in _DEFECT_MARKS.items():
        chosen = defects.of(kind)
        if not len(chosen):
            continue
        drawn = np.argsort(-np.abs(chosen.deviation), kind="stable")[:_MOST]
        label = f"{name}: {len(chosen)}" + (f", {_MOST} drawn" if len(chosen) > _MOST else "")
        size, edge = (3.0, 0.7) if len(drawn) > 400 else (5.0, 1.1)
        look: dict[str, Any] = {"color": color, "markerfacecolor": "none", "markersize": size, "markeredgewidth": edge}
        axes.plot(chosen.col[drawn], chosen.row[drawn], marker, label=label, **look)
    axes.set_xlim(-0.5, cols - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.set_xlabel("column")
    axes.set_ylabel("row")
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
    if len(defects):
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), borderaxespad=0.0, markerscale=1.3)
    else:
        axes.text(0.5, 0.5, "no defective pixels", transform=axes.transAxes, ha="center", va="center")
    return figure


@styled()
def telegraph_figure(traces: Sequence[Trace]) -> Figure:
    """Draw a row for each pixel: its values against the frame number, their histogram, and the two levels, dashed."""
    figure = Figure(figsize=(WIDTH_IN, 0.7 + 1.35 * len(traces)))
    grid = figure.subplots(len(traces), 2, sharey="row", squeeze=False, width_ratios=(4, 1))
    for (over_frames, histogram), trace in zip(grid, traces, strict=True):
        frames = np.arange(1, len(trace.dn) + 1)
        over_frames.step(frames, trace.dn, where="mid", color=BLUE, linewidth=0.9)
        over_frames.plot(frames, trace.dn, ".", color=BLUE, markersize=4)
        low, high = float(trace.dn.min()), float(trace.dn.max())
        bins = np.linspace(low - 0.5, high + 0.5, min(int(high - low) + 2, 32))
        histogram.hist(trace.dn, bins, orientation="horizontal", color=BLUE, alpha=0.75)
        for axes in (over_frames, histogram):
            for level in (trace.lower_dn, trace.upper_dn):
                axes.axhline(level, color=ORANGE, linestyle="--", linewidth=1.3, zorder=3)
        over_frames.set_title(f"row {trace.row}, column {trace.col}", loc="left", fontsize=9)
        over_frames.set_ylabel("DN")
        over_frames.margins(x=0.01)
    grid[-1][0].set_xlabel("frame number")
    grid[-1][1].set_xlabel("frames")
    return figure
