"""Figures of a sensor: noise budget and quantum efficiency."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from photosite.calibration.spectral.result import SpectralCalibration
from photosite.metrics.snr import NoiseBudget, noise_budget
from photosite.report.style import BLACK, BLUE, GRAY, GREEN, ORANGE, VERMILION, channel_style, new_figure, styled
from photosite.sensor.combined_noise import CombinedNoise
from photosite.sensor.model import Sensor
from photosite.values.uncertain import COVERAGE_95

_PARTS = (
    ("total", "total_db", BLACK, "-"),
    ("shot noise", "shot_db", BLUE, "--"),
    ("read noise", "read_db", VERMILION, "-."),
    ("DSNU", "dsnu_db", GREEN, ":"),
    ("PRNU", "prnu_db", ORANGE, (0, (6, 1.5))),
)

_ROOM_FOR_TEXT = 6.0  # factor of the signal that a short text covers on the logarithmic axis


@styled()
def noise_budget_figure(sensor: Sensor, calibrated: Sensor | None = None) -> Figure:
    """Draw the SNR against the signal from 0.05 to 100 % of the voltage swing, in total and for each noise source.

    Of several captures it is the combined frame up to its saturation; dotted lines mark where the captures switch.
    Noise sources that the sensor does not have are omitted. The same sensor as calibrated is drawn as points.

    References
    ----------
    Farrell, Okincha and Parmar (2008), Figure 6.
    """
    figure, axes = new_figure(height_in=4.8)
    swing = sensor.pixel.voltage_swing_v.value
    lowest = 5e-4 * swing
    if sensor.captures is not None:
        swing = CombinedNoise(sensor).light_capacity_e * sensor.pixel.conversion_gain_uv_per_e.value * 1e-6
    budget = noise_budget(sensor, np.geomspace(lowest, swing, 300))
    draw_noise_budget(axes, budget)
    _mark_turns(axes, budget, lowest, swing, axes.get_ylim()[0])
    if calibrated is not None:
        _draw_calibrated(axes, noise_budget(calibrated, np.geomspace(lowest, swing, 17)))
    axes.legend(loc="upper left", ncols=2)
    return figure


def draw_noise_budget(axes: Axes, budget: NoiseBudget) -> None:
    """Draw the curves of a noise budget over increasing voltages, and set limits and labels of the axes."""
    lowest, highest = float(budget.volts[0]), float(budget.volts[-1])
    for name, attribute, color, line in _PARTS:
        level, width = getattr(budget, attribute), 2.2 if name == "total" else 1.5
        if np.isfinite(level).all():
            axes.plot(budget.volts, level, linestyle=line, color=color, label=name, linewidth=width)
    for step in budget.transitions:
        volts = step.light_e * lowest / float(budget.signal_e[0])
        axes.axvline(volts, color=GRAY, linewidth=0.8, linestyle=":")
        if lowest < volts < highest:
            text = f" {step.below}"
            axes.annotate(text, (volts, step.after_db), color=GRAY, fontsize=9)
    axes.set(xscale="log", xlabel="signal at the pixel (V)", ylabel="signal-to-noise ratio (dB)")
    axes.set_xlim(0.9 * lowest, 1.1 * highest)
    axes.set_ylim(bottom=min(0.0, float(budget.total_db.min()) - 3.0))


def _draw_calibrated(axes: Axes, budget: NoiseBudget) -> None:
    label: str | None = "as calibrated"
    for _, attribute, color, _ in _PARTS:
        level = getattr(budget, attribute)
        if np.isfinite(level).all():
            axes.plot(budget.volts, level, "o", color=color, markerfacecolor="white", markersize=4.5, label=label)
            label = None


def _mark_turns(axes: Axes, budget: NoiseBudget, lowest: float, highest: float, bottom: float) -> None:
    """Mark the signals at which another noise source dominates."""
    floor, prnu = budget.dark_limited_below_volts, budget.prnu_limited_above_volts
    if lowest < floor < highest:
        _mark(axes, floor, "← read noise + DSNU dominate", (-5, 6), bottom)
    if lowest < prnu < highest:
        # Near the right border, write to the left of the line and above the other text.
        near = prnu > highest / _ROOM_FOR_TEXT
        _mark(axes, prnu, "PRNU dominates →", (-5, 22) if near else (5, 6), bottom)


def _mark(axes: Axes, volts: float, text: str, offset: tuple[int, int], bottom: float) -> None:
    axes.axvline(volts, color=GRAY, linewidth=0.8, linestyle=(0, (2, 2)))
    side = "right" if offset[0] < 0 else "left"
    axes.annotate(text, (volts, bottom), xytext=offset, textcoords="offset points", ha=side, color=GRAY, fontsize=9)


@styled()
def spectral_sensitivity_figure(sensor: Sensor) -> Figure:
    """Draw the quantum efficiency of each channel, with its 95 % band if the uncertainty is known.

    A channel known at one wavelength only is drawn as a point.
    """
    figure, axes = new_figure(height_in=3.8)
    draw_spectral_sensitivity(axes, sensor)
    axes.legend(title="channel", loc="upper right")
    return figure


def draw_spectral_sensitivity(axes: Axes, sensor: Sensor) -> None:
    """Draw the quantum efficiencies on given axes, without a legend."""
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


@styled()
def quantum_efficiency_figure(calibration: SpectralCalibration, beside: Sensor | None = None) -> Figure:
    """Draw the measured quantum efficiency of each channel with its 95 % interval, one panel each.

    Parameters
    ----------
    calibration
        Result from bands of light (drawn as points) or from a chart (drawn as a line).
    beside
        Sensor whose quantum efficiencies are drawn as thin black lines, such as the true ones of a virtual sensor.
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
