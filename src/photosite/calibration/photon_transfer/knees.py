"""Knees of a photon transfer curve: where the frames change from one capture to the next, or a companding table bends.

A frame of several captures has the variance of the capture that it is from: K_k (y + K_k read_k^2) at a signal y, with
K_k the output per electron of that capture. Where the combination changes to a capture with fewer electrons or more
read noise, the variance jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.reduction.groups import CLIPPED_FRACTION
from photosite.calibration.withheld import SEVERAL_CAPTURES
from photosite.errors import CalibrationError
from photosite.sensor.noise_terms import QUANTIZATION_DN2

_Array = NDArray[np.float64]

_Codes = tuple[float, _Array]
"""Distance of the numbers of a channel in the dark, and that in each light group."""


class SeveralCapturesError(CalibrationError):
    """Frames combine several captures, or are companded: their photon transfer curve has knees."""


class Piece(NamedTuple):
    """Points `first` to `last` of a curve that lie on one line: intercept + slope x signal."""

    first: int
    last: int
    intercept: float
    slope: float

    def at(self, signal: float) -> float:
        """Return the variance of the line."""
        return self.intercept + self.slope * signal


_NEW_PIECE, _LEFT_OUT = 30.0, 12.0
"""Costs in chi square of another piece, and of a point between two pieces, where captures are blended."""
_MODEL_ERROR = 0.01
"""Relative deviation of the variance from a straight line that is no knee."""


def find_pieces(signal: _Array, variance: _Array, uncertainty: _Array) -> list[Piece]:
    """Return the pieces of a photon transfer curve, by dynamic programming over all partitions.

    The sum of the squared residuals of the lines, with a cost for each piece and for each point in no piece, is the
    least. A line rises with the signal, and its intercept is not negative beyond its uncertainty. Neighboring pieces
    whose lines meet are one: a bend is no knee.

    Parameters
    ----------
    signal, variance, uncertainty
        (points,) ascending signals above black, the temporal variances and their standard uncertainties.

    Examples
    --------
    >>> signal = np.geomspace(10, 1e5, 30)
    >>> variance = np.where(signal < 3e3, 4 + 0.5 * signal, 400 + 8 * signal)
    >>> [(piece.first, piece.last, round(piece.slope, 3)) for piece in find_pieces(signal, variance, variance / 100)]
    [(0, 17, 0.5), (18, 29, 8.0)]
    """
    count = len(signal)
    spread = np.hypot(uncertainty, _MODEL_ERROR * variance)
    best, choice = np.full(count + 1, np.inf), np.full(count + 1, -1)
    best[0] = 0.0
    for start in range(count):
        if best[start] + _LEFT_OUT < best[start + 1]:
            best[start + 1], choice[start + 1] = best[start] + _LEFT_OUT, -1
        costs = best[start] + _NEW_PIECE + _chi_squares(signal[start:], variance[start:], spread[start:])
        better = np.flatnonzero(costs < best[start + 1 :])
        best[start + 1 + better], choice[start + 1 + better] = costs[better], start
    pieces, end = [], count
    while end > 0:
        if choice[end] < 0:
            end -= 1
            continue
        start = int(choice[end])
        pieces.append((start, end - 1))
        end = start
    return _merged(signal, variance, spread, pieces[::-1])


LEAST_POINTS = 3
"""Points of a piece: two for the line, one that can contradict it."""


def _chi_squares(signal: _Array, variance: _Array, spread: _Array) -> _Array:
    """Return chi square of the line through the first 1, 2, ... points; infinite where there is no valid one."""
    weight, scale = 1.0 / spread**2, max(float(np.abs(signal).max()), 1e-300)
    x = signal / scale
    w, wx, wxx = (np.cumsum(weight * x**power) for power in range(3))
    wv, wxv, wvv = np.cumsum(weight * variance), np.cumsum(weight * x * variance), np.cumsum(weight * variance**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = w * wxx - wx**2
        slope = (w * wxv - wx * wv) / determinant
        intercept = (wxx * wv - wx * wxv) / determinant
        chi_square = wvv - intercept * wv - slope * wxv
        valid = (slope > 0.0) & (intercept > -3.0 * np.sqrt(wxx / determinant))
    valid &= np.isfinite(chi_square) & (np.arange(1, len(x) + 1) >= LEAST_POINTS)
    return np.where(valid, np.maximum(chi_square, 0.0), np.inf)


def line_through(signal: _Array, variance: _Array, spread: _Array, first: int, last: int) -> tuple[Piece, _Array]:
    """Return the line through points, and the covariance of its parameters."""
    part = slice(first, last + 1)
    design = np.stack([np.ones(last + 1 - first), signal[part]], axis=1) / spread[part, None]
    scale = np.abs(design).max(axis=0)
    inverse = np.linalg.inv((design / scale).T @ (design / scale)) / np.outer(scale, scale)
    intercept, slope = inverse @ design.T @ (variance[part] / spread[part])
    return Piece(first, last, float(intercept), float(slope)), inverse


def step_at_knee(
    signal: _Array, variance: _Array, uncertainty: _Array, before: Piece, after: Piece
) -> tuple[float, float]:
    """Return the ratio of the variances after and before a knee, and its standard uncertainty."""
    x = np.array([1.0, 0.5 * (signal[before.last] + signal[after.first])])
    lines = [line_through(signal, variance, uncertainty, each.first, each.last) for each in (before, after)]
    (low, high), relative = (
        [max(piece.at(x[1]), 1e-300) for piece, _ in lines],
        [float(x @ covariance @ x) / max(piece.at(x[1]), 1e-300) ** 2 for piece, covariance in lines],
    )
    return high / low, high / low * float(np.sqrt(sum(relative)))


LEAST_STEP = 0.03
"""Least relative step of the variance at a knee."""


def _merged(signal: _Array, variance: _Array, spread: _Array, pieces: list[tuple[int, int]]) -> list[Piece]:
    """Return the lines of pieces; those that meet their neighbor are one with it."""
    found: list[Piece] = []
    for first, last in pieces:
        piece, _ = line_through(signal, variance, spread, first, last)
        if found:
            step, uncertainty = step_at_knee(signal, variance, spread, found[-1], piece)
            if abs(step - 1.0) < max(3.0 * uncertainty, LEAST_STEP):
                piece, _ = line_through(signal, variance, spread, found.pop().first, last)
        found.append(piece)
    return found


_SMOOTH_ERROR = 0.002
"""Relative deviation of the variance from a straight line that is no step of the noise."""
_STEP_CHI_SQUARE, _WITH_OTHER_CODES = 9.0, 4.0
"""Decrease of chi square by a step of the noise: 1 of 3000 sets of clean or bent levels without a step reaches 10. And
where the distance of the numbers changes with the level, as that of the captures' converters: 1 of 400; or 1 of 44
where it changes once, so that the place of the step is known."""
OTHER_CODES = 0.3
"""Relative difference of the distances of the numbers of two captures."""


def _place_of_codes(codes: _Array) -> int | None:
    """Return the first point of larger distances of the numbers, where there are two distances, one after the other."""
    larger = codes > (1.0 + OTHER_CODES) * codes.min()
    place = int(larger.argmax())
    parts = codes[:place], codes[place:]
    once = larger[place:].all() and all(np.ptp(part) < 0.1 * part.min() for part in parts if part.size)
    return place if place and once else None


def find_noise_step(
    signal: _Array,
    variance: _Array,
    uncertainty: _Array,
    darks: int = 1,
    least: int = 1,
    codes: _Array | None = None,
) -> int | None:
    """Return the first point above a step of the read noise on one line's slope, None if no such step is seen.

    Captures that read one charge, put on one scale, have the same slope and another read noise. The step must explain
    the points better than a bend (a quadratic or a cubic term), or one deviating point, or another dark variance.
    Where the distance of the numbers changes once, the step is there, and must be seen beside a quadratic term.

    Parameters
    ----------
    signal, variance, uncertainty
        (points,) ascending signals above black, the temporal variances and their standard uncertainties.
    darks, least
        Points of dark frames, the first ones; least number of points of flat fields below a step.
    codes
        Distance of the numbers at each point.

    Examples
    --------
    >>> signal = np.linspace(0.0, 28000.0, 15)
    >>> variance = 4.0 + signal + 400.0 * (signal > 5000.0)
    >>> find_noise_step(signal, variance, 0.005 * variance), find_noise_step(signal, 4 + signal, 0.005 * variance)
    (3, None)
    """
    count = len(signal)
    weight = 1.0 / np.hypot(uncertainty, _SMOOTH_ERROR * variance)
    x = signal / signal.max() if count else signal
    line = [np.ones(count), x]
    first, last = darks + least, count - 2 * least
    if last <= first or count < 4 + least:
        return None

    def chi_square(*columns: _Array) -> float:
        design = np.stack([*line, *columns], axis=1) * weight[:, None]
        found = np.linalg.lstsq(design, variance * weight, rcond=None)[0]
        return float(((variance * weight - design @ found) ** 2).sum())

    def step_at(place: int) -> _Array:
        return np.asarray((np.arange(count) >= place).astype(np.float64))

    def upward(place: int, *columns: _Array) -> bool:
        design = np.stack([*line, *columns, step_at(place)], axis=1) * weight[:, None]
        return bool(np.linalg.lstsq(design, variance * weight, rcond=None)[0][-1] > 0.0)

    known = None if codes is None else _place_of_codes(codes)
    if known is not None and first <= known <= last:
        without, with_step = chi_square(x**2), chi_square(x**2, step_at(known))
        seen = without - with_step > _WITH_OTHER_CODES * max(1.0, with_step / max(count - 4, 1))
        return known if seen and upward(known, x**2) else None
    chances = {place: chi_square(step_at(place)) for place in range(first, last + 1)}
    place = min(chances, key=chances.__getitem__)
    points = np.eye(count)
    others = min(chi_square(x**2), chi_square(x**2, x**3), *(chi_square(point) for point in points))
    scatter = max(1.0, chances[place] / max(count - 4, 1))
    other_codes = codes is not None and codes.max() > (1.0 + OTHER_CODES) * codes.min()
    limit = _WITH_OTHER_CODES if other_codes else _STEP_CHI_SQUARE
    return place if others - chances[place] > limit * scatter and upward(place) else None


BELOW_SATURATION = 0.85
"""Fraction of the saturated signal that is used; brighter pixels clip."""
_FALLEN, _STILL_RISING = 0.8, 1.05
"""Fraction of the largest variance, and ratio of the signals of the last two levels: saturation is below both."""


def linear_end(signal: _Array, variance: _Array, clipped: NDArray[np.bool_]) -> tuple[int, bool]:
    """Return the number of points below saturation, and whether saturation was reached; signals ascend."""
    last = len(signal) - 1
    still = last > 0 and signal[last] < _STILL_RISING * signal[last - 1]
    reached = bool(clipped.any() or (still and variance[last] < _FALLEN * variance.max()))
    if not reached:
        return len(signal), False
    first = int(np.argmax(clipped)) if clipped.any() else last
    return min(first, int(np.searchsorted(signal, BELOW_SATURATION * signal[last]))), True


_LARGE_STEP = 1.5
"""Ratio of the variances on both sides of a knee, or its inverse, with which no system gain holds."""
_MOST_BETWEEN = 2
"""Points of each channel between the pieces at a knee."""


def check_knees(channels: Sequence[Channel], source: str, codes: Sequence[_Codes] | None = None) -> None:
    """Raise `SeveralCapturesError` if the variance steps by a factor, or an amount, that biases the system gain.

    `codes` are the distances of the numbers of each channel, where they change with the level.
    """
    levels = [channel.levels for channel in channels]
    if not levels:
        return
    signal, variance, uncertainty, clipped = (
        np.concatenate([each[level.repeated] for level, each in zip(levels, values, strict=True)])
        for values in (
            [level.signal for level in levels],
            [level.noise - QUANTIZATION_DN2 for level in levels],
            [np.hypot(level.noise_uncertainty, level.noise_rounding) for level in levels],
            [level.clipped | (level.white_fraction > CLIPPED_FRACTION) for level in levels],
        )
    )
    order = np.argsort(signal, kind="stable")
    signal, variance, uncertainty, clipped = (each[order] for each in (signal, variance, uncertainty, clipped))
    known = (variance > 0.0) & (uncertainty > 0.0) & (signal > 0.0)
    signal, variance, uncertainty, clipped = (each[known] for each in (signal, variance, uncertainty, clipped))
    if len(signal) < 2 * LEAST_POINTS:
        return
    end, _ = linear_end(signal, variance, clipped)
    found = []
    for before, after in pairwise(find_pieces(signal[:end], variance[:end], uncertainty[:end])):
        step, _ = step_at_knee(signal, variance, uncertainty, before, after)
        near = after.first - before.last - 1 <= _MOST_BETWEEN * len(levels)
        if near and not 1.0 / _LARGE_STEP < step < _LARGE_STEP:
            found.append((0.5 * float(signal[before.last] + signal[after.first]), step))
    if not found:
        _check_noise_step(channels, signal[:end], source, codes)
        return
    where = ", ".join(f"{at:.4g} DN (factor {step:.3g})" for at, step in found)
    cause = "the frames combine several captures"
    if any(step < 1.0 for _, step in found):
        cause = "the numbers are companded, or combine several captures"
    what = f"the temporal variance steps at {where} above black: {cause}"
    hint = "State the companding table in the sensor file if there is one, or calibrate the frames of each capture"
    raise SeveralCapturesError(what, where=source, hint=hint, id=SEVERAL_CAPTURES.id)


def _check_noise_step(channels: Sequence[Channel], below: _Array, source: str, codes: Sequence[_Codes] | None) -> None:
    """Raise `SeveralCapturesError` if the read noise steps, at signals up to the last one given."""
    if not below.size:
        return
    points = []
    for k, channel in enumerate(channels):
        levels, dark = channel.levels, channel.dark.variance
        if dark.reason:
            return
        shortest = int(np.argmin(dark.exposure_s))
        dark_e2 = float(dark.y[shortest])
        of_dark, of_lights = (1.0, np.ones(len(levels.x))) if codes is None else codes[k]
        of_darks = float(np.sqrt(dark.covariance[shortest, shortest]))
        points.append((0.0, dark_e2 - QUANTIZATION_DN2, of_darks, of_dark))
        kept = levels.repeated & (levels.signal > 0.0) & (levels.signal <= below.max())
        values = (
            levels.signal,
            levels.shot + dark_e2 - QUANTIZATION_DN2,
            np.hypot(levels.noise_uncertainty, levels.noise_rounding),
            of_lights[levels.group],
        )
        points += list(zip(*(each[kept].tolist() for each in values), strict=True))
    signal, variance, uncertainty, distances = np.array(sorted(points)).T
    count = len(channels)
    if not ((variance > 0.0) & (uncertainty > 0.0)).all():
        return
    place = find_noise_step(signal, variance, uncertainty, count, count, None if codes is None else distances)
    if place is not None:
        raise SeveralCapturesError(
            f"the temporal variance steps at {0.5 * (signal[place - 1] + signal[place]):.4g} DN above black with the "
            f"same slope on both sides: the frames combine readings of one charge with different read noise",
            where=source,
            hint="Calibrate the frames of each capture",
            id=SEVERAL_CAPTURES.id,
        )
