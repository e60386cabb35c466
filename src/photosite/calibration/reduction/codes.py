"""Codes of the converter among the digital numbers: their step and sums, and the white level of a channel.

Missing and doubled codes show a digital gain, and its size. A gain g that is applied after the converter makes
round(g c) of the code c. Above 1 it leaves numbers out, at a mean distance of g; below 1 it maps two codes to one
number at regular places. The quantization noise is then that of the converter's step, g^2/12 DN^2, and of the second
rounding, 1/12 DN^2 where g is not an integer.

Numbers left out are found as gaps between numbers that both occur often. Doubled numbers are found in the Fourier
transform of the counts. Without a gain, the counts of noise have no amplitude above a frequency of 0.7 / (standard
deviation), apart from chance. A digital gain has peaks at the fractional parts of k/g, of height |sinc(k/g)|.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.values.diagnostic import DiagnosticKind

Counts = NDArray[np.int64]
"""(n, 3): channel, digital number, and how often it occurs among the sampled pixels of a group."""


_LENGTH = 1 << 17
_APART = _LENGTH // 100


STRETCH_TOLERANCE = 1e-3
"""Relative difference within which a gain is that between the full scales of two bit depths."""


@dataclass(frozen=True)
class Steps:
    """Distance of the converter's codes in one channel, DN.

    Parameters
    ----------
    by_group
        (groups,) step at each group's level, in the order of the groups.
    uniform
        Whether the step is the same at all levels, as with a digital gain; else it grows, as with decoded square-root
        companding.
    """

    by_group: tuple[float, ...]
    uniform: bool = True

    @property
    def step(self) -> float:
        """The largest step."""
        return max(self.by_group)

    def quantization(self, group: int) -> float:
        """Return the quantization noise at a group's level, DN^2."""
        step = self.by_group[group]
        again = self.uniform and step != round(step)
        return (step**2 + again) / 12.0

    def __str__(self) -> str:
        if not self.uniform:
            low, high = min(self.by_group), self.step
            return f"neighboring numbers are {low:.3g} DN apart at low levels and {high:.3g} DN at high ones"
        if self.step < 1.0:
            return f"some numbers stand for two codes of the converter, as after a digital gain of {self.step:.4g}"
        left_out = 100.0 * (1.0 - 1.0 / self.step)
        return f"{left_out:.3g} % of the numbers are left out, as after a digital gain of {self.step:.4g}"

    def stretched_from(self, bits: int) -> int | None:
        """Return the bit depth whose numbers were stretched to the whole range of `bits`, None if it is another gain.

        Examples
        --------
        >>> Steps((16.0037,)).stretched_from(16), Steps((16.0,)).stretched_from(16)
        (12, None)
        """
        for fewer in range(6, bits):
            gain = ((1 << bits) - 1) / ((1 << fewer) - 1)
            if self.uniform and self.step != round(self.step) and abs(self.step - gain) < STRETCH_TOLERANCE * gain:
                return fewer
        return None


def count_codes(samples: Sequence[NDArray[np.uint16]], labels: NDArray[np.int64]) -> Counts:
    """Return the counts of the digital numbers in a group's samples; `labels` are those of a sample's pixels."""
    stack = np.array(samples, np.uint16).reshape(-1, *labels.shape)
    parts = []
    for label in range(int(labels.max()) + 1):
        counts = np.bincount(stack[:, labels == label].ravel())
        codes = np.flatnonzero(counts)
        parts.append(np.column_stack([np.full(len(codes), label), codes, counts[codes]]))
    return np.concatenate(parts).astype(np.int64)


