"""Statistics of a group of frames: level, temporal variance and spatial variance per channel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.quantization import rounding_uncertainty, second_rounding
from photosite.engine.frame_sums import LabelTotals
from photosite.frames.frame_set import FrameGroup
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.cfa import Cfa, channel_names
from photosite.values.uncertain import Source, Uncertain, combined

CLIPPED_FRACTION = 0.001
"""Fraction of numbers at 0 or at full scale above which a light level is outside the linear range."""

LEAST_DARK_VARIANCE = 0.24
"""DN^2; EMVA 1288: below it quantization hides the temporal dark noise, and this is its upper limit."""

CLIPPED_DARK_FRACTION = 0.005
"""Fraction of a dark level's numbers at 0 above which the frames count as clipped (`dark/clipped_darks.py`).

At this fraction the read noise is 0.5 % low. Below it, the possible effect of clipping widens the uncertainty."""

_SPREAD_SIGMA = 4.0
"""Standard uncertainties from which noise that differs between pixels is taken into account."""


def clipping_bias(fraction: float) -> float:
    """Return the relative bias of a normal noise's variance when a fraction of its lower tail is clipped, 0 or
    negative.

    With a = z(fraction), it is the clipped variable's second moment about the true mean, less the square of its new
    mean: 1 + a^2 F - (F - a f) - (f + a F)^2 - 1 (F, f: normal distribution and density at a).

    Examples
    --------
    >>> round(clipping_bias(0.005), 4), round(clipping_bias(1e-5), 7)
    (-0.0091, -1.91e-05)
    """
    if fraction <= 0.0:
        return 0.0
    normal = NormalDist()
    a = normal.inv_cdf(min(fraction, 1.0 - 1e-12))
    density = normal.pdf(a)
    return a * a * fraction - (fraction - a * density) - (density + a * fraction) ** 2


def _spread_beyond_chance(totals: LabelTotals) -> float:
    """Return the variance over pixels of their true temporal variances, DN^4; 0 within chance.

    Normal noise of variance s_i with f degrees of freedom gives measured variances with the mean square <s_i^2> (1 +
    2 / f), of which 2 / f is sampling. Their variance V has the relative uncertainty sqrt((2 + 12 / f) / pixels).
    """
    total, freedom = totals.variance_spread, totals.frames - 1
    beyond = total - 2.0 * (total + totals.pixel_variance**2) / (freedom + 2.0)
    chance = total * math.sqrt((2.0 + 12.0 / freedom) / totals.pixels)
    return beyond if beyond > _SPREAD_SIGMA * chance else 0.0


@dataclass(frozen=True)
class Level:
    """One channel of one group: mean and variances in DN and DN^2, with their uncertainties.

    Uncertainties that levels share are kept apart and not included in the others. Those from clipping (`shared_*`) are
    common to all clipped dark levels of the channel: they cancel in a difference of two dark levels, but not in a
    difference with a light level. Those from rounding (`rounding_*`) are common to levels with the same mean;
    `rounding_pixel` is that of a single pixel's mean, of which the level's mean averages a part away.
    """

    pixels: int
    frames: int
    mean: float
    mean_variance: float  # sampling variance of the mean, from temporal noise only
    variance: float  # temporal, quantization included, shifts of whole frames excluded; NaN for one frame
    variance_uncertainty: float  # from the spread of the per-pixel variances, so valid for any distribution
    spatial_variance: float  # over pixels of the mean frame, temporal noise included
    low_fraction: float  # fraction of the digital numbers at 0
    high_fraction: float  # fraction at full scale
    frame_shift: float  # standard deviation of the shifts of whole frames; negative where its variance is
    # Part of `variance_uncertainty` from noise that differs between pixels: that of any group of the same chip
    variance_spread: float = 0.0
    shared_mean: float = 0.0
    shared_variance: float = 0.0
    rounding_mean: float = 0.0
    rounding_variance: float = 0.0
    rounding_pixel: float = 0.0
    # Distance of the converter's codes, DN, and the quantization noise that it causes, DN^2 (`codes.Steps`)
    step: float = 1.0
    quantization: float = QUANTIZATION_DN2
    # Squared fractions of `variance_uncertainty` by source: results computed from this level are correlated through
    # them.
    sources: Mapping[Source, float] = field(default_factory=lambda: {Source(): 1.0}, repr=False, compare=False)

    @classmethod
    def of(cls, totals: LabelTotals) -> Level:
        """Return the level of exact totals."""
        samples = totals.frames * totals.pixels
        variance = uncertainty = shift = math.nan
        spread = 0.0
        if totals.frames > 1:
            variance = totals.pixel_variance
            uncertainty = math.sqrt(totals.variance_spread / totals.pixels)
            if variance == 0.0:  # no number differs: the variance is below that of one that does
                uncertainty = 1.0 / samples
            spread = math.sqrt(_spread_beyond_chance(totals) / totals.pixels)
            shift_variance = totals.frame_mean_variance - variance / totals.pixels
            shift = math.copysign(math.sqrt(abs(shift_variance)), shift_variance)
        return cls(
            pixels=totals.pixels,
            frames=totals.frames,
            mean=totals.mean,
            mean_variance=variance / samples,
            variance=variance,
            variance_uncertainty=uncertainty,
            spatial_variance=totals.spatial_variance,
            low_fraction=totals.low / samples,
            high_fraction=totals.high / samples,
            frame_shift=shift,
            variance_spread=spread,
        ).with_rounding()

    def with_rounding(self) -> Level:
        """Return the level with the uncertainties from rounding."""
        spatial = self.spatial_variance - self.variance / self.frames
        square = self.step**2
        mean_error, variance_error, pixel_error = rounding_uncertainty(
            self.variance / square, self.variance_uncertainty / square, spatial / square
        )
        again = second_rounding(self.step, self.variance)
        return replace(
            self,
            rounding_mean=math.hypot(self.step * mean_error, again[0]),
            rounding_pixel=self.step * pixel_error,
            rounding_variance=math.hypot(square * variance_error, again[1] * self.variance, again[2]),
        )

    @property
    def single_rounding(self) -> float:
        """Standard uncertainty of the mean of a single frame from rounding: noise and pattern are one spread."""
        spread, square = self.spatial_variance, self.step**2
        return self.step * rounding_uncertainty(spread / square, spread / square * math.sqrt(2.0 / self.pixels), 0.0)[0]

    @property
    def scale_uncertainty(self) -> float:
        """Relative standard uncertainty of a small variance, temporal or spatial, from a digital gain."""
        return second_rounding(self.step, self.variance)[1]

    @property
    def noise(self) -> Uncertain:
        """`variance` with its sources, DN^2, with the quantization noise of steps of 1 DN."""
        u = self.variance_uncertainty
        value = self.variance - (self.quantization - QUANTIZATION_DN2)
        return Uncertain(value, {source: u * math.sqrt(fraction) for source, fraction in self.sources.items()})

    def widened(self, uncertainty: float, source: Source) -> Level:
        """Return the level with a part added to the uncertainty of its variance, DN^2."""
        total = math.hypot(self.variance_uncertainty, uncertainty)
        if not total > 0.0:
            return self
        sources = {each: part * (self.variance_uncertainty / total) ** 2 for each, part in self.sources.items()}
        return replace(self, variance_uncertainty=total, sources={**sources, source: (uncertainty / total) ** 2})

    @property
    def clipping_uncertainty(self) -> float:
        """Standard uncertainty of `variance` from a few numbers clipped at 0, DN^2."""
        return abs(clipping_bias(self.low_fraction)) * self.variance

    @property
    def clipped(self) -> bool:
        """Whether a light level is outside the linear range: many numbers are clipped, or all pixels read the same."""
        return max(self.low_fraction, self.high_fraction) > CLIPPED_FRACTION or self.spatial_variance == 0.0

    @property
    def repeated(self) -> bool:
        """Whether there are several frames, and so a temporal variance."""
        return self.frames > 1

    def shifts_beyond_chance(self, false_alarms: float) -> bool:
        """Return whether the frame means scatter more than the noise of the pixels explains.

        For steady frames the variance of the frame means is variance / pixels, and the quotient of the two estimates
        follows Fisher's F distribution with n - 1 and (n - 1)(P - 1) degrees of freedom (two-way analysis of variance,
        n frames by P pixels). `false_alarms` is the fraction of steady levels for which the answer may be True. Row
        noise counts as a shift here, because it scatters the frame means.
        """
        from scipy.special import fdtri

        freedom = self.frames - 1
        if freedom == 0 or self.pixels < 2:
            return False
        explained = self.variance / self.pixels
        limit = float(fdtri(freedom, freedom * (self.pixels - 1), 1.0 - false_alarms))
        return explained + math.copysign(self.frame_shift**2, self.frame_shift) > limit * explained


def pooled_level(levels: Sequence[Level]) -> Level:
    """Return all channels of a group as one level: means over pixels, spreads within the channels."""
    pixels = sum(level.pixels for level in levels)
    fractions = [(level.pixels / pixels, level) for level in levels]

    def mean(name: str, power: int = 1) -> float:
        return float(sum(fraction**power * getattr(level, name) for fraction, level in fractions))

    def independent(name: str) -> float:
        return math.hypot(*(fraction * getattr(level, name) for fraction, level in fractions))

    noise = combined([level.noise for _, level in fractions], [fraction for fraction, _ in fractions])
    total = noise.standard_uncertainty
    sources = {source: (part / total) ** 2 for source, part in noise.parts.items() if total > 0.0}
    means = ("mean", "variance", "spatial_variance", "low_fraction", "high_fraction", "frame_shift", "quantization")
    return Level(
        pixels=pixels,
        frames=levels[0].frames,
        mean_variance=mean("mean_variance", 2),
        variance_uncertainty=total,
        sources=sources,
        step=max(level.step for level in levels),
        **{name: mean(name) for name in (*means, "rounding_mean", "rounding_variance", "rounding_pixel")},
        **{name: independent(name) for name in ("shared_mean", "shared_variance", "variance_spread")},
    )


@dataclass(frozen=True)
class GroupStatistics:
    """A group and its levels, one per channel; `frame_means` are those of its frames, in their order."""

    group: FrameGroup
    levels: tuple[Level, ...]
    light_trusted: bool = True  # whether its stated light agrees with that of the other levels
    frame_means: tuple[float, ...] = ()
    light_known: bool = True  # whether exposure time or photons tell its light

    @property
    def frames(self) -> int:
        """Frames used, without repeated ones."""
        return self.levels[0].frames

    @property
    def label(self) -> str:
        """The group's name in messages."""
        return group_label(self.group)


def group_label(group: FrameGroup) -> str:
    """Return a group's name in messages: "dark frames at 0.01 s"."""
    text = f"{group.kind} frames at {group.exposure_s:g} s"
    if group.kind == "light" and group.photons_per_pixel is not None:
        text += f" ({group.photons_per_pixel:g} photons)"
    if group.level is not None:
        text += f" ({Path(group.level).name})"
    return text


def reference_dark(darks: Sequence[GroupStatistics] | Sequence[FrameGroup]) -> int:
    """Return the index of the dark group for read noise and DSNU: most frames, then shortest exposure."""

    def rank(entry: GroupStatistics | FrameGroup) -> tuple[int, float]:
        if isinstance(entry, GroupStatistics):
            return -entry.frames, entry.group.exposure_s
        return -len(entry), entry.exposure_s

    return min(range(len(darks)), key=lambda index: rank(darks[index]))


def label_tile(cfa: Cfa) -> NDArray[np.int64]:
    """Return the CFA's tile as integers, in the order of `channel_names`."""
    names = channel_names(cfa)
    return np.array([[names.index(name) for name in row] for row in cfa], dtype=np.int64)
