"""The gain of each pixel: its temporal variance against its mean, over dark frames and light levels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.chip_maps import defects
from photosite.calibration.reduction.groups import GroupStatistics, Level
from photosite.calibration.spatial.pixel_slopes import slope_coefficients
from photosite.engine.frame_sums import FrameSums, MeanFrame
from photosite.engine.lazy_maps import row_strips
from photosite.values.diagnostic import Diagnostic, DiagnosticKind
from photosite.values.estimate import Estimate, signed_square
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain

FloatMap = NDArray[np.float32]

MOST_UNCERTAINTY = 0.2
"""Largest relative standard uncertainty of a typical pixel's gain. Beyond it, gains of 0 and below would be common."""

PIXEL_GAINS_MISSING = DiagnosticKind(
    "pixel-gains-missing",
    "warning",
    "The gains of single pixels were requested and could not be measured.",
    "There is no map of the gain; all pixels have the system gain.",
    "Take more frames of each light level: about 2 / (levels x u^2) for a relative uncertainty u, which must be at "
    f"most {100 * MOST_UNCERTAINTY:g} %. photosite plan states it.",
    size="relative standard uncertainty of a typical pixel's gain, where it is the reason",
)
PIXEL_GAIN_NOISE = DiagnosticKind(
    "pixel-gain-noise",
    "warning",
    "The map of the gain scatters by its measurement noise more than by the differences between the pixels.",
    "A pixel's gain from the map is farther from the truth than the system gain is.",
    "Take more frames of each light level, or omit the map (--pixel-gain).",
    size="measurement noise over the spread of the true gains",
)


def pixel_gain_uncertainty(
    signal_dn: NDArray[np.float64], variance_dn2: NDArray[np.float64], frames: NDArray[np.float64]
) -> float:
    """Return the standard uncertainty of the gain of one pixel, DN per electron.

    With weights w = (n - 1) / (2 v^2), the inverse variances of the sample variances, it is that of a line's slope:
    1 / sqrt(sum of w (x - <x>)^2).

    Parameters
    ----------
    signal_dn, variance_dn2, frames
        (levels,) signal x, temporal variance v and number of frames n of the dark frames and each light level.

    Examples
    --------
    >>> signal = np.array([0.0, 1000.0, 2000.0])  # gain 2 DN per electron, no read noise
    >>> variance = np.maximum(2.0 * signal, 1.0)
    >>> round(pixel_gain_uncertainty(signal, variance, np.full(3, 201.0)) / 2.0, 3)  # 1 / sqrt(200), two light levels
    0.071
    """
    weights = (frames - 1.0) / (2.0 * variance_dn2**2)
    centred = signal_dn - weights @ signal_dn / weights.sum()
    return 1.0 / math.sqrt(float(weights @ centred**2))


