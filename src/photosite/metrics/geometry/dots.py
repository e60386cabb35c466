"""Dots of a point grid in an image: where they are in each channel, and their rows and columns in the chart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import LUMA, ChartImage
from photosite.metrics.charts.lattice import lattice
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.values.region import Region
from photosite.values.shown import Shown
from photosite.values.uncertain import NORMAL_MAD

Array = NDArray[np.float64]

_LEAST_DOTS = 20
_LEAST_PITCH = 8.0
"""Distance of dots, in tiles of the color filters."""
_LEAST_CONTRAST = 8.0
_BRIGHT = 0.4
"""Fraction of a dot's amplitude from which a pixel belongs to it."""
_SIZES = 0.3, 3.0
"""Areas of dots relative to the median."""
_ROUNDS, _ITERATIONS = 3, 20
_CLOSE_PX = 2e-4
"""Step of a centroid at which it is found."""


@dataclass(frozen=True, eq=False)
class Dots(Shown):
    """Dots of a chart in an image.

    Parameters
    ----------
    index
        (n, 2) row and column of each dot in the chart, counted from one near the middle of the frame.
    places
        (n, 2) row and column of the centroid in each channel, in pixels.
    shape
        (rows, cols) of the frame.
    """

    index: NDArray[np.int_]
    places: dict[str, Array]
    shape: tuple[int, int]

    @property
    def half_diagonal(self) -> float:
        """From the middle of the frame to its corner, in pixels."""
        return math.hypot(*self.shape) / 2

    def from_center(self, channel: str) -> Array:
        """Return (n, 2) centroids relative to the middle of the frame, in half diagonals."""
        middle = np.array(self.shape) / 2
        return np.asarray((self.places[channel] - middle) / self.half_diagonal)

    def grid(self, values: Array, channel: str) -> tuple[Array, Array, Array]:
        """Return values of the dots as a map: mean rows and columns of the lines of dots, and (lines, lines) values."""
        first = self.index.min(axis=0)
        size = self.index.max(axis=0) - first + 1
        found = np.full(size, np.nan)
        found[tuple((self.index - first).T)] = values
        lines = []
        for axis in (0, 1):
            line = self.index[:, axis] - first[axis]
            count = np.bincount(line, minlength=size[axis])
            lines.append(np.bincount(line, self.places[channel][:, axis], size[axis]) / np.maximum(count, 1))
        return lines[0], lines[1], found


def find_dots(image: ChartImage, chart: PlacedChart, channels: tuple[str, ...]) -> Dots:
    """Find the dots of a point grid, and their centroids in channels.

    Raises
    ------
    InputError
        If fewer than 20 dots are found, or they are too close to each other.
    """
    seen = image.shared(("dots", chart), lambda: _seen_dots(image, chart))
    centroids = {name: image.shared(("dots", chart, name), partial(_centroids, image, name, seen)) for name in channels}
    good = np.all([np.isfinite(each).all(axis=1) for each in centroids.values()], axis=0)
    if good.sum() < _LEAST_DOTS:
        hint = "Check the corners, the light and the focus; dots need several pixels"
        raise InputError("dots found", value=int(good.sum()), expected=f"{_LEAST_DOTS} or more", hint=hint)
    return Dots(seen.index[good], {name: each[good] for name, each in centroids.items()}, image.shape)


@dataclass(frozen=True, eq=False)
class _SeenDots:
    """Dots before their centroids are measured: rows and columns in the chart, rough places, radius and pitch."""

    index: NDArray[np.int_]
    places: Array
    radius: float
    pitch: float
    tile: int


def _seen_dots(image: ChartImage, chart: PlacedChart) -> _SeenDots:
    steps = _expected_steps(chart)
    tile = (1, 1) if image.origin == "picture" else (len(image.cfa), len(image.cfa[0]))
    pitch = float(np.hypot(*steps).min())
    if pitch < _LEAST_PITCH * max(tile):
        expected = f"{_LEAST_PITCH * max(tile):g} pixels or more"
        raise InputError("distance of the dots", value=pitch, expected=expected, hint="Use a chart of larger pitch")
    found, radius = _blobs(image, tile, pitch)
    if len(found) < _LEAST_DOTS:
        hint = "Check the corners, the light and the focus"
        raise InputError("dots found", value=len(found), expected=f"{_LEAST_DOTS} or more", hint=hint)
    return _SeenDots(*lattice(found, steps, image.shape), radius, pitch, max(tile))


def _expected_steps(chart: PlacedChart) -> Array:
    """Return (2, 2): the row and column components of the steps from dot to dot, down and across, in pixels."""
    from scipy.ndimage import center_of_mass, label

    light = chart.scene.weights.sum(axis=0)
    spots, count = label(light > 0.5 * (light.max() + light.min()))
    points = np.array(center_of_mass(light, spots, range(1, count + 1))) + 0.5
    steps = [np.diff(np.sort(points[:, axis])) for axis in (0, 1)]
    if min(int((each > 1.0).sum()) for each in steps) < 2:
        raise InputError("rows and columns of dots in the chart", expected="3 or more")
    down, across = (float(np.median(each[each > 1.0])) for each in steps)
    middle = np.array(light.shape) / 2
    at = chart.to_image(middle + np.array([(0.0, 0.0), (down, 0.0), (0.0, across)]))
    return np.asarray((at[1:] - at[0]).T)


