"""From the charge of every pixel to the inputs of `clipped_moments`, with derivatives: coupling and response curve.

With mean m_i and variance v_i of the charge, well capacity w, coupled fractions k_ij, response curve s and system gain
K, a pixel's own charge keeps its limit, and that of its neighbors counts as normal noise::

    q_j    = min(charge_j, w)                          mean E_j and variance V_j in closed form
    c_i    = k_ii m_i + sum_j k_ij E_j                 j: the neighbors
    mean   = black + K s(c_i)                          before = K^2 s'(c_i)^2 k_ii^2 v_i
    after  = K^2 (read_noise^2 + dsnu^2 + s'(c_i)^2 sum_j k_ij^2 V_j)
    well   = black + K s(k_ii w + sum_j k_ij E_j)

The curve is taken as straight over the noise, which neglects s'' v / 2 of the mean. Beyond w it continues straight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array, kron

from photosite.engine.clipped_normal import clipped_charge
from photosite.sensor.effects.model import Effects
from photosite.sensor.effects.response_curve import ResponseCurve

Array = NDArray[np.float64]

COUPLING = ("coupling_percent", "diagonal_percent")
DIFFERENTIABLE_EFFECTS = ("response_curve", "interpixel_capacitance")


@dataclass(frozen=True)
class _Curve:
    """The response curve at an array of charges, with derivatives."""

    value: Any
    slope: Any
    bend: Any
    by_well: Any
    slope_by_well: Any
    by_factors: tuple[Any, ...] = ()  # of the polynomial
    slope_by_factors: tuple[Any, ...] = ()


def _curve(curve: ResponseCurve | None, factors: Array | None, charge_e: Array, well_e: float) -> _Curve:
    """Return the curve at charges; the factors of a polynomial are those given."""
    if curve is None:
        return _Curve(charge_e, 1.0, 0.0, 0.0, 0.0)
    inside, beyond = charge_e < well_e, np.maximum(charge_e - well_e, 0.0)
    within = np.minimum(charge_e, well_e)
    if factors is None:
        from scipy.interpolate import PchipInterpolator

        assert curve.charge_e is not None
        cubic: Any = PchipInterpolator(curve.charge_e, curve.deviation_percent)
        last = curve.charge_e[-1]

        def at(charge: Array) -> tuple[Array, Array, Array]:
            deviation, first, second = (cubic(np.minimum(charge, last), order) / 100.0 for order in range(3))
            flat = charge > last
            first, second = (np.where(flat, 0.0, each) for each in (first, second))
            value, slope = charge * (1.0 + deviation), 1.0 + deviation + charge * first
            return value, slope, 2.0 * first + charge * second

        value, slope, bend = at(within)
        bend_at_well = at(np.array(well_e))[2]
        bends = np.where(inside, 0.0, bend_at_well)
        return _Curve(value + slope * beyond, slope, np.where(inside, bend, 0.0), bends * beyond, bends)
    u, powers = within / well_e, range(1, factors.size + 1)
    polynomial = np.polynomial.Polynomial((0.0, *(factors / 100.0)))
    deviation, first, second = (each(u) for each in (polynomial, polynomial.deriv(1), polynomial.deriv(2)))
    slope = 1.0 + deviation + u * first
    bend = np.where(inside, (2.0 * first + u * second) / well_e, 0.0)
    return _Curve(
        within * (1.0 + deviation) + slope * beyond,
        slope,
        bend,
        -np.square(u) * first,
        -u * bend,
        tuple((within * u**n + (n + 1) * u**n * beyond) / 100.0 for n in powers),
        tuple((n + 1) * u**n / 100.0 for n in powers),
    )


@lru_cache(maxsize=2)
def _neighbors(rows: int, cols: int) -> tuple[csr_array, csr_array]:
    """Return the symmetric (pixels, pixels) changes of the signals by each fraction, of next and diagonal neighbors.

    Beyond the edges the array is continued by its outer pixels, as in `charge_stages.couple_pixels`.
    """

    def both_sides(count: int) -> Any:
        ends = np.zeros(count)
        ends[0] += 1.0
        ends[-1] += 1.0
        ones = np.ones(count - 1)
        return diags_array((ones, ends, ones), offsets=(-1, 0, 1), shape=(count, count))

    down, across, one = both_sides(rows), both_sides(cols), eye_array(rows * cols)
    sides = kron(down, eye_array(cols)) + kron(eye_array(rows), across) - 4.0 * one
    return csr_array(sides), csr_array(kron(down, across) - 4.0 * one)


class _Coupling:
    """Fractions of the pixels in each other's signals: the own ones, and matrices of those of the neighbors."""

    def __init__(self, shape: tuple[int, ...], percents: tuple[float, float]) -> None:
        own, others = zip(*(_split(change) for change in _neighbors(*shape)), strict=True)
        fractions = [percent / 100.0 for percent in percents]
        self.own = (1.0 + sum(fraction * each for fraction, each in zip(fractions, own, strict=True))).reshape(shape)
        self.others = sum(fraction * each for fraction, each in zip(fractions, others, strict=True))
        self.squares = self.others.power(2)
        # Derivatives by the two percentages
        self.own_by = [each.reshape(shape) / 100.0 for each in own]
        self.others_by = [each / 100.0 for each in others]
        self.squares_by = [2.0 * self.others.multiply(each) for each in self.others_by]


