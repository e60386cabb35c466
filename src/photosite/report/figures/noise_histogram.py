"""How the readings in the dark are distributed about their pixels' means, tails and all."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from photosite.calibration.chip_maps.noise_shape import tukey_density, tukey_reach
from photosite.calibration.chip_maps.temporal_noise import TemporalNoise
from photosite.report.style import BLACK, BLUE, ORANGE, new_figure, styled

_PER_POINT = 2
"""Bins of the histogram that make a point."""

_NORMAL_QUARTILE = 0.6744897501960817


@styled()
def noise_histogram_figure(noise: TemporalNoise) -> Figure:
    """The histogram of all readings about their pixels' means, with the normal and the Tukey lambda distribution.

    Parameters
    ----------
    noise
        What a calibration with maps found.

    Returns
    -------
    matplotlib.figure.Figure
        Density against digital numbers, logarithmic: a tail heavier than normal leaves the dashed line. The normal
        distribution is that of the histogram's quartiles; the Tukey lambda one has its shape and standard deviation,
        and is drawn where its shape can be told from a normal one's. Where it ends, its label says how many readings
        lie beyond.
    """
    figure, axes = new_figure()
    bins = len(noise.residual_count) // _PER_POINT * _PER_POINT
    count = noise.residual_count[:bins].reshape(-1, _PER_POINT).sum(axis=1)
    x = noise.residual_dn[:bins].reshape(-1, _PER_POINT).mean(axis=1)
    width, total = float(x[1] - x[0]), float(count.sum())
    there = count > 0
    density = count[there] / (total * width)
    bars = np.minimum(np.sqrt(count[there]), 0.999 * count[there]) / (total * width)
    low, high = _quantiles(noise, np.array([0.25, 0.75]))
    sigma = (high - low) / (2 * _NORMAL_QUARTILE)
    normal = np.linspace(x[there][0], x[there][-1], 600)
    axes.errorbar(
        x[there], density, bars, fmt="o", color=BLUE, markersize=3.2, elinewidth=0.8, label="readings", zorder=2
    )
    axes.plot(
        normal,
        np.exp(-0.5 * (normal / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)),
        color=BLACK,
        linestyle="--",
        label=f"normal, {sigma:.3g} DN by the quartiles",
        zorder=3,
    )
    if noise.shape.tukey_lambda.value is not None and not noise.shape.shape_is_normal:
        _draw_tukey(axes, noise.shape.tukey_lambda.value, x, count)
    axes.set_yscale("log")
    axes.set_ylim(0.4 / (total * width), 3.0 * float(density.max()))
    reach = 1.05 * max(-x[there][0], x[there][-1], 5 * sigma)
    axes.set_xlim(-reach, reach)
    axes.set_xlabel("reading less its pixel's mean (DN)")
    axes.set_ylabel("density (1/DN)")
    axes.legend(loc="lower center")
    return figure


def _draw_tukey(axes: Axes, shape: float, x: NDArray[np.float64], count: NDArray[np.int64]) -> None:
    """The Tukey lambda distribution of the readings' standard deviation; above a shape of 0 it has an end."""
    spread = float(np.sqrt(count @ x**2 / count.sum()))
    reach = tukey_reach(shape, spread)
    label = f"Tukey lambda, shape {shape:.3f}".replace("-", "−")
    if (beyond := int(count[np.abs(x) > reach].sum())) > 0:
        label += f": ends at ±{reach:.3g} DN, {beyond} readings beyond"
        for end in (-reach, reach):
            axes.axvline(end, color=ORANGE, linestyle=":", linewidth=0.9, zorder=1)
    axes.plot(*tukey_density(shape, spread), color=ORANGE, label=label, zorder=4)


def _quantiles(noise: TemporalNoise, p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quantiles of the histogram, linear within a bin."""
    width = noise.residual_dn[1] - noise.residual_dn[0]
    below = np.cumsum(noise.residual_count) / noise.residual_count.sum()
    return np.asarray(np.interp(p, below, noise.residual_dn + width / 2))
