"""Flat fields at which part of the pixels are full, below the full scale of the converter.

The noise of full pixels is cut off, so that the temporal variance falls below that of the other levels at once. A bend
of the response, and noise that pixels share, change the ratio of variance to signal steadily.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtri, stdtrit

from photosite.calibration.photon_transfer.photon_transfer import Array, LightLevels
from photosite.values.diagnostic import DiagnosticKind, one_in

MOST_LEVELS = 3
"""Levels that may be partly full; with more, the largest variance is passed, which is saturation."""

LEAST_OTHERS = 3
"""Other levels that the line through the ratios needs: one more than it has parameters."""

MANY_OTHERS = 6
"""Other levels from which a parabola through the ratios takes the place of the line: it follows a bend of the response
that grows with the third power."""

LEAST_FALLS = 0.07, 0.02
"""Least fall of the variance below the line, and below the parabola, which bends explain less: 5 and 1.5 % of numbers
at the well."""

P_VALUE = 1e-6
"""Fraction of sets without full wells that are reported."""

FULL_WELLS = DiagnosticKind(
    "partly-full-wells",
    "warning",
    "The temporal variance of the brightest flat fields is far below that of the others, relative to the signal.",
    "Some pixels are full there, below the full scale of the converter. These levels were left out.",
    "Nothing for the gain; take brighter flat fields too, for the saturation capacity.",
    ("saturation_*", "system_gain_dn_per_e", "prnu*"),
    "fall of the variance at the brightest level, relative",
    f"below {one_in(P_VALUE)} sets",
)


def full_wells(levels: LightLevels) -> tuple[NDArray[np.intp], float]:
    """Return the levels at which pixels are full, dimmest first, and the relative fall of the variance at the last.

    Levels that are clipped by the converter, or have one frame, are passed over.
    """
    inside = np.flatnonzero(levels.repeated & ~levels.clipped & (levels.signal > 0.0))
    order = inside[np.argsort(levels.signal[inside])]
    signal, ratio = levels.signal[order], levels.shot[order] / levels.signal[order]
    covariance = levels.shot_covariance[np.ix_(order, order)] / np.outer(signal, signal)
    for count in range(1, min(MOST_LEVELS, len(order) - LEAST_OTHERS) + 1):
        expected, limit = _extrapolated(signal, ratio, covariance, len(order) - count)
        fall = expected - ratio[-count:]
        if (fall > np.maximum(limit, LEAST_FALLS[len(order) - count >= MANY_OTHERS] * expected)).all():
            return order[-count:], float(fall[-1] / expected[-1])
    return order[:0], 0.0


def _extrapolated(signal: Array, ratio: Array, covariance: Array, known: int) -> tuple[Array, Array]:
    """Return the ratios of the levels from `known` on by the curve through the others, and the limit of their distance.

    Where the others scatter beyond chance about the curve, their scatter counts, by Student's t.
    """
    design = np.vander(signal / signal[-1], 2 + (known >= MANY_OTHERS), increasing=True)
    weights = np.linalg.inv(covariance[:known, :known])
    inner = np.linalg.inv(design[:known].T @ weights @ design[:known])
    gain = design[known:] @ inner @ design[:known].T @ weights
    left = ratio[:known] - design[:known] @ inner @ design[:known].T @ weights @ ratio[:known]
    away = np.column_stack([-gain, np.eye(len(signal) - known)])
    uncertainty = np.sqrt(np.diag(away @ covariance @ away.T))
    freedom, square = known - design.shape[1], float(left @ weights @ left)
    if square <= float(chdtri(freedom, 0.01)):
        return gain @ ratio[:known], -float(ndtri(P_VALUE)) * uncertainty
    return gain @ ratio[:known], float(stdtrit(freedom, 1.0 - P_VALUE)) * np.sqrt(square / freedom) * uncertainty
