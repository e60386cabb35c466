"""Dark groups clipped at 0: fit of the reference group, correction of all levels, and of row and column parts.

Under the model of `censored_likelihood.py`, the mean, temporal variance and spatial variance of a clipped level are
known functions of its true mean, DSNU and noise. The correction inverts them. It is applied to all dark levels, so that
the effect of the chip's individual pixels is nearly the same in all of them, and cancels in slopes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from photosite.calibration.dark.censored_likelihood import CensoredDark, count_clipped, fit_censored
from photosite.calibration.reduction.frame_reader import FrameReader
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, GroupStatistics, Level
from photosite.calibration.reduction.reduce import Reduction
from photosite.calibration.spatial.nonuniformity import VarianceComponents
from photosite.calibration.withheld import CLIPPED_TOO_FAR, UNSOLVED_CLIPPING
from photosite.errors import CalibrationError
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.uncertain import Missing, Uncertain, correlated, weighted_mean

_REACH, _POINTS = 8.0, 97
"""Half-width of the integrals in standard deviations, and points of the one over the fixed pattern."""

_HIGHEST_NUMBER = 1 << 16
"""Upper limit of the digital numbers."""


@dataclass(frozen=True)
class _Pixels:
    """Central moments of a clipped and rounded normal, (points,) each, by the true mean of the pixel."""

    fraction: NDArray[np.float64]  # of the pixels at each true mean; the sum is 1
    offset: NDArray[np.float64]  # true mean less that of the level
    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    third: NDArray[np.float64]
    fourth: NDArray[np.float64]

    @classmethod
    def of(cls, mu: float, dsnu_variance: float, read_variance: float) -> _Pixels:
        """Return the moments by sums over the probabilities of each number, which are exact for any noise."""
        d, r = math.sqrt(max(dsnu_variance, 0.0)), math.sqrt(read_variance)
        t = np.linspace(-_REACH, _REACH, _POINTS) if d > 0.0 else np.zeros(1)
        fraction = np.exp(-0.5 * t * t)
        offset = d * t
        top = max(2, min(math.ceil(mu + _REACH * (d + r)) + 2, _HIGHEST_NUMBER))  # a solver may try any noise
        y = np.arange(1, top, dtype=np.float64)
        at_least = ndtr((mu + offset[:, None] - y + 0.5) / r)
        # E[y^k] is the sum over y of P(Y >= y) (y^k - (y - 1)^k).
        raw = [at_least @ (y**k - (y - 1.0) ** k) for k in (1, 2, 3, 4)]
        m = raw[0]
        third = raw[2] - 3.0 * m * raw[1] + 2.0 * m**3
        fourth = raw[3] - 4.0 * m * raw[2] + 6.0 * m**2 * raw[1] - 3.0 * m**4
        return cls(fraction / fraction.sum(), offset, m, raw[1] - m**2, third, fourth)


def _moments(mu: float, dsnu_variance: float, read_variance: float) -> NDArray[np.float64]:
    """Return (3,) mean, temporal variance, and spatial variance of the pixels' means, of clipped numbers.

    A negative DSNU variance, an estimate for a chip without DSNU, continues the first order of a small one.
    """
    pixels = _Pixels.of(mu, dsnu_variance, read_variance)
    mean = float(pixels.fraction @ pixels.mean)
    spatial = float(pixels.fraction @ (pixels.mean - mean) ** 2)
    if dsnu_variance < 0.0:
        spatial = dsnu_variance * float(ndtr((mu - 0.5) / math.sqrt(read_variance))) ** 2
    return np.array([mean, float(pixels.fraction @ pixels.variance), spatial])


def moment_slopes(theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) derivatives of the moments by mean, DSNU variance and read variance."""
    steps = np.array([1e-3 * math.sqrt(theta[2]), 1e-3 * max(abs(theta[1]), 1e-2 * theta[2]), 1e-3 * theta[2]])
    return np.column_stack(
        [(_moments(*(theta + step)) - _moments(*(theta - step))) / (2.0 * step.max()) for step in np.diag(steps)]
    )


