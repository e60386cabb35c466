"""Figures of several captures of one exposure: photon transfer with its knees, and signal-to-noise ratios."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from photosite.calibration.captures.combined import CombinedCalibration
from photosite.calibration.captures.each_capture import CaptureCalibration
from photosite.calibration.result import Calibration
from photosite.report.style import GRAY, line_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SNR = "signal-to-noise ratio (dB)"


def draw_knees(axes: Axes, found: CombinedCalibration) -> None:
    """Draw the photon transfer curve of combined frames, by capture, with the lines of the captures and the knees."""
    shown = (found.signal_dn > 0.0) & (found.variance_dn2 > 0.0)
    for number in range(-1, len(found.captures)):
        points = shown & (found.piece == number)
        if not points.any():
            continue
        x, y = found.signal_dn[points], found.variance_dn2[points]
        color = GRAY if number < 0 else line_style(number)[0]
        label = "in a transition, or saturated" if number < 0 else f"capture {number + 1}"
        bars = 1.96 * found.variance_uncertainty_dn2[points]
        axes.errorbar(x, y, yerr=bars, fmt="o", markersize=4.0, color=color, label=label, linewidth=1.0)
        if number >= 0:
            gain = found.captures[number].output_gain_dn_per_e.value or 0.0
            constant = float(np.median(y - gain * x)) if number == 0 else max(float(np.median(y - gain * x)), 0.0)
            line = np.geomspace(x.min(), x.max(), 50)
            axes.plot(line, np.maximum(constant, 0.0) + gain * line, color=color, linewidth=1.0)
    _draw_knees(axes, found)
    axes.set(xscale="log", yscale="log")
    axes.set(xlabel="linear output above black (DN)", ylabel="temporal variance (DN²)")


def draw_combined_snr(axes: Axes, found: CombinedCalibration) -> None:
    """Draw the temporal signal-to-noise ratio of combined frames against the output, by capture, with the knees."""
    shown = (found.signal_dn > 0.0) & (found.variance_dn2 > 0.0)
    for number in range(len(found.captures)):
        points = shown & (found.piece == number)
        if points.any():
            x, y = found.signal_dn[points], found.variance_dn2[points]
            axes.plot(
                x,
                10.0 * np.log10(x**2 / y),
                "o-",
                markersize=4.0,
                color=line_style(number)[0],
                label=f"capture {number + 1}",
            )
    _draw_knees(axes, found)
    axes.set(xscale="log", xlabel="linear output above black (DN)", ylabel=_SNR)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[1]))


def _draw_knees(axes: Axes, found: CombinedCalibration) -> None:
    for number, knee in enumerate(found.knees):
        if knee.signal_dn.interval_95 is not None:
            axes.axvspan(*knee.signal_dn.interval_95, color=GRAY, alpha=0.2, label=None if number else "knee")


def draw_captures_snr(axes: Axes, found: CaptureCalibration) -> None:
    """Draw the signal-to-noise ratio of each calibrated capture against the light, up to its highest signal.

    S^2 / N with N the shot noise, (read noise)^2, DSNU^2 and (PRNU S)^2; captures without a gain are left out.
    """
    for number, (name, calibration) in enumerate(found.captures.items()):
        ratio = found.sensitivity_ratio[name].value if name in found.sensitivity_ratio else 1.0
        top, read = _highest_e(calibration), calibration.read_noise_e.value
        if top is None or read is None or not ratio:
            continue
        signal = np.geomspace(max(abs(read), 1e-3) / 3.0, top, 200)
        dsnu, prnu = calibration.dsnu_e.value or 0.0, (calibration.prnu_percent.value or 0.0) / 100.0
        variance = signal + read**2 + dsnu**2 + (prnu * signal) ** 2
        color, _, style = line_style(number)
        axes.plot(signal / ratio, 10.0 * np.log10(signal**2 / variance), color=color, linestyle=style, label=name)
    axes.set(xscale="log", xlabel="light (electrons of the first capture)", ylabel=_SNR)
    axes.set_ylim(bottom=0.0)


def _highest_e(calibration: Calibration) -> float | None:
    """Return the electrons at saturation, or at the brightest level where it was not reached."""
    top, gain = calibration.saturation_capacity_e.value, calibration.system_gain_dn_per_e.value
    levels = [float(curves["response"].y.max()) for curves in calibration.curves.values() if "response" in curves]
    return top if top is not None or not levels or gain is None else max(levels) / gain