def channel_counts(counts: Counts, channel: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the digital numbers of a channel, in increasing order, and their counts."""
    chosen = counts[counts[:, 0] == channel]
    return chosen[:, 1], chosen[:, 2]


def find_steps(
    groups: Sequence[Counts], noise_dn: Sequence[float], channel: int, channels: int, clip: tuple[float, float]
) -> Steps | None:
    """Return the steps of a channel; None where they are 1 DN within what the counts show.

    Parameters
    ----------
    groups
        Counts of each group.
    noise_dn
        (groups,) temporal standard deviation, NaN if unknown.
    channel, channels
        Index of the channel, and number of channels that are searched.
    clip
        Lowest and highest number; both are left out.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> numbers = np.rint(1.37 * np.rint(rng.normal(100.0, 3.0, (8, 64, 64)))).astype(np.uint16)
    >>> counts = count_codes(list(numbers), np.zeros((64, 64), np.int64))
    >>> round(find_steps([counts], [4.1], 0, 1, (0, 4095)).step, 2)
    1.37
    """
    inside = []
    for counts in groups:
        codes, numbers = channel_counts(counts, channel)
        take = (codes > clip[0]) & (codes < clip[1])
        inside.append((codes[take], numbers[take]))
    return _missing(inside) or _doubled(inside, noise_dn, channels)


FREQUENT_COUNT = 20
"""Counts of two numbers between which the others must occur. By chance a number between them is missing in fewer than
1 of 10^8 cases (Poisson counts, a density without a dip)."""
LEAST_GAPS = 8
"""Distances of numbers that a step is computed from."""


def _missing(groups: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]]) -> Steps | None:
    """Return the steps from gaps between numbers that occur often."""
    gaps = []
    for codes, counts in groups:
        often = counts >= FREQUENT_COUNT
        gaps.append(np.diff(codes)[often[1:] & often[:-1]])
    all_gaps = np.concatenate(gaps)
    if len(all_gaps) < LEAST_GAPS or np.count_nonzero(all_gaps > 1) < 3:
        return None
    step = float(all_gaps.mean())
    regular = all_gaps.max() <= math.floor(step) + 1 and all_gaps.min() >= math.floor(step)
    if regular and all(abs(float(found.sum()) - step * len(found)) < 2.0 + 0.01 * found.sum() for found in gaps):
        return Steps((step,) * len(groups))
    known = [i for i, found in enumerate(gaps) if len(found) >= 3 and np.ptp(found) <= 1 + found.min() // 2]
    if len(known) < 3 or len(known) < 0.5 * sum(len(found) >= 3 for found in gaps):
        return None
    level = np.array([np.average(codes, weights=counts) if len(codes) else 0.0 for codes, counts in groups])
    # The mean square of the steps, weighted by their widths, as for numbers that fall everywhere alike.
    square = np.array([float((gaps[i] ** 3).sum() / gaps[i].sum()) for i in known])
    order = np.argsort(level[known])
    at, steps = level[known][order], np.sqrt(square[order])
    if np.any(np.diff(steps) < -0.2 * steps[:-1]) or steps[-1] < 1.5 * steps[0]:
        return None
    return Steps(tuple(np.interp(level, at, steps).tolist()), uniform=False)


DOUBLED_P_VALUE = 5e-4
"""Fraction of clean calibrations in which doubled numbers may be reported."""
SMOOTH_FREQUENCY = 0.7
"""Frequency times standard deviation above which a density of normal noise has no amplitude (exp(-9.7))."""
LEAST_NOISE_DN = 3.0
"""Least temporal noise of the levels in which doubled numbers are searched."""
LEAST_STEP, PEAKS, ORDERS, MISFIT = 0.55, 4, 12, 0.1
"""Smallest step that is searched; peaks that it is searched from, and their orders k; largest squared misfit of the
heights, relative."""
NEAR_NUMBERS, LEAST_TWICE, LEAST_RATIO = 15, 3, 1.5
"""Numbers on either side with which a number's counts are compared; numbers that stand for two codes, at least; and how
much more often they must occur (2 times with a digital gain)."""


def _doubled(
    groups: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]], noise_dn: Sequence[float], channels: int
) -> Steps | None:
    """Return the step below 1 from the peaks of the counts' Fourier transform."""
    chosen = [i for i, noise in enumerate(noise_dn) if noise >= LEAST_NOISE_DN and len(groups[i][0])]
    if not chosen:
        return None
    total = np.zeros(_LENGTH)
    for i in chosen:
        codes, counts = groups[i]
        total[codes] += counts
    number = float(total.sum())
    lowest = math.ceil(SMOOTH_FREQUENCY / min(noise_dn[i] for i in chosen) * _LENGTH)
    power = np.abs(np.fft.rfft(total)) ** 2 / number
    if lowest >= len(power):
        return None
    places: list[float] = []
    left = power.copy()
    left[:lowest] = 0.0
    limit = math.log(len(power) * channels / DOUBLED_P_VALUE)
    while len(places) < PEAKS and left.max() > limit:
        peak = int(np.argmax(left))
        places.append(peak / _LENGTH)
        left[max(peak - _APART, 0) : peak + _APART] = 0.0
    inverse = {
        (m + sign * at) / k for at in places for k in range(1, ORDERS + 1) for m in range(2 * k + 1) for sign in (1, -1)
    }
    steps = {1.0 / value for value in inverse if 1.0 + 1.0 / _LENGTH < value < 1.0 / LEAST_STEP}
    # With gains like 0.75, ties of the rounding change the peaks; they occur at exact values only.
    steps |= {round(step, 3) for step in steps if abs(step - round(step, 3)) < 1e-4}
    near = power.copy()  # the highest power within two frequencies
    for shift in (1, 2):
        near[shift:] = np.maximum(near[shift:], power[:-shift])
        near[:-shift] = np.maximum(near[:-shift], power[shift:])
    misfits = {step: _misfit(step, near, number, lowest) for step in sorted(steps)}
    best = min(misfits, key=misfits.__getitem__, default=1.0)
    if misfits.get(best, 1.0) >= MISFIT or _count_ratio(total, best) < LEAST_RATIO:
        return None
    return Steps((best,) * len(groups))


def _count_ratio(counts: NDArray[np.float64], step: float) -> float:
    """Return how much more often the numbers occur that stand for two codes than the others; 0 if it is not known.

    The offset of the codes is the one with the largest ratio. A converter with unequal steps, whose counts may have the
    same frequencies, reaches 1.2.
    """
    near = 2 * NEAR_NUMBERS + 1
    sums = np.cumsum(np.pad(counts, (NEAR_NUMBERS + 1, NEAR_NUMBERS), "symmetric"))
    usual = (sums[near:] - sums[:-near]) / near
    known = np.flatnonzero(usual > FREQUENT_COUNT)
    relative = counts[known] / usual[known]
    codes = np.arange(int(known.max(initial=0) / step) + 2)
    ratios = [0.0]
    for offset in np.arange(0.0, 1.0, 1.0 / 64.0):
        twice = np.bincount((step * codes + offset + 0.5).astype(int), minlength=len(counts))[known] == 2
        if LEAST_TWICE <= np.count_nonzero(twice) < len(known):
            ratios.append(float(relative[twice].mean() / relative[~twice].mean()))
    return max(ratios)


def _misfit(step: float, near: NDArray[np.float64], number: float, lowest: int) -> float:
    """Return the squared misfit of the peaks' heights, relative to the squares of those expected for a step."""
    order = np.arange(1, ORDERS + 1) / step
    folded = np.abs(order - np.rint(order))
    take = np.rint(folded * _LENGTH).astype(int) > lowest
    if not take.any():
        return math.inf
    codes = np.rint(step * np.arange(600))
    phases = 2.0 * np.pi * folded[take, None] * codes
    expected = np.hypot(np.cos(phases).mean(axis=1), np.sin(phases).mean(axis=1))
    places = np.rint(folded[take] * _LENGTH).astype(int)
    found = np.sqrt(near[places] / number)
    return float(((found - expected) ** 2).sum() / (expected**2).sum())


@dataclass(frozen=True)
class Sums:
    """Each number is the sum of `number` codes of `bits` bits."""

    number: int
    bits: int

    def __str__(self) -> str:
        return (
            f"the flat fields are clipped at {self.number} times the full scale of {self.bits} bits: each number is "
            f"the sum of {self.number} of the converter's (binned pixels or averaged frames); gain, wells and noise "
            f"hold for the sums, and the quantization noise of {self.number} codes was subtracted"
        )


SUMMED_CODES = DiagnosticKind(
    "summed-codes",
    "warning",
    "The flat fields are clipped at a multiple of a smaller converter's full scale.",
    "Each number is the sum of several of the converter's (binned pixels or averaged frames): gain, wells and noise "
    "are those of the sums, and their quantization noise was subtracted.",
    "Switch binning and averaging off, if single pixels are wanted.",
    ("system_gain_dn_per_e", "saturation_*", "read_noise_*"),
    "number of codes in a sum",
    "below 1 of 1000 cameras",
)


NUMBERS = (2, 4, 8, 9, 16, 32, 64)
"""Numbers of frames or pixels that cameras add up."""
LEAST_BITS = 10
"""Smallest bit depth that is searched: a white level is a multiple of 1023 or more, times one of the numbers, by chance
in fewer than one of 1000 cameras."""


def find_sums(white: int, step: float, bits: int) -> Sums | None:
    """Return how many of the converter's codes make one number, from the white level; None for one.

    Examples
    --------
    >>> find_sums(4 * 4095, 1.0, 14), find_sums(4 * 4095, 4.0, 14), find_sums(4095, 1.0, 12)
    (Sums(number=4, bits=12), None, None)
    """
    if step < 1.0 or step != round(step) or white % round(step):
        return None
    codes = white // round(step)
    for fewer in range(LEAST_BITS, bits):
        number, left = divmod(codes, (1 << fewer) - 1)
        if left == 0 and number in NUMBERS:
            return Sums(number, fewer)
    return None


WHITE_LEAST_FRACTION, WHITE_LEAST_COUNT = 0.004, 10
"""Fraction and number of a group's samples at the white level that show it."""

WHITE_PILED = 4.0
"""Counts at the white level over those of each of the three numbers below.

Clipping collects the upper tail of the noise, so that this holds from 12 DN of noise at `WHITE_LEAST_FRACTION`, and
from 3 DN where half of the samples are clipped. At the end of a smooth tail, 10 counts above 2 are a case in 10^9."""

WHITE_MOST_ABOVE = 0.001
"""Fraction of samples above the white level that defective pixels may have."""


def find_white_level(lights: Sequence[Counts], channel: int, full_scale: int) -> int:
    """Return the number at which a channel's flat fields are clipped; the full scale if none shows a lower one.

    Examples
    --------
    >>> import numpy as np
    >>> from photosite.calibration.reduction.codes import count_codes
    >>> rng = np.random.default_rng(1)
    >>> numbers = np.minimum(np.rint(rng.normal(2990.0, 15.0, (8, 64, 64))), 3000).astype(np.uint16)
    >>> counts = count_codes(list(numbers), np.zeros((64, 64), np.int64))
    >>> find_white_level([counts], 0, 4095)
    3000
    """
    found = 0
    for counts in lights:
        codes, numbers = channel_counts(counts, channel)
        if not len(codes):
            continue
        total = int(numbers.sum())
        above = total - numbers.cumsum()  # samples above each code
        at = int((above < WHITE_LEAST_FRACTION * total).argmax())
        most = max(WHITE_LEAST_COUNT, WHITE_PILED * float(numbers[max(at - 3, 0) : at].max(initial=0)))
        if numbers[at] >= most and above[at] <= WHITE_MOST_ABOVE * total:
            found = max(found, int(codes[at]))
    if found and all(fraction_above(counts, channel, found) <= WHITE_MOST_ABOVE for counts in lights):
        return min(found, full_scale)
    return full_scale


def fraction_above(counts: Counts, channel: int, code: int) -> float:
    """Return the fraction of a channel's samples above a number."""
    codes, numbers = channel_counts(counts, channel)
    return float(numbers[codes > code].sum() / max(numbers.sum(), 1))
