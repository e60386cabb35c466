"""Saturation, the linear range, system gain and responsivity: EMVA 1288 R4.0, photon transfer method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.dark_lines import DarkLines
from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.calibration.reduction.groups import CLIPPED_SHARE, GroupStatistics
from photosite.values.uncertain import Missing, Source, Uncertain, Value, combined

LINEAR_SHARE = 0.7
"""EMVA 1288: the range for gain and responsivity ends at 70 % of the signal at saturation."""

FALLEN_SHARE = 0.8
"""The variance has passed its maximum where a brighter level's shot variance is below this share of it."""

STILL_SHARE = 0.02
"""A level is fully clipped where this share of the largest shot variance, or less, is left."""


@dataclass(frozen=True)
class LightLevels:
    """The light levels of one channel, dark taken off, sorted by brightness.

    Parameters
    ----------
    abscissa
        "photons_per_pixel" where every group has it, else "exposure_s".
    x, exposure_s
        (m,) on that axis; exposure times.
    signal, signal_covariance
        (m,) mean less dark, DN; (m, m).
    shot, shot_covariance
        (m,) temporal variance less the dark's, DN^2, NaN where a level has one frame; (m, m) of sampling.
    noise, noise_uncertainty
        (m,) temporal variance with the dark's, DN^2, and its standard uncertainty as found from the level alone.
    dark_noise, dark_share
        The dark temporal variances, and (m, darks) how much of each was taken off.
    mean
        (m,) mean with the dark, DN.
    spread
        (m,) standard deviation of single numbers over pixels and frames, DN.
    mean_variance
        (m,) variance of the mean over pixels and frames, fixed pattern included.
    clipped, white_share
        (m,) whether it is notably clipped; share of numbers at the top.
    group
        (m,) index of the group among the light groups.
    """

    abscissa: str
    x: NDArray[np.float64]
    exposure_s: NDArray[np.float64]
    signal: NDArray[np.float64]
    signal_covariance: NDArray[np.float64]
    shot: NDArray[np.float64]
    shot_covariance: NDArray[np.float64]
    noise: NDArray[np.float64]
    noise_uncertainty: NDArray[np.float64]
    dark_noise: tuple[Uncertain, ...]
    dark_share: NDArray[np.float64]
    mean: NDArray[np.float64]
    spread: NDArray[np.float64]
    mean_variance: NDArray[np.float64]
    clipped: NDArray[np.bool_]
    white_share: NDArray[np.float64]
    group: NDArray[np.intp]

    @property
    def repeated(self) -> NDArray[np.bool_]:
        """(m,) whether the level has a temporal variance."""
        return np.isfinite(self.shot)


def light_levels(lights: Sequence[GroupStatistics], channel: int, dark: DarkLines) -> LightLevels:
    """One channel's light levels with the dark taken off.

    The dark is that of the same exposure where there is one, else read off the line through the darks. What
    several light levels share because they use the same darks is in the covariances.
    """
    photons = [entry.group.photons_per_pixel for entry in lights]
    known = all(count is not None for count in photons)
    exposure = np.array([entry.group.exposure_s for entry in lights])
    x = np.array([float(count or 0.0) for count in photons]) if known else exposure
    order = np.argsort(x, kind="stable")
    levels = [lights[i].levels[channel] for i in order]
    exposure = exposure[order]

    take_mean = dark.mean.weights_at(exposure)
    take_variance = dark.variance.weights_at(exposure)
    mean = np.array([level.mean for level in levels])
    variance = np.array([level.variance for level in levels])
    # A single frame does not tell its noise; its spread over pixels bounds it.
    sampling = np.array(
        [level.mean_variance if level.repeated else level.spatial_variance / level.pixels for level in levels]
    )
    spread = np.array([level.variance_uncertainty for level in levels])
    of_mean = np.array([level.rounding_mean for level in levels])
    of_variance = np.array([level.rounding_variance for level in levels])
    return LightLevels(
        abscissa="photons_per_pixel" if known else "exposure_s",
        x=x[order],
        exposure_s=exposure,
        signal=mean - take_mean @ dark.mean.y,
        signal_covariance=np.diag(sampling + of_mean**2) + take_mean @ dark.mean.covariance @ take_mean.T,
        shot=variance - take_variance @ dark.variance.y,
        shot_covariance=np.diag(spread**2 + of_variance**2)
        + take_variance @ dark.variance.covariance @ take_variance.T,
        noise=variance,
        noise_uncertainty=spread,
        dark_noise=dark.variance.points,
        dark_share=take_variance,
        mean=mean,
        spread=np.sqrt([level.spatial_variance + np.nan_to_num(level.variance) for level in levels]),
        mean_variance=np.array([level.spatial_variance / level.pixels for level in levels]),
        clipped=np.array([level.clipped for level in levels]),
        white_share=np.array([level.high_fraction for level in levels]),
        group=order,
    )


