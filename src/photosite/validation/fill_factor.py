"""Fit of the fill factor to measured and simulated patch means."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.fit import Fit, fit_linear
from photosite.errors import InputError
from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import ChiSquare, RelativeDifference, Selection, chi_square_of_means
from photosite.values.shown import Shown

FEWEST_PATCHES = 3
"""Fewer patches give no usable standard error."""


@dataclass(frozen=True, slots=True)
class ChannelFillFactor(Shown):
    """The fill factor fitted to one channel, with its standard error."""

    value: float
    standard_error: float


@dataclass(frozen=True, eq=False)
class FillFactorFit(Shown):
    """The fill factor fitted to patch means.

    Parameters
    ----------
    value, standard_error, interval_95
        Of the fill factor; the interval is Student's t. Errors that scale all patches alike (light level, exposure
        time, scale of the quantum efficiency) shift the value and are not part of the standard error. A value above 1
        is physically impossible and shows such an error.
    degrees_of_freedom, simulated_with
        Degrees of freedom of the interval, patches less one; the fill factor of the simulation.
    names, channels, used
        The patches and channels; false where either camera is saturated or the simulated mean is not above black.
    residuals, residual_noise
        (patches, channels) measured over fitted, less 1, and their standard errors from the noise of both frames;
        masked where not used.
    patch_scatter
        Relative standard deviation between patches beyond noise, common to the channels of a patch, such as uneven
        light. 0 where noise explains the residuals.
    by_channel
        The same fit for each channel. A fill factor changes all channels alike, so a difference beyond the standard
        errors indicates another lamp spectrum or other quantum efficiencies. The channels share the unevenness of the
        light, so their differences are more precise than the values.
    chi_square
        Chi-square of the residuals under noise alone; degrees of freedom are the points less one.
    """

    value: float
    standard_error: float
    interval_95: tuple[float, float]
    degrees_of_freedom: int
    simulated_with: float
    names: tuple[str, ...]
    channels: tuple[str, ...]
    used: Selection
    residuals: RelativeDifference
    residual_noise: RelativeDifference
    patch_scatter: float
    by_channel: Mapping[str, ChannelFillFactor]
    chi_square: ChiSquare

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers for JSON, with None for points that were left out."""
        return {
            "value": self.value,
            "standard_error": self.standard_error,
            "interval_95": list(self.interval_95),
            "degrees_of_freedom": self.degrees_of_freedom,
            "simulated_with": self.simulated_with,
            "patches": list(self.names),
            "channels": list(self.channels),
            "residuals": self.residuals.tolist(),
            "residual_noise": self.residual_noise.tolist(),
            "patch_scatter": self.patch_scatter,
            "by_channel": {name: asdict(found) for name, found in self.by_channel.items()},
            "chi_square": asdict(self.chi_square),
        }


