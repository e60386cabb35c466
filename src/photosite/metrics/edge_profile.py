"""A slanted edge in the pixels of one channel: its straight line, and its profile across that line.

Lines of pixels run across the edge: rows for a nearly vertical edge. Pixel i covers the coordinates i to i + 1. The
public function is `photosite.metrics.sharpness.slanted_edge_mtf`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Array = NDArray[np.float64]

LEAST_HALF_WIDTH = 8.0
"""Pixels required on each side of the edge, in every line."""
_LEAST_LINES = 16
_LEAST_CONTRAST = 0.05
"""Smallest (bright - dark) / (bright + dark)."""
_STRAIGHT_PX = 2.0
"""Largest RMS distance of the edge in each line from the straight line."""
_NO_EDGE = -1e6
_FIT_STEPS = 8
_FIT_ENOUGH_PX = 1e-5
_SMOOTHING = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16.0


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of one channel."""

    # (n,) centers and values, line by line
    y: Array
    x: Array
    value: Array
    shape: tuple[int, int]  # (lines, columns) of their rectangle
    period: int  # columns after which the sites of the channel repeat


@dataclass(frozen=True)
class Edge:
    """A straight line x = position + slope (y - middle), bright on the right (sign 1) or on the left (sign -1)."""

    position: float
    slope: float
    middle: float
    sign: float

    def at(self, y: Array) -> Array:
        """Return the column coordinate where the edge crosses a line."""
        return np.asarray(self.position + self.slope * (y - self.middle))

    def distance(self, pixels: Pixels) -> Array:
        """Return (n,) distances perpendicular to the edge, positive to the right."""
        return (pixels.x - self.at(pixels.y)) / math.hypot(1.0, self.slope)


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean values over the distance from the edge."""

    distance: Array  # (bins,) centers of the bins, symmetric about the edge
    # (bins,) mean of the pixels in each bin, interpolated to its center, and the variance of that mean
    mean: Array
    variance: Array

    @property
    def width(self) -> float:
        """Width of a bin in pixels."""
        return float(self.distance[1] - self.distance[0])

    def ends(self) -> tuple[float, float]:
        """Return the means of the outer eighths of the profile, left and right."""
        outer = self.mean.size // 8
        return float(self.mean[:outer].mean()), float(self.mean[-outer:].mean())


def first_edge(values: Array, mask: NDArray[np.bool_]) -> Edge:
    """Return the edge from the centroids of the derivative of each line.

    Raises `InputError` if the contrast is too low, or the edge is not straight.
    """
    ends = [float(values[:, part][mask[:, part]].mean()) for part in _sides(values.shape[1])]
    contrast = abs(ends[1] - ends[0]) / max(abs(ends[1] + ends[0]), 1e-300)
    if not contrast >= _LEAST_CONTRAST:
        hint = "Choose a region that one edge of a chart divides"
        raise InputError("contrast of the edge", value=contrast, expected=f"{_LEAST_CONTRAST} or more", hint=hint)
    sign = math.copysign(1.0, ends[1] - ends[0])
    lines = [r for r in range(values.shape[0]) if mask[r].sum() > 1]
    if len(lines) < _LEAST_LINES:
        raise InputError("lines of pixels across the edge", value=len(lines), expected=f"{_LEAST_LINES} or more")
    y = np.array(lines) + 0.5
    edge, half = Edge(values.shape[1] / 2, 0.0, values.shape[0] / 2, sign), math.inf
    # Use whole lines first, then windows around the edge that become narrower.
    for next_half in (values.shape[1] / 4, 2 * LEAST_HALF_WIDTH, None):
        now = edge.at(y)
        centroids = np.array([_centroid(values[r], mask[r], now[k], half) for k, r in enumerate(lines)])
        slope, position = np.polyfit(y - edge.middle, centroids, 1)
        edge = replace(edge, position=float(position), slope=float(slope))
        if next_half is not None:
            half = max(next_half, 2 * LEAST_HALF_WIDTH)
    scatter = float(np.sqrt(np.mean((centroids - edge.at(y)) ** 2)))
    if not scatter < _STRAIGHT_PX:
        hint = "Choose a region that one straight edge divides from side to side, or average noisy frames"
        expected = f"below {_STRAIGHT_PX:g} pixels RMS"
        raise InputError("deviation of the edge from a straight line", value=scatter, expected=expected, hint=hint)
    return edge


def _sides(columns: int) -> tuple[slice, slice]:
    """Return the outer eighths of the columns, at least two."""
    outer = max(columns // 8, 2)
    return slice(0, outer), slice(columns - outer, columns)


def _centroid(values: Array, mask: NDArray[np.bool_], middle: float, half: float) -> float:
    """Return the centroid of the derivative of a line, under a Hamming window."""
    places = np.flatnonzero(mask)
    steps = np.diff(values[places])
    x = (places[:-1] + places[1:] + 1) / 2
    if math.isfinite(half):
        near = np.clip(np.abs(x - middle) / half, 0.0, 1.0)
        steps = steps * np.where(near < 1, 0.54 + 0.46 * np.cos(math.pi * near), 0.0)
    total = steps.sum()
    # A line without an edge gets a position that makes the straight-line fit fail.
    return float(x @ steps / total) if total != 0 else _NO_EDGE


def whole_cycles(pixels: Pixels, edge: Edge) -> Pixels:
    """Return the lines over which the edge moves by whole periods, so that all phases are sampled equally.

    Raises `InputError` if the edge moves by less than one period, so that some phases are not sampled.
    """
    lines = pixels.shape[0]
    cycles = math.floor(lines * abs(edge.slope) / pixels.period)
    if cycles < 1:
        hint = "Take a longer region, or turn the chart by about 5 degrees"
        what, moved = f"displacement of the edge over {lines} lines", lines * abs(edge.slope)
        raise InputError(what, value=moved, expected=f"{pixels.period} columns or more", hint=hint)
    used = round(cycles * pixels.period / abs(edge.slope))
    first = (lines - used) // 2
    keep = (pixels.y > first) & (pixels.y < first + used)
    return replace(pixels, y=pixels.y[keep], x=pixels.x[keep], value=pixels.value[keep])


def profile_across(pixels: Pixels, edge: Edge, oversampling: int) -> Profile:
    """Return the profile in bins of 1 / oversampling pixel, over the distances that every line covers.

    Raises `InputError` if the edge is too close to the sides of the region, or a bin has no pixel.
    """
    ends = edge.at(np.array([pixels.y.min(), pixels.y.max()]))
    margin = min(float(ends.min()), pixels.shape[1] - float(ends.max())) - pixels.period
    half = math.floor(oversampling * margin / math.hypot(1.0, edge.slope))
    if half < oversampling * LEAST_HALF_WIDTH:
        what, hint = "distance of the edge from the sides of the region", "Choose a wider region around the edge"
        raise InputError(what, value=max(margin, 0.0), expected=f"{LEAST_HALF_WIDTH:g} pixels or more", hint=hint)
    distance = edge.distance(pixels)
    index = np.floor(distance * oversampling).astype(np.intp) + half
    inside = (index >= 0) & (index < 2 * half)
    index, value, place = index[inside], pixels.value[inside], distance[inside]
    count = np.bincount(index, minlength=2 * half)
    if count.min() < 1:
        angle_deg = math.degrees(math.atan(abs(edge.slope)))
        hint = "Turn the chart by a few degrees, take a longer region, or reduce {oversampling}"
        expected = "one that samples all phases of a pixel"
        arguments = {"oversampling": 2}
        raise InputError("angle of the edge", value=angle_deg, expected=expected, hint=hint, arguments=arguments)
    middle = (np.arange(2 * half) + 0.5 - half) / oversampling
    mean = np.bincount(index, value, 2 * half) / count
    # The pixels of a bin are not centered in it: interpolate their mean to the center along the slope of the profile.
    off = np.bincount(index, place - middle[index], 2 * half) / count
    slope = np.gradient(mean, middle + off)
    residual = value - (mean[index] + slope[index] * (place - middle[index] - off[index]))
    # Pool the variance of neighboring bins, which hold few pixels each.
    degrees = np.convolve(np.maximum(count - 1, 0), np.ones(9), "same")
    scatter = np.convolve(np.bincount(index, residual**2, 2 * half), np.ones(9), "same")
    return Profile(middle, mean - slope * off, scatter / np.maximum(degrees, 1) / count)


def refined(pixels: Pixels, edge: Edge, oversampling: int) -> tuple[Edge, Profile]:
    """Return the edge whose slope minimizes the residuals of the pixels about their profile, and that profile.

    The slope is found by Gauss-Newton steps. A shift of the line only shifts the profile; the line is put, by
    convention, where the profile is half way from dark to bright.
    """
    profile = profile_across(pixels, edge, oversampling)
    for _ in range(_FIT_STEPS):
        smooth = np.convolve(np.pad(profile.mean, 2, mode="edge"), _SMOOTHING, "valid")
        distance = edge.distance(pixels)
        near = np.abs(distance) < profile.distance[-1]
        steepness = np.interp(distance[near], profile.distance, np.gradient(smooth, profile.distance))
        residual = pixels.value[near] - np.interp(distance[near], profile.distance, smooth)
        # As the edge moves to the right, a pixel moves to the left relative to it.
        moved = -steepness * (pixels.y[near] - edge.middle) / math.hypot(1.0, edge.slope)
        turn = float(moved @ residual / (moved @ moved))
        shift = _half_way(profile.distance, smooth, profile.ends()) * math.hypot(1.0, edge.slope)
        edge = replace(edge, position=edge.position + shift, slope=edge.slope + turn)
        profile = profile_across(pixels, edge, oversampling)
        if abs(shift) + abs(turn) * pixels.shape[0] < _FIT_ENOUGH_PX:
            break
    return edge, profile


def _half_way(distance: Array, profile: Array, ends: tuple[float, float]) -> float:
    """Return where a profile crosses the middle between its ends; the mean of several crossings."""
    above = (profile > (ends[0] + ends[1]) / 2).astype(np.int8)
    places = np.flatnonzero(np.diff(above))
    share = ((ends[0] + ends[1]) / 2 - profile[places]) / (profile[places + 1] - profile[places])
    return float(np.mean(distance[places] + share * (distance[1] - distance[0])))
