"""The fill factor as the one free parameter between measured and simulated patch means."""

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
from photosite.validation.agreement import ChiSquare, Selection, chi_square_of_means

FEWEST_PATCHES = 3
"""With fewer, the scatter of patches about the fit says next to nothing about its error."""

_Masked = np.ma.MaskedArray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True)
class ChannelFillFactor:
    """The fill factor that one channel alone asks for, with its standard error."""

    value: float
    standard_error: float


@dataclass(frozen=True, eq=False)
class FillFactorFit:
    """What the patch means say of the fill factor.

    Parameters
    ----------
    value, standard_error, interval_95
        Of the fill factor; the interval is Student's t's. What scales all patches alike (the light's level, the
        exposure, the scale of the quantum efficiency) goes into the value, and the standard error knows nothing
        of it. A value above 1, which no pixel has, says that one of those is not what the simulation was told.
    degrees_of_freedom
        Of the interval: patches less one.
    simulated_with
        The fill factor that the simulated patches had.
    names, channels
        The patches and channels.
    used
        (patches, channels), false where either camera saturates or the simulated mean is not above black.
    residuals
        (patches, channels): measured over fitted, less 1; masked where not used.
    residual_noise
        (patches, channels): their standard errors from the noise of both frames alone; masked alike.
    patch_scatter
        Standard deviation from patch to patch, relative, of what the channels of a patch share beyond noise: uneven
        light, above all. 0 where noise explains the residuals.
    by_channel
        The same fit to each channel alone. A fill factor changes all channels alike; where these differ by more than
        their errors, something else differs too: the lamp's spectrum, or the quantum efficiencies. They share
        the unevenness of the light, so their differences are known better than they are.
    chi_square
        Of the residuals under the noise alone, with one degree of freedom less than points.
    """

    value: float
    standard_error: float
    interval_95: tuple[float, float]
    degrees_of_freedom: int
    simulated_with: float
    names: tuple[str, ...]
    channels: tuple[str, ...]
    used: Selection
    residuals: _Masked
    residual_noise: _Masked
    patch_scatter: float
    by_channel: Mapping[str, ChannelFillFactor]
    chi_square: ChiSquare

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers for JSON; None for points that were left out."""
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

    Patch means are proportional to the fill factor as long as nothing saturates, so measured = (value / fill_factor)
    simulated, and no second simulation is needed.

    Parameters
    ----------
    measured, simulated
        Statistics of the same patches, in the same order.
    fill_factor
        What the simulation was done with, above 0 and at most 1.

    Returns
    -------
    FillFactorFit

    Raises
    ------
    InputError
        If patches or channels differ, fewer than three patches can be used, or the measured patches are on the whole
        not above black.

    Notes
    -----
    Farrell, Okincha and Parmar (2008), section 3, fit the fill factor in this way and give no error. Here:

    *Weights are relative.* What real patches differ by is mostly proportional to their signal: light that is uneven
    over the chart, reflectances that are not the tabulated ones. Plain least squares of the means would hang the fit
    on the few brightest patches. A patch's ratio, measured over simulated, has the variance of its noise and one more
    that is the same for all patches and found from their scatter (Mandel and Paule, `calibration.fit.fit_linear`):
    where noise is small, patches weigh alike; where it dominates, by what they know.

    *Patches are the unit.* Its three channels see the same light, so a patch's errors come in threes, and taking 72
    points as independent would make the standard error too small by up to the square root of 3. The channels of a
    patch are therefore averaged first, by their noise, and the error comes from the scatter of 24 patches under these
    weights, with Student's t of 23 degrees of freedom (G. Knapp and J. Hartung, Stat. Med. 22 (2003) 2693), also
    where noise would explain the scatter. `tests/validation/test_fill_factor.py` counts how often the interval holds
    the truth, and how often one from 72 points does not.

    *What it does not cover.* Errors common to all patches, as said at `FillFactorFit.value`. Errors of neighbouring
    patches that go together (a lamp to one side) make the standard error too large where the light on average
    over the chart was measured, because they then cancel, and too small where it was measured at one place.

    Noise of the simulated means biases a ratio by its relative variance, 1e-4 for a mean known to 1 %; noise-weighting
    makes it less.

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
        raise InputError(
            f"a fill factor is fitted to {FEWEST_PATCHES} patches or more, and {lit.size} of {len(used)} are above "
            "black in the simulation and saturated in neither; expose otherwise"
        )
    overall = float(measured.mean_dn[used].sum() / simulated.mean_dn[used].sum())
    if not overall > 0:
        raise InputError(
            "the measured patches are on the whole not above black, so no fill factor explains them; "
            "check the black level and that light reached the chart"
        )
    ratio, variance = _ratios(measured, simulated, used, overall)
    fit = _mean(*_by_patch(ratio[lit], variance[lit], used[lit]))
    scale, error = _scale(fit)
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
        by_channel=_by_channel(ratio, variance, used, measured.channels, fill_factor),
        chi_square=chi_square_of_means(measured, _scaled(simulated, scale), used, fitted=1),
    )


def _check(measured: PatchStatistics, simulated: PatchStatistics, fill_factor: float) -> None:
    if not 0 < fill_factor <= 1:
        raise InputError(f"a fill factor is above 0 and at most 1, not {fill_factor}")
    for what in ("names", "channels"):
        one, other = getattr(measured, what), getattr(simulated, what)
        if one != other:
            raise InputError(
                f"measured and simulated patches differ in their {what}: {', '.join(one)} and {', '.join(other)}; "
                "take both statistics with the same regions"
            )


def _ratios(
    measured: PatchStatistics, simulated: PatchStatistics, used: Selection, overall: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(patches, channels): measured over simulated and its variance from noise; 1 and 1 where not used."""
    signal = np.where(used, simulated.mean_dn, 1.0)
    noise = np.hypot(measured.standard_error_dn, overall * simulated.standard_error_dn)
    return np.where(used, measured.mean_dn / signal, 1.0), np.where(used, (noise / signal) ** 2, 1.0)


