"""Figures of dark frames: map of the dark current with glow, and the black level from frame to frame."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.black_level_drift import BlackLevelSeries
from photosite.calibration.effects.glow import GlowMap
from photosite.report.style import BLACK, GRAY, WIDTH_IN, line_style, new_figure, styled
from photosite.sensor.effects.glow import Glow
from photosite.values.uncertain import COVERAGE_95

_SERIES = 6  # largest number of series drawn


@styled()
def glow_figure(found: GlowMap) -> Figure:
    """Draw the dark current in blocks of the chip, in DN/s, with contours of the fitted glow."""
    rows, cols = found.shape
    height = min(max((WIDTH_IN - 1.6) * rows / cols, 2.4), 7.0)
    figure = Figure(figsize=(WIDTH_IN, height + 0.6))
    axes = figure.add_subplot()
    side = max(2, -(-max(rows, cols) // max(found.rate_dn_per_s.shape)))
    extent = (-0.5, found.rate_dn_per_s.shape[1] * side - 0.5, found.rate_dn_per_s.shape[0] * side - 0.5, -0.5)
    low, high = np.percentile(found.rate_dn_per_s, (0.5, 99.8))
    image = axes.imshow(found.rate_dn_per_s, cmap="viridis", extent=extent, vmin=low, vmax=high)
    figure.colorbar(image, ax=axes, label="dark current (DN/s)")
    peak, decay = found.peak_dn_per_s.value, found.decay_pixels.value
    if found.places and peak is not None and decay is not None:
        glow = Glow(places=found.places, peak_e_per_s=peak, decay_pixels=decay).map(rows, cols)
        levels = peak * np.exp(-np.arange(3.0, 0.0, -1.0))
        axes.contour(glow, levels=levels, colors="white", linewidths=0.9)
    axes.grid(visible=False)
    axes.set(xlabel="column", ylabel="row")
    return figure


@styled()
def drift_figure(found: BlackLevelSeries) -> Figure:
    """Draw the means of successive dark frames less that of their series; band: 95 % of what noise explains."""
    figure, axes = new_figure(height_in=3.6)
    order = sorted(range(len(found.means_dn)), key=lambda n: -len(found.means_dn[n]))[:_SERIES]
    for position, n in enumerate(order):
        color, marker, line = line_style(position)
        means = found.means_dn[n]
        axes.plot(np.arange(1, len(means) + 1), means, line, color=color, marker=marker, markersize=3.5, linewidth=1.0)
    noise = COVERAGE_95 * found.noise_dn[order[0]]
    axes.axhspan(-noise, noise, color=GRAY, alpha=0.25, linewidth=0, zorder=0)
    axes.axhline(0.0, color=BLACK, linewidth=0.8)
    axes.set(xlabel="frame of the series", ylabel="mean less that of the series (DN)")
    return figure
