"""The system gain from dark frames alone: photon transfer over pixels whose dark currents differ.

Dark current is collected as photoelectrons are: its shot noise is K times its mean. From a short to a long exposure
time t, a pixel's mean x grows by its dark signal and its temporal variance w by K times that. Black level, read noise,
and noise that rows and frames share are the same for all pixels and go into a constant: only differences between pixels
count, so that a black level that moves with the exposure time does no harm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark.dark_result import DarkResult
from photosite.calibration.measurements import NO_LIGHT
from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.reduction.groups import GroupStatistics
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.withheld import NO_FLAT_FIELDS
from photosite.engine.frame_sums import FrameSums
from photosite.frames.frame_set import FrameSource
from photosite.values.diagnostic import DiagnosticKind, one_in
from photosite.values.uncertain import Missing, Uncertain

LEAST_FRAMES = 4
"""Dark frames at each of the two exposure times: two for each half."""

LEAST_BIN = 64
"""Pixels with the largest dark signals that make the first bin; the others have twice the pixels of the one before."""

MOST_UNCERTAINTY = 0.2
"""Largest relative standard uncertainty of the gain."""

MOST_SIGNAL = 0.5
"""Largest dark signal of a pixel, as a fraction of the range of the converter."""

P_VALUE = 1e-3
"""Fraction of chips with shot noise alone whose pixels may scatter as far, for each of the two tests."""

GAIN_FROM_DARKS = DiagnosticKind(
    "gain-from-dark-frames",
    "note",
    "There are no flat fields. Dark currents that differ between the pixels have shot noise, which shows the gain.",
    "System gain and electrons come from dark frames of two exposure times. Dark currents that blink weakly, below "
    "what the noise shows, make the gain too high, by up to its uncertainty. Interpixel capacitance makes "
    "it lower, by four times the fraction in each next pixel.",
    "Take flat fields at two levels or more.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s"),
    "relative standard uncertainty of the gain",
    "none: it states the source",
)
EXCESS_DARK_NOISE = DiagnosticKind(
    "excess-dark-noise",
    "withheld",
    "There are no flat fields, and the temporal variance of pixels with more dark current is not that of shot noise: "
    "dark currents that blink between two levels (telegraph noise), or a temperature that drifted.",
    "The dark frames give no system gain.",
    "Take flat fields at two levels or more.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s"),
    false_alarms=f"{one_in(2 * P_VALUE)} sets",
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DarkGain:
    """The system gain from dark frames.

    Parameters
    ----------
    gain
        DN per electron.
    exposures_s
        The short and the long exposure time.
    electrons
        Dark signal of the brightest pixels, the mean of `LEAST_BIN`.
    """

    gain: Uncertain
    exposures_s: tuple[float, float]
    electrons: float

    method: ClassVar[str] = "slope of temporal variance against dark signal over the pixels, from dark frames alone"

    def __str__(self) -> str:
        low, high = self.exposures_s
        u = 100 * self.gain.standard_uncertainty / self.gain.value
        return (
            f"no light frames: the system gain comes from the dark frames of {low:g} and {high:g} s, by the shot noise "
            f"of dark signals of up to {self.electrons:.3g} e-; standard uncertainty {u:.2g} %"
        )


def measure_dark_gain(reduction: Reduction, dark: DarkResult) -> DarkGain | Missing:
    """Return the system gain from dark frames of two exposure times, or why they do not give it.

    Each group is divided in halves. The pixels are binned by their dark signals in one half; mean signal and mean
    variance of the bins are those of the other half, so that noise neither selects pixels nor flattens the line. A
    parabola through the bins, whose errors are the scatter of the pixels, has the gain as its slope between
    no dark signal and the mean of the darker half of the pixels. Its curvature takes up noise that grows with the
    square of the dark signal, as that of blinking dark currents does; the change of the slope up to there is part of
    the uncertainty. The halves change their parts, and the mean of both slopes is the gain.

    Pixels of one dark signal must have one variance: their deviations in both halves are compared.
    """
    pair = _pair(reduction)
    if isinstance(pair, Missing):
        return pair
    if dark.rounding_shows:
        return NO_FLAT_FIELDS.missing("no light frames, and rounding hides the noise of the dark frames")
    spreads = dark.slopes or ()
    if not any(spread.variance.value > 3.0 * spread.variance.standard_uncertainty for spread in spreads):
        return NO_FLAT_FIELDS.missing("no light frames, and no dark currents that differ between the pixels")
    halves = [_half(reduction, pair, k) for k in range(2)]
    limit = MOST_SIGNAL * ((1 << reduction.frames.bits) - 1)
    kept = halves[0][0] < limit
    (x0, w0), (x1, w1) = ((x[kept], w[kept]) for x, w in halves)
    if x0.size < 8 * LEAST_BIN:
        return NO_FLAT_FIELDS.missing("no light frames, and too few pixels for the shot noise of dark frames")
    found = [_slope(x0, x1, w1), _slope(x1, x0, w0)]
    gain = 0.5 * (found[0].gain + found[1].gain)
    u = 0.5 * math.hypot(found[0].uncertainty, found[1].uncertainty, found[0].change + found[1].change)
    exposures = pair[0].group.exposure_s, pair[1].group.exposure_s
    if not 0.0 < u < MOST_UNCERTAINTY * gain:
        size = f"uncertain by {100 * u / gain:.2g} %" if gain > 0.0 else "below 0"
        return NO_FLAT_FIELDS.missing(
            f"no light frames, and the dark current is too small for a gain from dark frames of {exposures[0]:g} and "
            f"{exposures[1]:g} s: it would be {size}"
        )
    if _differing_noise(found, x0, w0, x1, w1, gain) or min(each.p_value for each in found) < P_VALUE / 2:
        return EXCESS_DARK_NOISE.missing(
            "no light frames, and the noise of pixels with more dark current is not shot noise alone: pixels that "
            "blink, or a temperature that drifted"
        )
    return DarkGain(Uncertain.of(gain, u), exposures, found[0].largest / gain)


def _pair(reduction: Reduction) -> tuple[GroupStatistics, GroupStatistics] | Missing:
    """Return the two dark groups whose difference is known best relative to their exposure times."""
    usable = [
        entry
        for entry in reduction.darks
        if entry.frames >= LEAST_FRAMES and not any(level.low_fraction or level.clipped for level in entry.levels)
    ]
    gains = [1.0 if steps is None else steps.by_group[reduction.reference or 0] for steps in reduction.steps]
    pairs = [(a, b) for a in usable for b in usable if a.group.exposure_s < b.group.exposure_s]
    if not pairs or max(gains) > min(gains):
        return NO_LIGHT

    def size(pair: tuple[GroupStatistics, GroupStatistics]) -> float:
        noise = math.hypot(*(entry.levels[0].variance / math.sqrt(entry.frames - 1) for entry in pair))
        return noise / (pair[1].group.exposure_s - pair[0].group.exposure_s)

    return min(pairs, key=size)


def _half(reduction: Reduction, pair: tuple[GroupStatistics, GroupStatistics], part: int) -> tuple[Array, Array]:
    """Return (pixels,) dark signal and its variance, in every other frame of two groups."""
    taken = reduction.as_taken  # hot pixels may have been replaced
    used, maps = {id(entry.source) for entry in taken.used}, []
    for entry in pair:
        (group,) = (each for each in taken.frames.of_kind("dark") if each.exposure_s == entry.group.exposure_s)
        sources = [source for source in group.frames if id(source) in used][part::2]
        sums = FrameSums((reduction.frames.rows, reduction.frames.cols), white=(1 << reduction.frames.bits) - 1)
        sums.add(_read(sources))
        maps.append((sums.mean().ravel(), sums.variance().ravel()))
    (mean, variance), (later_mean, later_variance) = maps
    return later_mean - mean, later_variance - variance


def _read(sources: Sequence[FrameSource]) -> Sequence[NDArray[np.unsignedinteger]]:
    return [source.read() for source in sources]


@dataclass(frozen=True)
class _Slope:
    """A fit over bins: the slope halfway between no signal and the darker half, and its change to either of them.

    `p_value` is the chance of the chi square, and `largest` the largest mean signal of a bin.
    """

    gain: float
    uncertainty: float
    change: float
    p_value: float
    largest: float
    bins: tuple[NDArray[np.int64], ...]


def _bins(signal: Array) -> tuple[NDArray[np.int64], ...]:
    order, edges, size = np.argsort(-signal, kind="stable"), [0], LEAST_BIN
    while 2 * (edges[-1] + size) < order.size:
        edges.append(edges[-1] + size)
        size *= 2
    return tuple(np.split(order, edges[1:]))


def _slope(by: Array, x: Array, w: Array) -> _Slope:
    """Fit the parabola through bins of the pixels with similar `by`."""
    from scipy.special import chdtrc

    bins = _bins(by)
    mean, variance = (np.array([values[part].mean() for part in bins]) for values in (x, w))
    scale, gain, half = float(np.ptp(mean)), 0.0, 0.5 * float(mean[-1])
    design = np.vander((mean - half) / scale, 3, increasing=True)
    for _ in range(3):  # within a bin, variances differ by the gain times the signals
        error = [np.var(w[part] - gain * x[part], ddof=1) / part.size for part in bins]
        fit = fit_linear(design, variance, np.diag(error))
        gain = float(fit.parameters[1]) / scale
    chance = float(chdtrc(fit.degrees_of_freedom, fit.chi_square))
    change = 2.0 * float(fit.parameters[2]) / scale**2 * half
    return _Slope(gain, math.sqrt(fit.covariance[1, 1]) / scale, change, chance, float(mean[0]), bins)


def _differing_noise(found: Sequence[_Slope], x0: Array, w0: Array, x1: Array, w1: Array, gain: float) -> bool:
    """Return whether pixels of one dark signal differ in noise: their deviations agree in both halves."""
    total = squares = largest = 0.0
    for part in found[0].bins:  # pixels with large dark signals first: there, blinking is the largest part of the noise
        rest = [w[part] - gain * x[part] for x, w in ((x0, w0), (x1, w1))]
        product = math.prod((each - each.mean()) / each.std() for each in rest)
        total, squares = total + float(product.sum()), squares + float((product**2).sum())
        largest = max(largest, total / math.sqrt(squares))
    return 0.5 * math.erfc(largest / math.sqrt(2.0)) < P_VALUE / len(found[0].bins)
