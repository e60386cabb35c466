"""OTFs of circular and annular pupils with rotationally symmetric wavefronts, by quadrature.

Frequencies are relative to the cutoff 1 / (lambda N). The OTF is real.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.optics.zernike import Term, zernike_values

Array = NDArray[np.float64]
Waves = dict[Term, float]
"""Zernike coefficients, each the RMS of its term over the full circle, in waves."""

LARGEST_ANNULAR_SLOPE = 12.0
"""Slope, waves per pupil radius, up to which the quadrature is faster than Fourier transforms."""
_SLOPE_LEVELS = (1.0, 2.0, 3.0, 4.5, 6.0, 9.0, LARGEST_ANNULAR_SLOPE)
"""Slopes at which the numbers of frequencies and quadrature nodes step up."""


def defocused_otf(s: Array, waves_at_rim: float) -> Array:
    """Return the OTF of a circular pupil with the wavefront W r^2, W in waves, at frequencies of any shape.

    (4 / pi) integral from s to 1 of sqrt(1 - u^2) cos(8 pi W s (u - s)) du (H. H. Hopkins, Proc. R. Soc. A 231 (1955)
    91). The substitution u = cos(angle) makes it smooth; Gauss-Legendre nodes are enough for its oscillations.

    Examples
    --------
    >>> defocused_otf(np.array([0.0, 0.5, 1.0]), 0.5).round(4)
    array([1.    , 0.0846, 0.    ])
    """
    s = np.minimum(np.abs(s), 1.0)
    nodes, weights = _gauss_legendre(32 * (1 + math.ceil(abs(waves_at_rim) / 8)))
    result = np.empty(s.shape)
    flat, out = s.reshape(-1), result.reshape(-1)
    for first in range(0, flat.size, 4096):
        part = flat[first : first + 4096, None]
        end = np.arccos(part)
        angle = end * (nodes + 1) / 2
        values = (np.sin(angle) ** 2 * np.cos(8 * math.pi * waves_at_rim * part * (np.cos(angle) - part))) @ weights
        out[first : first + 4096] = (2 / math.pi) * end[:, 0] * values
    return result


def aberration_free_otf(s: Array, obscuration: float = 0.0) -> Array:
    """Return the OTF of an annulus without aberrations: the overlap of two annuli over the area of one.

    See E. L. O'Neill, J. Opt. Soc. Am. 46 (1956) 285. `obscuration` is the inner radius over the outer radius.

    Examples
    --------
    >>> aberration_free_otf(np.array([0.0, 0.5, 1.0])).round(4), aberration_free_otf(np.array([0.5]), 0.5).round(4)
    (array([1.   , 0.391, 0.   ]), array([0.2236]))
    """
    s = np.minimum(np.abs(s), 1.0)
    overlap = _disc_overlap(2 * s, 1.0, 1.0)
    if obscuration:
        overlap += _disc_overlap(2 * s, obscuration, obscuration) - 2 * _disc_overlap(2 * s, 1.0, obscuration)
    return overlap / (math.pi * (1 - obscuration**2))


class AnnularOtf:
    """OTFs of one annular pupil, tabulated over frequency for each wavefront."""

    def __init__(self, obscuration: float) -> None:
        self._obscuration = obscuration
        self._quadratures: dict[tuple[tuple[Term, ...], float], tuple[Array, Array, Array]] = {}
        self._splines: dict[tuple[tuple[Term, float], ...], Callable[[Array], Array]] = {}

    def at(self, s: Array, waves: Waves, slope: float) -> Array:
        """Return the OTF at relative frequencies for a wavefront of terms (n, 0) with a largest slope."""
        key = tuple(waves.items())
        if key not in self._splines:
            self._splines[key] = self._change_spline(waves, slope)
        return aberration_free_otf(s, self._obscuration) + self._splines[key](np.minimum(s, 1.0))

    def _change_spline(self, waves: Waves, slope: float) -> Callable[[Array], Array]:
        """Return a spline of the change that the wavefront makes; wavelengths share the quadrature."""
        from scipy.interpolate import CubicSpline

        level = next(n for n in _SLOPE_LEVELS if slope <= n)
        key = (tuple(waves), level)
        if key not in self._quadratures:
            s = np.linspace(0.0, 1.0, (321 if self._obscuration else 161) + math.ceil(16 * level))
            nodes = 10 + math.ceil(1.3 * level)
            self._quadratures[key] = (s, *overlap_quadrature(s, tuple(waves), self._obscuration, nodes))
        s, difference, weight = self._quadratures[key]
        phase = 2 * math.pi * np.tensordot(np.array(list(waves.values())), difference, 1)
        # cos(p) - 1 = -2 sin(p / 2)^2 keeps full precision for small changes.
        change = -2 * (weight * np.sin(phase / 2) ** 2).sum(axis=1)
        result: Callable[[Array], Array] = CubicSpline(s, change)
        return result


def overlap_quadrature(s: Array, terms: tuple[Term, ...], obscuration: float, count: int) -> tuple[Array, Array]:
    """Return quadrature nodes and weights over the overlap of two shifted annuli.

    An annulus is a disc less a disc. The overlap of two annuli is therefore that of discs of radius 1 and 1, less twice
    that of 1 and the inner radius, plus that of the inner radius and itself.

    Parameters
    ----------
    s
        (frequencies,) relative to the cutoff, 0 to 1: the centers of the copies are 2 s apart.
    terms
        Terms (n, 0) of the wavefront.
    obscuration
        Inner radius of the annulus.
    count
        Nodes in each direction of each piece of the overlap.

    Returns
    -------
    difference, weight
        (terms, frequencies, nodes) Zernike values of one copy less those of the other, and (frequencies, nodes): the
        OTF is the sum of weight * cos(2 pi waves . difference).
    """
    pieces = [_disc_quadrature(s, 1.0, 1.0, 1.0, count)]
    if obscuration:
        pieces.append(_disc_quadrature(s, 1.0, obscuration, -2.0, count))
        pieces.append(_disc_quadrature(s, obscuration, obscuration, 1.0, count))
    x, y, weight = (np.concatenate([p[k] for p in pieces], axis=1) for k in range(3))
    near, far = np.hypot(x - s[:, None], y), np.hypot(x + s[:, None], y)
    difference = zernike_values(terms, far, np.zeros_like(far)) - zernike_values(terms, near, np.zeros_like(near))
    return difference, weight / (math.pi * (1 - obscuration**2))


@lru_cache(maxsize=32)
def _gauss_legendre(count: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights


def _disc_overlap(distance: Array, large: float, small: float) -> Array:
    """Return the area that two discs share."""
    d = np.clip(distance, large - small, large + small)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.where(d > 0, (d * d + small**2 - large**2) / (2 * d), 0.0)
        far = np.where(d > 0, (d * d + large**2 - small**2) / (2 * d), 0.0)
    return _segment(small, near) + _segment(large, far)


def _segment(radius: float, height: Array) -> Array:
    """Return the area of a disc beyond a chord at a height from its center."""
    cosine = np.clip(height / radius, -1.0, 1.0)
    return radius**2 * (np.arccos(cosine) - cosine * np.sqrt(1 - cosine * cosine))


def _disc_quadrature(s: Array, large: float, small: float, factor: float, count: int) -> tuple[Array, Array, Array]:
    """Return x, y and weights, (frequencies, nodes), over the overlap of a disc at -s and a smaller one at s.

    Rows are at y = small sin(angle), where chords are smooth. Up to the corners where the circles meet, a row ends on
    the large disc; beyond, if the small disc's center is inside, on the small one. The lower half equals the upper.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        meet = np.where(s > 0, ((2 * s) ** 2 + small**2 - large**2) / (4 * s), 0.0 if large == small else -np.inf)
    corner = np.where(np.abs(meet) < small, np.arccos(np.clip(np.abs(meet) / small, 0, 1)), 0.0)
    nodes, weights = _gauss_legendre(count)
    nodes, weights = (nodes + 1) / 2, weights / 2
    pieces = []
    full = np.where(meet < 0, math.pi / 2, corner)
    for on_large, begin, end in ((True, np.zeros_like(s), corner), (False, corner, full)):
        angle = begin[:, None] + (end - begin)[:, None] * nodes
        half = small * np.cos(angle)
        y = small * np.sin(angle)
        low = s[:, None] - half
        other = np.sqrt(np.maximum(large**2 - y**2, 0.0)) - s[:, None]
        length = np.maximum((other if on_large else s[:, None] + half) - low, 0.0)
        x = low[..., None] + length[..., None] * nodes
        weight = (2 * factor * (end - begin)[:, None] * weights * half * length)[..., None] * weights
        pieces.append((x, np.broadcast_to(y[..., None], x.shape), weight))
    x, y, weight = (np.concatenate([p[k].reshape(s.size, -1) for p in pieces], axis=1) for k in range(3))
    return x, y, weight
