"""Light levels whose stated light contradicts the other levels: a lamp, a shutter or a list that is wrong for a few.

The stated light per DN is a smooth function of the signal, whatever the response: a straight one, a bent one, or one
with an offset. A polynomial through it, found without the few levels that fit worst, predicts the light of each of
them from its signal. Errors are errors of the light, so that a level that is far off does not pull the curve.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.photon_transfer.photon_transfer import LightLevels, find_saturation, linear_levels
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.values.diagnostic import DiagnosticKind, one_in

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LightOutlier:
    """A level whose stated light contradicts the others.

    Parameters
    ----------
    group
        Index of its light group.
    stated_over_expected
        Stated light, over the light at which the other levels have this signal.
    """

    group: int
    stated_over_expected: float


def find_light_outliers(channels: Sequence[LightLevels], whites: Sequence[int]) -> list[LightOutlier]:
    """Return the levels whose stated light contradicts the others in any channel, by group.

    The levels of the linear range are compared first, then those up to saturation. At least four levels are needed.
    A deviation is found beyond chance (Student's t with the freedom of the scatter of the others, divided among the
    levels by Bonferroni) and above `LEAST_DEVIATION`. The brightest levels also deviate where the response bends; they
    are outliers only if their temporal variance shows no bend.

    Parameters
    ----------
    channels
        The light levels of each channel.
    whites
        Number at which each channel is clipped, DN.
    """
    found: dict[int, float] = {}
    for levels, white in zip(channels, whites, strict=True):
        for place, deviation in _channel_outliers(levels, white).items():
            group = int(levels.group[place])
            found[group] = max(found.get(group, 1.0), deviation, key=lambda ratio: abs(math.log(ratio)))
    return [LightOutlier(group, found[group]) for group in sorted(found)]


OUTLIER_P_VALUE = 1e-4
"""Fraction of sets of levels, of one channel and range, in which a level may be taken for an outlier."""


LIGHT_OUTLIERS = DiagnosticKind(
    "wrong-light-levels",
    "warning",
    "The stated light of a few levels contradicts the others.",
    "They were left out of responsivity, linearity, PRNU and saturation exposure; only their noise was used.",
    "Check lamp, shutter and the list of levels.",
    ("responsivity_*", "quantum_efficiency_*", "linearity_*", "prnu*", "saturation_capacity_photons"),
    "stated light of the worst level over the light that its signal shows",
    f"below {one_in(OUTLIER_P_VALUE)} sets of levels of one channel",
)


def outlier_warning(lights: Sequence[GroupStatistics], outliers: Sequence[LightOutlier]) -> str:
    """Return the warning that lists the outliers."""
    listed = "; ".join(
        f"{lights[outlier.group].label}: {_fraction(outlier.stated_over_expected)}" for outlier in outliers
    )
    return (
        f"the stated light of {len(outliers)} of {len(lights)} levels contradicts the others ({listed}); they were "
        f"left out of responsivity, linearity, PRNU and saturation exposure, and only their noise was used; check "
        f"lamp, shutter and the list of levels"
    )


def _fraction(ratio: float) -> str:
    if 0.5 < ratio < 2.0:
        return f"{100.0 * abs(ratio - 1.0):.2g} % {'more' if ratio > 1.0 else 'less'} than their signal shows"
    return f"{ratio:.3g} times what their signal shows"


LEAST_SIGNAL = 0.02
"""Signal, as a fraction of the brightest, below which stray light hides the proportion."""
HIGHEST_SIGNAL = 0.95
"""Signal, as a fraction of that at the largest variance, up to which levels are compared."""
ORDER_FACTOR = 1.2
"""Factor by which the light of a level too dim or too bright to be compared may be out of order."""


def _channel_outliers(levels: LightLevels, white: int) -> dict[int, float]:
    """Return stated over expected light of the outliers of a channel, by their place."""
    order = np.argsort(levels.signal, kind="stable")
    by_signal = levels.take(order)  # with a wrong light, the order by light is not that of the signal
    saturation = find_saturation(by_signal, white)
    usable = ~by_signal.clipped & (by_signal.x > 0.0) & (by_signal.signal > 0.0)
    usable &= by_signal.signal > LEAST_SIGNAL * by_signal.signal[usable].max(initial=0.0)
    below = usable.copy()
    if saturation.signal is not None:
        below &= by_signal.signal <= HIGHEST_SIGNAL * saturation.signal
    found: dict[int, float] = {}
    for inside in (usable & linear_levels(by_signal, saturation), below):
        places = np.array([i for i in np.flatnonzero(inside) if i not in found], dtype=np.intp)
        found |= {int(places[i]): ratio for i, ratio in _outliers(by_signal.take(places)).items()}
    trusted = below.copy()
    trusted[list(found)] = False
    if trusted.any():
        # A dim or saturated level is only known to have less or more light than all that were compared.
        x, signal = by_signal.x, by_signal.signal
        low, high = x[trusted].min(), x[trusted].max()
        dimmer = (signal < signal[trusted].min()) & (x > ORDER_FACTOR * low) & ~below
        brighter = (signal > signal[trusted].max()) & (ORDER_FACTOR * x < high) & (x > 0.0) & ~below
        found |= {int(i): float(x[i] / low) for i in np.flatnonzero(dimmer)}
        found |= {int(i): float(x[i] / high) for i in np.flatnonzero(brighter)}
    return {int(order[i]): ratio for i, ratio in found.items()}


LEAST_LEVELS = 4
"""Levels below which no outlier can be found."""
LEAST_DEVIATION = 0.005
"""Relative deviation below which the scatter of lamp and shutter explains a level, and the fits allow for it."""
MOST_OUTLIERS = 3
"""Outliers at most; they are also at most a quarter of the levels, and two of more than `MANY_LEVELS` levels."""
MANY_LEVELS = 60
"""Levels above which trying all sets of three takes too long."""
_POWERS = (0, 1, 2, -1)
"""Powers of the signal in light per DN: proportion, bends, and an offset of the signal, from stray light."""


def _outliers(levels: LightLevels) -> dict[int, float]:
    """Return stated over expected light of the outliers among levels sorted by signal, by their place."""
    n = len(levels.x)
    if n < LEAST_LEVELS:
        return {}
    terms = 1 if n < 5 else 2 if n < 7 else min(n - 4, len(_POWERS))
    per_dn, signal = levels.x / levels.signal, levels.signal
    per_dn = per_dn / np.median(per_dn)
    uncertainty = np.sqrt(np.diag(levels.signal_covariance)) / signal
    design = np.stack([(signal / signal.max()) ** power for power in _POWERS[:terms]], axis=1)
    for count in range(min(MOST_OUTLIERS if n <= MANY_LEVELS else 2, n // 4), 0, -1):
        freedom = n - count - terms
        if freedom < (2 if count == 1 else 3):
            continue
        worst = _worst(design, per_dn, uncertainty, count)
        left = np.setdiff1d(np.arange(n), worst)
        fit = fit_linear(design[left], per_dn[left], np.diag(uncertainty[left] ** 2))
        expected = design @ fit.parameters
        if not (expected > 0.0).all():
            continue
        scale = 1.0 if fit.extra_variance > 0.0 else max(1.0, math.sqrt(fit.chi_square / freedom))
        spread = np.einsum("ij,jk,ik->i", design, fit.covariance, design) + fit.extra_variance + uncertainty**2
        limit = -float(stdtrit(freedom, OUTLIER_P_VALUE / (2.0 * (n - count + 1)))) * scale * np.sqrt(spread)
        # Beyond the other levels the curve may go on differently: by as much as its highest power matters there.
        simple = np.delete(design, min(terms, 3) - 1, axis=1) if terms > 1 else design
        other = simple @ fit_linear(simple[left], per_dn[left], np.diag(uncertainty[left] ** 2)).parameters
        outside = (np.arange(n) < left.min()) | (np.arange(n) > left.max())
        limit += np.where(outside, np.abs(other - expected), 0.0)
        ratio = per_dn / expected
        # Rosner's test of several outliers: the least of them, against the scatter without any of them.
        beyond = (np.abs(per_dn - expected) > limit) & (np.abs(np.log(ratio)) > LEAST_DEVIATION)
        if beyond[worst].all():
            bent = _bent(levels, left, worst, ratio)
            return {int(i): float(ratio[i]) for i in worst if i not in bent}
    return {}


def _worst(design: Array, y: Array, uncertainty: Array, count: int) -> NDArray[np.intp]:
    """Return the places of the points without which the others fit best."""
    weight = 1.0 / np.sqrt(uncertainty**2 + np.median(uncertainty) ** 2)
    orthogonal, _ = np.linalg.qr(design * weight[:, None])
    scaled = y * weight
    residual = scaled - orthogonal @ (orthogonal.T @ scaled)
    left = np.eye(len(y)) - orthogonal @ orthogonal.T
    chosen = np.array(list(combinations(range(len(y)), count)))
    # What the sum of squares loses without these points: e' (1 - H)^-1 e, with the hat matrix H.
    reduced = left[chosen[:, :, None], chosen[:, None, :]] + 1e-9 * np.eye(count)
    lost = np.einsum("ij,ij->i", residual[chosen], np.linalg.solve(reduced, residual[chosen][..., None])[..., 0])
    return np.asarray(chosen[int(lost.argmax())])


LEAST_OF_CURVE = 8
"""Levels from which the variance over the signal is compared with a parabola, not a straight line."""


def _bent(levels: LightLevels, left: NDArray[np.intp], worst: NDArray[np.intp], ratio: Array) -> list[int]:
    """Return the outliers that may belong to a bend: neighbors of each other, and those at either end.

    A bend changes the local slope of the response, and the temporal variance by the square of it; a wrong light does
    not. The variance of an outlier over its signal is compared with the curve through those of the others.
    """
    first, last = int(left.min()), int(left.max())
    known = left[levels.repeated[left]]
    suspects = [int(i) for i in worst if not first < i < last or np.any(np.abs(worst - i) == 1)]
    if not suspects or len(known) < 3:
        return suspects
    terms = 2 if len(known) < LEAST_OF_CURVE else 3
    design = np.stack([(levels.signal / levels.signal.max()) ** power for power in range(terms)], axis=1)
    per_dn = levels.shot / levels.signal
    variance = np.diag(levels.shot_covariance) / levels.signal**2
    fit = fit_linear(design[known], per_dn[known], np.diag(variance[known]))
    expected = design @ fit.parameters
    spread = np.sqrt(np.einsum("ij,jk,ik->i", design, fit.covariance, design) + fit.extra_variance + variance)
    for i in suspects:
        change = abs(math.log(ratio[i]))
        step, expected_step = levels.x[i] - levels.x[last], levels.x[i] / ratio[i] - levels.x[last]
        if i > last and step > 0.0 and expected_step > 0.0:
            change = abs(2.0 * math.log(expected_step / step) + math.log(ratio[i]))
        if not abs(per_dn[i] - expected[i]) + 2.0 * spread[i] < 0.5 * change * expected[i]:
            return suspects
    return []