@dataclass(frozen=True)
class Saturation:
    """Where a channel saturates.

    Parameters
    ----------
    index
        The light level with the largest temporal variance (EMVA 1288 R4.0), of single frames the brightest one; None
        where saturation was not seen.
    signal
        Its signal, DN, dark taken off; None where saturation was not seen.
    x
        Where on the axis of the light levels the variance is largest: about that level, known to a step between levels.
    level_dn
        Mean digital number of fully clipped pixels.
    level_method
        How that was read.
    """

    index: int | None
    signal: float | None
    x: Value
    level_dn: Value
    level_method: str


def find_saturation(levels: LightLevels, white: int) -> Saturation:
    """Find where the temporal variance is largest, and what fully clipped pixels read."""
    level_dn, method = _clipped_level(levels, white)
    repeated = np.flatnonzero(levels.repeated)
    if repeated.size == 0:
        seen = isinstance(level_dn, Uncertain)
        reason = "no light level has two frames, and the variance shows saturation"
        if not seen:
            return Saturation(None, None, Missing(reason), level_dn, method)
        brightest = int(np.argmax(levels.signal))
        return Saturation(brightest, float(levels.signal[brightest]), Missing(reason), level_dn, method)
    peak = int(repeated[np.argmax(levels.shot[repeated])])
    beyond = repeated[repeated > peak]
    fallen = beyond.size > 0 and levels.shot[beyond].min() < FALLEN_SHARE * levels.shot[peak]
    if not (fallen or levels.white_share[peak:].max() > CLIPPED_SHARE):
        reason = "no flat reached saturation; take flats up to where they do not get brighter"
        return Saturation(None, None, Missing(reason), level_dn, method)
    return Saturation(peak, float(levels.signal[peak]), _between_neighbours(levels, peak), level_dn, method)


def _between_neighbours(levels: LightLevels, peak: int) -> Uncertain:
    """The amount of light at the maximum, of which the levels tell only that one of them has the largest variance.

    Up to the maximum the variance rises with the light; beyond, more and more pixels clip, a share ndtr(z) of them at z
    spreads w past the middle. So the maximum is where the share grows as fast as the light, phi(z) = w ndtr(-z), and a
    level beyond it still has more variance than the level before while the share is below the step between the two.
    That bounds the maximum from below by the largest level, or a little less, and from above by the next, or a little
    less; between the bounds any place is as likely (rectangular).
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
    """What fully clipped pixels read: the brightest flats where they are still, or the converter's top."""
    last = len(levels.x) - 1
    shot = levels.shot[levels.repeated]
    still = levels.repeated[last] and levels.shot[last] < STILL_SHARE * shot.max()
    if still or levels.white_share[last] > 1.0 - CLIPPED_SHARE:
        value = Uncertain.of(float(levels.mean[last]), float(np.sqrt(levels.mean_variance[last])))
        return value, "mean of the brightest flats, all pixels clipped"
    share = float(levels.white_share.max())
    if share > CLIPPED_SHARE:
        value = Uncertain.of(float(white))
        return value, f"the converter's highest number, which {100 * share:.3g} % of the brightest flats read"
    return Missing("no flat is clipped; take flats up to where they do not get brighter"), "fully clipped flats"


def linear_levels(levels: LightLevels, saturation: Saturation) -> NDArray[np.bool_]:
    """(m,) which light levels are in the linear range.

    Not notably clipped and, where saturation was seen, at most 70 % of the signal there.
    """
    inside = ~levels.clipped
    if saturation.signal is not None:
        inside &= levels.signal <= LINEAR_SHARE * saturation.signal
    return inside


