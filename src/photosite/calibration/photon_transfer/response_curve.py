"""System gain at small signal and response curve, together, from the means and variances of the light levels.

With e the electrons, y the signal, K the gain at small signal and H a shape of the response with H(0) = 0,

    e = (y / K) exp(H),    shot variance = (dy/de)^2 e = K y exp(-H) / (1 + y H')^2.

H(0) = 0 makes K the slope of the signal at small signal. The means of the light levels give a shape H_L
(`response_shape`), sqrt(2 e) times more precisely than variances could. But non-linear light (lamp, shutter) bends
means as well, and leaves the variances those of a straight response. So the shape of the sensor is

    H = fraction H_L + own y,

where the variances determine the fraction, between about 0 (all of it is the light) and 1 (all of it is the sensor),
and a bend of the sensor's own, which another one of the light hides from the means. Both have wide normal priors. Where
the variances cannot tell sensor from light, the uncertainty of K covers both (docs/theory/estimators.md).

Read noise that enters before the bend is scaled by (dy/de / K)^2 like the shot noise; read noise that enters after it
is not. Half of its change is taken, with an uncertainty of the same size, because frames do not show which it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.calibration.photon_transfer.photon_transfer import GainFit, LightLevels, effect_of_darks, fit_gain
from photosite.calibration.photon_transfer.response_shape import (
    SHOWING_LEVELS,
    ResponseShape,
    constant_light,
    find_shape,
)
from photosite.calibration.withheld import WRONG_PROPORTION
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.block_diagonal import block_diagonal
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Source, Uncertain

Array = NDArray[np.float64]


LARGEST_BEND = math.log(2.0)
"""Largest H_L that is fitted; beyond it the gain is withheld."""


@dataclass(frozen=True, eq=False)
class ResponseCurve(Shown):
    """The response of one channel: electrons against signal.

    Parameters
    ----------
    gain
        System gain at small signal, DN/e-.
    signal_dn
        (n,) signals of all light levels, and that of fully clipped pixels last if it is known.
    bend
        (n,) H: logarithm of the electrons over those of a straight response with the gain at small signal.
    slope
        (n,) y H'.
    shape
        The shape of the means; None where they are straight.
    """

    gain: Uncertain
    signal_dn: Array
    bend: tuple[Uncertain, ...]
    slope: tuple[Uncertain, ...]
    shape: ResponseShape | None

    @property
    def electrons(self) -> tuple[Uncertain, ...]:
        """(n,) electrons at each signal."""
        return tuple(self.stretch(i) * float(y) / self.gain for i, y in enumerate(self.signal_dn))

    def light_bend(self, level: int) -> Uncertain:
        """Return the part of the bend of the means at a level that is not the sensor's."""
        if self.shape is None:
            return self.bend[level] * -1.0
        spread = math.sqrt(max(float(self.shape.covariance[level, level]), 0.0))
        return Uncertain.of(float(self.shape.bend[level]), spread) - self.bend[level]

    def stretch(self, level: int) -> Uncertain:
        """Return the electrons at a level over those of a straight response."""
        return self.bend[level].apply(math.exp, math.exp)

    @property
    def deviation_percent(self) -> tuple[Uncertain, ...]:
        """(n,) deviation of each signal from that of a straight response with the gain, percent."""
        return tuple(100.0 / self.stretch(i) - 100.0 for i in range(len(self.signal_dn)))

    @property
    def light_deviation_percent(self) -> tuple[Uncertain, ...]:
        """(n,) deviation of each signal that is due to the light, not in proportion to what is stated, percent."""
        light_bends = (self.light_bend(i) for i in range(len(self.signal_dn)))
        return tuple(100.0 / part.apply(math.exp, math.exp) - 100.0 for part in light_bends)

    def to_dict(self) -> dict[str, Any]:
        """Return signals, electrons, and deviations of sensor and light, each with its standard uncertainty."""
        entries: dict[str, Any] = {"signal_dn": self.signal_dn.tolist()}
        for name in ("electrons", "deviation_percent", "light_deviation_percent"):
            values = getattr(self, name)
            entries[name] = [part.value for part in values]
            entries[f"{name}_uncertainty"] = [part.standard_uncertainty for part in values]
        return entries

    def contrast(self, level: int) -> Uncertain:
        """Return relative change of electrons over that of the signal at a level: 1 + y H'."""
        return self.slope[level] + 1.0

    def responsivity(self, levels: LightLevels, used: NDArray[np.bool_]) -> Uncertain:
        """Return the slope through the origin of the straightened signal, y exp(H), against the light.

        Where the light bends, the slope at small signal differs from it. The difference is added to the uncertainty.
        """
        bend = np.array([self.bend[i].value for i in np.flatnonzero(used)])
        slope = np.array([self.slope[i].value for i in np.flatnonzero(used)])
        straight = levels.signal[used] * np.exp(bend)
        scale = np.exp(bend) * (1.0 + slope)
        covariance = levels.signal_covariance[np.ix_(used, used)] * np.outer(scale, scale)
        fit = fit_linear(levels.x[used][:, None], straight, covariance)
        (value,) = fit.uncertain
        weights = fit.estimator[0] * straight
        for i, weight in zip(np.flatnonzero(used), weights, strict=True):
            value += (self.bend[i] - self.bend[i].value) * float(weight)
        if self.shape is not None:
            value += Uncertain.of(0.0, abs(math.exp(-self.shape.offset) - value.value))
        return value


