"""Quantum efficiency as measured, with its 95 % intervals."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from photosite.calibration.spectral.result import SpectralCalibration
from photosite.report.style import BLACK, GRAY, channel_style, new_figure, styled
from photosite.sensor.model import Sensor


@styled()
def quantum_efficiency_figure(calibration: SpectralCalibration, beside: Sensor | None = None) -> Figure:
    """Quantum efficiency of each channel, one panel each, with its 95 % interval.

    Parameters
    ----------
    calibration
        From bands of light (its values are points) or from a chart (a line).
    beside
        A sensor whose quantum efficiencies are drawn as thin black lines: the truth of a virtual one.

    Returns
    -------
    matplotlib.figure.Figure
    """
    names = list(calibration.channels)
    figure, first = new_figure(height_in=1.6 + 1.6 * len(names))
    first.remove()
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for position, (axes, name) in enumerate(zip(panels, names, strict=True)):
        channel = calibration.channels[name]
        color, marker, _ = channel_style(name, position)
        nm, percent = channel.wavelength_nm, 100.0 * channel.quantum_efficiency
        low, high = (100.0 * end for end in channel.interval_95)
        if calibration.bands:
            axes.errorbar(
                nm, percent, [percent - low, high - percent], color=color, fmt=marker, markersize=4, capsize=2
            )
        else:
            axes.fill_between(nm, low, high, color=color, alpha=0.25, linewidth=0)
            axes.plot(nm, percent, color=color)
        if beside is not None and name in beside.channels:
            known = beside.channels[name]
            inside = np.linspace(nm[0], nm[-1], 801)
            axes.plot(inside, 100.0 * known.quantum_efficiency_at(inside), color=BLACK, linewidth=0.8)
        axes.axhline(0.0, color=GRAY, linewidth=0.8)
        axes.set_ylabel(f"{name}: quantum\nefficiency (%)")
    panels[-1].set_xlabel("wavelength (nm)")
    shown = "value" if calibration.bands else "posterior mean"
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=GRAY, marker="o" if calibration.bands else "", linestyle="" if calibration.bands else "-")
    ]
    handles.append(Line2D([], [], color=GRAY) if calibration.bands else Patch(color=GRAY, alpha=0.25, linewidth=0))
    labels = [shown, "95 % interval"]
    if beside is not None:
        handles.append(Line2D([], [], color=BLACK, linewidth=0.8))
        labels.append(beside.name)
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure
