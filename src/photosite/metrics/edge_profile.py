"""A slanted edge in scattered pixels: the line it follows, and its profile across that line.

Lines of pixels run across the edge: rows for an edge that stands. Coordinates run over borders, pixel i covers i to
i + 1. `photosite.metrics.sharpness` is the face of this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Array = NDArray[np.float64]

LEAST_HALF_WIDTH = 8.0
"""Pixels that the edge needs on each side of it, in every line."""
_LEAST_LINES = 16
_LEAST_CONTRAST = 0.05
"""(bright - dark) / (bright + dark) below which there is no edge to speak of."""
_STRAIGHT_PX = 2.0
"""RMS distance of the lines' edges from a straight one, above which it is none."""
_FIT_STEPS = 8
_FIT_ENOUGH_PX = 1e-5
_SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


@dataclass(frozen=True, eq=False)
class Pixels:
    """One channel's pixels.

    Parameters
    ----------
    y, x, value
        (n,) middles and values, line by line.
    shape
        (lines, columns) of the rectangle they are from.
    period
        Columns after which the channel's places repeat.
    """

    y: Array
    x: Array
    value: Array
    shape: tuple[int, int]
    period: int


@dataclass(frozen=True)
class Edge:
    """A straight line x = position + slope (y - middle), with the bright side on the right (sign 1) or left (-1)."""

    position: float
    slope: float
    middle: float
    sign: float

    def at(self, y: Array) -> Array:
        """Column coordinate where the edge crosses a line."""
        across: Array = self.position + self.slope * (y - self.middle)
        return across

    def distance(self, pixels: Pixels) -> Array:
        """(n,) from the edge at a right angle to it, to the right positive."""
        return (pixels.x - self.at(pixels.y)) / math.hypot(1.0, self.slope)


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean values by distance across the edge.

    Parameters
    ----------
    distance
        (bins,) middles of the bins; as many on the left of the edge as on its right.
    mean, variance
        (bins,) of the pixels in each bin, brought to its middle; and the variance of that mean.
    """

    distance: Array
    mean: Array
    variance: Array

    @property
    def width(self) -> float:
        """Of a bin, in pixels."""
        return float(self.distance[1] - self.distance[0])

    def ends(self) -> tuple[float, float]:
        """Means of the outer quarter of the profile on the left and on the right."""
        outer = self.mean.size // 8
        return float(self.mean[:outer].mean()), float(self.mean[-outer:].mean())


def first_edge(values: Array, mask: NDArray[np.bool_]) -> Edge:
    """The edge by the centroids of the lines' differences.

    Raises
    ------
    InputError
        If there is too little contrast, or no straight line.
    """
    ends = [float(values[:, part][mask[:, part]].mean()) for part in _sides(values.shape[1])]
    contrast = abs(ends[1] - ends[0]) / max(abs(ends[1] + ends[0]), 1e-300)
    if not contrast >= _LEAST_CONTRAST:
        raise InputError(
            f"there is no edge here, or too weak a one: its sides differ by {contrast:.2g} of their sum, and "
            f"{_LEAST_CONTRAST:g} is wanted; choose a region that one edge of a chart divides"
        )
    sign = math.copysign(1.0, ends[1] - ends[0])
    lines = [r for r in range(values.shape[0]) if mask[r].sum() > 1]
    if len(lines) < _LEAST_LINES:
        raise InputError(f"an edge needs {_LEAST_LINES} lines of pixels across it or more, not {len(lines)}")
    y = np.array(lines) + 0.5
    edge, half = Edge(values.shape[1] / 2, 0.0, values.shape[0] / 2, sign), math.inf
    # At first all of each line counts, then what is near the edge, then what is nearer still.
    for next_half in (values.shape[1] / 4, 2 * LEAST_HALF_WIDTH, None):
        now = edge.at(y)
        centroids = np.array([_centroid(values[r], mask[r], now[k], half) for k, r in enumerate(lines)])
        slope, position = np.polyfit(y - edge.middle, centroids, 1)
        edge = replace(edge, position=float(position), slope=float(slope))
        if next_half is not None:
            half = max(next_half, 2 * LEAST_HALF_WIDTH)
    scatter = float(np.sqrt(np.mean((centroids - edge.at(y)) ** 2)))
    if not scatter < _STRAIGHT_PX:
        raise InputError(
            f"no straight edge was found: its place in the lines scatters by {scatter:.2g} pixels about a straight "
            "one; choose a region that one edge divides from side to side, and average frames if there is much noise"
        )
    return edge


def _sides(columns: int) -> tuple[slice, slice]:
    """The outer eighths of the columns, two at least."""
    outer = max(columns // 8, 2)
    return slice(0, outer), slice(columns - outer, columns)


def _centroid(values: Array, mask: NDArray[np.bool_], middle: float, half: float) -> float:
    """Column coordinate about which a line's differences balance, under a Hamming window."""
    places = np.flatnonzero(mask)
    steps = np.diff(values[places])
    x = (places[:-1] + places[1:] + 1) / 2
    if math.isfinite(half):
        near = np.clip(np.abs(x - middle) / half, 0.0, 1.0)
        steps = steps * np.where(near < 1, 0.54 + 0.46 * np.cos(math.pi * near), 0.0)
    total = steps.sum()
    # A line without an edge breaks the others' line, and is told by that.
    return float(x @ steps / total) if total != 0 else -1e6


