"""Figure of a gain series: read noise in electrons with its two parts, and system gain, against the gain setting."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from photosite.calibration.gain_series.result import GainMode, GainSeries
from photosite.calibration.gain_series.series_statistics import log_amplification
from photosite.report.style import BLACK, BLUE, GRAY, ORANGE, SKY, VERMILION, label_log_ticks, styled, two_panels

_POINTS = 200
_MARKERS = ("o", "s")
_BOTH, _BEFORE, _AFTER = "sum of both parts", "before the amplifier", "after the amplifier"
_ORDER = ("measured", "low conversion gain", "high conversion gain", _BOTH, _BEFORE, _AFTER)


@styled()
def gain_series_figure(series: GainSeries) -> Figure:
    """Draw read noise referred to the input, its parts before and after the amplifier, and system gain, by setting.

    Points with 95 % intervals. Lines are the two-part model, and gains proportional to the nominal settings. The shaded
    band marks the conversion-gain switch.
    """
    figure, noise, gain = two_panels(6.4, upper_height=1.4)
    for number, mode in enumerate(series.modes):
        _draw_mode(noise, gain, series, mode, number)
    if series.switch is not None:
        for axes in (noise, gain):
            axes.axvspan(*series.switch.between_95, color=SKY, alpha=0.15, linewidth=0)
            axes.axvspan(*series.switch.between, color=SKY, alpha=0.15, linewidth=0)
    settings = np.array(series.settings)
    if series.scale == "proportional":
        noise.set_xscale("log")
        gain.xaxis.set_major_locator(FixedLocator(settings.tolist()))
        gain.xaxis.set_minor_locator(NullLocator())
        gain.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    for axes in (noise, gain):
        axes.set_yscale("log")
        label_log_ticks(axes.yaxis)
    noise.set_ylim(bottom=_bottom(series))
    noise.set_ylabel("read noise (e⁻)")
    gain.set_ylabel("system gain K (DN/e⁻)")
    gain.axhline(1.0, color=GRAY, linewidth=0.8, linestyle=":")
    gain.set_xlabel("gain setting" if series.scale == "proportional" else f"gain setting ({series.scale})")
    unique = dict(zip(*reversed(noise.get_legend_handles_labels()), strict=True))
    shown = [label for label in _ORDER if label in unique]
    figure.legend([unique[label] for label in shown], shown, loc="outside upper center", ncols=min(len(shown), 3))
    figure.align_ylabels([noise, gain])
    return figure


def _bottom(series: GainSeries) -> float:
    """Return the lower limit of the axis: a third of the smallest read noise."""
    values = [step.calibration.read_noise_e.value or 0.0 for step in series.steps]
    return 0.3 * min((value for value in values if value > 0.0), default=1.0)


def _draw_mode(noise: Axes, gain: Axes, series: GainSeries, mode: GainMode, number: int) -> None:
    steps = [step for step in series.steps if step.setting in mode.settings]
    x = np.array([step.setting for step in steps])
    marker = _MARKERS[number % len(_MARKERS)]
    label = _ORDER[1 + number] if len(series.modes) == 2 else _ORDER[0]
    for axes, parameter in ((noise, "read_noise_e"), (gain, "system_gain_dn_per_e")):
        entries = [getattr(step.calibration, parameter) for step in steps]
        known = [(s, e) for s, e in zip(x, entries, strict=True) if e.value is not None and e.value > 0]
        y = np.array([e.value for _, e in known])
        ends = np.array([e.interval_95 for _, e in known]).reshape(-1, 2)
        bars = np.clip(np.stack([y - ends[:, 0], ends[:, 1] - y]), 0.0, None)
        axes.errorbar([s for s, _ in known], y, bars, fmt=marker, color=BLACK, elinewidth=0.9, label=label, zorder=3)
    level = np.array(
        [np.log(step.calibration.system_gain_dn_per_e.value or np.nan) for step in steps], dtype=np.float64
    ) - log_amplification(x, series.scale)
    line_x = _along(x, series)
    k = np.exp(np.nanmean(level) + log_amplification(line_x, series.scale))
    gain.plot(line_x, k, color=BLUE, linewidth=1.3, zorder=2)
    _draw_parts(noise, mode, line_x, k)


def _along(x: NDArray[np.float64], series: GainSeries) -> NDArray[np.float64]:
    ends = float(x.min()), float(x.max())
    return np.geomspace(*ends, _POINTS) if series.scale == "proportional" else np.linspace(*ends, _POINTS)


def _draw_parts(axes: Axes, mode: GainMode, x: NDArray[np.float64], k: NDArray[np.float64]) -> None:
    whole = mode.read_noise_dn(k)
    if whole is None:
        return
    axes.plot(x, whole / k, color=BLUE, linewidth=1.5, label=_BOTH, zorder=2)
    pre, post = mode.pre_amplifier_noise_e, mode.post_amplifier_noise_dn
    for entry, scale, color, line, label in (
        (pre, np.ones_like(k), VERMILION, "--", _BEFORE),
        (post, 1.0 / k, ORANGE, "-.", _AFTER),
    ):
        if entry.value is None or entry.interval_95 is None:
            continue
        low, high = (np.maximum(end, 0.0) * scale for end in entry.interval_95)
        axes.fill_between(x, low, high, color=color, alpha=0.18, linewidth=0)
        if entry.value > 0:
            axes.plot(x, entry.value * scale, color=color, linestyle=line, linewidth=1.3, label=label)
