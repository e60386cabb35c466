"""One color channel of the light frames: saturation, linear range, gain and response, and the points behind its fits.

EMVA 1288 fits straight lines through the origin up to 70 % of saturation. For a converter or amplifier with 2 %
curvature the photon transfer line is off by 5 %, because the variance goes with the square of the local slope. So gain
and responsivity exist twice: at small signal with the response curve, which is the best estimate, and by the standard's
lines. They are the same where the response is straight within the noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.dark.dark_lines import DarkLines, same_exposure
from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.calibration.photon_transfer.full_well import full_wells
from photosite.calibration.photon_transfer.photon_transfer import (
    LINEAR_FRACTION,
    LightLevels,
    Saturation,
    find_saturation,
    fit_gain,
    fit_response,
    gain_value,
    light_levels,
    linear_levels,
    temporal_series,
)
from photosite.calibration.photon_transfer.response_curve import ResponseCurve
from photosite.calibration.photon_transfer.unfilled_wells import missing_charge
from photosite.calibration.photon_transfer.without_darks import unknown_dark_current
from photosite.calibration.reduction.groups import CLIPPED_FRACTION, GroupStatistics
from photosite.calibration.withheld import FEW_LEVELS, NO_LINEAR_LEVEL, UNKNOWN_DARK_CURRENT, UNKNOWN_PHOTONS
from photosite.sensor.noise_terms import QUANTIZATION_DN2
from photosite.values.exposure import format_exposure
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Source, Uncertain, Value, derive

_UNSATURATED = 0.9
"""Fraction of the signal at saturation below which pixels do not saturate, but for very uneven ones."""

NO_PHOTONS = UNKNOWN_PHOTONS.missing("the photons per pixel are not known; give them in a descriptor or a protocol")


CURRENT_SIGMA, LARGEST_DARK = 3.0, 0.1
"""Standard uncertainties to the largest dark current that the means allow; fraction of the signal up to which it may be
unknown."""

_UNKNOWN_CURRENT = Source()
"""The dark current that dark frames of one exposure time leave open: that of all channels."""


@dataclass(frozen=True)
class Channel:
    """One color channel of the light frames.

    Parameters
    ----------
    index, dark
        Index of the channel in `channel_names`, and its dark signal and dark variance against exposure time.
    levels, saturation, used
        Its light levels, dark subtracted; where it saturates; (levels,) whether a level lies in the linear range.
    gain, line_gain, straight_gain
        System gain of this channel alone, DN/e-: at small signal, the slope of the standard's line, and that of a
        straight response with noise that pixels or frames share.
    curve
        The response curve; None where the response is straight within the noise.
    full, fall
        The levels at which some pixels are full, which count as clipped, and the fall of the variance there.
    """

    index: int
    dark: DarkLines
    levels: LightLevels
    saturation: Saturation
    used: NDArray[np.bool_]
    gain: Value
    line_gain: Value
    straight_gain: Value
    curve: ResponseCurve | None = None
    full: tuple[int, ...] = ()
    fall: float = 0.0

    @classmethod
    def of(cls, index: int, lights: Sequence[GroupStatistics], dark: DarkLines, white: int) -> Channel:
        """Analyze the light levels of a channel by straight lines; `white` is the full scale of the converter, DN."""
        levels = light_levels(lights, index, dark)
        saturation = find_saturation(levels, white)
        full, fall = (np.array([], np.intp), 0.0) if saturation.signal is not None else full_wells(levels)
        used, gain = linear_levels(levels, saturation), gain_value(None)
        channel = cls(index, dark, levels, saturation, used, gain, gain, gain, full=tuple(full.tolist()), fall=fall)
        return channel.without(np.isin(np.arange(len(levels.x)), full))._with_filled_wells()

    def without(self, full: NDArray[np.bool_]) -> Channel:
        """Return the channel with (levels,) some levels counted as clipped."""
        levels = replace(self.levels, clipped=self.levels.clipped | full)
        used = linear_levels(levels, self.saturation)
        gain = gain_value(fit_gain([levels], [used]))
        return replace(self, levels=levels, used=used, gain=gain, line_gain=gain, straight_gain=gain)

    def _with_filled_wells(self) -> Channel:
        """Return the channel with the digital number of full wells, to which some pixels are not yet full."""
        levels, top, noise = self.levels, self.saturation.level_dn, self.dark.variance.at_zero
        if isinstance(top, Missing) or isinstance(self.gain, Missing) or isinstance(noise, Missing):
            return self
        if top.standard_uncertainty == 0.0 or not levels.repeated[-1]:  # the converter's limit
            return self
        gain, full = self.gain.value, float(levels.signal[-1])
        brightest = int(np.argmax(np.where(self.used & levels.repeated, levels.signal, -math.inf)))
        pattern = math.sqrt(float(levels.pattern_variance[brightest])) / float(levels.signal[brightest])
        # The well limits the charge of light and dark current together.
        own = math.hypot(levels.noise_uncertainty[-1], levels.noise_rounding[-1], noise.standard_uncertainty)
        missing = missing_charge(
            float(levels.noise[-1]) - noise.value,
            own,
            self._unknown_dark_shot(noise),
            math.sqrt(gain * full),
            pattern * full,
            gain,
        )
        return replace(self, saturation=replace(self.saturation, level_dn=top + missing))

    def _unknown_dark_shot(self, noise: Uncertain) -> float:
        """Return the largest shot noise, DN^2, of the charge in the dark frames of one exposure time; 0 for several."""
        if self.dark.variance.fit is not None or not isinstance(self.gain, Uncertain):
            return 0.0
        current, most = self.unknown_dark_current(), max(noise.value - QUANTIZATION_DN2, 0.0)
        if not isinstance(current, Uncertain):
            return most
        return min(self.gain.value * current.interval_95[1] * float(self.dark.mean.exposure_s[0]), most)

    @property
    def unsaturated(self) -> NDArray[np.bool_]:
        """Whether (levels,) no pixel saturates at a level, the linear range and the levels above it."""
        inside = ~self.levels.clipped
        if self.saturation.signal is not None:
            inside &= self.levels.signal <= _UNSATURATED * self.saturation.signal
        return inside

    @property
    def in_series(self) -> NDArray[np.bool_]:
        """Whether (levels,) a level of the linear range belongs to the standard's temporal measurements."""
        pairs = self.used.copy()
        pairs[self.used] = temporal_series(self.levels.frames[self.used])
        return pairs

    @property
    def saturation_signal(self) -> float | None:
        """Signal of fully clipped pixels, DN; None where it is not known."""
        top = self.saturation.level_dn
        if isinstance(top, Missing) or self.dark.mean.reason:
            return None
        # The digital number less the dark level of the brightest level.
        return top.value - float(self.levels.mean[-1] - self.levels.signal[-1])

    def responsivity(self, *, by_line: bool = False) -> Value:
        """Return the responsivity in DN/photon, or the reason why it is missing.

        It is that at small signal with the response curve, or the slope of the standard's line.
        """
        if not self.levels.photons_known:
            return NO_PHOTONS
        taken = self.in_series if by_line else self.used
        fit = fit_response(self.levels, taken, plain=by_line)
        if fit is None:
            return NO_LINEAR_LEVEL.missing("no light level lies in the linear range")
        if (why := self.no_slope_of_light()) is not None:
            return why
        take = taken & self.levels.trusted
        value = fit.uncertain[0] if by_line or self.curve is None else self.curve.responsivity(self.levels, take)
        current = self.unknown_dark_current()
        if current is None:
            return value
        return derive(lambda c: value - c * float(fit.estimator[0] @ self._dark_seconds(take)), current)

    def unknown_dark_current(self) -> Value | None:
        """Return the dark current in DN/s where dark frames of one exposure time leave it open; None elsewhere.

        It is between 0 and what the dark noise and the means of the flat fields allow: a dark current shifts these by
        its charge in the dark frames from the straight line through the origin.
        """
        dark, take = self.dark, self.used & self.levels.trusted
        seconds = self._dark_seconds(take)
        if dark.mean.fit is not None or dark.mean.reason or dark.variance.reason or not seconds.any():
            return None
        low, high, dark_s = 0.0, math.inf, float(dark.mean.exposure_s[0])
        noise = dark.variance.at_zero
        if isinstance(self.gain, Uncertain) and isinstance(noise, Uncertain) and dark_s > 0.0:
            high = max(noise.interval_95[1] - QUANTIZATION_DN2, 0.0) / (self.gain.value * dark_s)
        design = np.column_stack([self.levels.x[take], seconds])
        if self.curve is None and np.linalg.matrix_rank(design / np.abs(design).max(axis=0)) == 2:
            found = fit_linear(design, self.levels.signal[take], self.levels.signal_covariance[np.ix_(take, take)])
            current = found.uncertain[1]
            reach = CURRENT_SIGMA * current.standard_uncertainty
            high = min(high, max(current.value, 0.0) + reach)
            low = min(max(current.value - reach, 0.0), high)
        if high * float(np.abs(seconds).max()) > LARGEST_DARK * float(self.levels.signal[take].max()):
            return UNKNOWN_DARK_CURRENT.missing(
                f"the dark current is not known, and may be a part of the signal of more than {100 * LARGEST_DARK:.0f} "
                f"%: all dark frames have the exposure time {format_exposure(dark_s)} s; take some at a second one"
            )
        return Uncertain.of(0.5 * (low + high), 0.5 * (high - low) / math.sqrt(3.0), _UNKNOWN_CURRENT)

    def _dark_seconds(self, take: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return by how much the exposure times of some levels exceed that of the dark frames of one exposure time."""
        seconds = self.levels.exposure_s[take] - self.dark.mean.exposure_s[0]
        return np.where(same_exposure(self.levels.exposure_s[take], self.dark.mean.exposure_s[0]), 0.0, seconds)

    def no_slope_of_light(self) -> Missing | None:
        """Return why the slope of the means is not that of the light alone, with incomplete dark frames; else None."""
        why = self.dark.mean.reason or self.dark.variance.reason
        if not why or self.dark.mean.fit is not None:
            return None
        take = self.used & self.levels.trusted
        if self.dark.mean.reason and len(np.unique(self.levels.x[take])) < 2:
            return FEW_LEVELS.missing(f"one level of light in the linear range; {why}")
        times = self.levels.exposure_s[take]
        return unknown_dark_current(float(times.min()), float(times.max()), why)

    @property
    def disproportion(self) -> float:
        """Half of the range of signal over light in the linear range, relative to its mean."""
        take = self.used & self.levels.trusted & (self.levels.x > 0.0)
        ratio = self.levels.signal[take] / self.levels.x[take]
        return float(np.ptp(ratio) / (2.0 * ratio.mean()))

    @property
    def dark_current_can_bend(self) -> bool:
        """Whether the dark current that one dark exposure time leaves open explains the disproportion."""
        current = self.unknown_dark_current()
        if not isinstance(current, Uncertain):
            return current is not None
        take = self.used & self.levels.trusted & (self.levels.x > 0.0)
        most = current.value + math.sqrt(3.0) * current.standard_uncertainty
        return bool(0.5 * most * np.ptp(self._dark_seconds(take) / self.levels.signal[take]) >= self.disproportion)

    def stretch_at_saturation(self) -> Uncertain:
        """Return the electrons of fully clipped pixels over those of a straight response with the gain."""
        if self.curve is None or self.saturation_signal is None:
            return Uncertain(1.0)
        return self.curve.stretch(len(self.levels.x))

    def straightening(self) -> NDArray[np.float64]:
        """Return (levels,) factors that make the shot variances proportional to the signals."""
        curve, count = self.curve, len(self.levels.x)
        if curve is None:
            return np.ones(count)
        return np.array([curve.stretch(i).value * curve.contrast(i).value ** 2 for i in range(count)])

    def temporal_variance(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (levels,) temporal variance, the dark's included, DN^2, and the square of its uncertainty."""
        levels, dark = self.levels, self.dark.variance
        weights = dark.weights_at(levels.exposure_s)
        dark_part = np.sum(weights**2 * dark.variance, axis=1)
        # Negative only by rounding.
        return levels.shot + weights @ dark.y, np.maximum(np.diag(levels.shot_covariance) - dark_part, 0.0)


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Curve(Shown):
    """Measured points and the straight line through them.

    Parameters
    ----------
    title, x_label, y_label
        Labels of a plot, units included.
    x, y, y_uncertainty, used
        (points,) measured values; standard uncertainty of sampling alone; whether the fit used the point.
    intercept, slope, line_covariance
        The line, and the (2, 2) covariance of its parameters; None where no line could be fitted.
    extra_variance
        Variance per point, beyond sampling, that explains the scatter about the line; 0 for ideal frames.
    """

    title: str
    x_label: str
    y_label: str
    x: Array
    y: Array
    y_uncertainty: Array
    used: NDArray[np.bool_]
    intercept: float | None = None
    slope: float | None = None
    extra_variance: float = 0.0
    line_covariance: Array | None = None

    @classmethod
    def of_fit(
        cls,
        title: str,
        x_label: str,
        y_label: str,
        points: tuple[Array, Array, Array, NDArray[np.bool_]],
        fit: Fit | None,
    ) -> Curve:
        """Return the curve of a fit with two parameters, or with the slope alone through the origin."""
        if fit is None:
            return cls(title, x_label, y_label, *points)
        intercept, covariance = 0.0, np.zeros((2, 2))
        if len(fit.parameters) == 1:
            covariance[1, 1] = fit.covariance[0, 0]
        else:
            intercept, covariance = float(fit.parameters[0]), fit.covariance
        slope = float(fit.parameters[-1])
        return cls(title, x_label, y_label, *points, intercept, slope, fit.extra_variance, covariance)

    def line(self, x: ArrayLike) -> tuple[Array, Array] | None:
        """Return the line and its standard uncertainty at some abscissae; None without a line.

        With intercept a and slope b, u^2 = u^2(a) + 2 x u(a, b) + x^2 u^2(b): that of the true line, not of a point.

        Examples
        --------
        >>> none, used = np.array([]), np.array([], dtype=bool)
        >>> curve = Curve("", "s", "DN", none, none, none, used, 1.0, 2.0, 0.0, np.array([[4.0, -1.0], [-1.0, 1.0]]))
        >>> [numbers.tolist() for numbers in curve.line([0.0, 1.0])]
        [[1.0, 3.0], [2.0, 1.7320508075688772]]
        """
        if self.intercept is None or self.slope is None or self.line_covariance is None:
            return None
        at = np.asarray(x, dtype=np.float64)
        (aa, ab), (_, bb) = self.line_covariance
        return self.intercept + self.slope * at, np.sqrt(aa + 2.0 * ab * at + bb * at**2)


@dataclass(frozen=True)
class LinearRange(Shown):
    """The range of light in which a channel is taken as linear.

    Parameters
    ----------
    abscissa, lowest, highest
        The range of photons per pixel ("photons_per_pixel") or exposure time ("exposure_s").
    highest_dn
        Mean digital number of the brightest level inside.
    levels, levels_measured
        Number of light levels inside, and of all.
    rule
        How the range was found.
    contradicting
        Stated amounts of light of the levels left out because they contradict the others.
    """

    abscissa: str
    lowest: float
    highest: float
    highest_dn: float
    levels: int
    levels_measured: int
    rule: str
    contradicting: tuple[float, ...] = ()


def channel_curves(dark: DarkLines, channel: Channel | None) -> dict[str, Curve]:
    """Return one channel's curves: "dark_signal", "dark_variance" and, with light, "response", "photon_transfer".

    The lines of the last two are those of EMVA 1288.
    """
    curves = {}
    for kind, line, title, y_label in (
        ("dark_signal", dark.mean, "Dark signal", "mean (DN)"),
        ("dark_variance", dark.variance, "Dark temporal variance", "variance (DN²)"),
    ):
        if not line.reason:
            points = line.exposure_s, line.y, np.sqrt(line.variance), np.ones(len(line.y), dtype=np.bool_)
            curves[kind] = Curve.of_fit(title, "exposure (s)", y_label, points, line.fit)
    if channel is None:
        return curves
    levels, used = channel.levels, channel.used
    axis = "photons per pixel" if levels.photons_known else "exposure (s)"
    level, x_label, series = levels.signal, "signal (DN)", channel.in_series
    uncertainty, fit = np.sqrt(np.diag(levels.signal_covariance)), fit_response(levels, series, plain=True)
    if dark.mean.reason:
        level, x_label = levels.mean, "mean (DN)"
        uncertainty = np.sqrt(np.maximum(uncertainty**2 - dark.mean.variance, 0.0))
        fit = _free_line(levels.x, level, uncertainty, used)
    points = levels.x, level, uncertainty, used & levels.trusted
    if levels.light_known:
        curves["response"] = Curve.of_fit("Response", axis, x_label, points, fit)
    known = levels.repeated
    noise, uncertainty, y_label = levels.shot, np.sqrt(np.diag(levels.shot_covariance)), "temporal variance less dark"
    fit = fit_gain([levels], [series], plain=True)
    if dark.variance.reason:
        noise, uncertainty, y_label = levels.noise, levels.noise_uncertainty, "temporal variance"
        fit = _free_line(level, noise, uncertainty, used & known)
    points = level[known], noise[known], uncertainty[known], used[known]
    curves["photon_transfer"] = Curve.of_fit("Photon transfer", x_label, f"{y_label} (DN²)", points, fit)
    return curves


def _free_line(x: Array, y: Array, uncertainty: Array, used: NDArray[np.bool_]) -> Fit | None:
    """Return the line with a fitted constant, for points whose dark value is unknown."""
    if len(np.unique(x[used])) < 2:
        return None
    return fit_linear(np.vander(x[used], 2, increasing=True), y[used], np.diag(uncertainty[used] ** 2))


def linear_range(channel: Channel) -> LinearRange:
    """Return the linear range of a channel that has at least one level in it."""
    levels, used = channel.levels, channel.used & channel.levels.trusted
    rule = f"at most {100 * CLIPPED_FRACTION:g} % of the pixels clipped"
    if channel.saturation.signal is not None:
        limit = LINEAR_FRACTION * channel.saturation.signal
        rule += (
            f", and signal up to {100 * LINEAR_FRACTION:g} % of that at the largest temporal variance, {limit:.1f} DN"
        )
    return LinearRange(
        abscissa=levels.abscissa,
        lowest=float(levels.x[used].min()),
        highest=float(levels.x[used].max()),
        highest_dn=float(levels.mean[used].max()),
        levels=int(used.sum()),
        levels_measured=len(used),
        rule=rule,
        contradicting=tuple(levels.x[~levels.trusted].tolist()),
    )