def _by_patch(
    ratio: NDArray[np.float64], variance: NDArray[np.float64], used: Selection
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(patches,): the channels' mean, weighted by their noise, and its variance."""
    weight = np.where(used, 1.0 / variance, 0.0)
    return (weight * ratio).sum(axis=1) / weight.sum(axis=1), 1.0 / weight.sum(axis=1)


def _mean(ratio: NDArray[np.float64], variance: NDArray[np.float64]) -> Fit:
    return fit_linear(np.ones((ratio.size, 1)), ratio, np.diag(variance))


def _scale(fit: Fit) -> tuple[float, float]:
    """The fitted ratio, and its standard error from the weighted scatter about it (Knapp and Hartung)."""
    # With an extra variance the weighted squares average to 1 already: that is how it was found.
    mean_square = 1.0 if fit.extra_variance > 0.0 else fit.chi_square / fit.degrees_of_freedom
    return float(fit.parameters[0]), math.sqrt(float(fit.covariance[0, 0]) * mean_square)


def _by_channel(
    ratio: NDArray[np.float64],
    variance: NDArray[np.float64],
    used: Selection,
    channels: tuple[str, ...],
    fill_factor: float,
) -> dict[str, ChannelFillFactor]:
    """Channels with too few patches are left out."""
    found = {}
    for k, name in enumerate(channels):
        which = used[:, k]
        if np.count_nonzero(which) >= FEWEST_PATCHES:
            scale, error = _scale(_mean(ratio[which, k], variance[which, k]))
            found[name] = ChannelFillFactor(fill_factor * scale, fill_factor * error)
    return found


def _scaled(found: PatchStatistics, scale: float) -> PatchStatistics:
    """Means and their errors, as a camera with another fill factor has them."""
    return replace(found, mean_dn=scale * found.mean_dn, standard_error_dn=scale * found.standard_error_dn)
