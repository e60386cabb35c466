"""Draws from a normal distribution truncated at zero, by exact Hamiltonian Monte Carlo.

A. Pakman and L. Paninski, "Exact Hamiltonian Monte Carlo for truncated multivariate Gaussians", J. Comput. Graph.
Stat. 23 (2014) 518. Under a normal density the motion is a harmonic oscillation with a closed form. It is followed for
a quarter of its period, and reflected at each wall, the plane at which an entry is 0. Every draw is accepted.
"""

from __future__ import annotations

import math

import numpy as np

from photosite.engine.jit import F64, compiled

_MOST_HITS = 1_000_000
"""Largest number of reflections in one draw."""

_MARGIN = 0.1
"""Distance of the chain's start from each wall, in standard deviations."""


def positive_normal_draws(mean: F64, factor: F64, momenta: F64) -> F64:
    """Return draws of a normal vector, given that none of its entries is negative.

    - `mean`: (d,) of the normal distribution before truncation.
    - `factor`: (d, d) with factor @ factor.T its covariance, of full rank.
    - `momenta`: (n, d) independent standard normal numbers, one row per draw.

    Returns (n, d) the chain. It starts near the mode, so the first draws are not yet representative.

    Raises `ArithmeticError` if a draw has too many reflections, because walls are too close to each other.

    Examples
    --------
    >>> momenta = np.random.default_rng(0).standard_normal((20_000, 1))
    >>> half = positive_normal_draws(np.zeros(1), np.eye(1), momenta)
    >>> bool(abs(half.mean() - np.sqrt(2 / np.pi)) < 0.02)
    True
    """
    walls = np.ascontiguousarray(factor, np.float64)
    offset = np.asarray(mean, np.float64)
    out = np.empty((len(momenta), mean.size))
    if not _chain(walls, walls @ walls.T, offset, _inside(walls, offset), np.ascontiguousarray(momenta), out):
        raise ArithmeticError(f"a draw has more than {_MOST_HITS} reflections")
    return np.asarray(out @ factor.T + mean)


def _inside(walls: F64, offset: F64) -> F64:
    """Return (d,) the whitened point of highest density at least a tenth of a standard deviation from every wall.

    Least distance under linear inequalities, by non-negative least squares (C. L. Lawson and R. J. Hanson, "Solving
    Least Squares Problems", 1974, chapter 23). A chain that starts far away keeps that energy for many draws.
    """
    from scipy.optimize import nnls

    norm = np.linalg.norm(walls, axis=1)
    bounds = _MARGIN - offset / norm
    if (bounds <= 0).all():
        return np.zeros(offset.size)
    system = np.vstack([(walls / norm[:, None]).T, bounds])
    target = np.zeros(offset.size + 1)
    target[-1] = 1.0
    fractions, _ = nnls(system, target, maxiter=100 * offset.size)
    residual = system @ fractions - target
    return np.asarray(-residual[:-1] / residual[-1])


@compiled()
def _chain(walls: F64, products: F64, offset: F64, place: F64, momenta: F64, out: F64) -> bool:
    """Compute whitened draws z with walls @ z + offset >= 0, one per row of `out`; false after too many reflections."""
    count, size = momenta.shape
    at = place.copy()
    velocity = np.empty(size)
    for draw in range(count):
        velocity[:] = momenta[draw]
        height, climb = walls @ at, walls @ velocity
        left = math.pi / 2
        hit = 0
        for _ in range(_MOST_HITS):
            hit, when = -1, left
            for wall in range(size):
                # height cos t + climb sin t + offset = swing cos(t + phase) + offset; the wall is met while this falls.
                swing = math.hypot(height[wall], climb[wall])
                if swing > abs(offset[wall]):
                    moment = math.acos(-offset[wall] / swing) - math.atan2(-climb[wall], height[wall])
                    if moment < 0.0:
                        moment += 2 * math.pi
                    if moment < when:
                        hit, when = wall, moment
            sine, cosine = math.sin(when), math.cos(when)
            for k in range(size):
                at[k], velocity[k] = at[k] * cosine + velocity[k] * sine, velocity[k] * cosine - at[k] * sine
                height[k], climb[k] = height[k] * cosine + climb[k] * sine, climb[k] * cosine - height[k] * sine
            if hit < 0:
                break
            left -= when
            turn = 2.0 * climb[hit] / products[hit, hit]
            for k in range(size):
                velocity[k] -= turn * walls[hit, k]
                climb[k] -= turn * products[hit, k]
        if hit >= 0:
            return False
        out[draw] = at
    return True
