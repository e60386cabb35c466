"""The part of a frame around an edge: pixels far from it add noise and time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.sharpness.slanted_edge import SlantedEdge
from photosite.values.region import Region

Array = NDArray[np.float64]

_MOST_RISE = 0.5
_CLIPPED_FRACTION = 1e-3
_MOST_LINES = 600
_BAND = 8
"""Lines over which the edge is looked for at either end."""


def edge_region(image: ChartImage, region: Region, reach_px: float) -> Region:
    """Return the lines in the middle of a region, at most 600, and the pixels around the edge in them.

    The region begins on whole tiles of the color filter array.
    """
    tile = 1 if image.origin == "picture" else int(np.lcm(len(image.cfa), len(image.cfa[0])))
    mean = image.mean[region.r0 : region.r1, region.c0 : region.c1]
    rows, cols = region.shape
    levels = mean.sum(axis=-1) if mean.ndim == 3 else mean
    middle = levels[_middle(rows)], levels[:, _middle(cols)]
    across = np.ptp(_smooth(middle[0].mean(axis=0), tile)) >= np.ptp(_smooth(middle[1].mean(axis=1), tile))
    plane = levels if across else levels.T
    lines = _middle(plane.shape[0], tile)
    kept = plane[lines]
    ends = [_edge_at(_smooth(part.mean(axis=0), 2 * tile)) for part in (kept[: _BAND * tile], kept[-_BAND * tile :])]
    margin = 3.0 * reach_px + 8.0 * tile
    first = max(int(min(ends) - margin), 0) // tile * tile
    last = min(int(max(ends) + margin) + tile, plane.shape[1])
    if across:
        return Region(region.name, region.r0 + lines.start, region.r0 + lines.stop, region.c0 + first, region.c0 + last)
    return Region(region.name, region.r0 + first, region.r0 + last, region.c0 + lines.start, region.c0 + lines.stop)


def check_edge(image: ChartImage, plane: Array, mask: NDArray[np.bool_], channel: str) -> None:
    """Raise `InputError` for an edge with saturated pixels."""
    full = float((plane[mask] >= image.white - image.black).mean())
    if full > _CLIPPED_FRACTION:
        expected = f"at most {_CLIPPED_FRACTION}"
        raise InputError(f"fraction of saturated {channel} pixels", value=full, expected=expected)


def check_blur(edge: SlantedEdge, reach_px: float) -> None:
    """Raise `InputError` for an edge whose rise the measured pixels do not hold.

    A rise of half the reach lifts the response by 0.4 %, and one of 0.8 times the reach by 5 %.
    """
    try:
        rise = edge.rise_distance().value
    except InputError:
        return  # noise, which intervals hold
    if rise > _MOST_RISE * reach_px:
        expected = f"at most {_MOST_RISE * reach_px:g} pixels"
        hint = "Focus the chart, or raise reach_px of edge-sfr"
        raise InputError("10-90 % rise of the edge", value=rise, expected=expected, hint=hint)


def _middle(size: int, tile: int = 1) -> slice:
    first = max((size - _MOST_LINES) // 2, 0) // tile * tile
    return slice(first, min(first + _MOST_LINES, size))


def _smooth(profile: np.ndarray, width: int) -> np.ndarray:
    """Return the means of neighbors, so that the channels of a mosaic are one signal."""
    if profile.size < 3 * width:
        raise InputError("width of the region", value=profile.size, expected=f"{3 * width} pixels or more")
    return np.convolve(profile, np.full(width, 1.0 / width), "valid")


def _edge_at(profile: np.ndarray) -> float:
    """Return where the largest step over neighbors is."""
    step = max(profile.size // 64, 2)
    return float(np.argmax(np.abs(profile[step:] - profile[:-step]))) + 0.5 * step
