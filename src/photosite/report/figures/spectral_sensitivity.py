"""Quantum efficiency against wavelength."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from photosite.report.style import channel_style, new_figure, styled
from photosite.sensor.model import Sensor
from photosite.values.measured import COVERAGE_95


@styled()
def spectral_sensitivity_figure(sensor: Sensor) -> Figure:
    """Quantum efficiency of each channel, with its 95 % band where an uncertainty is known.

    Parameters
    ----------
    sensor
        Whose channels; a channel known at one wavelength only is drawn as a point.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(height_in=3.8)
    draw_spectral_sensitivity(axes, sensor)
    axes.legend(title="channel", loc="upper right")
    return figure


def draw_spectral_sensitivity(axes: Axes, sensor: Sensor) -> None:
    """The same on given axes, without a legend."""
    for position, name in enumerate(sensor.channel_names):
        channel = sensor.channels[name]
        color, marker, line = channel_style(name, position)
        wavelength, percent = np.array(channel.wavelength_nm), 100.0 * np.array(channel.quantum_efficiency)
        single = wavelength.size == 1
        axes.plot(
            wavelength, percent, color=color, linestyle="" if single else line, marker=marker, markersize=4, label=name
        )
        if channel.standard_uncertainty is not None:
            half = 100.0 * COVERAGE_95 * np.array(channel.standard_uncertainty)
            if single:
                axes.errorbar(wavelength, percent, half, color=color, capsize=3)
            else:
                axes.fill_between(wavelength, percent - half, percent + half, color=color, alpha=0.2, linewidth=0)
    axes.set(xlabel="wavelength (nm)", ylabel="quantum efficiency (%)")
    axes.set_ylim(bottom=0.0)
