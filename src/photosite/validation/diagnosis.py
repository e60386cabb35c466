"""Likely causes of a difference between measured and simulated patches, in their means and in their noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import Selection, spatial_noise, temporal_noise
from photosite.values.region import Corners
from photosite.values.shown import Shown

if TYPE_CHECKING:
    from photosite.validation.result import Validation

_BETTER = 0.5
"""Another orientation or CFA explains the frames if it lowers the scatter of patches to less than this fraction."""

_SMALL = 0.02
"""Relative scatter or difference between channels that uneven light or the chart itself may cause."""

_APART = 3.0
"""Standard errors between the differences of dark and of bright patches above which they count as different."""


@dataclass(frozen=True, slots=True)
class Scale(Shown):
    """The ratio of measured to simulated patches by channel, of the sums over the patches.

    The scatter is the relative root-mean-square deviation of a patch's ratio from that of its channel.
    """

    ratio: Mapping[str, float]
    scatter: float


def scale_of(measured: PatchStatistics, simulated: PatchStatistics, used: Selection) -> Scale | None:
    """Return the ratio of each channel and the scatter of patches; None where no patch is above black."""
    lit = used & (simulated.mean_dn > 0)
    ratio: dict[str, float] = {}
    away: list[NDArray[np.float64]] = []
    for k, channel in enumerate(measured.channels):
        x, y = simulated.mean_dn[lit[:, k], k], measured.mean_dn[lit[:, k], k]
        if x.size and y.sum() > 0:
            ratio[channel] = float(y.sum() / x.sum())
            away.append(y / (x * ratio[channel]) - 1.0)
    if not away:
        return None
    return Scale(ratio, float(np.sqrt(np.mean(np.concatenate(away) ** 2))))


def corner_orders(corners: Corners) -> dict[str, Corners]:
    """Return a chart's corners in the seven other orientations, by the name of the orientation."""
    a, b, c, d = corners
    return {
        "turned by 180 degrees": (c, d, a, b),
        "turned by 90 degrees clockwise": (b, c, d, a),
        "turned by 90 degrees counterclockwise": (d, a, b, c),
        "mirrored, left for right": (b, a, d, c),
        "mirrored, top for bottom": (d, c, b, a),
        "mirrored about its diagonal": (a, d, c, b),
        "mirrored about its other diagonal": (c, b, a, d),
    }


def diagnose(
    validation: Validation, others: Mapping[str, PatchStatistics], fitted: str | None = None
) -> tuple[str, ...]:
    """Name likely causes of a difference between measured and simulated patches.

    Parameters
    ----------
    validation
        The comparison.
    others
        Statistics of the measured frames under other assumptions, by assumption: another orientation of the chart,
        another CFA.
    fitted
        The fitted parameter. It absorbs every common scale of the patches, so common scales are not named.
    """
    if validation.means.p_value >= validation.level / len(validation.tests):
        return ()
    found = scale_of(validation.measured, validation.simulated, validation.used)
    if found is None:
        return ("the measured patches are not above black: check the black level and the light",)
    better = _better(validation, others, found.scatter)
    return _of_scale(found, fitted) if better is None else (better,)


def _better(validation: Validation, others: Mapping[str, PatchStatistics], scatter: float) -> str | None:
    """Return the assumption that fits best, if it is much better."""
    tried = {
        what: scale.scatter
        for what, seen in others.items()
        if (scale := scale_of(seen, validation.simulated, ~seen.saturated & ~validation.simulated.saturated))
    }
    if not tried:
        return None
    best = min(tried, key=lambda what: tried[what])
    if tried[best] > _BETTER * scatter:
        return None
    return (
        f"{best}: the scatter of patches about one ratio for each channel would fall from {100 * scatter:.3g} % to "
        f"{100 * tried[best]:.3g} %"
    )