@dataclass(frozen=True)
class PixelGains(Shown):
    """How well the map of the gains is known, and what it shows.

    Parameters
    ----------
    spread_percent
        Standard deviation of the true gains over the pixels, relative to the system gain.
    uncertainty_percent
        Median of the relative standard uncertainty of a pixel's gain.
    undetermined
        Number of pixels that have the system gain with an uncertainty of 100 %, because they respond to light by less
        than half or their variance does not grow with it.
    frames, levels
        Number of flat fields, and of light levels.
    """

    spread_percent: Estimate
    uncertainty_percent: float
    undetermined: int
    frames: int
    levels: int

    @property
    def noise_over_spread(self) -> float:
        """Measurement noise over the spread of the true gains."""
        spread = self.spread_percent.value or 0.0
        return self.uncertainty_percent / spread if spread > 0.0 else math.inf

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """A warning where the map is mostly measurement noise."""
        if self.noise_over_spread <= 1.0:
            return ()
        spread = self.spread_percent.value or 0.0
        text = (
            f"a pixel's gain is uncertain by {self.uncertainty_percent:.2g} %, and the pixels' gains differ by "
            f"{max(spread, 0.0):.2g} %: the map is mostly measurement noise"
        )
        return (PIXEL_GAIN_NOISE(text, self.noise_over_spread),)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers, for JSON."""
        return {**vars(self), "spread_percent": self.spread_percent.to_dict()}


class GainSums:
    """Sums over dark frames and light levels from which each pixel's gain follows.

    The gain is the slope of the weighted line of variance v against mean m, over the levels k of a pixel:

        g = sum of c_k v_k / sum of c_k m_k,    c_k = w_k (x_k - <x>_w) / sum of w_k (x_k - <x>_w)^2

    The weights w_k = (n_k - 1) / (2 V_k^2) and the signals x_k are those of all pixels of the channel, so that
    numerator and denominator are linear in the frames. With weights of the pixel itself, levels whose variance happens
    to be low would count more, and g would be too low; in the least squares of Huang et al. the noise of m makes it too
    low. This ratio is too high by the relative amount sum of c_k^2 s^2 / n_k, with the read noise s: 1e-5 and less. The
    sampling errors of v and m from shot noise cancel in it, beyond 2 v^2 / (n - 1), and leave

        u(g)^2 = sum of c_k^2 2 v_k^2 / (n_k - 1) / (sum of c_k m_k)^2,

    in which v_k follows from the pixel's noise in the dark, its response and its likely gain.

    Offset, noise of rows and columns, and rounding are the same at all levels and cancel, because the c_k add up to 0.
    Shifts of whole frames (an unsteady lamp) are subtracted, in proportion to the pixel's signal.

    Parameters
    ----------
    shape, tile
        (rows, cols) of the frames, and the channels.
    dark
        The dark frames of the chip's noise.
    lights
        By the index of the group, the light levels of each channel that are in its linear range and have two frames or
        more.

    References
    ----------
    F. Huang et al., Nature Methods 10, 653 (2013): g = (B B^T)^-1 B A^T, with A and B the variances and means above
    those of the dark frames.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        tile: NDArray[np.int64],
        dark: GroupStatistics,
        lights: Sequence[dict[int, Level]],
    ) -> None:
        self.tile, self.dark, self.lights = tile, dark, lights
        self.coefficients: list[dict[int | None, float]] = []
        self.gains: list[float] = []
        for own, levels in zip(dark.levels, lights, strict=True):
            points = [own, *levels.values()]
            x = np.array([level.mean - own.mean for level in points])
            variance = np.array([level.variance for level in points])
            weights = np.array([level.frames - 1.0 for level in points]) / variance**2
            c = slope_coefficients(x, weights)
            self.coefficients.append(dict(zip((None, *levels), c.tolist(), strict=True)))
            self.gains.append(float(c @ variance))
        self._numerator, self._response = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        self._noise = np.zeros(shape, np.float32)

    @staticmethod
    def usable(dark: GroupStatistics, lights: Sequence[dict[int, Level]]) -> bool:
        """Return whether each channel has a light level with several frames, and noise in all of them."""
        return all(
            levels and all(level.variance > 0.0 for level in (own, *levels.values()))
            for own, levels in zip(dark.levels, lights, strict=True)
        )

    def add(self, index: int, mean: MeanFrame, sums: FrameSums) -> None:
        """Add a light level by the index of its group: its mean, and the sums for its variance."""
        self._add(index, mean, lambda rows: sums.variance(rows=rows))

    def add_dark(self, mean: MeanFrame, variance: FloatMap, noise: FloatMap) -> None:
        """Add the dark frames.

        `variance` is without shifts of whole frames, and `noise` the variance moderated by those of other pixels.
        """
        self._add(None, mean, lambda rows: variance[rows].astype(np.float64))
        self._noise = noise

    def _add(self, index: int | None, mean: MeanFrame, variance: Callable[[slice], NDArray[np.float64]]) -> None:
        for rows in (slice(*strip) for strip in row_strips(self._response, self.tile.shape[0])):
            m, v = mean[rows], variance(rows)
            for k, coefficients in enumerate(self.coefficients):
                if index not in coefficients:
                    continue
                c, black = coefficients[index], self.dark.levels[k].mean
                for part in defects.sites(self.tile, k):
                    signal, own = m[part], v[part]
                    if index is not None:
                        level = self.lights[k][index]
                        own -= signed_square(level.frame_shift) * ((signal - black) / (level.mean - black)) ** 2
                    self._numerator[rows][part] += c * own
                    self._response[rows][part] += c * signal

    def maps(self, gain: float) -> tuple[FloatMap, FloatMap, PixelGains] | Missing:
        """Return the map of the gains, that of their standard uncertainties, and what they show.

        The sums are lost. `gain` is the system gain; the map is scaled to it, so that what changes the variances of all
        pixels alike (a bent response, charge that moves between pixels) is corrected as in the system gain, whose own
        uncertainty is not part of a pixel's.
        """
        values, response = self._numerator, self._response
        unknown = ~((response > defects.DEAD_RESPONSE * self._usual()) & (values > 0.0))
        response[unknown] = values[unknown] = 1.0
        values /= response
        own = float(np.mean(self.gains))
        uncertainty = self._uncertainty(np.full((1, 1), own, np.float32))
        known = ~unknown
        relative = float(np.median(uncertainty[known])) / own if known.any() else math.inf
        levels, frames = max(map(len, self.lights)), sum(self._frames().values())
        if not relative <= MOST_UNCERTAINTY:
            text = (
                f"a pixel's gain is uncertain by {100 * relative:.2g} % with {frames} flat fields of {levels} levels; "
                f"at most {100 * MOST_UNCERTAINTY:g} % makes a map"
            )
            return PIXEL_GAINS_MISSING.missing(text)
        spread = self._spread(values, uncertainty, known, own)
        # A pixel's variance follows from its gain; from the gain as measured, u would be low where the gain is.
        true = max(spread.value, 0.0) * own**2
        likely = np.asarray(own + (values - own) * (true / (true + uncertainty**2)), np.float32)
        uncertainty = self._uncertainty(likely)
        for part in (values, uncertainty):
            part *= np.float32(gain / own)
            part[unknown] = np.float32(gain)
        estimate = Estimate.of_variance(spread * 1e4, "variance of the map of the gains less its measurement noise")
        return values, uncertainty, PixelGains(estimate, 100 * relative, int(unknown.sum()), frames, levels)

    def _uncertainty(self, gain: FloatMap) -> FloatMap:
        """Return the standard uncertainty of the pixels' gains, given likely gains, (1, 1) or a map.

        With a pixel's noise s^2 and response r, its variance at level k is v_k = s^2 + g r x_k, and the shift of the
        light f_k r^2 adds 2 v_k f_k r^2 to v_k^2: a sum over the levels of polynomials in x.
        """
        out = np.empty_like(self._response)
        for k, (own, levels) in enumerate(zip(self.dark.levels, self.lights, strict=True)):
            c2 = np.array([*self.coefficients[k].values()]) ** 2
            points = [own, *levels.values()]
            x = np.array([level.mean - own.mean for level in points])
            c2 *= 2.0 / (np.array([level.frames for level in points]) - 1.0)
            shift = np.array([0.0, *(max(signed_square(level.frame_shift), 0.0) for level in levels.values())])
            a0, a1, a2 = (float(c2 @ x**j) for j in range(3))
            b0, b1 = (2.0 * float((c2 * shift) @ x**j) for j in range(2))
            for part in defects.sites(self.tile, k):
                noise, r = self._noise[part], self._response[part]
                slope = (gain if gain.shape == (1, 1) else gain[part]) * r
                square = a0 * noise**2 + 2.0 * a1 * noise * slope + a2 * slope**2 + (b0 * noise + b1 * slope) * r**2
                out[part] = np.sqrt(square) / r
        return out

    def _frames(self) -> dict[int, int]:
        """Return the number of frames of each light level."""
        return {i: level.frames for levels in self.lights for i, level in levels.items()}

    def _usual(self) -> FloatMap:
        """Return the median response of each pixel's channel, as a map."""
        usual = np.empty(self._response.shape, np.float32)
        for k in range(len(self.gains)):
            middle = np.median(defects.channel_values(self._response, self.tile, k))
            for part in defects.sites(self.tile, k):
                usual[part] = middle
        return usual

    @staticmethod
    def _spread(values: FloatMap, uncertainty: FloatMap, known: NDArray[np.bool_], gain: float) -> Uncertain:
        """Return the relative variance of the true gains: that of the map less that of its noise."""
        relative = values[known].astype(np.float64) / gain
        square = (relative - relative.mean()) ** 2
        total, fourth = float(square.mean()), float((square**2).mean())
        noise = float(np.mean((uncertainty[known].astype(np.float64) / gain) ** 2))
        return Uncertain.of(total - noise, math.sqrt(max(fourth - total**2, 0.0) / relative.size))
