"""Figure of measured polarizers: the signal of each channel against the angle of the light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from photosite.calibration.light.polarizers import Polarizer
from photosite.frames.raw_frame import RawFrame
from photosite.report.style import line_style, new_figure, styled
from photosite.values.cfa import channel_mask


@styled()
def polarizers_figure(
    flats: Mapping[float, Sequence[RawFrame]], darks: Sequence[RawFrame], found: Mapping[str, Polarizer]
) -> Figure:
    """Draw each channel's mean signal over that of unpolarized light, against the angle of the light, and the fit."""
    figure, axes = new_figure(3.8)
    angles = np.array(sorted(flats))
    fine = np.linspace(0.0, 180.0, 181)
    for position, (name, one) in enumerate(found.items()):
        color, marker, line = line_style(position)
        d = (1.0 - one.leakage.value) / (1.0 + one.leakage.value)
        signal = np.array([_mean(flats[angle], name) - _dark(darks, flats[angle][0], name) for angle in angles])
        shape = 1.0 + d * np.cos(2.0 * np.radians(angles - one.angle_deg.value))
        level = float(signal @ shape / (shape @ shape))
        axes.plot(angles % 180.0, signal / level, marker, color=color)
        fitted = 1.0 + d * np.cos(2.0 * np.radians(fine - one.angle_deg.value))
        axes.plot(fine, fitted, line, color=color, label=f"{name}: {one.angle_deg.value:.2f}°")
    axes.set(xlabel="angle of the light (degrees)", ylabel="signal over that of unpolarized light", xlim=(0.0, 180.0))
    figure.legend(loc="outside upper right", ncols=len(found))
    return figure


def _mean(frames: Sequence[RawFrame], name: str) -> float:
    mask = channel_mask(frames[0].cfa, name, frames[0].shape)
    return float(np.mean([frame.dn[mask].mean() for frame in frames]))


def _dark(darks: Sequence[RawFrame], frame: RawFrame, name: str) -> float:
    return _mean(darks, name) if darks else frame.black_level_dn