@dataclass(frozen=True, eq=False)
class BentGain:
    """The gain at small signal of some channels, DN/e-, and the response curve of each."""

    fit: GainFit
    gain: Uncertain
    curves: tuple[ResponseCurve, ...]

    def in_noise_alone(self) -> BentGain:
        """Return straight curves whose uncertainty contains the bend, which the means do not show.

        Noise that does not grow with the signal (brighter-fatter effect) is more likely than light that hides the bend
        of a sensor from the means.
        """
        source = Source()
        curves = tuple(
            replace(
                curve,
                bend=tuple(Uncertain(0.0, {source: part.value}) for part in curve.bend),
                slope=tuple(Uncertain(0.0, {source: part.value}) for part in curve.slope),
            )
            for curve in self.curves
        )
        return replace(self, curves=curves)


OWN_BEND = 0.5
"""Standard deviation of the sensor's own bend before the variances are seen, relative to the largest H_L.

Where the variances show more, it is OWN_BEND itself: nearly free."""
FREE_BEND_P_VALUES = (1e-3, 0.03)
"""Fraction of straight, and of bent responses in which a free bend of the variances alone may be found by chance."""


def fit_bent_gain(
    channels: Sequence[LightLevels], used: Sequence[NDArray[np.bool_]], saturation_dn: Sequence[float | None]
) -> BentGain | Missing | None:
    """Return the gain at small signal with the response curves; None where the response is straight within noise.

    Missing where the response bends too far to be fitted.

    Parameters
    ----------
    channels, used
        Light levels of each channel, and whether they are in the linear range.
    saturation_dn
        Signal of fully clipped pixels of each channel, if it is known.
    """
    line = fit_gain(channels, used)
    if line is None or line.parameters[0] <= 0.0:
        return None
    signals = [
        levels.signal if top is None else np.append(levels.signal, top)
        for levels, top in zip(channels, saturation_dn, strict=True)
    ]
    shapes = [
        None if constant_light(levels, mask) is not None else find_shape(levels, mask, signal)
        for levels, mask, signal in zip(channels, used, signals, strict=True)
    ]
    bent = any(shape is not None for shape in shapes)
    joint = _Joint.of(channels, used, signals, shapes)
    if joint.largest_bend > LARGEST_BEND:
        factor = f"{math.exp(joint.largest_bend):.2g}" if joint.largest_bend < math.log(100.0) else "more than 100"
        return WRONG_PROPORTION.missing(f"the signal is not in proportion to the stated light, by a factor of {factor}")
    found = joint.fit(line, OWN_BEND * joint.largest_bend) if bent else None
    if bent or joint.may_bend():
        free = joint.fit(line, OWN_BEND)
        if _better(free.fit, line if found is None else found.fit, FREE_BEND_P_VALUES[bent]):
            return free if bent else free.in_noise_alone()
    return found


UNSEEN_FALL, LARGEST_FALL = 1.0, 0.01
"""Standard uncertainties by which variances fall below the line from which a fall is not excluded; and largest fall
that the charge of neighboring pixels causes (brighter-fatter effect), for 10 000 electrons."""


def unseen_fall(channels: Sequence[LightLevels], used: Sequence[NDArray[np.bool_]], gain: float) -> float:
    """Return how much too low the gain of a line through the variances may be, relative to it, by a fall of them.

    A parabola through the variances falls below the line by more than its uncertainty, but not beyond chance: its
    gain is as likely as that of the line. Falls larger than `LARGEST_FALL` are not expected.
    """
    masked = [(levels, mask & levels.repeated) for levels, mask in zip(channels, used, strict=True)]
    y, v = (np.concatenate([getattr(levels, name)[mask] for levels, mask in masked]) for name in ("signal", "shot"))
    if len(y) < SHOWING_LEVELS or len(np.unique(y)) < SHOWING_LEVELS or gain <= 0.0:
        return 0.0
    shot = block_diagonal(*[levels.shot_covariance[np.ix_(mask, mask)] for levels, mask in masked])
    fit = fit_linear(np.column_stack([y, y * y / y.max()]), v, shot)
    if fit.parameters[1] > -UNSEEN_FALL * math.sqrt(fit.covariance[1, 1]):
        return 0.0
    return float(min(max(fit.parameters[0] / gain - 1.0, 0.0), LARGEST_FALL * y.max() / gain / 1e4))