def correct_clipping(level: Level, model: CensoredDark) -> Level | Missing:
    """Return a dark level corrected for clipping, or the reason why no noise fits it.

    Its own uncertainties come from temporal noise, and from the part of the chip's effect (its pixels are a sample of
    the model's) that differs from that on the reference level. The common part is in `shared_mean` and
    `shared_variance`. The model is the censored fit of the same channel: the start of the search and, for a level of
    one frame, its noise and DSNU.

    Examples
    --------
    >>> clipped = _moments(0.0, 4.0, 9.0)
    >>> mean, temporal, spatial = (float(entry) for entry in clipped)
    >>> level = Level(10**6, 10, mean, 1e-6, temporal, 1e-3, spatial + temporal / 10, 0.5, 0.0, 0.0)
    >>> model = CensoredDark(10**6, 10, 0.5, 0.1, 3.9, 9.2, np.eye(3), 1.0, True)
    >>> corrected = correct_clipping(level, model)
    >>> abs(corrected.mean) < 1e-6, round(corrected.variance - 1 / 12, 6)
    (True, 9.0)
    """
    from scipy.optimize import least_squares, root

    if level.low_fraction == 0.0:
        return level
    start = model.theta
    observed = np.array([level.mean, level.variance, level.spatial_variance - level.variance / level.frames])
    free = np.array([0, 1, 2]) if level.repeated else np.array([0])
    scale = math.sqrt(abs(start[1]) + start[2])

    def theta_of(x: NDArray[np.float64], near: NDArray[np.float64]) -> NDArray[np.float64]:
        theta = near.copy()
        theta[0] += scale * x[0]
        if level.repeated:
            theta[1] += scale**2 * x[1]
            theta[2] *= math.exp(min(x[2], 50.0))
        return theta

    def residual(x: NDArray[np.float64], near: NDArray[np.float64]) -> NDArray[np.float64]:
        away = (_moments(*theta_of(x, near)) - observed) / np.array([scale, scale**2, scale**2])
        return np.asarray(away[free])

    near, found = start, root(residual, np.zeros(len(free)), (start,), tol=1e-10)
    if not _solved(found):  # a level with few numbers at 0 may be far from the model, and near its own moments
        own = np.array([level.mean, observed[2], max(level.variance - QUANTIZATION_DN2, 0.01 * start[2])])
        near = own if level.repeated else np.array([level.mean, *start[1:]])
        found = least_squares(residual, np.zeros(len(free)), bounds=(-20.0, 20.0), args=(near,), xtol=1e-15)
    if not _solved(found):
        zeros = f"{100 * level.low_fraction:.3g} % of the numbers are 0"
        if found.success:
            return CLIPPED_TOO_FAR.missing(f"{zeros}, and no level and noise explain the rest")
        return UNSOLVED_CLIPPING.missing(f"{zeros}; the search for level and noise of the rest did not converge")
    return _restored(level, theta_of(found.x, near), start, free)


def _solved(found: Any) -> bool:
    return float(np.abs(found.fun).max()) < 1e-6  # in units of the noise, or of its variance


