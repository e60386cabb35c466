"""Signal-to-noise ratio against the amount of light: measured, and of the linear model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from photosite.calibration.photon_transfer.channel import Channel
from photosite.calibration.photon_transfer.photon_transfer import fit_response
from photosite.calibration.withheld import NO_LINEAR_LEVEL
from photosite.values.shown import Shown
from photosite.values.uncertain import Missing, Uncertain


@dataclass(frozen=True, eq=False)
class SnrCurve(Shown):
    """Signal-to-noise ratio of one channel at each light level, and of the linear model.

    Parameters
    ----------
    x, snr, snr_uncertainty, used
        (points,) amount of light; signal over temporal noise, a ratio; its standard uncertainty from sampling; whether
        the level is in the linear range.
    photons
        Whether `x` is in photons per pixel; else it is the signal in electrons.
    response_dn, gain_dn_per_e
        DN per unit of `x`, and system gain.
    dark_variance_dn2
        Dark temporal variance at exposure zero, quantization included.

    Notes
    -----
    EMVA 1288 R4.0 Linear: SNR = signal / temporal noise. In the linear model it is
    eta p / sqrt(sigma_d^2 + sigma_q^2 / K^2 + eta p), for an ideal sensor sqrt(p). Where the photons are unknown,
    electrons replace them: the ideal sensor then has shot noise only.
    """

    x: NDArray[np.float64]
    snr: NDArray[np.float64]
    snr_uncertainty: NDArray[np.float64]
    used: NDArray[np.bool_]
    photons: bool
    response_dn: Uncertain
    gain_dn_per_e: Uncertain
    dark_variance_dn2: Uncertain

    def model(self, x: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the linear model's ratio and its standard uncertainty, to first order.

        `x` holds amounts of light above 0, in any shape. NaN where a negative dark variance leaves no noise.

        Examples
        --------
        >>> one = Uncertain(1.0)
        >>> levels, none = np.array([]), np.array([], dtype=bool)
        >>> curve = SnrCurve(levels, levels, levels, none, True, one, one, Uncertain.of(0.0, 2.0))
        >>> [round(float(n), 3) for n in curve.model(100.0)]
        [10.0, 0.1]
        """
        k = self.gain_dn_per_e
        signal, variance = self._signal_and_variance(x)
        variance = np.where(variance > 0.0, variance, np.nan)
        snr = signal / np.sqrt(variance)
        dark_part = -0.5 * snr / variance * self.dark_variance_dn2.standard_uncertainty
        if self.photons:
            gain_part = -0.5 * snr / variance * signal * k.standard_uncertainty
            response_part = snr * (1.0 - 0.5 * k.value * signal / variance) * self.response_dn.relative
        else:
            gain_part = snr * (1.0 - k.value * signal / variance) * k.relative
            response_part = np.zeros_like(snr)
        return snr, np.sqrt(dark_part**2 + gain_part**2 + response_part**2)

    def with_pattern(self, x: ArrayLike, dsnu_dn: float, prnu: float) -> NDArray[np.float64]:
        """Return the linear model's ratio with the fixed pattern as noise: that of the pixels of one frame.

        This is the total SNR of EMVA 1288 R4.0 Linear.

        Parameters
        ----------
        x
            Amounts of light above 0, any shape.
        dsnu_dn, prnu
            DSNU1288 in DN, and PRNU1288 as a fraction of the signal; a negative one stands for a negative variance.

        Examples
        --------
        >>> one, none = Uncertain(1.0), np.array([])
        >>> curve = SnrCurve(none, none, none, none.astype(bool), True, one, one, Uncertain(0.0))
        >>> curve.with_pattern([1e4, 1e8], 0.0, 0.01).round(1).tolist()
        [70.7, 100.0]
        """
        signal, variance = self._signal_and_variance(x)
        variance = variance + dsnu_dn * abs(dsnu_dn) + prnu * abs(prnu) * signal**2
        return np.asarray(signal / np.sqrt(np.where(variance > 0.0, variance, np.nan)))

    def _signal_and_variance(self, x: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        gain = self.gain_dn_per_e.value
        signal = np.asarray(x, dtype=np.float64) * (self.response_dn.value if self.photons else gain)
        return signal, self.dark_variance_dn2.value + gain * signal


def snr_curve(channel: Channel) -> SnrCurve | Missing:
    """Return the signal-to-noise ratios of a channel's light levels, or the reason why they are missing.

    Left out are levels with one frame, levels whose noise or signal is not above zero, and levels brighter than that of
    the largest noise, where clipping removes the noise.
    """
    levels, gain, photons = channel.levels, channel.line_gain, channel.levels.photons_known
    fit = fit_response(levels, channel.in_series, plain=True)
    if isinstance(gain, Missing):
        return gain
    if fit is None:
        return NO_LINEAR_LEVEL.missing("no light level lies in the linear range")
    if isinstance(dark := channel.dark.variance.at_zero, Missing):
        return dark
    variance, variance_u2 = channel.temporal_variance()
    known = levels.repeated & levels.trusted & (variance > 0.0) & (levels.signal > 0.0)
    if channel.saturation.index is not None:
        known[channel.saturation.index + 1 :] = False
    signal, variance, variance_u2 = levels.signal[known], variance[known], variance_u2[known]
    snr = signal / np.sqrt(variance)
    relative = np.sqrt(np.diag(levels.signal_covariance)[known] / signal**2 + variance_u2 / (2.0 * variance) ** 2)
    slope = Uncertain.of(float(fit.parameters[0]), float(np.sqrt(fit.covariance[0, 0])))
    return SnrCurve(
        x=levels.x[known] if photons else signal / gain.value,
        snr=snr,
        snr_uncertainty=snr * relative,
        used=channel.used[known],
        photons=photons,
        response_dn=slope if photons else gain,
        gain_dn_per_e=gain,
        dark_variance_dn2=dark,
    )
