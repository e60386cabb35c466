"""What limits the signal-to-noise ratio at each level of the signal: the 2008 paper's Figure 6."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.metrics.snr import NoiseBudget, noise_budget
from photosite.report.style import BLACK, BLUE, GRAY, GREEN, ORANGE, VERMILION, new_figure, styled
from photosite.sensor.model import Sensor

_PARTS = (
    ("total", "total_db", BLACK, "-"),
    ("shot noise", "shot_db", BLUE, "--"),
    ("read noise", "read_db", VERMILION, "-."),
    ("DSNU", "dsnu_db", GREEN, ":"),
    ("PRNU", "prnu_db", ORANGE, (0, (6, 1.5))),
)

_ROOM_FOR_TEXT = 3.5
"""Factor of the signal that the width of a short text takes on the logarithmic axis."""


@styled()
def noise_budget_figure(sensor: Sensor, calibrated: Sensor | None = None, points: int = 300) -> Figure:
    """Signal-to-noise ratio against the signal, whole and by cause.

    Parameters
    ----------
    sensor
        Whose noise; lines.
    calibrated
        The same sensor as calibrated; a row of points on each line's place.
    points
        Points of each line.

    Returns
    -------
    matplotlib.figure.Figure
        From 0.05 % of the voltage swing to all of it. A noise that the sensor does not have has no line.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), Figure 6.
    """
    figure, axes = new_figure(height_in=4.8)
    swing = sensor.pixel.voltage_swing_v.value
    lowest = 5e-4 * swing
    budget = noise_budget(sensor, np.geomspace(lowest, swing, points))
    draw_noise_budget(axes, budget)
    _mark_turns(axes, budget, lowest, swing, axes.get_ylim()[0])
    if calibrated is not None:
        _draw_calibrated(axes, noise_budget(calibrated, np.geomspace(lowest, swing, 17)))
    axes.legend(loc="upper left", ncols=2)
    return figure


def draw_noise_budget(axes: Axes, budget: NoiseBudget) -> None:
    """Draw the curves of a noise budget.

    Parameters
    ----------
    axes
        Theirs alone; its limits and labels are set.
    budget
        Over increasing volts.
    """
    lowest, highest = float(budget.volts[0]), float(budget.volts[-1])
    for name, attribute, color, line in _PARTS:
        level, width = getattr(budget, attribute), 2.2 if name == "total" else 1.5
        if np.isfinite(level).all():
            axes.plot(budget.volts, level, linestyle=line, color=color, label=name, linewidth=width)
    axes.set(xscale="log", xlabel="signal at the pixel (V)", ylabel="signal-to-noise ratio (dB)")
    axes.set_xlim(0.9 * lowest, 1.1 * highest)
    axes.set_ylim(bottom=min(0.0, float(budget.total_db.min()) - 3.0))


def _draw_calibrated(axes: Axes, budget: NoiseBudget) -> None:
    labelled = False
    for _, attribute, color, _ in _PARTS:
        level = getattr(budget, attribute)
        if np.isfinite(level).all():
            label = None if labelled else "as calibrated"
            axes.plot(budget.volts, level, "o", color=color, markerfacecolor="white", markersize=4.5, label=label)
            labelled = True


def _mark_turns(axes: Axes, budget: NoiseBudget, lowest: float, highest: float, bottom: float) -> None:
    """The signals at which another noise takes the lead."""
    floor, prnu = budget.dark_limited_below_volts, budget.prnu_limited_above_volts
    if lowest < floor < highest:
        _mark(axes, floor, "← read noise + DSNU lead", (-5, 6), bottom)
    if lowest < prnu < highest:
        # Near the right border there is room on the left only, above the other text.
        near = prnu > highest / _ROOM_FOR_TEXT
        _mark(axes, prnu, "PRNU leads →", (-5, 22) if near else (5, 6), bottom)


def _mark(axes: Axes, volts: float, text: str, offset: tuple[int, int], bottom: float) -> None:
    axes.axvline(volts, color=GRAY, linewidth=0.8, linestyle=(0, (2, 2)))
    side = "right" if offset[0] < 0 else "left"
    axes.annotate(text, (volts, bottom), xytext=offset, textcoords="offset points", ha=side, color=GRAY, fontsize=9)