def _inverse(theta: NDArray[np.float64], free: NDArray[np.int64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.inv(moment_slopes(theta)[np.ix_(free, free)]), np.float64)


def _influence(
    pixels: _Pixels, back: NDArray[np.float64], free: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (2, points) the effect of a pixel at each true mean on the level's mean and read variance, times pixels.

    The pixel's own offset is not an error of the level.
    """
    moments = pixels.mean, pixels.variance, (pixels.mean - float(pixels.fraction @ pixels.mean)) ** 2
    change = np.array([moment - pixels.fraction @ moment for moment in moments])
    influence = back @ change[free]
    return influence[0] - pixels.offset, influence[-1]


def _restored(level: Level, theta: NDArray[np.float64], first: NDArray[np.float64], free: NDArray[np.int64]) -> Level:
    """Return the level at `theta`; `first` is the reference level, with which it shares the effect of its pixels."""
    pixels, back = _Pixels.of(*theta.tolist()), _inverse(theta, free)
    temporal = back @ _temporal_covariance(pixels, level.frames)[np.ix_(free, free)] @ back.T / level.pixels
    reference = _Pixels.of(*first.tolist())
    shared, own = [], []
    for here, other in zip(
        _influence(pixels, back, free), _influence(reference, _inverse(first, free), free), strict=True
    ):
        size = math.sqrt(float(reference.fraction @ other**2))
        along = float((pixels.fraction * here) @ other) / size if here.size == other.size and size > 0.0 else 0.0
        shared.append(along / math.sqrt(level.pixels))
        own.append(max(float(pixels.fraction @ here**2) - along**2, 0.0) / level.pixels)
    mean, mean_variance = float(theta[0]), float(temporal[0, 0]) + own[0]
    restored = replace(level, mean=mean, mean_variance=mean_variance, shared_mean=shared[0], low_fraction=0.0)
    if not level.repeated:
        return restored
    numbers = float(theta[2]) + QUANTIZATION_DN2
    return replace(
        restored,
        variance=numbers,
        variance_uncertainty=math.sqrt(float(temporal[2, 2]) + own[1]),
        shared_variance=shared[1],
        spatial_variance=float(theta[1]) + numbers / level.frames,
    )


def _temporal_covariance(pixels: _Pixels, n: int) -> NDArray[np.float64]:
    """Return the (3, 3) covariance of mean, temporal and spatial variance over n frames, times the number of pixels."""
    away = pixels.mean - pixels.fraction @ pixels.mean

    def over(values: NDArray[np.float64]) -> float:
        return float(pixels.fraction @ values)

    mean_mean = over(pixels.variance) / n
    if n == 1:
        return np.array([[mean_mean, 0.0, 0.0], [0.0, math.nan, 0.0], [0.0, 0.0, math.nan]])
    square = pixels.variance**2
    mean_temporal = over(pixels.third) / n
    mean_spatial = 2.0 * over(away * pixels.variance) / n
    temporal = over(pixels.fourth - square * (n - 3) / (n - 1)) / n
    both = 2.0 * over(square) / (n * (n - 1))
    temporal_spatial = 2.0 * over(away * pixels.third) / n - both
    spatial = 4.0 * over(away**2 * pixels.variance) / n + both
    return np.array(
        [
            [mean_mean, mean_temporal, mean_spatial],
            [mean_temporal, temporal, temporal_spatial],
            [mean_spatial, temporal_spatial, spatial],
        ]
    )


CLIPPED_DARKS = DiagnosticKind(
    "clipped-darks",
    "warning",
    "Numbers of the dark frames are 0 because the black level is too low.",
    "Read noise, DSNU and black level come from a censored fit, with larger uncertainties; light levels with more than "
    "a few numbers at 0 were left out.",
    "Raise the camera's black level (pedestal), and take the dark frames again.",
    ("read_noise_*", "dsnu*", "black_level_dn", "dark_current_*", "dark_voltage_*", "dcnu_percent"),
    "fraction of the numbers that are 0",
    "none: numbers are counted",
)

NO_PIXEL_SLOPES = CLIPPED_DARKS.missing(
    "the dark frames are clipped at 0, and clipped pixels do not show their dark current; raise the camera's black "
    "level (pedestal)"
)

METHOD = "censored maximum likelihood (normal DSNU, normal noise, rounded, clipped at 0)"

DarkEstimates = tuple[Uncertain, Uncertain, Uncertain]
"""Black level (DN), DSNU variance and read variance (DN^2), correlated.

The black level's uncertainty does not include DSNU^2 / pixels, like that of a mean dark level."""


@dataclass(frozen=True)
class ClippedDarks:
    """Dark groups corrected for clipping at 0."""

    groups: tuple[GroupStatistics, ...]
    censored: tuple[CensoredDark, ...]  # fit of the reference group, per channel
    estimates: tuple[DarkEstimates, ...]  # its estimates with their covariance, per channel

    def pooled(self) -> DarkEstimates:
        """Return the mean estimates of all channels, weighted by their pixels."""
        weights = [float(dark.pixels) for dark in self.censored]
        black, dsnu, read = (weighted_mean(entries, weights) for entries in zip(*self.estimates, strict=True))
        return black, dsnu, read

    def scale(self, channel: int) -> float:
        """Return the factor that undoes the clipping of the variance of shifts common to all pixels."""
        theta = self.censored[channel].theta
        theta[1] = max(theta[1], 0.0)
        return 1.0 / float(moment_slopes(theta)[0, 0]) ** 2

    def components(
        self, channel: int, plain: VarianceComponents | Missing, filtered: VarianceComponents | Missing
    ) -> tuple[VarianceComponents | Missing, VarianceComponents | Missing]:
        """Return row, column and pixel parts of the fixed pattern, from those of the clipped mean frame.

        A row's offset shifts the mean of its clipped pixels as a common shift does. The total is the DSNU of the
        censored fit. The high-pass takes the same fraction of the pixel part with and without clipping.
        """
        if isinstance(plain, Missing):
            return plain, filtered
        _, dsnu, _ = self.estimates[channel]
        scale = self.scale(channel)
        row, column = plain.row * scale, plain.column * scale
        pixel = dsnu - row - column
        restored = VarianceComponents(total=dsnu, row=row, column=column, pixel=pixel)
        if isinstance(filtered, Missing):
            return restored, filtered
        row, column = filtered.row * scale, filtered.column * scale
        if plain.pixel.value > 2.0 * plain.pixel.standard_uncertainty:
            pixel = pixel * (filtered.pixel.value / plain.pixel.value)
        else:
            pixel = filtered.pixel * scale
        return restored, VarianceComponents(total=pixel + row + column, row=row, column=column, pixel=pixel)

    def warning(self, names: Sequence[str]) -> str:
        """Return the warning of a calibration with clipped dark frames."""
        fraction = max(dark.zero_fraction for dark in self.censored)
        text = (
            f"the dark frames are clipped at 0 (up to {100 * fraction:.3g} % of their numbers): read noise, DSNU and "
            f"black level come from {METHOD}; the same model corrects the dark levels, and light levels with more than "
            f"a few numbers at 0 were left out"
        )
        if odd := [name for name, dark in zip(names, self.censored, strict=True) if not dark.misfit_is_chance]:
            worst = max(dark.misfit for dark in self.censored)
            where = f" of channel{'s' * (len(odd) > 1)} {', '.join(odd)}" if len(names) > 1 else ""
            text += (
                f"; the model does not describe the dark frames{where} (hot pixels, shading, tails; chi square "
                f"{worst:.2g} per degree of freedom), and uncertainties were widened accordingly"
            )
        return text


def correct_clipped_darks(reduction: Reduction, reference: GroupStatistics, reader: FrameReader) -> ClippedDarks | None:
    """Read the reference group again for its zeros, fit it, and correct all dark levels; None where none is clipped.

    Raises
    ------
    CalibrationError
        If too little of a level is above 0.
    """
    darks = reduction.darks
    if not any(level.low_fraction > CLIPPED_DARK_FRACTION for entry in darks for level in entry.levels):
        return None
    members = {id(source) for source in reference.group.frames}
    sources = [entry.source for entry in reduction.used if id(entry.source) in members]
    shape = reduction.frames.rows, reduction.frames.cols
    counts = count_clipped((source.read() for source in sources), shape, reader.tile)
    censored = []
    for name, channel in zip(reduction.names, counts, strict=True):
        found = fit_censored(channel)
        if isinstance(found, Missing):
            raise _error(reduction, reference, name, found)
        censored.append(found)
    groups = []
    for entry in darks:
        levels = []
        for name, level, dark in zip(reduction.names, entry.levels, censored, strict=True):
            corrected = correct_clipping(level, dark)
            if isinstance(corrected, Missing):
                raise _error(reduction, entry, name, corrected)
            levels.append(corrected)
        groups.append(replace(entry, levels=tuple(levels)))
    return ClippedDarks(tuple(groups), tuple(censored), tuple(_estimates(dark) for dark in censored))


def _error(reduction: Reduction, group: GroupStatistics, name: str, why: Missing) -> CalibrationError:
    kind, hint = CLIPPED_TOO_FAR, "Raise the camera's black level (pedestal) and take the dark frames again"
    if why.id == UNSOLVED_CLIPPING.id:
        kind, hint = UNSOLVED_CLIPPING, "Leave out the dark frames of this exposure time"
    return reduction.error(kind, f"the dark frames are clipped at 0 DN: {why.reason}", hint, group, name)


def _estimates(dark: CensoredDark) -> DarkEstimates:
    covariance = dark.covariance.copy()
    covariance[0, 0] -= max(dark.dsnu_variance, 0.0) / dark.pixels
    black, dsnu, read = correlated(dark.theta, covariance)
    return black, dsnu, read
