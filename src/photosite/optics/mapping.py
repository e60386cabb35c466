"""Distortion and lateral chromatic aberration as curves: from image heights to where they fall, and back.

Between a mapping's heights the curve is ideal height times a cubic spline in its square, since distortion is an odd
function: orders up to the seventh are met exactly. Where that would fold back it is the monotone cubic of Fritsch and
Carlson (1980). Beyond the last height it is a straight line. Between a mapping's wavelengths heights are linear.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.optics.spread import RadialMapping

_NODES = 4097
"""Of the inverse, evenly in squared height."""
_PLACES = 8
"""Between two heights, at which the curve must have risen."""
_FINE = 1 << 16
"""Heights at which the curve is evaluated to be inverted: straight lines between them err by 1e-10 of the reach."""


def heights_at(mapping: RadialMapping, wavelength_nm: float) -> NDArray[np.float64]:
    """(n,) real image heights at one wavelength, m."""
    grid = mapping.wavelength_nm
    at = float(np.clip(wavelength_nm, grid[0], grid[-1]))
    index = int(np.clip(np.searchsorted(grid, at, side="right") - 1, 0, max(grid.size - 2, 0)))
    if grid.size == 1:
        first: NDArray[np.float64] = mapping.real_m[0]
        return first
    share = (at - grid[index]) / (grid[index + 1] - grid[index])
    heights: NDArray[np.float64] = mapping.real_m[index] + share * (mapping.real_m[index + 1] - mapping.real_m[index])
    return heights


def image_height(mapping: RadialMapping, wavelength_nm: float) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """The curve from image heights without distortion to real ones, m.

    Examples
    --------
    >>> barrel = RadialMapping(np.array([550.0]), np.array([0.0, 5e-3, 10e-3]), np.array([[0.0, 4.95e-3, 9.6e-3]]))
    >>> image_height(barrel, 550.0)(np.array([0.0, 5e-3, 10e-3]))
    array([0.     , 0.00495, 0.0096 ])
    """
    from scipy.interpolate import PchipInterpolator

    ideal, real = mapping.ideal_m, heights_at(mapping, wavelength_nm)
    curve = _odd(ideal, real)
    between = np.linspace(0.0, 1.0, _PLACES, endpoint=False)
    fine = np.append((ideal[:-1, None] + between * np.diff(ideal)[:, None]).ravel(), ideal[-1])
    if (np.diff(curve(fine)) <= 0).any():
        curve = PchipInterpolator(np.concatenate([-ideal[:0:-1], ideal]), np.concatenate([-real[:0:-1], real]))
    end = float(ideal[-1])
    near_end = end - 1e-4 * float(ideal[-1] - ideal[-2])
    slope = float(curve(end) - curve(near_end)) / (end - near_end)

    def height(ideal_m: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = np.asarray(curve(np.minimum(ideal_m, end)), np.float64)
        return inside + slope * np.maximum(np.asarray(ideal_m) - end, 0.0)

    return height


def _odd(ideal: NDArray[np.float64], real: NDArray[np.float64]) -> Callable[[Any], Any]:
    """ideal times a spline of real over ideal in ideal squared."""
    from scipy.interpolate import CubicSpline

    ratio = real[1:] / ideal[1:]
    if ratio.size == 1:
        return lambda height: height * ratio[0]
    spline = CubicSpline(ideal[1:] ** 2, ratio)
    return lambda height: height * spline(np.square(height))


def inverse_scale(mapping: RadialMapping, wavelength_nm: float, reach_m: float) -> tuple[NDArray[np.float64], float]:
    """Ideal over real image height, evenly spaced in squared real height.

    Parameters
    ----------
    mapping
        The lens's.
    wavelength_nm
        Of the light.
    reach_m
        Real height up to which the inverse is wanted.

    Returns
    -------
    scale
        (4097,) at squared real heights from 0 to reach_m squared.
    step_m2
        Distance of these, m^2.

    Examples
    --------
    >>> smaller = RadialMapping(np.array([550.0]), np.array([0.0, 10e-3]), np.array([[0.0, 8e-3]]))
    >>> scale, step_m2 = inverse_scale(smaller, 550.0, 12e-3)
    >>> scale.round(9).min(), scale.round(9).max()
    (np.float64(1.25), np.float64(1.25))
    """
    curve = image_height(mapping, wavelength_nm)
    far = float(mapping.ideal_m[-1])
    while curve(np.array([far]))[0] < reach_m:  # beyond the table the curve is straight and rises
        far *= 2
    ideal = np.linspace(0.0, far, _FINE)
    step_m2 = reach_m**2 / (_NODES - 1)
    real = np.sqrt(step_m2 * np.arange(1, _NODES))
    scale = np.interp(real, curve(ideal), ideal) / real
    # On the axis the quotient is a derivative: the curve is odd, so there the scale is even and its first node flat.
    first = ideal[1] / curve(ideal[1:2])
    return np.concatenate([first, scale]), step_m2


_CUBIC_STEP = 2.5
"""Steps between nodes whose images are shared among four, where two may be one step apart."""


def wavelength_nodes(
    mapping: RadialMapping, wavelength_nm: NDArray[np.float64], reach_m: float, step_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A few wavelengths that stand for all, and how each wavelength's light is shared among its neighbours.

    Parameters
    ----------
    mapping
        The lens's.
    wavelength_nm
        (wavelengths,) increasing: those of the light.
    reach_m
        Ideal image height up to which heights are compared.
    step_m
        How far apart the images of neighbouring nodes may be, at the height where they are farthest, where light is
        shared between two of them. Among four, by Lagrange's cubics, 2.5 times as far is as good at half a cycle per 5
        steps and better below: (3 / 128) (2 pi f h)^4 is left of a wave of frequency f between nodes h apart, where
        two leave (1 / 8) (2 pi f h)^2. The fewer of both are taken.

    Returns
    -------
    nodes_nm
        (nodes,): increasing. Never more than the wavelengths; where as many are needed, these themselves.
    shares
        (nodes, wavelengths): summing to 1 over nodes; among four some are below 0.

    Examples
    --------
    >>> colors = RadialMapping(np.array([400.0, 700.0]), np.array([0, 1e-2]), np.array([[0, 1e-2], [0, 1.0004e-2]]))
    >>> nodes, shares = wavelength_nodes(colors, np.arange(400.0, 701.0, 10), 1e-2, 1e-6)
    >>> nodes, shares.shape
    (array([400., 500., 600., 700.]), (4, 31))
    """
    grid = np.asarray(wavelength_nm, np.float64)
    alone = np.array([grid[grid.size // 2]]), np.ones((1, grid.size))
    if mapping.wavelength_nm.size == 1 or grid.size == 1:
        return alone
    ideal = np.linspace(0.0, reach_m, 33)
    real = np.stack([image_height(mapping, w)(ideal) for w in grid])
    # The way that the image travels from the first wavelength: nodes stand at even distances on it.
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(real, axis=0)).max(axis=1))])
    linear, cubic = (math.ceil(way[-1] / step - 1e-6) + 1 for step in (step_m, _CUBIC_STEP * step_m))
    count = min(linear, max(cubic, 4))
    if count == 1:
        return alone
    if count >= grid.size:
        return grid, np.eye(grid.size)
    places = np.linspace(0.0, way[-1], count)
    moving = np.concatenate([[True], np.diff(way) > 0])
    nodes = np.interp(places, way[moving], grid[moving])
    position = np.clip(way / places[1], 0.0, count - 1)
    return nodes, _shares(position, count)


def _shares(position: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(count, n): Lagrange's weights at positions 0 to count - 1, of four neighbours, or of two of fewer."""
    points = 4 if count >= 4 else 2
    first = np.clip(np.floor(position).astype(np.int64) - (points // 2 - 1), 0, count - points)
    shares = np.zeros((count, position.size))
    for own in range(points):
        others = [other for other in range(points) if other != own]
        weight = np.prod([(position - first - other) / (own - other) for other in others], axis=0)
        shares[first + own, np.arange(position.size)] = weight
    return shares