def _of_scale(found: Scale, fitted: str | None) -> tuple[str, ...]:
    ratios = np.array(list(found.ratio.values()))
    middle = float(np.exp(np.log(ratios).mean()))
    apart = float(ratios.max() / ratios.min() - 1.0)
    listed = ", ".join(f"{channel} {ratio:.4f}" for channel, ratio in found.ratio.items())
    about = f"the scatter of patches is {100 * found.scatter:.3g} %"
    if found.scatter > max(_SMALL, apart):
        cause = (
            "patches do not share a common ratio: check the chart, its corners, evenness of the light, stray light, "
            "and the spectra of lamp and quantum efficiency"
        )
    elif apart > _SMALL:
        cause = "the channels have different ratios: check the lamp's spectrum and the quantum efficiencies"
    elif fitted is not None:
        cause = (
            f"the common scale is fitted ({fitted.replace('_', ' ')}) and the rest is small: check corners, uneven and "
            "stray light, and spectra"
        )
    else:
        cause = (
            f"all channels share the ratio {middle:.4f}: check light level, exposure time, f-number, fill factor and "
            "the scale of the quantum efficiencies"
        )
    return f"measured over simulated is {listed}; {about}", cause


def describe_noise_difference(
    measured: PatchStatistics, simulated: PatchStatistics, used: NDArray[np.bool_], *, temporal: bool
) -> tuple[str, ...]:
    """Describe the ratio of each channel, the largest difference, and likely causes, of noise over pixels or frames.

    A channel's ratio is the median over its patches, with a distribution-free interval of at least 95 % (order
    statistics). Likely causes follow from the relative differences of variance in the darkest and the brightest third
    of all patches and channels, averaged with weights from their standard errors. Without noise in any patch of the
    simulation there are no lines.
    """
    (seen, error_m), (made, error_s) = (
        (temporal_noise(found) if temporal else None) or spatial_noise(found) for found in (measured, simulated)
    )
    which = used & (made > 0)
    if not which.any():
        return ()
    ratio = np.full(made.shape, np.nan)
    ratio[which] = seen[which] / made[which]
    of_channels = ", ".join(
        f"{channel} {_median(ratio[which[:, k], k])}"
        for k, channel in enumerate(measured.channels)
        if which[:, k].any()
    )
    what = "noise from frame to frame" if temporal else "noise over pixels"
    patch, k = np.unravel_index(int(np.nanargmax(np.abs(ratio - 1.0))), ratio.shape)
    lines = [
        f"{what}, measured over simulated: {of_channels}, medians over patches; the largest difference is "
        f"{100 * (ratio[patch, k] - 1):+.2f} % ({measured.names[patch]}, {measured.channels[k]})"
    ]
    error = np.hypot(error_m, error_s)
    known = which & (error > 0)
    if known.sum() >= 6:
        away, size = (seen**2 - made**2)[known] / made[known] ** 2, error[known] / made[known] ** 2
        lines.append(f"{what}: {_likely_causes(simulated.mean_dn[known], away, size, temporal)}")
    return tuple(lines)


def _median(values: NDArray[np.float64]) -> str:
    from scipy.stats import binom

    ordered = np.sort(values)
    text = f"{np.median(ordered):.4f}"
    rank = int(binom.ppf(0.025, ordered.size, 0.5))  # the interval leaves out rank - 1 values on either side
    if rank < 1:
        return text  # five patches or fewer give no 95 % interval
    return f"{text} ({ordered[rank - 1]:.4f} to {ordered[-rank]:.4f})"


def _likely_causes(
    level: NDArray[np.float64], away: NDArray[np.float64], error: NDArray[np.float64], temporal: bool
) -> str:
    order = np.argsort(level, kind="stable")
    third = level.size // 3
    (dark, dark_error), (bright, bright_error) = (_mean(away[i], error[i]) for i in (order[:third], order[-third:]))
    numbers = f"(variance {100 * dark:+.1f} % in the darkest third, {100 * bright:+.1f} % in the brightest)"
    if abs(abs(dark) - abs(bright)) < _APART * np.hypot(dark_error, bright_error):
        return f"dark and bright patches differ alike {numbers}: check the gain, or several parameters"
    if abs(dark) > abs(bright):
        others = "" if temporal else " and DSNU"
        return f"dark patches differ most {numbers}: check read noise{others}"
    others = " and flicker of the light" if temporal else ", PRNU and evenness of the light"
    return f"bright patches differ most {numbers}: check the gain{others}"


def _mean(values: NDArray[np.float64], error: NDArray[np.float64]) -> tuple[float, float]:
    weight = error**-2.0
    return float((weight * values).sum() / weight.sum()), float(weight.sum() ** -0.5)
