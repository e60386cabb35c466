"""The arithmetic of ISO 12233:2023's edge-based response, step by step, for comparison with other implementations.

`slanted_edge_mtf` is less sensitive to noise and to bins that are not filled evenly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from photosite.errors import InputError

Array = NDArray[np.float64]

_BINS = 4
"""Bins per pixel."""
_PEDESTAL = 0.05
"""Of the windows with which centroids are found."""
_MOST_CORRECTION = 10.0


def edge_sfr(values: Array, order: int = 5) -> tuple[Array, Array]:
    """Return frequencies in cycles/pixel and the spatial frequency response of an edge.

    Parameters
    ----------
    values
        (rows, cols) proportional to light, with an edge closer to the vertical or the horizontal.
    order
        Order of the polynomial of the edge, 1 to 5.

    Raises
    ------
    InputError
        If there is no edge.

    Notes
    -----
    ISO 12233:2023, as the public implementation sfrmat5 (P. Burns) has it: centroids of the lines' differences under a
    Tukey window, found twice; a polynomial through them; bins of a quarter pixel along the line; differences over two
    bins under a centered Tukey window; the transform, corrected for the differences.
    """
    if abs(values[2].mean() - values[-4].mean()) > abs(values[:, 2].mean() - values[:, -4].mean()):
        values = np.rot90(values)
    lines, width = values.shape
    sign = 1.0 if values[:, :5].mean() < values[:, -6:].mean() else -1.0
    steps = _differences(values, sign * np.array([0.5, -0.5]))
    y = np.arange(lines)
    places = _centroids(steps, np.full(lines, (width + 1) / 2))
    places = _centroids(steps, Polynomial.fit(y, places, order)(y))
    edge = Polynomial.fit(y, places, order)
    slope = float(Polynomial.fit(y, places, 1).convert().coef[1])
    used = round(math.floor(lines * abs(slope)) / abs(slope)) if slope else 0
    if not np.isfinite(places).all() or not 0 < used <= lines:
        raise InputError("edge", expected="one edge that crosses whole columns", hint="Turn the chart by a few degrees")
    profile = _profile(values[:used], edge(y[:used]) - edge(0.0), float(edge.convert().coef[1]))
    line_spread = _centered(_differences(profile, sign * np.array([0.5, 0.0, -0.5])))
    line_spread *= _tukey(line_spread.size, line_spread.size / 2)
    half = line_spread.size // 2 + 1
    spectrum = np.abs(np.fft.fft(line_spread))[:half]
    # The correction of the differences, of which sfrmat5's is one frequency step ahead.
    phase = math.pi * (np.arange(1, half) + 1) / (half + 1)
    correction = np.minimum(np.abs(phase / np.sin(phase)), _MOST_CORRECTION)
    frequency = np.arange(half) * _BINS / (line_spread.size * math.cos(math.atan(slope)))
    shown = slice(0, round(half / 2))
    return frequency[shown], (spectrum / spectrum[0] * np.concatenate([[1.0], correction]))[shown]


def _differences(values: Array, kernel: Array) -> Array:
    """Return convolutions along the last axis of the same size; the outermost values are repeated."""
    first = kernel.size // 2
    found = np.apply_along_axis(lambda row: np.convolve(row, kernel)[first : first + row.size], -1, values)
    found[..., 0], found[..., -1] = found[..., 1], found[..., -2]
    return found


def _centroids(steps: Array, middle: Array) -> Array:
    """Return the centroid of each line under a window around its middle."""
    width = steps.shape[1]
    windows = np.array([(1.0 - _PEDESTAL) * _tukey(width, place) + _PEDESTAL for place in middle])
    weighted = steps * windows
    return np.asarray(weighted @ np.arange(1, width + 1) / weighted.sum(axis=1) - 0.5)


def _tukey(size: int, middle: float) -> Array:
    """Return a Tukey window without a flat part, centered on a position."""
    whole = round(2 * max(middle, size - middle))
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(whole) / (whole - 1))
    return window[:size] if middle >= size / 2 else window[whole - size :]


def _profile(values: Array, shift: Array, slope: float) -> Array:
    """Return means in bins along the edge; empty bins are interpolated."""
    lines, width = values.shape
    offset = round(-_BINS * (lines - 1) * slope)
    bins = np.ceil((np.arange(width) - shift[:, None]) * _BINS).astype(np.intp) - min(offset, 0)
    size = max(int(bins.max()) + 1, _BINS * width + abs(offset) + 1)
    inside = bins >= 0
    count = np.bincount(bins[inside], minlength=size)
    total = np.bincount(bins[inside], values[inside], size)
    first = round(0.5 * abs(offset))
    chosen = np.arange(first, first + _BINS * width)
    filled = np.flatnonzero(count)
    return np.interp(chosen, filled, total[filled] / count[filled])


def _centered(line_spread: Array) -> Array:
    """Return the values with their maximum in the middle and zeros at the end that is left."""
    size = line_spread.size
    at = float(np.flatnonzero(line_spread == line_spread.max()).mean()) + 1.0
    move = round(at - round((size + 1) / 2))
    moved = np.zeros(size)
    if move >= 0:
        moved[: size - move] = line_spread[move:]
    else:
        moved[-move:] = line_spread[:move]
    return moved
