"""Light levels, saturation, linear range, system gain and responsivity: EMVA 1288 R4.0, photon transfer method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.dark.dark_lines import DarkLines
from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.calibration.reduction.groups import CLIPPED_FRACTION, GroupStatistics, Level
from photosite.calibration.withheld import NO_PHOTON_TRANSFER, NO_SATURATION, SINGLE_FLATS
from photosite.values.block_diagonal import block_diagonal
from photosite.values.uncertain import Source, Uncertain, Value, combined

Array = NDArray[np.float64]

LINEAR_FRACTION = 0.7
"""EMVA 1288: the range for gain and responsivity ends at 70 % of the signal at saturation."""

FALLEN_FRACTION = 0.8
"""A brighter level with a shot variance below this fraction of the largest shows that the maximum is passed."""

NOT_REACHED = NO_SATURATION.missing(
    "no flat field reached saturation; take flat fields up to the level where they stop getting brighter"
)

STILL_FRACTION = 0.02
"""A level with a shot variance below this fraction of the largest is fully clipped."""


@dataclass(frozen=True)
class LightLevels:
    """The light levels of one channel, dark subtracted, sorted by amount of light.

    Parameters
    ----------
    abscissa
        "photons_per_pixel" where every group has it, else "exposure_s"; "signal_dn" where the light is unknown.
    x, exposure_s
        (m,) amount of light on that axis; exposure times in seconds.
    signal, signal_covariance
        (m,) mean less dark, DN; its (m, m) covariance.
    shot, shot_covariance
        (m,) temporal variance less the dark's, DN^2, NaN for one frame; its (m, m) sampling covariance.
    noise, noise_uncertainty
        (m,) temporal variance including the dark's, DN^2, and its standard uncertainty from the level alone.
    noise_rounding
        (m,) standard uncertainty of the temporal variance from rounding, DN^2.
    dark_noise, dark_fraction
        The dark temporal variances, and the (m, darks) fraction of each that was subtracted.
    mean, spread, mean_variance
        (m,) mean including the dark, and standard deviation over pixels and frames, DN; variance of the mean over both,
        fixed pattern included.
    frame_scatter
        (m,) temporal variance of the mean, from the scatter of the means of frames; 0 where the noise of independent
        pixels explains it.
    clipped, white_fraction, group, frames
        (m,) whether the level is clipped; fraction of numbers at full scale; index of the light group; number of
        frames.
    trusted
        (m,) whether the amount of light is known: not where it contradicts the other levels (`level_outliers.py`).
    """

    abscissa: str
    x: Array
    exposure_s: Array
    signal: Array
    signal_covariance: Array
    shot: Array
    shot_covariance: Array
    noise: Array
    noise_uncertainty: Array
    noise_rounding: Array
    dark_noise: tuple[Uncertain, ...]
    dark_fraction: Array
    mean: Array
    spread: Array
    mean_variance: Array
    frame_scatter: Array
    clipped: NDArray[np.bool_]
    white_fraction: Array
    group: NDArray[np.intp]
    frames: Array
    trusted: NDArray[np.bool_]

    @property
    def photons_known(self) -> bool:
        """Whether the abscissa is photons per pixel."""
        return self.abscissa == "photons_per_pixel"

    @property
    def light_known(self) -> bool:
        """Whether the abscissa is an amount of light, and not the signal itself."""
        return self.abscissa != "signal_dn"

    @property
    def repeated(self) -> NDArray[np.bool_]:
        """(m,) whether the level has a temporal variance."""
        return np.isfinite(self.shot)

    @property
    def pattern_variance(self) -> Array:
        """(m,) variance over pixels of their means, without temporal noise, DN^2."""
        return np.maximum(self.spread**2 - self.noise * (1.0 + 1.0 / self.frames), 0.0)

    def take(self, places: NDArray[np.intp]) -> LightLevels:
        """Return some of the levels, in this order."""
        changed: dict[str, Any] = {
            name: value[places] for name, value in vars(self).items() if isinstance(value, np.ndarray)
        }
        for name in ("signal_covariance", "shot_covariance"):
            changed[name] = changed[name][:, places]
        return replace(self, **changed)

    def with_variances(self, factors: Array, relative: float = 0.0) -> LightLevels:
        """Return the levels with their temporal variances multiplied by (m,) factors.

        All factors have one relative error, of this standard uncertainty.
        """
        shot = factors * self.shot
        return replace(
            self,
            shot=shot,
            shot_covariance=np.outer(factors, factors) * self.shot_covariance + relative**2 * np.outer(shot, shot),
            noise=factors * self.noise,
            noise_uncertainty=factors * self.noise_uncertainty,
            noise_rounding=factors * self.noise_rounding,
            dark_fraction=factors[:, None] * self.dark_fraction,
        )

    def with_noise_of_means(self, factors: Array) -> LightLevels:
        """Return the levels with the variances of their means multiplied by (m,) factors."""
        root = np.sqrt(factors)
        return replace(self, signal_covariance=np.outer(root, root) * self.signal_covariance)


def light_levels(lights: Sequence[GroupStatistics], channel: int, dark: DarkLines) -> LightLevels:
    """Return one channel's light levels, less the dark of the same exposure or of the line through the dark levels.

    The covariances include the dark frames that several levels share.
    """
    photons = [entry.group.photons_per_pixel for entry in lights]
    known = all(count is not None for count in photons)
    exposure = np.array([entry.group.exposure_s for entry in lights])
    x = np.array([float(count or 0.0) for count in photons]) if known else exposure
    unmeasured = not all(entry.light_known for entry in lights)
    if unmeasured:  # the signal stands for the light
        means = np.array([entry.levels[channel].mean for entry in lights])
        x = means - dark.mean.weights_at(exposure) @ dark.mean.y
    order = np.argsort(x, kind="stable")
    levels, exposure = [lights[i].levels[channel] for i in order], exposure[order]

    def each(name: str) -> Array:
        return np.array([getattr(level, name) for level in levels])

    take_mean, take_variance = dark.mean.weights_at(exposure), dark.variance.weights_at(exposure)
    mean, spread = each("mean"), each("variance_uncertainty")
    signal = mean - take_mean @ dark.mean.y
    variance = np.array([level.noise.value for level in levels]) - _uneven_shifts(levels, signal)
    rounding = each("rounding_variance")
    over_pixels, shift = each("spatial_variance") / each("pixels"), each("frame_shift")
    # The noise of a single frame is unknown; its spread over pixels is an upper bound.
    sampling = np.where([level.repeated for level in levels], each("mean_variance"), over_pixels)
    dark_covariance = dark.mean.covariance + np.diag((dark.mean.differing * dark.mean.shared) ** 2)
    return LightLevels(
        abscissa="signal_dn" if unmeasured else "photons_per_pixel" if known else "exposure_s",
        x=x[order],
        exposure_s=exposure,
        signal=signal,
        signal_covariance=np.diag(sampling + each("rounding_mean") ** 2) + take_mean @ dark_covariance @ take_mean.T,
        shot=variance - take_variance @ dark.variance.y,
        shot_covariance=np.diag(spread**2 + rounding**2) + take_variance @ dark.variance.covariance @ take_variance.T,
        noise=variance,
        noise_uncertainty=spread,
        noise_rounding=rounding,
        dark_noise=dark.variance.points,
        dark_fraction=take_variance,
        mean=mean,
        spread=np.sqrt(each("spatial_variance") + np.nan_to_num(each("variance"))),
        mean_variance=over_pixels,
        frame_scatter=np.where(shift > 0.0, shift**2 / each("frames") + each("mean_variance"), 0.0),
        clipped=np.array([level.clipped for level in levels]),
        white_fraction=each("high_fraction"),
        group=order,
        frames=each("frames").astype(np.float64),
        trusted=np.array([lights[i].light_trusted for i in order]),
    )


SHIFTS_P_VALUE = 1e-3
"""Fraction of levels under steady light whose shifts may count as those of the lamp."""


LIT_SIGMA = 5.0
"""Signal from which shifts of whole frames are those of the light, over the noise of a pixel."""
NEGLIGIBLE_SHIFTS = 1e-4
"""Fraction of a variance below which the shifts may be those of image lag or of the black level as well."""


def _uneven_shifts(levels: Sequence[Level], signal: Array) -> Array:
    """Return the temporal variance that a change of the light from frame to frame leaves in uneven pixels.

    Light that changes by the relative variance f shifts a pixel of the signal s by s f^(1/2). The shift of the whole
    frame is not in the variance of a level; the spread of s over the pixels, lens fall-off included, leaves f Var(s).
    """
    left = np.zeros(len(levels))
    for i, (level, mean) in enumerate(zip(levels, signal, strict=True)):
        # In less light, the black level shifts as much as the lamp.
        lit = level.repeated and mean > LIT_SIGMA * math.sqrt(max(level.variance, 0.0))
        if lit and level.frame_shift > 0.0 and level.shifts_beyond_chance(SHIFTS_P_VALUE):
            uneven = max(level.spatial_variance - level.variance / level.frames, 0.0)
            left[i] = (level.frame_shift / mean) ** 2 * uneven
            if left[i] < NEGLIGIBLE_SHIFTS * level.variance:
                left[i] = 0.0
    return left


@dataclass(frozen=True)
class Saturation:
    """Where a channel saturates.

    Parameters
    ----------
    index, signal
        The light level with the largest temporal variance (EMVA 1288 R4.0), or the brightest of levels with one frame,
        and its signal, DN, dark subtracted; None where no level is saturated.
    x
        Amount of light at the largest variance; its uncertainty is that of a step between levels.
    level_dn, level_method
        Mean digital number of fully clipped pixels, and how it was measured.
    """

    index: int | None
    signal: float | None
    x: Value
    level_dn: Value
    level_method: str


def find_saturation(levels: LightLevels, white: int) -> Saturation:
    """Return where the temporal variance is largest, and the digital number of fully clipped pixels.

    `white` is the full scale of the converter, DN. Levels whose light is not trusted are passed over.
    """
    if not levels.trusted.all():
        places = np.flatnonzero(levels.trusted)
        found = find_saturation(levels.take(places), white)
        return found if found.index is None else replace(found, index=int(places[found.index]))
    level_dn, method = _clipped_level(levels, white)
    repeated = np.flatnonzero(levels.repeated)
    if repeated.size == 0:
        x: Value = SINGLE_FLATS.missing("no light level has two frames, which the variance at saturation needs")
        reached, peak = isinstance(level_dn, Uncertain), int(np.argmax(levels.signal))
    else:
        peak = int(repeated[np.argmax(levels.shot[repeated])])
        beyond = repeated[repeated > peak]
        fallen = beyond.size > 0 and levels.shot[beyond].min() < FALLEN_FRACTION * levels.shot[peak]
        reached = bool(fallen or levels.white_fraction[peak:].max() > CLIPPED_FRACTION)
        x = _between_neighbours(levels, peak) if reached else NOT_REACHED
    if not reached:
        return Saturation(None, None, x, level_dn, method)
    return Saturation(peak, float(levels.signal[peak]), x, level_dn, method)


def _between_neighbours(levels: LightLevels, peak: int) -> Uncertain:
    """Return the amount of light at the maximum of the variance, between the levels around the largest one.

    Up to the maximum the variance grows with the light. Beyond it more and more pixels clip, a fraction ndtr(z) at z
    relative spreads w past the middle. So the maximum is where that fraction grows as fast as the light,
    phi(z) = w ndtr(-z). A level beyond it still has a larger variance than the level before while the fraction is below
    the step between the two. The maximum thus lies from slightly below the largest level to slightly below the next
    one, with a rectangular distribution.
    """
    from scipy.special import log_ndtr, ndtri

    x, near = levels.x, max(peak - 1, 0)
    low, at, high = (float(x[k]) for k in (near, peak, min(peak + 1, len(x) - 1)))
    if low < at < high:
        width = float(levels.spread[near] / levels.signal[near])
        grid = np.linspace(-6.0, 0.0, 6001)
        hazard = -0.5 * grid**2 - 0.5 * math.log(2.0 * math.pi) - log_ndtr(-grid)
        top = float(np.interp(math.log(width), hazard, grid))
        before, after = (max(float(ndtri(step)) - top, 0.0) * width * at for step in (1.0 - low / at, 1.0 - at / high))
        if at - before < high - after:
            low, high = at - before, high - after
    half = 0.5 * (high - low)
    return Uncertain.of(low + half, half / math.sqrt(3.0), Source(0.95 * math.sqrt(3.0), 0.95 * math.sqrt(3.0)))


def _clipped_level(levels: LightLevels, white: int) -> tuple[Value, str]:
    """Return the digital number of fully clipped pixels: the full scale, or the brightest flat fields without noise.

    Where most numbers of a level are the full scale, it is the exact level at which pixels clip, and the mean of the
    brightest flat fields may hold pixels that do not. Few numbers at the full scale may be those of hot pixels.
    """
    last, fraction = len(levels.x) - 1, float(levels.white_fraction.max())
    shot = levels.shot[levels.repeated]
    still = levels.repeated[last] and levels.shot[last] < STILL_FRACTION * shot.max()
    if still and fraction < 0.5:
        value, variance = Uncertain.of(float(levels.mean[last])), float(levels.mean_variance[last])
        scatter = float(levels.frame_scatter[last])
        if scatter > 0.0:  # row noise, for one, shifts whole frames
            noise, frames = float(levels.noise[last]), float(levels.frames[last])
            of_pixels = float(levels.spread[last]) ** 2 - noise
            variance *= max(1.0 - noise / frames / of_pixels, 0.0) if of_pixels > 0.0 else 0.0
            value += Uncertain.of(0.0, math.sqrt(scatter), Source.student(frames - 1.0))
        value += Uncertain.of(0.0, math.sqrt(variance))
        return value, "mean of the brightest flat fields, all pixels clipped"
    if still and white & (white + 1) and levels.spread[last] < 1.0:
        # Below a full scale of 2^n - 1, full wells without noise pile up at a number as a converter's limit does.
        return Uncertain.of(float(levels.mean[last]), float(abs(white - levels.mean[last]))), "mean of full pixels"
    if fraction > CLIPPED_FRACTION:
        method = f"full scale of the converter: {100 * fraction:.3g} % of the values in the brightest flat fields"
        return Uncertain.of(float(white)), method
    reason = "no flat field is clipped; take flat fields up to the level where they stop getting brighter"
    return NO_SATURATION.missing(reason), "fully clipped flat fields"


def with_rounded_darks(levels: LightLevels, dark: DarkLines, gain: float) -> LightLevels:
    """Return the levels less the smallest dark variance and, beyond it, the shot noise of the dark signal.

    Where rounding makes the variance of a dark level depend on its mean, an interpolation between dark levels has
    errors that differ from flat field to flat field. Flat fields have noise enough, so that the dark variance in them
    is that of any dark level up to its error from rounding, and the shot noise of the difference of dark signals,
    `gain` times it. All flat fields share the error: a fit finds it from them.
    """
    variance, place = dark.variance, int(np.argmin(dark.variance.y))
    least = dark.mean.weights_at(variance.exposure_s[[place]]) @ dark.mean.y
    fraction = np.zeros_like(levels.dark_fraction)
    fraction[:, place] = 1.0
    return replace(
        levels,
        shot=levels.noise - variance.y[place] - gain * (levels.mean - levels.signal - least),
        shot_covariance=levels.shot_covariance
        - levels.dark_fraction @ variance.covariance @ levels.dark_fraction.T
        + fraction @ variance.covariance @ fraction.T,
        dark_fraction=fraction,
    )


def temporal_series(frames: Array) -> NDArray[np.bool_]:
    """Return (m,) which levels, with so many frames each, are those of EMVA 1288's temporal measurements.

    The standard takes two frames of each exposure, and more of one exposure for the fixed pattern alone. Without three
    pairs, all levels count.

    Examples
    --------
    >>> temporal_series(np.array([2.0, 2.0, 50.0, 2.0])).tolist()
    [True, True, False, True]
    """
    pairs = frames == 2.0
    return pairs if np.count_nonzero(pairs) > 2 else np.ones_like(pairs)


def linear_levels(levels: LightLevels, saturation: Saturation) -> NDArray[np.bool_]:
    """Return (m,) whether each light level is in the linear range.

    It must not be clipped and, where saturation is known, have at most 70 % of the signal there.
    """
    inside = ~levels.clipped
    if saturation.signal is not None:
        inside &= levels.signal <= LINEAR_FRACTION * saturation.signal
    return inside


@dataclass(frozen=True)
class GainFit(Fit):
    """The photon transfer line, and the effect of the dark variances on the gain.

    `dark` has the value 0, and the sources of the dark variances, which read noise and dark noise share.
    """

    dark: Uncertain

    @property
    def uncertain(self) -> tuple[Uncertain, ...]:
        """The gain, correlated with the other results from the dark frames."""
        own = max(float(self.covariance[0, 0]) - self.dark.standard_uncertainty**2, 0.0)
        source = Source.student(self.freedom) if math.isfinite(self.freedom) else None
        return (Uncertain.of(float(self.parameters[0]), math.sqrt(own), source) + self.dark,)


def fit_gain(
    channels: Sequence[LightLevels], used: Sequence[NDArray[np.bool_]], *, plain: bool = False
) -> GainFit | None:
    """Fit the system gain K: the slope through the origin of shot variance against signal, all channels together.

    K is one number for a chip, because all channels share the converter. The signal's uncertainty enters by its effect
    K u(signal) on the variance axis (effective variance). A variance that is low by chance also has a low estimated
    uncertainty, and weights from such uncertainties bias the line downwards by twice the relative variance. So the
    relative uncertainty of each level is applied to the value of the line there. With `plain`, all levels have equal
    weights, as in EMVA 1288. None where no level can be used.
    """
    masked = [(levels, mask & levels.repeated) for levels, mask in zip(channels, used, strict=True)]
    y, v, noise, uncertainty = (
        np.concatenate([getattr(levels, name)[mask] for levels, mask in masked])
        for name in ("signal", "shot", "noise", "noise_uncertainty")
    )
    if y.size == 0:
        return None
    shot = block_diagonal(*[levels.shot_covariance[np.ix_(mask, mask)] for levels, mask in masked])
    signal = block_diagonal(*[levels.signal_covariance[np.ix_(mask, mask)] for levels, mask in masked])
    gain = float(y @ v / (y @ y))
    for _ in range(3):
        expected = np.maximum(noise - v + gain * y, 0.0)
        change = uncertainty**2 * ((expected / noise) ** 2 - 1.0)
        fit = fit_linear(y[:, None], v, shot + np.diag(change) + gain**2 * signal, plain=plain)
        gain = float(fit.parameters[0])
    return GainFit(**vars(fit), dark=effect_of_darks(masked, fit))


def effect_of_darks(masked: Sequence[tuple[LightLevels, NDArray[np.bool_]]], fit: Fit) -> Uncertain:
    """Return 0 with the effect of the dark variances on the gain, for the levels of each channel that were fitted."""
    dark, start = Uncertain(0.0), 0
    for levels, mask in masked:
        end = start + int(mask.sum())
        fraction = fit.estimator[0, start:end] @ levels.dark_fraction[mask]
        dark, start = dark - combined(levels.dark_noise, fraction), end
    return Uncertain(0.0, dark.parts)


def gain_value(fit: GainFit | None, gain: Uncertain | None = None) -> Value:
    """Return K in DN/e-, by default the slope of the line, or the reason why it is missing."""
    if fit is None:
        return SINGLE_FLATS.missing(
            "no light level in the linear range has two frames; photon transfer needs their noise"
        )
    slope, uncertainty = float(fit.parameters[0]), float(np.sqrt(fit.covariance[0, 0]))
    if slope < 2.0 * uncertainty:
        return NO_PHOTON_TRANSFER.missing(
            f"the temporal variance does not rise with the signal (slope {slope:.3g} ± {uncertainty:.3g} DN); "
            f"photon transfer needs brighter flat fields or more frames"
        )
    return fit.uncertain[0] if gain is None else gain


def fit_response(levels: LightLevels, used: NDArray[np.bool_], *, plain: bool = False) -> Fit | None:
    """Fit the responsivity: the slope through the origin of signal against the light levels' axis.

    With `plain`, all levels have equal weights.
    """
    take = used & levels.trusted
    if not take.any():
        return None
    covariance = levels.signal_covariance[np.ix_(take, take)]
    return fit_linear(levels.x[take][:, None], levels.signal[take], covariance, plain=plain)
