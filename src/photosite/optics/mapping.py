"""Where image points fall: distortion and lateral chromatic aberration as a radial mapping, and its inverse.

Between tabulated heights the mapping is the ideal height times a cubic spline in the squared height, since distortion
is an odd function; orders up to the seventh are reproduced exactly. If that spline folds back, the monotone cubic of
Fritsch and Carlson (1980) replaces it. Beyond the last height the mapping is a straight line. Between wavelengths,
heights are interpolated linearly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError

Array = NDArray[np.float64]

_INVERSE_NODES = 4097
"""Nodes of the inverse, evenly spaced in squared height."""
_CHECKS_PER_INTERVAL = 8
"""Points between two tabulated heights at which the curve must increase."""
_CURVE_POINTS = 1 << 16
"""Points at which the curve is evaluated for its inversion; linear interpolation errs by 1e-10 of the reach."""
_CUBIC_STEP = 2.5
"""Node distance allowed with cubic weights, relative to that with linear weights."""


@dataclass(frozen=True, eq=False)
class RadialMapping:
    """Real image heights of a lens: distortion and, with several wavelengths, lateral chromatic aberration.

    Parameters
    ----------
    wavelength_nm
        (L,) increasing; linear in between, the nearest one beyond. One wavelength applies to all light.
    ideal_m
        (n,) increasing from 0: image heights of a distortion-free lens of the same focal length and distance.
    real_m
        (L, n): image heights of this lens, increasing from 0.

    Raises
    ------
    InputError
        If shapes do not match, a value is not finite, or heights or wavelengths do not increase.
    """

    wavelength_nm: Array
    ideal_m: Array
    real_m: Array

    def __post_init__(self) -> None:
        grid, ideal, real = (np.asarray(a, np.float64) for a in (self.wavelength_nm, self.ideal_m, self.real_m))
        vectors = grid.ndim == ideal.ndim == 1
        if not vectors or grid.size < 1 or ideal.size < 2 or real.shape != (grid.size, ideal.size):
            expected = f"of shape (L, n), n >= 2, for wavelength_nm {grid.shape} and ideal_m {ideal.shape}"
            raise InputError("real_m", value=real.shape, expected=expected)
        for name, values in (("wavelength_nm", grid), ("ideal_m", ideal), ("real_m", real)):
            if not np.isfinite(values).all():
                raise InputError(name, value=values.tolist(), expected="finite")
            if (np.diff(values) <= 0).any() or (name != "wavelength_nm" and (values[..., 0] != 0).any()):
                expected = "increasing" if name == "wavelength_nm" else "increasing from 0"
                raise InputError(name, value=values.tolist(), expected=expected)
            object.__setattr__(self, name, values)


@dataclass(frozen=True, eq=False)
class HeightCurve:
    """Real image height as a function of ideal image height at one wavelength, both in m.

    `tabulated` is the curve up to `last_m`, the last tabulated ideal height; beyond, it is straight, with `end_slope`.
    """

    tabulated: Callable[[Any], Any]
    last_m: float
    end_slope: float

    def __call__(self, ideal_m: Array) -> Array:
        inside = np.asarray(self.tabulated(np.minimum(ideal_m, self.last_m)), np.float64)
        return inside + self.end_slope * np.maximum(np.asarray(ideal_m) - self.last_m, 0.0)


def heights_at(mapping: RadialMapping, wavelength_nm: float) -> Array:
    """Return the (n,) real image heights at one wavelength, m."""
    grid = mapping.wavelength_nm
    at = float(np.clip(wavelength_nm, grid[0], grid[-1]))
    if grid.size == 1:
        return np.asarray(mapping.real_m[0], np.float64)
    index = int(np.clip(np.searchsorted(grid, at, side="right") - 1, 0, grid.size - 2))
    share = (at - grid[index]) / (grid[index + 1] - grid[index])
    return np.asarray(mapping.real_m[index] + share * (mapping.real_m[index + 1] - mapping.real_m[index]), np.float64)


def image_height(mapping: RadialMapping, wavelength_nm: float) -> HeightCurve:
    """Return the curve from ideal to real image heights at one wavelength.

    Examples
    --------
    >>> barrel = RadialMapping(np.array([550.0]), np.array([0.0, 5e-3, 10e-3]), np.array([[0.0, 4.95e-3, 9.6e-3]]))
    >>> image_height(barrel, 550.0)(np.array([0.0, 5e-3, 10e-3]))
    array([0.     , 0.00495, 0.0096 ])
    """
    from scipy.interpolate import PchipInterpolator

    ideal, real = mapping.ideal_m, heights_at(mapping, wavelength_nm)
    curve = _odd_spline(ideal, real)
    fractions = np.linspace(0.0, 1.0, _CHECKS_PER_INTERVAL, endpoint=False)
    fine = np.append((ideal[:-1, None] + fractions * np.diff(ideal)[:, None]).ravel(), ideal[-1])
    if (np.diff(curve(fine)) <= 0).any():
        curve = PchipInterpolator(np.concatenate([-ideal[:0:-1], ideal]), np.concatenate([-real[:0:-1], real]))
    end = float(ideal[-1])
    near_end = end - 1e-4 * float(ideal[-1] - ideal[-2])
    return HeightCurve(curve, end, float(curve(end) - curve(near_end)) / (end - near_end))


def _odd_spline(ideal: Array, real: Array) -> Callable[[Any], Any]:
    from scipy.interpolate import CubicSpline

    ratio = real[1:] / ideal[1:]
    if ratio.size == 1:
        return lambda height: height * ratio[0]
    spline = CubicSpline(ideal[1:] ** 2, ratio)
    return lambda height: height * spline(np.square(height))


def inverse_scale(mapping: RadialMapping, wavelength_nm: float, reach_m: float) -> tuple[Array, float]:
    """Return ideal over real image height, evenly spaced in squared real height, and that spacing in m^2.

    The (4097,) values reach from the axis to `reach_m`, the largest real height that is needed.

    Examples
    --------
    >>> smaller = RadialMapping(np.array([550.0]), np.array([0.0, 10e-3]), np.array([[0.0, 8e-3]]))
    >>> scale, step_m2 = inverse_scale(smaller, 550.0, 12e-3)
    >>> scale.round(9).min(), scale.round(9).max()
    (np.float64(1.25), np.float64(1.25))
    """
    curve = image_height(mapping, wavelength_nm)
    far = float(mapping.ideal_m[-1])
    while curve(np.array([far]))[0] < reach_m:  # ends: beyond the table the curve is straight and increases
        far *= 2
    ideal = np.linspace(0.0, far, _CURVE_POINTS)
    step_m2 = reach_m**2 / (_INVERSE_NODES - 1)
    real = np.sqrt(step_m2 * np.arange(1, _INVERSE_NODES))
    scale = np.interp(real, curve(ideal), ideal) / real
    # On the axis the quotient is the derivative. The curve is odd, so the scale is even and flat at its first node.
    first = ideal[1] / curve(ideal[1:2])
    return np.concatenate([first, scale]), step_m2


def wavelength_nodes(
    mapping: RadialMapping, wavelength_nm: Array, reach_m: float, step_m: float
) -> tuple[Array, Array]:
    """Return a few of the (wavelengths,), whose images represent all, and the (nodes, wavelengths) weights on them.

    `reach_m` is the largest ideal image height that is needed. `step_m` is the largest distance between the images of
    neighboring nodes, where it is largest, for linear weights on two nodes. Weights sum to 1 over the nodes; cubic
    ones may be negative.

    Notes
    -----
    Linear weights leave (1 / 8) (2 pi f h)^2 of a wave of frequency f between nodes at the distance h; Lagrange's cubic
    weights on four nodes leave (3 / 128) (2 pi f h)^4. At half a cycle per 5 steps, cubic weights are as good at 2.5
    times the distance, and better at lower frequencies. Whichever needs fewer nodes is used.

    Examples
    --------
    >>> colors = RadialMapping(np.array([400.0, 700.0]), np.array([0, 1e-2]), np.array([[0, 1e-2], [0, 1.0004e-2]]))
    >>> nodes, weights = wavelength_nodes(colors, np.arange(400.0, 701.0, 10), 1e-2, 1e-6)
    >>> nodes, weights.shape
    (array([400., 500., 600., 700.]), (4, 31))
    """
    grid = np.asarray(wavelength_nm, np.float64)
    single = np.array([grid[grid.size // 2]]), np.ones((1, grid.size))
    if mapping.wavelength_nm.size == 1 or grid.size == 1:
        return single
    ideal = np.linspace(0.0, reach_m, 33)
    real = np.stack([image_height(mapping, w)(ideal) for w in grid])
    # Path length of the image from the first wavelength to each; nodes are evenly spaced along it.
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(real, axis=0)).max(axis=1))])
    linear, cubic = (math.ceil(path[-1] / step - 1e-6) + 1 for step in (step_m, _CUBIC_STEP * step_m))
    count = min(linear, max(cubic, 4))
    if count == 1:
        return single
    if count >= grid.size:
        return grid, np.eye(grid.size)
    places = np.linspace(0.0, path[-1], count)
    moving = np.concatenate([[True], np.diff(path) > 0])
    nodes = np.interp(places, path[moving], grid[moving])
    position = np.clip(path / places[1], 0.0, count - 1)
    return nodes, _lagrange_weights(position, count)


def _lagrange_weights(position: Array, count: int) -> Array:
    """Return (count, n) Lagrange weights at positions 0 to count - 1: cubic, or linear for fewer than four nodes."""
    points = 4 if count >= 4 else 2
    first = np.clip(np.floor(position).astype(np.int64) - (points // 2 - 1), 0, count - points)
    weights = np.zeros((count, position.size))
    for own in range(points):
        others = [other for other in range(points) if other != own]
        weight = np.prod([(position - first - other) / (own - other) for other in others], axis=0)
        weights[first + own, np.arange(position.size)] = weight
    return weights
