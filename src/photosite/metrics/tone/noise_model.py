"""The variance of the noise over the signal, from gray patches, and the signals at which it has a ratio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from photosite.errors import InputError
from photosite.metrics.tone.gray_patches import GrayPatch
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain, Value, combined


@dataclass(frozen=True)
class NoiseModel(Shown):
    """The variance floor + offsets + per_signal S + pattern S^2 of a signal S.

    Parameters
    ----------
    floor, per_signal, pattern
        Without signal, of shot noise, and of the fixed pattern that is proportional to the signal.
    offsets
        Of the fixed pattern without signal; 0 where `floor` includes it.
    limit
        Largest signal that follows the model; the noise of combined captures has steps.

    Examples
    --------
    >>> model = NoiseModel(Uncertain(4.0), Uncertain(1.0), Uncertain(0.0))
    >>> round(model.signal_at(10.0).value, 1), round(model.ratio_db(100.0).value, 2)
    (103.9, 19.83)
    """

    floor: Uncertain
    per_signal: Uncertain
    pattern: Uncertain
    offsets: Uncertain = field(default_factory=lambda: Uncertain(0.0))
    limit: float = math.inf

    @classmethod
    def of(cls, patches: Sequence[GrayPatch], *, several: bool) -> NoiseModel:
        """Return the model of patches that are not clipped; of several frames the fixed pattern is known apart.

        Raises
        ------
        InputError
            If there are too few patches.
        """
        if several:
            (floor, per_signal), used = _polynomial(patches, "temporal", 1)
            offsets, pattern = _fixed(patches[: used or None])
        else:
            (floor, per_signal, pattern), used = _polynomial(patches, "total", 2)
            offsets = Uncertain(0.0)
        limit = math.inf if used == len(patches) else patches[used - 1].mean.value if used else -math.inf
        return cls(floor, per_signal, pattern, offsets, limit)

    @property
    def temporal(self) -> NoiseModel:
        """The model without the fixed pattern."""
        return replace(self, pattern=Uncertain(0.0), offsets=Uncertain(0.0))

    @property
    def fixed(self) -> NoiseModel:
        """The model without the temporal noise, of several frames."""
        return replace(self, floor=Uncertain(0.0), per_signal=Uncertain(0.0))

    def variance(self, signal: float) -> Uncertain:
        """Return the variance of a signal."""
        return self.floor + self.offsets + self.per_signal * signal + self.pattern * signal**2

    def ratio_db(self, signal: float) -> Value:
        """Return 20 log10 of a signal over its noise."""
        variance = self.variance(signal)
        if variance.value <= 0.0:
            return Missing("the variance of the noise is not above 0")
        return (signal / variance.sqrt()).decibel(20.0)

    def signal_at(self, ratio: float) -> Value:
        """Return the signal that is a number of times its noise."""
        square = ratio**2
        rest = 1.0 - square * self.pattern.value
        inside = (square * self.per_signal.value) ** 2 + 4.0 * rest * square * self.variance(0.0).value
        if rest <= 0.0 or inside < 0.0:
            return Missing(f"the fixed pattern keeps the ratio below {ratio:g}")
        signal = (square * self.per_signal.value + math.sqrt(inside)) / (2.0 * rest)
        if signal <= 0.0:
            return Missing("the variance of the noise is not above 0")
        if signal > self.limit:
            return Missing(f"the noise has steps above a signal of {max(self.limit, 0.0):.4g}")
        # Implicit differentiation of S^2 = ratio^2 variance(S).
        steepness = 2.0 * signal * rest - square * self.per_signal.value
        change = self.variance(signal) * (square / steepness)
        return change - change.value + signal


_IN_STEPS = 1e-5
"""Probability of the residuals of a polynomial by chance from which the noise has steps."""


def _polynomial(patches: Sequence[GrayPatch], kind: str, order: int) -> tuple[tuple[Uncertain, ...], int]:
    """Return the coefficients of the variance over the signal, by weighted least squares, and the number of patches.

    All patches are used, or those from the darkest on that a polynomial describes.
    """
    from scipy.special import chdtrc

    pairs = [(patch.mean.value, getattr(patch, kind)) for patch in patches]
    if len(pairs) < order + 2:
        expected = f"{order + 2} or more"
        raise InputError("gray patches that are not clipped", value=len(pairs), expected=expected)
    mean, size, spread = np.array([(x, each.value, each.standard_uncertainty) for x, each in pairs]).T
    for used in range(len(pairs), order + 1, -1):
        x, y = mean[:used], size[:used]
        relative = spread[:used] / np.maximum(y, 1e-300)
        model = np.vander(x, order + 1, increasing=True)
        fitted = y
        for _ in range(10):  # weights from the polynomial, not from the noisy variances
            weight = 1.0 / np.maximum(relative * np.maximum(fitted, y.min() * 0.1), 1e-300) ** 2
            covariance = np.linalg.inv(model.T @ (weight[:, None] * model))
            solver = covariance @ (model.T * weight)
            fitted = model @ (solver @ y)
        found = tuple(combined([each for _, each in pairs[:used]], row) for row in solver)
        if chdtrc(used - order - 1, float(weight @ (y - fitted) ** 2)) > _IN_STEPS:
            return found, used
    return found, 0


def _fixed(patches: Sequence[GrayPatch]) -> tuple[Uncertain, ...]:
    """Return offsets and pattern of the fixed pattern's variance offsets + pattern S^2, by weighted least squares."""
    known = [(patch.mean.value, patch.fixed) for patch in patches if patch.fixed is not None]
    x, spread = np.array([(mean, fixed.standard_uncertainty) for mean, fixed in known]).T
    model = np.stack([np.ones_like(x), x**2], axis=1)
    weight = 1.0 / np.maximum(spread, 1e-300) ** 2
    solver = np.linalg.solve(model.T @ (weight[:, None] * model), model.T * weight)
    # The fixed pattern is what temporal noise leaves: sums of both know that their errors are opposite.
    return tuple(combined([fixed for _, fixed in known], row) for row in solver)


def bright_pattern(patches: Sequence[GrayPatch]) -> Uncertain:
    """Return the variance of the fixed pattern over the square of the signal, from the brightest patches."""
    brightest = [patch for patch in patches if patch.mean.value > 0.2 * patches[-1].mean.value]
    ratios = [patch.fixed / (patch.mean * patch.mean) for patch in brightest if patch.fixed is not None]
    weights = [1.0 / max(ratio.standard_uncertainty, 1e-300) ** 2 for ratio in ratios]
    total = sum(weights)
    return sum((ratio * (weight / total) for ratio, weight in zip(ratios, weights, strict=True)), Uncertain(0.0))
