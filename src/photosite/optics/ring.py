"""Transfer functions of round and ring-shaped pupils whose wavefront depends on the radius alone: real, by quadrature.

Frequencies are over the cutoff 1 / (lambda N).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from photosite.optics.zernike import Term, zernike_values

Array = NDArray[np.float64]


def defocus_transfer(s: Array, waves_at_rim: float) -> Array:
    """Transfer function of a round pupil with the wavefront W r^2.

    Parameters
    ----------
    s
        Frequencies over the cutoff, of any shape.
    waves_at_rim
        W.

    Notes
    -----
    (4 / pi) integral from s to 1 of sqrt(1 - u^2) cos(8 pi W s (u - s)) du (H. H. Hopkins, Proc. R. Soc. A 231 (1955)
    91), taken with u = cos(angle), where it is smooth, by Gauss and Legendre with nodes enough for its oscillations.

    Examples
    --------
    >>> defocus_transfer(np.array([0.0, 0.5, 1.0]), 0.5).round(4)
    array([1.    , 0.0846, 0.    ])
    """
    s = np.minimum(np.abs(s), 1.0)
    nodes, weights = _gauss(32 * (1 + math.ceil(abs(waves_at_rim) / 8)))
    result = np.empty(s.shape)
    flat, out = s.reshape(-1), result.reshape(-1)
    for first in range(0, flat.size, 4096):
        part = flat[first : first + 4096, None]
        reach = np.arccos(part)
        angle = reach * (nodes + 1) / 2
        values = (np.sin(angle) ** 2 * np.cos(8 * math.pi * waves_at_rim * part * (np.cos(angle) - part))) @ weights
        out[first : first + 4096] = (2 / math.pi) * reach[:, 0] * values
    return result


def bare_transfer(s: Array, obscuration: float = 0.0) -> Array:
    """Transfer function of a ring without aberrations: the overlap of two rings over the area of one.

    Parameters
    ----------
    s
        Frequencies over the cutoff, of any shape.
    obscuration
        Inner radius over outer radius.

    Notes
    -----
    E. L. O'Neill, J. Opt. Soc. Am. 46 (1956) 285, written with the overlaps of discs.

    Examples
    --------
    >>> bare_transfer(np.array([0.0, 0.5, 1.0])).round(4), bare_transfer(np.array([0.5]), 0.5).round(4)
    (array([1.   , 0.391, 0.   ]), array([0.2236]))
    """
    s = np.minimum(np.abs(s), 1.0)
    overlap = _lens(2 * s, 1.0, 1.0)
    if obscuration:
        overlap += _lens(2 * s, obscuration, obscuration) - 2 * _lens(2 * s, 1.0, obscuration)
    return overlap / (math.pi * (1 - obscuration**2))


@lru_cache(maxsize=32)
def _gauss(count: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre: finding them costs more than using them."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights


def _lens(distance: Array, large: float, small: float) -> Array:
    """Area that two discs share."""
    d = np.clip(distance, large - small, large + small)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.where(d > 0, (d * d + small**2 - large**2) / (2 * d), 0.0)
        far = np.where(d > 0, (d * d + large**2 - small**2) / (2 * d), 0.0)

    def segment(radius: float, height: Array) -> Array:
        share = np.clip(height / radius, -1.0, 1.0)
        area: Array = radius**2 * (np.arccos(share) - share * np.sqrt(1 - share * share))
        return area

    return segment(small, near) + segment(large, far)


def ring_geometry(s: Array, terms: tuple[Term, ...], obscuration: float, count: int) -> tuple[Array, Array]:
    """Where two copies of a ring overlap, as nodes of a quadrature.

    Parameters
    ----------
    s
        (frequencies,) over the cutoff, 0 to 1: the copies' middles are 2 s apart.
    terms
        (n, 0) of the wavefront.
    obscuration
        Inner radius of the ring.
    count
        Nodes in each direction of each piece of the overlap.

    Returns
    -------
    difference, weight
        (terms, frequencies, nodes) Zernike values of one copy less those of the other, and (frequencies, nodes)
        weights: the transfer function is the sum of weight * cos(2 pi waves . difference).

    Notes
    -----
    A ring is a disc less a disc, so the overlap of two is that of discs of 1 and 1, less twice 1 and the inner radius,
    plus the inner radius and itself.
    """
    pieces = [_overlap(s, 1.0, 1.0, 1.0, count)]
    if obscuration:
        pieces.append(_overlap(s, 1.0, obscuration, -2.0, count))
        pieces.append(_overlap(s, obscuration, obscuration, 1.0, count))
    x, y, weight = (np.concatenate([p[k] for p in pieces], axis=1) for k in range(3))
    near, far = np.hypot(x - s[:, None], y), np.hypot(x + s[:, None], y)
    difference = zernike_values(terms, far, np.zeros_like(far)) - zernike_values(terms, near, np.zeros_like(near))
    return difference, weight / (math.pi * (1 - obscuration**2))


def ring_transfer(s: Array, waves: dict[Term, float], obscuration: float, count: int) -> Array:
    """(frequencies,) transfer function of a ring with a wavefront of terms (n, 0); see `ring_geometry`.

    Examples
    --------
    >>> ring_transfer(np.array([0.0, 0.5]), {(2, 0): 0.5 / math.sqrt(12)}, 0.0, 24).round(4)
    array([1.    , 0.0846])
    """
    difference, weight = ring_geometry(s, tuple(waves), obscuration, count)
    phase = 2 * math.pi * np.tensordot(np.array(list(waves.values())), difference, 1)
    result: Array = (weight * np.cos(phase)).sum(axis=1)
    return result


def _overlap(s: Array, large: float, small: float, factor: float, count: int) -> tuple[Array, Array, Array]:
    """x, y and weights, (frequencies, nodes), over a disc at -s and a smaller one at s.

    Rows are at y = small sin(angle), where chords are smooth. Up to the corners where the circles meet a row ends on
    the large disc; beyond, if the small disc's middle is inside, on the small one. The lower half equals the upper.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        meet = np.where(s > 0, ((2 * s) ** 2 + small**2 - large**2) / (4 * s), 0.0 if large == small else -np.inf)
    corner = np.where(np.abs(meet) < small, np.arccos(np.clip(np.abs(meet) / small, 0, 1)), 0.0)
    nodes, weights = _gauss(count)
    nodes, weights = (nodes + 1) / 2, weights / 2
    pieces = []
    for on_large, begin, end in (
        (True, np.zeros_like(s), corner),
        (False, corner, np.where(meet < 0, math.pi / 2, corner)),
    ):
        angle = begin[:, None] + (end - begin)[:, None] * nodes
        half = small * np.cos(angle)
        y = small * np.sin(angle)
        low = s[:, None] - half
        other = np.sqrt(np.maximum(large**2 - y**2, 0.0)) - s[:, None]
        length = np.maximum((other if on_large else s[:, None] + half) - low, 0.0)
        x = low[..., None] + length[..., None] * nodes
        weight = (2 * factor * (end - begin)[:, None] * weights * half * length)[..., None] * weights
        pieces.append((x, np.broadcast_to(y[..., None], x.shape), weight))
    return tuple(np.concatenate([p[k].reshape(s.size, -1) for p in pieces], axis=1) for k in range(3))  # type: ignore[return-value]
