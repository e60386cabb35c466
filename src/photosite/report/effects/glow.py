"""Amplifier glow in the report: the map of the dark current with the fitted glow."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.effects.glow import GlowMap
from photosite.calibration.result import Calibration
from photosite.report.effect import EffectFigure
from photosite.report.page import Block, Subheading, figure_block, reason_block
from photosite.report.style import WIDTH_IN, styled
from photosite.report.tables import estimates_table
from photosite.sensor.effects.glow import Glow


def _blocks(calibration: Calibration) -> tuple[Block, ...]:
    """Return the map of the dark current and the glow in it; nothing without a map."""
    if (found := calibration.glow) is None:
        return ()
    heading = Subheading("Amplifier glow")
    if not found.places:
        return heading, reason_block(found.peak_dn_per_s.reason or "none was found")
    figure = figure_block(
        glow_figure(found),
        "Map of the dark current with contours of the fitted glow",
        "Dark current in blocks of the chip, without hot pixels. Contours: where the fitted glow of a place has fallen "
        "to 1/e, 1/e² and 1/e³ of its peak.",
    )
    if found.peak_dn_per_s.value is None:
        return heading, figure, reason_block(found.peak_dn_per_s.reason or "it could not be fitted")
    entries = {
        ("Glow at its place", "DN/s"): found.peak_dn_per_s,
        ("Glow at its place", "e⁻/s"): found.peak_e_per_s,
        ("Distance at which it has fallen to 1/e", "pixels"): found.decay_pixels,
    }
    where = ", ".join(place.replace("_", " ") for place in found.places)
    return heading, figure, estimates_table(f"Amplifier glow: {where}", entries)


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


FIGURE = EffectFigure("Dark current", 30, _blocks)