def _split(matrix: csr_array) -> tuple[Array, csr_array]:
    own = matrix.diagonal()
    others = csr_array(matrix - diags_array(own))
    others.eliminate_zeros()
    return own, others


def _times(matrix: Any, values: Array) -> Array:
    return np.asarray(matrix @ values.ravel()).reshape(values.shape)


class ChargeConversion:
    """Inputs of `clipped_moments` of pixels with a charge of given mean and variance, and their derivatives.

    `values` has `system_gain_dn_per_e`, `black_level_dn`, `well_capacity_e`, `read_noise_e`, `dsnu_e`, and those of the
    effects: `polynomial_percent`, `coupling_percent` and `diagonal_percent`. `inputs` are mean, before, after and well.
    """

    def __init__(self, effects: Effects | None, values: Mapping[str, Array], mean_e: Array, variance_e2: Array) -> None:
        self._gain, self._well_e = float(values["system_gain_dn_per_e"]), float(values["well_capacity_e"])
        self._read_e, self._dsnu_e = float(values["read_noise_e"]), float(values["dsnu_e"])
        self._mean_e, self._variance_e2 = mean_e, variance_e2
        near: Any = 0.0
        near_e2: Any = 0.0
        self._coupling, self._own = None, np.ones(())
        if effects is not None and effects.interpixel_capacitance is not None:
            percents = float(values[COUPLING[0]]), float(values[COUPLING[1]])
            self._coupling = _Coupling(mean_e.shape, percents)
            self._own = self._coupling.own
            self._kept = clipped_charge(mean_e, variance_e2, self._well_e)
            near = _times(self._coupling.others, self._kept.mean)
            near_e2 = _times(self._coupling.squares, self._kept.variance)
        self._near_e2 = near_e2
        curve, factors = None if effects is None else effects.response_curve, values.get("polynomial_percent")
        self._at = _curve(curve, factors, self._own * mean_e + near, self._well_e)
        self._full = _curve(curve, factors, np.asarray(self._own * self._well_e + near), self._well_e)
        black, square = float(values["black_level_dn"]), self._gain**2
        self._own_e2 = np.square(self._own) * variance_e2
        self._after_e2 = self._read_e**2 + self._dsnu_e**2 + np.square(self._at.slope) * near_e2
        self.inputs: tuple[Any, Any, Any, Any] = (
            black + self._gain * self._at.value,
            square * np.square(self._at.slope) * self._own_e2,
            square * self._after_e2,
            black + self._gain * self._full.value,
        )

    def along(self, mean_e: Array, variance_e2: Array, directions: Mapping[str, Array]) -> tuple[Any, Any, Any, Any]:
        """Return the derivatives of the inputs along a direction of charge and values."""
        well, gain = (directions.get(name, 0.0) for name in ("well_capacity_e", "system_gain_dn_per_e"))
        own: Any = 0.0
        near: Any = 0.0
        near_e2: Any = 0.0
        if (coupling := self._coupling) is not None:
            kept = self._kept
            near = _times(coupling.others, kept.of_mean.along(mean_e, variance_e2, 0.0, well))
            near_e2 = _times(coupling.squares, kept.of_variance.along(mean_e, variance_e2, 0.0, well))
            for k, name in enumerate(COUPLING):
                if name in directions:
                    own = own + directions[name] * coupling.own_by[k]
                    near += directions[name] * _times(coupling.others_by[k], kept.mean)
                    near_e2 += directions[name] * _times(coupling.squares_by[k], kept.variance)

        def along_curve(at: _Curve, charge: Any) -> tuple[Any, Any]:
            value, slope = at.slope * charge + at.by_well * well, at.bend * charge + at.slope_by_well * well
            if (factors := directions.get("polynomial_percent")) is not None:
                value = value + sum(f * by for f, by in zip(factors, at.by_factors, strict=True))
                slope = slope + sum(f * by for f, by in zip(factors, at.slope_by_factors, strict=True))
            return value, slope

        value, slope = along_curve(self._at, self._own * mean_e + own * self._mean_e + near)
        full, _ = along_curve(self._full, self._own * well + own * self._well_e + near)
        own_e2 = np.square(self._own) * variance_e2 + 2.0 * self._own * own * self._variance_e2
        black, of_slope = directions.get("black_level_dn", 0.0), 2.0 * self._at.slope * slope
        after_e2 = of_slope * self._near_e2 + np.square(self._at.slope) * near_e2
        for name, spread in (("read_noise_e", self._read_e), ("dsnu_e", self._dsnu_e)):
            after_e2 = after_e2 + 2.0 * spread * directions.get(name, 0.0)
        _, before, after, _ = self.inputs
        relative, square = 2.0 * gain / self._gain, self._gain**2
        return (
            black + gain * self._at.value + self._gain * value,
            relative * before + square * (of_slope * self._own_e2 + np.square(self._at.slope) * own_e2),
            relative * after + square * after_e2,
            black + gain * self._full.value + self._gain * full,
        )

    def gradient(
        self, of_mean: Array, of_before: Array, of_after: Array, of_well: Array
    ) -> tuple[Array, Array, dict[str, Array]]:
        """Return the gradients by mean and variance of the charge, and by each value: the adjoint of `along`."""
        gain, square, at = self._gain, self._gain**2, self._at
        _, before, after, _ = self.inputs
        found = {
            "black_level_dn": of_mean.sum() + of_well.sum(),
            "system_gain_dn_per_e": (of_mean * at.value).sum()
            + (of_well * self._full.value).sum()
            + 2.0 / gain * ((of_before * before).sum() + (of_after * after).sum()),
            "read_noise_e": 2.0 * square * self._read_e * of_after.sum(),
            "dsnu_e": 2.0 * square * self._dsnu_e * of_after.sum(),
        }
        of_value, of_full = gain * of_mean, gain * of_well
        of_slope = 2.0 * square * at.slope * (of_before * self._own_e2 + of_after * self._near_e2)
        of_charge, of_full_charge = of_value * at.slope + of_slope * at.bend, of_full * self._full.slope
        well = (of_value * at.by_well + of_slope * at.slope_by_well + of_full * self._full.by_well).sum()
        well += (of_full_charge * self._own).sum()
        if at.by_factors:
            terms = zip(at.by_factors, at.slope_by_factors, self._full.by_factors, strict=True)
            found["polynomial_percent"] = np.array(
                [(of_value * by + of_slope * slope_by + of_full * full_by).sum() for by, slope_by, full_by in terms]
            )
        of_own_e2 = square * np.square(at.slope) * of_before
        of_mean_e, of_variance_e2 = of_charge * self._own, of_own_e2 * np.square(self._own)
        if (coupling := self._coupling) is not None:
            kept, of_near = self._kept, of_charge + of_full_charge
            of_own = of_charge * self._mean_e + of_full_charge * self._well_e
            of_own += 2.0 * of_own_e2 * self._own * self._variance_e2
            of_near_e2 = square * np.square(at.slope) * of_after
            for k, name in enumerate(COUPLING):
                found[name] = (
                    (of_own * coupling.own_by[k]).sum()
                    + (of_near * _times(coupling.others_by[k], kept.mean)).sum()
                    + (of_near_e2 * _times(coupling.squares_by[k], kept.variance)).sum()
                )
            # The matrices are symmetric.
            of_kept, of_kept_e2 = _times(coupling.others, of_near), _times(coupling.squares, of_near_e2)
            of_mean_e = of_mean_e + of_kept * kept.of_mean.mean + of_kept_e2 * kept.of_variance.mean
            of_variance_e2 = of_variance_e2 + of_kept * kept.of_mean.before + of_kept_e2 * kept.of_variance.before
            well += (of_kept * kept.of_mean.well + of_kept_e2 * kept.of_variance.well).sum()
        found["well_capacity_e"] = well
        return of_mean_e, of_variance_e2, {name: np.asarray(value) for name, value in found.items()}
