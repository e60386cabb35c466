"""A chart as a sensor sees it, and its patches on the sensor's noise budget: one result at a glance."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.metrics.snr import noise_budget
from photosite.report.style import BLACK, GRAY, channel_style, styled
from photosite.sensor.model import Sensor

_PARTS = (("shot noise", "shot_db", "--"), ("read noise", "read_db", "-."), ("DSNU", "dsnu_db", ":"))
_PART_OF_PRNU = ("PRNU", "prnu_db", (0, (6, 1.5)))


@styled()
def overview_figure(picture: NDArray[np.float32], patches: PatchStatistics, sensor: Sensor) -> Figure:
    """A developed chart beside the signal-to-noise ratios of its patches on the raw mosaic.

    Parameters
    ----------
    picture
        (rows, cols, 3), display sRGB.
    patches
        Of the same frame; saturated ones are left out.
    sensor
        Whose noise budget is drawn behind them.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = Figure(figsize=(10.4, 3.9))
    left, right = figure.subplots(1, 2, width_ratios=(1.12, 1.0))
    left.imshow(picture, interpolation="none")
    left.set_axis_off()
    left.set_title(f"ColorChecker, tungsten, simulated with the {sensor.name}", loc="left")
    _draw_budget(right, sensor)
    volts = patches.mean_dn * sensor.mv_per_dn * 1e-3
    for position, channel in enumerate(patches.channels):
        shown = ~patches.saturated[:, position] & np.isfinite(patches.spatial_snr_db[:, position])
        color, marker, _ = channel_style(channel, position)
        snr_db = patches.spatial_snr_db[shown, position]
        right.plot(volts[shown, position], snr_db, marker, color=color, label=f"patches, {channel}", alpha=0.9)
    right.set(xscale="log", xlabel="signal at the pixel (V)", ylabel="signal-to-noise ratio (dB)")
    right.set_title("24 patches of the raw frame on the noise budget", loc="left")
    right.legend(loc="lower right", ncols=2)
    return figure


def _draw_budget(axes: Axes, sensor: Sensor) -> None:
    swing = sensor.pixel.voltage_swing_v.value
    budget = noise_budget(sensor, np.geomspace(5e-3 * swing, swing, 200))
    axes.plot(budget.volts, budget.total_db, color=BLACK, linewidth=2.0, label="total")
    for name, attribute, line in (*_PARTS, _PART_OF_PRNU):
        level = getattr(budget, attribute)
        if np.isfinite(level).all():
            axes.plot(budget.volts, level, color=GRAY, linestyle=line, linewidth=1.1, label=name)
    axes.set_ylim(float(budget.total_db.min()) - 4.0, float(budget.total_db.max()) + 12.0)
