"""The characteristic curve and the signal-to-noise ratio of the input, where nothing is assumed of the camera."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from photosite.calibration.photon_transfer.general_model import GeneralModel
from photosite.report.figures.marks import draw_points
from photosite.report.style import GRAY, WIDTH_IN, channel_style, styled
from photosite.values.measured import COVERAGE_95
from photosite.values.uncertain import Uncertain


@styled()
def general_model_figure(channels: Mapping[str, GeneralModel]) -> Figure:
    """The characteristic curve of each channel; below, the signal-to-noise ratio of its input.

    Parameters
    ----------
    channels
        By channel, all against the same abscissa.

    Returns
    -------
    matplotlib.figure.Figure
        Bars are 95 % intervals. Dotted: the threshold, where the ratio is 1, and where it is largest, of one channel.

    Notes
    -----
    EMVA 1288 R4.0 General.
    """
    figure = Figure(figsize=(WIDTH_IN, 5.4))
    upper, lower = figure.subplots(2, 1, sharex=True)
    for position, (channel, found) in enumerate(channels.items()):
        look = channel_style(channel, position)[:2]
        every = np.ones(len(found.x), dtype=np.bool_)
        draw_points(upper, found.x, found.signal_dn, COVERAGE_95 * found.signal_uncertainty, every, look, 4.0)
        there = np.isfinite(found.snr) & (found.x > 0.0)
        half = COVERAGE_95 * found.snr_uncertainty[there]
        draw_points(lower, found.x[there], found.snr[there], half, every[there], look, 4.0)
        for value in (found.threshold, found.saturation) if len(channels) == 1 else ():
            if isinstance(value, Uncertain):
                for axes in (upper, lower):
                    axes.axvline(value.value, color=GRAY, linewidth=0.9, linestyle=":")
    lower.axhline(1.0, color=GRAY, linewidth=0.9, linestyle=":")
    photons = next(iter(channels.values())).abscissa == "photons_per_pixel"
    positive = np.concatenate([found.x[found.x > 0.0] for found in channels.values()])
    lower.set(xscale="log" if positive.max() > 30.0 * positive.min() else "linear", yscale="log")
    lower.set_xlabel("photons per pixel" if photons else "exposure (s)")
    lower.set_ylabel("input's signal-to-noise (1)")
    upper.set_ylabel("signal (DN)")
    figure.align_ylabels([upper, lower])
    if len(channels) > 1:
        looks = [(channel, *channel_style(channel, position)[:2]) for position, channel in enumerate(channels)]
        handles = [Line2D([], [], color=c, marker=m, linestyle="", label=name) for name, c, m in looks]
        figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    return figure
