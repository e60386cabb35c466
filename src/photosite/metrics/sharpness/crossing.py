"""Frequencies at which a response falls to a level."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.values.uncertain import Missing, Uncertain, Value

Array = NDArray[np.float64]

_NEAR = 0.25
"""Relative distance in frequency of the points through which the response is fitted."""
_LEAST_POINTS = 5


def crossing(frequency: Array, response: Array, standard_uncertainty: Array, level: float) -> Value:
    """Return the lowest frequency at which a response of independent points falls to a level, by a local parabola.

    Examples
    --------
    >>> f = np.linspace(0.0, 0.5, 51)
    >>> found = crossing(f, np.exp(-4.0 * f), np.full(51, 0.01), 0.5)
    >>> round(found.value, 3), round(found.standard_uncertainty, 4)
    (0.173, 0.0025)
    """
    smooth = np.convolve(np.pad(response, 1, mode="edge"), np.full(3, 1 / 3), "valid")
    below = np.flatnonzero(smooth < level)
    if not below.size or below[0] == 0:
        ends = f"between {frequency[0]:.2g} and {frequency[-1]:.2g} cycles/pixel" if frequency.size else "anywhere"
        return Missing(f"the response does not fall to {level:g} {ends}")
    middle = frequency[below[0]]
    order = np.argsort(np.abs(frequency - middle))
    near = order[: max(int((np.abs(frequency - middle) < _NEAR * middle).sum()), _LEAST_POINTS)]
    x, y, u = frequency[near] - middle, response[near], np.maximum(standard_uncertainty[near], 1e-12)
    model = np.vander(x, min(3, x.size))
    covariance = np.linalg.inv(model.T @ (model / u[:, None] ** 2))
    fit = covariance @ (model.T @ (y / u**2))
    at: Any = 0.0
    for _ in range(20):  # Newton's method, from the first point below the level
        at -= (np.polyval(fit, at) - level) / np.polyval(np.polyder(fit), at)
    slope = np.polyval(np.polyder(fit), at)
    if not (abs(at) <= _NEAR * 2 * middle and slope < 0):
        return Missing(f"noise hides where the response falls to {level:g}")
    along = at ** np.arange(fit.size - 1, -1, -1)
    return Uncertain.of(float(middle + at), float(np.sqrt(along @ covariance @ along) / -slope))