def fit_fill_factor(measured: PatchStatistics, simulated: PatchStatistics, fill_factor: float) -> FillFactorFit:
    """Fit the fill factor to patch means by weighted least squares.

    Below saturation, patch means are proportional to the fill factor: measured = (value / fill_factor) simulated. No
    second simulation is needed.

    Parameters
    ----------
    measured, simulated
        Statistics of the same patches, in the same order.
    fill_factor
        Fill factor of the simulation, above 0 and at most 1.

    Raises
    ------
    InputError
        If patches or channels differ, fewer than three patches can be used, or the measured patches are not above black
        on average.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3, fit the fill factor in this way without a standard error. Here the
    channels of a patch, which see the same light, are averaged first, weighted by noise. The ratio of a patch has the
    variance of its noise plus one variance common to all patches, estimated from their scatter (Mandel and Paule). The
    standard error comes from the scatter of the patches, with Student's t (G. Knapp and J. Hartung, Stat. Med. 22
    (2003) 2693). docs/validation/fill-factor.md gives the reasons, the measured coverage and the limits.

    Noise of the simulated means biases a ratio by its relative variance, 1e-4 for a mean known to 1 %.

    Examples
    --------
    >>> from photosite.frames.raw_frame import RawFrame
    >>> from photosite.metrics.patches import patch_statistics
    >>> from photosite.values.region import Region
    >>> rng = np.random.default_rng(2)
    >>> light = np.repeat(np.arange(1, 7) * 300.0, 20)[:, None] * np.ones(40)
    >>> patches = [Region(f"gray {i}", 20 * i, 20 * i + 20, 0, 40) for i in range(6)]
    >>> measured, simulated = (
    ...     patch_statistics(RawFrame(rng.poisson(light * ff).astype(np.uint16), bits=12), patches) for ff in (0.8, 0.9)
    ... )
    >>> fit = fit_fill_factor(measured, simulated, fill_factor=0.9)
    >>> abs(fit.value - 0.8) < 2 * fit.standard_error < 0.004
    True
    """
    from scipy.special import stdtrit

    _check(measured, simulated, fill_factor)
    used = ~(measured.saturated | simulated.saturated) & (simulated.mean_dn > 0)
    lit = np.flatnonzero(used.any(axis=1))
    if lit.size < FEWEST_PATCHES:
        expected = f"{FEWEST_PATCHES} or more, above black and not saturated"
        raise InputError("usable patches", value=lit.size, expected=expected, hint="Change the exposure time")
    overall = float(measured.mean_dn[used].sum() / simulated.mean_dn[used].sum())
    if not overall > 0:
        hint = "Check the black level and the light"
        raise InputError("the measured patches are not above black on average", hint=hint)
    # Measured over simulated and its variance from noise, (patches, channels) each; 1 where not used.
    signal = np.where(used, simulated.mean_dn, 1.0)
    noise = np.hypot(measured.standard_error_dn, overall * simulated.standard_error_dn)
    ratio, variance = np.where(used, measured.mean_dn / signal, 1.0), np.where(used, (noise / signal) ** 2, 1.0)
    weight = np.where(used[lit], 1.0 / variance[lit], 0.0)
    patch_ratio = (weight * ratio[lit]).sum(axis=1) / weight.sum(axis=1)
    fit = _mean(patch_ratio, 1.0 / weight.sum(axis=1))
    scale, error = _scale(fit)
    by_channel = {}
    for k, name in enumerate(measured.channels):
        which = used[:, k]
        if np.count_nonzero(which) >= FEWEST_PATCHES:
            estimate = _scale(_mean(ratio[which, k], variance[which, k]))
            by_channel[name] = ChannelFillFactor(*(fill_factor * found for found in estimate))
    fitted = replace(
        simulated, mean_dn=scale * simulated.mean_dn, standard_error_dn=scale * simulated.standard_error_dn
    )
    value, standard_error = fill_factor * scale, fill_factor * error
    reach = float(stdtrit(fit.degrees_of_freedom, 0.975)) * standard_error
    return FillFactorFit(
        value=value,
        standard_error=standard_error,
        interval_95=(value - reach, value + reach),
        degrees_of_freedom=fit.degrees_of_freedom,
        simulated_with=fill_factor,
        names=measured.names,
        channels=measured.channels,
        used=used,
        residuals=np.ma.array(ratio / scale - 1.0, mask=~used),
        residual_noise=np.ma.array(np.sqrt(variance) / scale, mask=~used),
        patch_scatter=math.sqrt(fit.extra_variance) / scale,
        by_channel=by_channel,
        chi_square=chi_square_of_means(measured, fitted, used, fitted=1),
    )


def _check(measured: PatchStatistics, simulated: PatchStatistics, fill_factor: float) -> None:
    if not 0 < fill_factor <= 1:
        raise InputError("fill_factor", value=fill_factor, expected="above 0 and at most 1")
    for what in ("names", "channels"):
        one, other = getattr(measured, what), getattr(simulated, what)
        if one != other:
            raise InputError(
                f"measured and simulated patches have different {what}: {', '.join(one)} and {', '.join(other)}",
                hint="Compute both statistics with the same regions",
            )


def _mean(ratio: NDArray[np.float64], variance: NDArray[np.float64]) -> Fit:
    return fit_linear(np.ones((ratio.size, 1)), ratio, np.diag(variance))


def _scale(fit: Fit) -> tuple[float, float]:
    """Return the fitted ratio and its standard error from the weighted scatter (Knapp and Hartung)."""
    # The extra variance is chosen so that the weighted squares average to 1.
    mean_square = 1.0 if fit.extra_variance > 0.0 else fit.chi_square / fit.degrees_of_freedom
    return float(fit.parameters[0]), math.sqrt(float(fit.covariance[0, 0]) * mean_square)
