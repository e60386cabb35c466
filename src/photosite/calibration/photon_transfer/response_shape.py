"""Shape of the response of a channel, from the means of its light levels: smooth bends, and tone curves.

With x the stated light, y the signal and e the electrons, a shape H is defined by e proportional to y exp(H(y)) and
H(0) = 0. It is 0 for a straight response. Under light in proportion to x,

    ln(x / y) = c + H(y).

Signals are given as t, relative to the brightest level in the linear range. H is a straight line through 0 plus an
integrated Wiener process, whose posterior mean is a cubic smoothing spline: any smooth bend, and knees within their
uncertainty (G. Wahba, "Improper priors, spline smoothing and the problem of guarding against model errors in
regression", J. R. Stat. Soc. B 40 (1978) 364). The light has two errors: scatter from level to level, and a
constant amount (shutter delay, stray light), which adds a multiple of 1 / t. Roughness of the bend, scatter and
constant amount have unknown sizes. The result is the mean over a grid of them, weighted by their marginal likelihood.

A tone curve bends the response and the temporal variance together. Each alone has another cause: wrong exposure times
bend the response only, filtering changes the variance only. Bends of some percent are left to the response curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.photon_transfer.photon_transfer import LINEAR_FRACTION, LightLevels
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import Uncertain

Array = NDArray[np.float64]


_ROUGHNESS = np.append(0.0, np.geomspace(1e-3, 30.0, 11))
_SCATTER = np.append(0.0, np.geomspace(1e-5, 0.05, 7))
_CONSTANT_LIGHT = np.array([0.0, 1e-4, 1e-3, 1e-2])
_UNSEEN_SCATTER, _UNSEEN_ROUGHNESS = np.array([3e-3]), np.array([0.006])
"""Scatter of the light of two levels, and roughness of the bend of three or fewer, which do not show them."""


@dataclass(frozen=True, eq=False)
class ResponseShape:
    """The shape of a response at n signals.

    Parameters
    ----------
    t
        (n,) signals relative to the brightest level in the linear range.
    bend, slope
        (n,) H, and dH/dt.
    covariance
        (2n, 2n) covariance of both, `bend` first.
    offset
        c: the logarithm of the light for a unit of signal at small signal.
    """

    t: Array
    bend: Array
    slope: Array
    covariance: Array
    offset: float


LEAST_CONSTANT = 0.005
"""Signal that does not grow with the light, relative to the brightest level, from which it is distinguished."""
_CONSTANT_CHI_SQUARE, _BEND_CHI_SQUARE = 25.0, 9.0
"""Decrease of chi square by a constant signal; the same relative to a bend of the second order without one."""


def constant_light(levels: LightLevels, used: NDArray[np.bool_]) -> Uncertain | None:
    """Return the signal of flat fields, DN, that does not grow with the stated light; None where none is seen.

    Shutters that stay open longer than stated, and stray light, add it; it may be negative. It must explain the means
    better than proportion does, and than a smooth bend, by more than the scatter of the levels.
    """
    points = _Points.of(levels, used)
    if points is None or len(points.t) <= SHOWING_LEVELS:
        return None
    covariance = levels.signal_covariance[np.ix_(points.taken, points.taken)]
    x, y = levels.x[points.taken], levels.signal[points.taken]
    line, proportional = (fit_linear(design, y, covariance) for design in (np.vander(x, 2), x[:, None]))
    scatter = max(1.0, line.chi_square / line.degrees_of_freedom)
    constant = line.uncertain[1]
    seen = (
        proportional.chi_square - line.chi_square > _CONSTANT_CHI_SQUARE * scatter
        and points.chi_square(2) - line.chi_square > _BEND_CHI_SQUARE * scatter
        and abs(constant.value) > LEAST_CONSTANT * float(y.max())
    )
    return constant if seen else None


LEAST_LEVELS, SHOWING_LEVELS = 2, 4
"""Different light levels whose means may contradict a straight response under proportional light; and those that show
the form of a bend, or a constant signal. Fewer levels show a bend that grows with the signal."""
LEAST_SIGNAL = 20.0
"""Signal of a level, in its standard uncertainties, from which it shows the shape."""


def find_shape(levels: LightLevels, used: NDArray[np.bool_], signals: Array) -> ResponseShape | None:
    """Return the shape at some signals (n,), DN; None where signals are proportional to the stated light within noise.

    Levels are compared with a constant ln(x / y), and polynomials of t with it. False alarms of all these chi-square
    tests together are `BEND_P_VALUE` at most.
    """
    points = _Points.of(levels, used)
    if points is None or points.straight():
        return None
    return points.shape_at(np.maximum(signals, 0.0) / float(levels.signal[points.taken].max()))


BEND_P_VALUE = 1e-3
"""Fraction of straight responses under proportional light that may be analyzed as bent."""
HIGHEST_ORDER = 3
"""Highest power of the signal that is tested for a bend."""
_NEGLIGIBLE = 1e-3
"""Weight, relative to the largest, below which a point of the grid is left out."""


@dataclass(frozen=True, eq=False)
class _Points:
    """(m,) t and ln(x / y) of the levels that are taken, and the (m, m) covariance of the latter from sampling."""

    t: Array
    log_ratio: Array
    covariance: Array
    taken: NDArray[np.bool_]

    @classmethod
    def of(cls, levels: LightLevels, used: NDArray[np.bool_]) -> _Points | None:
        """Return the levels that show the shape, None where they are too few."""
        variance = np.diag(levels.signal_covariance)
        take = used & levels.trusted & (levels.x > 0.0) & (levels.signal > LEAST_SIGNAL * np.sqrt(variance))
        x, y = levels.x[take], levels.signal[take]
        different = len(np.unique(np.round(np.log(x), 6)))
        if different < max(LEAST_LEVELS, min(len(x), SHOWING_LEVELS)):
            return None
        covariance = levels.signal_covariance[np.ix_(take, take)] / np.outer(y, y)
        return cls(y / float(y.max()), np.log(x / y), covariance, take)

    def straight(self) -> bool:
        from scipy.special import chdtrc

        m = len(self.t)
        orders = range(min(HIGHEST_ORDER, m - 2) + 1)
        squares = [self.chi_square(order) for order in orders]
        chances = [chdtrc(m - 1, squares[0]), *(chdtrc(k, squares[0] - squares[k]) for k in orders[1:])]
        return bool(min(chances) * len(chances) > BEND_P_VALUE)

    def chi_square(self, order: int) -> float:
        """Return chi square of a polynomial of some order."""
        root = np.linalg.cholesky(self.covariance)
        design = np.linalg.solve(root, np.vander(self.t, order + 1, increasing=True))
        y = np.linalg.solve(root, self.log_ratio)
        residual = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
        return float(residual @ residual)

    def shape_at(self, t: Array) -> ResponseShape:
        n, m = len(t), len(self.t)
        design = np.column_stack([np.ones(m), self.t])
        wiener = _wiener(self.t, self.t)
        # Rows: c, then H, then dH/dt.
        basis = np.zeros((1 + 2 * n, 2))
        basis[0, 0], basis[1 : n + 1, 1], basis[n + 1 :, 1] = 1.0, t, 1.0
        cross = np.vstack([np.zeros((1, m)), _wiener(t, self.t), _wiener_slope(t, self.t)])
        own = np.zeros((1 + 2 * n, 1 + 2 * n))
        slopes = _wiener_slope(t, t)
        own[1:, 1:] = np.block([[_wiener(t, t), slopes.T], [slopes, np.minimum.outer(t, t)]])
        mean, square = np.zeros(1 + 2 * n), np.zeros_like(own)
        for weight, noise, rough in self._grid(design, wiener):
            total = noise + rough * wiener
            solved = np.linalg.solve(total, np.column_stack([design, self.log_ratio, rough * cross.T]))
            normal = design.T @ solved[:, :2]
            line = np.linalg.solve(normal, design.T @ solved[:, 2])
            found = basis @ line + rough * cross @ (solved[:, 2] - solved[:, :2] @ line)
            left = basis - rough * cross @ solved[:, :2]
            covariance = rough * (own - cross @ solved[:, 3:]) + left @ np.linalg.solve(normal, left.T)
            mean += weight * found
            square += weight * (covariance + np.outer(found, found))
        covariance = square - np.outer(mean, mean)
        return ResponseShape(t, mean[1 : n + 1], mean[n + 1 :], covariance[1:, 1:], float(mean[0]))

    def _grid(self, design: Array, wiener: Array) -> list[tuple[float, Array, float]]:
        """Return weight, (m, m) covariance of the light, and square of the roughness for each point of the grid.

        The likelihood is the restricted one (REML), in which c and the straight part of H have no prior.
        """
        identity, constant = np.eye(len(self.t)), 1.0 / np.outer(self.t, self.t)
        grid, likelihood = [], []
        m = len(self.t)
        roughness = _ROUGHNESS if m >= SHOWING_LEVELS else _UNSEEN_ROUGHNESS
        scatters, amounts = (_SCATTER, _CONSTANT_LIGHT) if m > LEAST_LEVELS else (_UNSEEN_SCATTER, _CONSTANT_LIGHT[:1])
        for rough, scatter, amount in product(roughness**2, scatters**2, amounts**2):
            noise = self.covariance + scatter * identity + amount * constant
            root = np.linalg.cholesky(noise + rough * wiener)
            solved = np.linalg.solve(root, np.column_stack([design, self.log_ratio]))
            (aa, ab), (_, bb) = normal = solved[:, :2].T @ solved[:, :2]
            line = np.linalg.solve(normal, solved[:, :2].T @ solved[:, 2])
            residual = solved[:, 2] - solved[:, :2] @ line
            likelihood.append(-np.log(np.diag(root)).sum() - 0.5 * (np.log(aa * bb - ab * ab) + residual @ residual))
            grid.append((noise, rough))
        weights = np.exp(np.array(likelihood) - max(likelihood))
        weights[weights < _NEGLIGIBLE] = 0.0
        weights /= weights.sum()
        return [(float(w), noise, float(rough)) for w, (noise, rough) in zip(weights, grid, strict=True) if w > 0.0]


def _wiener(a: Array, b: Array) -> Array:
    """Return the covariance of an integrated Wiener process between places a and b."""
    low, high = np.minimum.outer(a, b), np.maximum.outer(a, b)
    return np.asarray(low**2 * (3.0 * high - low) / 6.0)


def _wiener_slope(a: Array, b: Array) -> Array:
    """Return the covariance of its slope at a with its value at b."""
    low = np.minimum.outer(a, b)
    return np.asarray(low * b[None, :] - 0.5 * low**2)


@dataclass(frozen=True)
class ToneCurve:
    """A tone curve as found.

    Parameters
    ----------
    exponent
        Exponent of the signal above dark against the light.
    """

    exponent: float

    def __str__(self) -> str:
        return (
            f"the numbers are not proportional to the light: the signal rises with its power {self.exponent:.2f} and "
            f"the temporal variance not in proportion to the signal, as with a tone curve (gamma, logarithm, "
            f"square-root companding) or soft saturation; calibrate raw numbers, undo the curve with its table "
            f"(--linearize), or take more dim flat fields"
        )


TONE_CURVE = DiagnosticKind(
    "tone-curve",
    "warning",
    "The numbers are not proportional to the light, and the temporal variance is not to the signal.",
    "A tone curve (gamma, logarithm, companding) or soft saturation: all figures from the flat fields are withheld but "
    "saturation in DN and linearity.",
    "Calibrate raw numbers, undo the curve with its table (--linearize), or take more dim flat fields.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s", "prnu*", "responsivity_*", "quantum_efficiency_*", "*_photons"),
    "exponent of the signal against the light",
)


def find_tone_curve(channels: Sequence[LightLevels]) -> ToneCurve | None:
    """Return the tone curve of the frames, None where no channel has a strong one.

    Levels up to 70 % of the largest signal are used, so that saturation does not count as a curve. All are used where
    most flat fields are quieter than the dark frames, as behind a logarithm.
    """
    found = [exponent for levels in channels if (exponent := _exponent(levels)) is not None]
    return ToneCurve(min(found)) if found else None


TONE_EXPONENT = 0.8
"""Exponent of the signal against the light below which the response is that of a tone curve; 1 is straight."""
TONE_LEAST_LEVELS, LEAST_RANGE = 3, 2.0
"""Light levels, and ratio of the largest to the smallest light, that an exponent needs."""
STILL_RISING = 0.98
"""Fraction of the largest signal above which flat fields may all be saturated."""
QUIETER_SIGMA, LEAST_RISE = 6.0, 0.2
"""Standard uncertainties by which half of the flat fields are quieter than the dark frames, and relative rise of their
signal, at which they are not saturated."""
TONE_CHI_SQUARE = 25.0
"""Chi square per degree of freedom of the variances about a line through the origin that a tone curve exceeds."""


def _exponent(levels: LightLevels) -> float | None:
    take = levels.repeated & levels.trusted & ~levels.clipped & (levels.x > 0.0) & (levels.signal > 0.0)
    if not take.any():
        return None
    quiet = levels.shot < -QUIETER_SIGMA * np.sqrt(np.diag(levels.shot_covariance))
    lowest, highest = levels.signal[take].min(), levels.signal[take].max()
    rising = take & (levels.signal < STILL_RISING * highest)
    if 2 * quiet[rising].sum() <= rising.sum() or highest < (1.0 + LEAST_RISE) * lowest:
        take &= levels.signal <= LINEAR_FRACTION * levels.signal[take].max()
    x, y, v = levels.x[take], levels.signal[take], levels.shot[take]
    if len(np.unique(x)) < TONE_LEAST_LEVELS or x.max() < LEAST_RANGE * x.min():
        return None
    log_x = np.log(x) - np.log(x).mean()
    exponent = float(log_x @ np.log(y) / (log_x @ log_x))
    if exponent >= TONE_EXPONENT:
        return exponent if _falls(levels) else None
    weight = 1.0 / np.diag(levels.shot_covariance)[take]
    slope = float((weight * y) @ v / ((weight * y) @ y))
    chi_square = float(weight @ (v - slope * y) ** 2)
    return exponent if slope <= 0.0 or chi_square > TONE_CHI_SQUARE * (len(y) - 1) else None


LEAST_STRAIGHT, FALLEN_SIGMA, RISEN_RATIO = 4, 6.0, 1.1
"""Light levels up to 70 % of the signal at the largest variance that show a bend of the response. With fewer, falling
variances of rising signals are those of a tone curve or of soft saturation: standard uncertainties by which the
variance falls, and ratio of the signals beyond its maximum. Sharp saturation ends at one signal."""


def _falls(levels: LightLevels) -> bool:
    """Return whether the variance falls while the signal still rises, and too few levels show the response below."""
    take = levels.repeated & levels.trusted & ~levels.clipped & (levels.signal > 0.0)
    order = np.argsort(levels.signal[take])
    y, v, u = (each[take][order] for each in (levels.signal, levels.shot, np.sqrt(np.diag(levels.shot_covariance))))
    peak = int(v.argmax())
    fallen = y[peak + 1 :][v[peak + 1 :] + FALLEN_SIGMA * np.hypot(u[peak + 1 :], u[peak]) < v[peak]]
    straight = np.count_nonzero(y <= LINEAR_FRACTION * y[peak])
    return bool(len(fallen) > 1 and fallen[-1] > RISEN_RATIO * fallen[0] and straight < LEAST_STRAIGHT)