@dataclass(frozen=True)
class GainFit(Fit):
    """The photon transfer line, and what the gain owes to the dark variances taken off its points.

    Parameters
    ----------
    dark
        Value 0; its sources are those of the dark variances, which read noise and dark noise share.
    """

    dark: Uncertain

    @property
    def uncertain(self) -> tuple[Uncertain, ...]:
        """The gain, correlated with what else the darks tell."""
        own = max(float(self.covariance[0, 0]) - self.dark.standard_uncertainty**2, 0.0)
        source = Source.student(self.freedom) if math.isfinite(self.freedom) else None
        return (Uncertain.of(float(self.parameters[0]), math.sqrt(own), source) + self.dark,)


def fit_gain(channels: Sequence[LightLevels], used: Sequence[NDArray[np.bool_]]) -> GainFit | None:
    """System gain K: the slope through the origin of shot variance against signal, all channels together.

    K is one number for a chip: channels differ in light, not in what an electron is worth.
    The signal's own uncertainty enters by its effect K u(signal) on the variance axis (effective variance).
    A variance that came out low by chance says of itself that it is known well; weights from such uncertainties draw
    the line below the points, by twice their relative variance. So the uncertainty of each is taken relative to itself
    and applied to what the line says of the level.

    Returns
    -------
    GainFit or None
        None where no level can be used.
    """
    masks = [mask & levels.repeated for levels, mask in zip(channels, used, strict=True)]
    y = np.concatenate([levels.signal[mask] for levels, mask in zip(channels, masks, strict=True)])
    v = np.concatenate([levels.shot[mask] for levels, mask in zip(channels, masks, strict=True)])
    if y.size == 0:
        return None
    shot = _block_diagonal([c.shot_covariance[np.ix_(m, m)] for c, m in zip(channels, masks, strict=True)])
    signal = _block_diagonal([c.signal_covariance[np.ix_(m, m)] for c, m in zip(channels, masks, strict=True)])
    noise, uncertainty = (
        np.concatenate([getattr(levels, name)[mask] for levels, mask in zip(channels, masks, strict=True)])
        for name in ("noise", "noise_uncertainty")
    )
    gain = float(y @ v / (y @ y))
    for _ in range(3):
        expected = np.maximum(noise - v + gain * y, 0.0)
        change = uncertainty**2 * ((expected / noise) ** 2 - 1.0)
        fit = fit_linear(y[:, None], v, shot + np.diag(change) + gain**2 * signal)
        gain = float(fit.parameters[0])
    dark, start = Uncertain(0.0), 0
    for levels, mask in zip(channels, masks, strict=True):
        end = start + int(mask.sum())
        share = fit.estimator[0, start:end] @ levels.dark_share[mask]
        dark, start = dark - combined(levels.dark_noise, share), end
    return GainFit(**vars(fit), dark=Uncertain(0.0, dark.parts))


def _block_diagonal(blocks: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    size = sum(len(block) for block in blocks)
    result = np.zeros((size, size))
    start = 0
    for block in blocks:
        end = start + len(block)
        result[start:end, start:end] = block
        start = end
    return result


def gain_value(fit: GainFit | None) -> Value:
    """K in DN per electron, or why there is none."""
    if fit is None:
        return Missing("no light level in the linear range has two frames; photon transfer needs their noise")
    gain, uncertainty = float(fit.parameters[0]), float(np.sqrt(fit.covariance[0, 0]))
    if gain < 2.0 * uncertainty:
        return Missing(
            f"the temporal variance does not rise with the signal (slope {gain:.3g} ± {uncertainty:.3g} DN); "
            f"photon transfer needs brighter flats or more frames"
        )
    return fit.uncertain[0]


def fit_response(levels: LightLevels, used: NDArray[np.bool_]) -> Fit | None:
    """Responsivity: the slope through the origin of signal against the light levels' axis."""
    if not used.any():
        return None
    x = levels.x[used]
    return fit_linear(x[:, None], levels.signal[used], levels.signal_covariance[np.ix_(used, used)])