def _blobs(image: ChartImage, tile: tuple[int, int], pitch: float) -> tuple[Array, float]:
    """Return (n, 2) rough centers of dots, and their median radius, in pixels."""
    from scipy.ndimage import center_of_mass, label, median_filter, zoom

    plane = image.plane(LUMA if image.origin == "picture" else image.channels[0])[0]
    rows, cols = (size // step for size, step in zip(plane.shape, tile, strict=True))
    light = plane[: rows * tile[0], : cols * tile[1]].reshape(rows, tile[0], cols, tile[1]).mean(axis=(1, 3))
    side = max(4, round(pitch / max(tile)))
    counts = -(-rows // side), -(-cols // side)
    padded = np.pad(light, [(0, counts[0] * side - rows), (0, counts[1] * side - cols)], mode="reflect")
    cells = padded.reshape(counts[0], side, counts[1], side).swapaxes(1, 2).reshape(*counts, -1)
    background = np.median(cells, axis=-1)
    rest = light - zoom(background, side, order=1, mode="nearest", grid_mode=True)[:rows, :cols]
    if float(np.mean(rest**3)) < 0:  # dark dots on a bright field
        rest, cells, background = -rest, -cells, -background
    peak = median_filter(np.percentile(cells, 99.5, axis=-1) - background, 3, mode="nearest")
    noise = NORMAL_MAD * float(np.median(np.abs(rest - np.median(rest))))
    if float(np.median(peak)) < _LEAST_CONTRAST * noise:
        hint = "Check the chart and its corners, and use more light"
        ratio = float(np.median(peak)) / noise
        raise InputError("signal of dots over noise", value=ratio, expected=f"{_LEAST_CONTRAST:g} or more", hint=hint)
    peak = np.maximum(peak, 0.1 * peak.max())
    bright = rest > _BRIGHT * zoom(peak, side, order=1, mode="nearest", grid_mode=True)[:rows, :cols]
    spots, count = label(bright)
    area = np.bincount(spots.ravel(), minlength=count + 1)[1:]
    large = np.sort(area)[::-1][: max(_LEAST_DOTS, round(rows * cols / side**2))]  # without specks of noise
    if not large.size:
        raise InputError("dots found", value=0, expected=f"{_LEAST_DOTS} or more")
    typical = float(np.median(large))
    kept = np.flatnonzero((area >= _SIZES[0] * typical) & (area <= _SIZES[1] * typical)) + 1
    points = np.array(center_of_mass(np.maximum(rest, 0.0), spots, kept)).reshape(-1, 2) + 0.5
    return points * np.array(tile), math.sqrt(typical * tile[0] * tile[1] / math.pi)


def _centroids(image: ChartImage, channel: str, seen: _SeenDots) -> Array:
    """Return (n, 2) centroids under a Gaussian window that is centered on them; NaN near borders.

    A plane through the surround of each dot is its background.
    """
    places, radius, tile = seen.places, seen.radius, seen.tile
    reach = min(0.48 * seen.pitch, 2.5 * radius + 2.0 * tile)
    half = math.ceil(reach / tile) * tile
    first = np.floor(places / tile).astype(int) * tile - half
    rows, cols = image.shape
    size = 2 * half + tile
    inside = (first >= 0).all(axis=1) & (first[:, 0] + size <= rows) & (first[:, 1] + size <= cols)
    found = np.full(places.shape, np.nan)
    if not inside.any():
        return found
    plane = image.plane(channel)[0]
    # Windows begin on whole tiles, so that the channel has the same sites in each.
    down, along = np.nonzero(image.mask(channel, Region("window", 0, size, 0, size)))
    row, col = first[inside, 0, None] + down, first[inside, 1, None] + along
    values = plane[row, col]
    center = places[inside]
    width = max(radius, tile)
    for _ in range(_ROUNDS):  # the surround is symmetric about the centroid only once that is known
        y, x = row + 0.5 - center[:, 0, None], col + 0.5 - center[:, 1, None]
        distance = np.hypot(y, x)
        rest = (values - _background(values, _surround(distance, reach), y, x)) * (distance < reach)
        shift = np.zeros((len(center), 2))
        for _ in range(_ITERATIONS):
            dy, dx = y - shift[:, 0, None], x - shift[:, 1, None]
            weight = rest * np.exp(-0.5 * (dy**2 + dx**2) / width**2)
            moment = np.stack([(weight * dy).sum(axis=1), (weight * dx).sum(axis=1)], axis=1)
            step = np.clip(moment / weight.sum(axis=1)[:, None], -1.0, 1.0)
            shift = shift + step
            if not (np.abs(step) > _CLOSE_PX).any():
                break
        center = center + shift
    center[~(np.hypot(*(center - places[inside]).T) < radius + tile)] = np.nan
    found[inside] = center
    return found


def _surround(distance: Array, reach: float) -> Array:
    """Return the weights of the background: 0 inside 0.75 of the reach and outside it, smooth in between."""
    inside = np.clip((distance / reach - 0.75) / 0.25, 0.0, 1.0)
    return np.asarray(np.sin(np.pi * inside) ** 2)


def _background(values: Array, surround: Array, y: Array, x: Array) -> Array:
    """Return the planes that fit the surrounds best."""
    model = np.stack([np.ones_like(values), y, x], axis=-1)
    used = model * surround[..., None]
    square = np.einsum("npi,npj->nij", used, model)
    planes = np.linalg.solve(square, np.einsum("npi,np->ni", used, values)[..., None])[..., 0]
    return np.asarray(np.einsum("npi,ni->np", model, planes))