def _better(more: Fit, less: Fit, by_chance: float) -> bool:
    """Return whether one more parameter, marginalized in `more`, explains the variances better than by chance."""
    from scipy.special import chdtrc, fdtrc

    gained, freedom = less.chi_square - more.chi_square, more.degrees_of_freedom - 1
    if gained <= 0.0 or freedom < 1:
        return False
    if more.extra_variance == 0.0:
        return bool(chdtrc(1, gained) < by_chance)
    return bool(fdtrc(1, freedom, gained * freedom / more.chi_square) < by_chance)


SENSOR_FRACTION = (0.5, 0.6)
"""Mean and standard deviation of the sensor's fraction of the bend before the variances are seen."""
_ROUNDS, _SMALL = 12, 1e-8
"""Rounds of the joint fit at most, and relative change of the gain that ends it."""


@dataclass(frozen=True, eq=False)
class _Joint:
    """Light levels with variances, of all channels together, and the shapes at all signals.

    Effects are fraction, own bend, fraction of the read noise that enters before the bend, and the errors of the shapes
    at all signals: bend and slope.
    """

    y: Array
    v: Array
    noise: Array
    uncertainty: Array
    shot: Array
    signal: Array
    read: Array
    masked: list[tuple[LightLevels, NDArray[np.bool_]]]
    at: NDArray[np.intp]  # the place of each level among the signals
    signals: tuple[Array, ...]
    shapes: tuple[ResponseShape | None, ...]
    t: Array  # signals relative to the largest in the linear range of all channels,
    bend: Array  # and the shapes there
    slope: Array
    shape_covariance: Array

    @classmethod
    def of(
        cls,
        channels: Sequence[LightLevels],
        used: Sequence[NDArray[np.bool_]],
        signals: Sequence[Array],
        shapes: Sequence[ResponseShape | None],
    ) -> _Joint:
        masked = [(levels, mask & levels.repeated) for levels, mask in zip(channels, used, strict=True)]
        y, v, noise, uncertainty = (
            np.concatenate([getattr(levels, name)[mask] for levels, mask in masked])
            for name in ("signal", "shot", "noise", "noise_uncertainty")
        )
        starts = np.append(0, np.cumsum([len(each) for each in signals]))
        sizes = [len(each) for each in signals]
        straight = [np.zeros((2 * n, 2 * n)) for n in sizes]
        return cls(
            y,
            v,
            noise,
            uncertainty,
            block_diagonal(*[levels.shot_covariance[np.ix_(mask, mask)] for levels, mask in masked]),
            block_diagonal(*[levels.signal_covariance[np.ix_(mask, mask)] for levels, mask in masked]),
            np.maximum(noise - v - QUANTIZATION_DN2, 0.0),
            masked,
            np.concatenate([start + np.flatnonzero(mask) for start, (_, mask) in zip(starts, masked, strict=False)]),
            tuple(signals),
            tuple(shapes),
            np.concatenate(signals) / y.max(),
            np.concatenate([np.zeros(n) if s is None else s.bend for n, s in zip(sizes, shapes, strict=True)]),
            np.concatenate([np.zeros(n) if s is None else s.t * s.slope for n, s in zip(sizes, shapes, strict=True)]),
            _interleaved([z if s is None else _scaled(s) for z, s in zip(straight, shapes, strict=True)]),
        )

    def may_bend(self) -> bool:
        """Return whether a parabola through the variances differs from the line by two of its uncertainties."""
        if len(self.y) < SHOWING_LEVELS:
            return False
        t = self.t[self.at]
        fit = fit_linear(np.column_stack([self.y, self.y * t]), self.v, self.shot)
        return bool(abs(fit.parameters[1]) > 2.0 * np.sqrt(fit.covariance[1, 1]))

    @property
    def largest_bend(self) -> float:
        return float(np.abs(self.bend[self.at]).max())

    def fit(self, line: GainFit, own: float) -> BentGain:
        """Fit the gain, with the effects marginalized: `own` is the standard deviation of the sensor's own bend."""
        at, t, y = self.at, self.t[self.at], self.y
        n, size = len(self.t), len(self.y)
        mean = np.zeros(3 + 2 * n)
        mean[0], mean[2] = SENSOR_FRACTION[0], 0.5
        prior = block_diagonal(np.diag([SENSOR_FRACTION[1] ** 2, own**2, 0.25]), self.shape_covariance)
        effects, gain = mean.copy(), float(line.parameters[0])
        for _ in range(_ROUNDS):
            fraction, bent, before = effects[:3]
            h, q = fraction * self.bend[at] + bent * t, 1.0 + fraction * self.slope[at] + bent * t
            model, scaled = y * np.exp(-h) / q**2, np.exp(-2.0 * h) / q**2
            # Derivatives of the variances with respect to the effects: through H and through y H'.
            by_h = -gain * model - 2.0 * before * self.read * scaled
            by_q = (-2.0 * gain * model - 2.0 * before * self.read * scaled) / q
            design = np.zeros((size, 3 + 2 * n))
            design[:, 0] = by_h * self.bend[at] + by_q * self.slope[at]
            design[:, 1] = (by_h + by_q) * t
            design[:, 2] = self.read * (scaled - 1.0)
            rows = np.arange(size)
            design[rows, 3 + at], design[rows, 3 + n + at] = by_h * fraction, by_q * fraction
            expected = np.maximum(self.noise - self.v + gain * model, 0.0)
            change = self.uncertainty**2 * ((expected / self.noise) ** 2 - 1.0)
            sampling = self.shot + np.diag(change) + gain**2 * self.signal
            spread = design @ prior
            rest = self.v - before * design[:, 2] - design @ (mean - effects)
            fit = fit_linear(model[:, None], rest, sampling + spread @ design.T)
            moved = gain
            gain = float(fit.parameters[0])
            total = sampling + spread @ design.T + fit.extra_variance * np.eye(size)
            solved = np.linalg.solve(total, np.column_stack([rest - gain * model, model, spread]))
            effects = mean + spread.T @ solved[:, 0]
            effects[:2] = np.clip(effects[:2], (-1.0, -0.4), (2.5, 0.4))
            effects[3:] = 0.0  # the shapes' errors are marginalized about their mean
            if abs(gain - moved) < _SMALL * abs(gain):
                break
        with_gain = -float(fit.covariance[0, 0]) * (spread.T @ solved[:, 1])
        covariance = prior - spread.T @ solved[:, 2:] + np.outer(with_gain, with_gain) / float(fit.covariance[0, 0])
        return self._result(fit, effects, covariance, with_gain)

    def _result(self, fit: Fit, effects: Array, covariance: Array, with_gain: Array) -> BentGain:
        """Return gain and curves with their common sources."""
        fraction, bent = float(effects[0]), float(effects[1])
        n = len(self.t)
        # From the effects to (H, y H') at all signals.
        by_fraction, by_own = np.append(self.bend, self.slope), np.append(self.t, self.t)
        change = np.column_stack([by_fraction, by_own, np.zeros(2 * n), fraction * np.eye(2 * n)])
        scales, vectors = np.linalg.eigh(change @ covariance @ change.T)
        keep = scales > _SMALL * scales[-1]
        loads, keys = vectors[:, keep] * np.sqrt(scales[keep]), [Source() for _ in range(int(keep.sum()))]
        parts = [
            Uncertain(float(value), dict(zip(keys, map(float, row), strict=True)))
            for value, row in zip(fraction * by_fraction + bent * by_own, loads, strict=True)
        ]
        gain_loads = (vectors[:, keep] / np.sqrt(scales[keep])).T @ (change @ with_gain)
        dark = effect_of_darks(self.masked, fit)
        gain_fit = GainFit(**vars(fit), dark=dark)
        shared = float(gain_loads @ gain_loads)
        own = max(float(fit.covariance[0, 0]) - dark.standard_uncertainty**2 - shared, 0.0)
        source = Source.student(fit.freedom) if math.isfinite(fit.freedom) else None
        gain = Uncertain.of(float(fit.parameters[0]), math.sqrt(own), source) + dark
        gain += Uncertain(0.0, dict(zip(keys, map(float, gain_loads), strict=True)))
        ends = np.append(0, np.cumsum([len(each) for each in self.signals]))
        curves = tuple(
            ResponseCurve(gain, signal, tuple(parts[start:end]), tuple(parts[n + start : n + end]), shape)
            for (start, end), shape, signal in zip(pairwise(ends), self.shapes, self.signals, strict=True)
        )
        return BentGain(gain_fit, gain, curves)


def _scaled(shape: ResponseShape) -> Array:
    """Return the covariance of H and t dH/dt."""
    scale = np.append(np.ones_like(shape.t), shape.t)
    return np.asarray(shape.covariance * np.outer(scale, scale))


def _interleaved(blocks: Sequence[Array]) -> Array:
    """Return the covariance of all bends, then all slopes, from those of (bends, slopes) of each channel."""
    total = block_diagonal(*blocks)
    halves = [len(block) // 2 for block in blocks]
    starts = np.append(0, np.cumsum([2 * half for half in halves]))[:-1]
    bends = [np.arange(start, start + half) for start, half in zip(starts, halves, strict=True)]
    order = np.concatenate([*bends, *(part + half for part, half in zip(bends, halves, strict=True))])
    return np.asarray(total[np.ix_(order, order)])