def whole_cycles(pixels: Pixels, edge: Edge) -> Pixels:
    """The lines in which the edge moves by whole periods of columns: each part of a pixel is met equally often.

    Raises
    ------
    InputError
        If it moves by less than one period, or nearly so: then parts of a pixel are not met at all.
    """
    lines = pixels.shape[0]
    cycles = math.floor(lines * abs(edge.slope) / pixels.period)
    if cycles < 1:
        columns = "a column" if pixels.period == 1 else f"{pixels.period} columns"
        raise InputError(
            f"the edge moves by {lines * abs(edge.slope):.2g} pixels over {lines} lines; it must lean by {columns} at "
            "least: take a longer region, or turn the chart by some 5 degrees"
        )
    used = round(cycles * pixels.period / abs(edge.slope))
    first = (lines - used) // 2
    keep = (pixels.y > first) & (pixels.y < first + used)
    return replace(pixels, y=pixels.y[keep], x=pixels.x[keep], value=pixels.value[keep])


def profile_across(pixels: Pixels, edge: Edge, oversampling: int) -> Profile:
    """The profile in bins of 1 / oversampling pixel, out to where every line still has pixels.

    Raises
    ------
    InputError
        If the edge comes too near to the region's sides, or a bin has no pixel.
    """
    ends = edge.at(np.array([pixels.y.min(), pixels.y.max()]))
    room = min(float(ends.min()), pixels.shape[1] - float(ends.max())) - pixels.period
    half = math.floor(oversampling * room / math.hypot(1.0, edge.slope))
    if half < oversampling * LEAST_HALF_WIDTH:
        raise InputError(
            f"the edge comes within {max(room, 0.0):.3g} pixels of the region's sides, and {LEAST_HALF_WIDTH:g} are "
            "wanted on both sides in all lines; choose a wider region about it"
        )
    distance = edge.distance(pixels)
    index = np.floor(distance * oversampling).astype(np.intp) + half
    inside = (index >= 0) & (index < 2 * half)
    index, value, place = index[inside], pixels.value[inside], distance[inside]
    count = np.bincount(index, minlength=2 * half)
    if count.min() < 1:
        raise InputError(
            f"the edge's angle of {math.degrees(math.atan(abs(edge.slope))):.3g} degrees leaves parts of a pixel "
            "unseen; turn the chart by a few degrees, take a longer region or less oversampling"
        )
    middle = (np.arange(2 * half) + 0.5 - half) / oversampling
    mean = np.bincount(index, value, 2 * half) / count
    # A bin's pixels lie about a place of their own: along the profile's slope its mean is brought to the middle.
    off = np.bincount(index, place - middle[index], 2 * half) / count
    slope = np.gradient(mean, middle + off)
    residual = value - (mean[index] + slope[index] * (place - middle[index] - off[index]))
    # Few pixels in a bin tell little of their variance: neighbours' are pooled.
    degrees = np.convolve(np.maximum(count - 1, 0), np.ones(9), "same")
    scatter = np.convolve(np.bincount(index, residual**2, 2 * half), np.ones(9), "same")
    return Profile(middle, mean - slope * off, scatter / np.maximum(degrees, 1) / count)


def refined(pixels: Pixels, edge: Edge, oversampling: int) -> tuple[Edge, Profile]:
    """The line turned until pixels lie nearest to the profile that they make, with half its step on the line.

    Gauss-Newton on the slope. A shift of the line shifts the profile with it and brings no pixel nearer; where in its
    profile an edge is, is a matter of words: where it is half way from dark to bright.
    """
    profile = profile_across(pixels, edge, oversampling)
    for _ in range(_FIT_STEPS):
        smooth = np.convolve(np.pad(profile.mean, 2, mode="edge"), _SMOOTHING, "valid")
        distance = edge.distance(pixels)
        near = np.abs(distance) < profile.distance[-1]
        steepness = np.interp(distance[near], profile.distance, np.gradient(smooth, profile.distance))
        residual = pixels.value[near] - np.interp(distance[near], profile.distance, smooth)
        # Where the edge goes farther right, a pixel lies farther left of it.
        moved = -steepness * (pixels.y[near] - edge.middle) / math.hypot(1.0, edge.slope)
        turn = float(moved @ residual / (moved @ moved))
        shift = _half_way(profile.distance, smooth, profile.ends()) * math.hypot(1.0, edge.slope)
        edge = replace(edge, position=edge.position + shift, slope=edge.slope + turn)
        profile = profile_across(pixels, edge, oversampling)
        if abs(shift) + abs(turn) * pixels.shape[0] < _FIT_ENOUGH_PX:
            break
    return edge, profile


def _half_way(distance: Array, profile: Array, ends: tuple[float, float]) -> float:
    """Where a profile passes the middle between its ends; of several places, their mean."""
    above = (profile > (ends[0] + ends[1]) / 2).astype(np.int8)
    places = np.flatnonzero(np.diff(above))
    share = ((ends[0] + ends[1]) / 2 - profile[places]) / (profile[places + 1] - profile[places])
    return float(np.mean(distance[places] + share * (distance[1] - distance[0])))
