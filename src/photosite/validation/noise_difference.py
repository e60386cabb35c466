"""Differences between the noise of measured and simulated patches, and their likely causes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import spatial_noise, temporal_noise

_APART = 3.0
"""Standard errors between the differences of dark and of bright patches above which they count as different."""


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
    by_channel = ", ".join(
        f"{channel} {_median(ratio[which[:, k], k])}"
        for k, channel in enumerate(measured.channels)
        if which[:, k].any()
    )
    what = "noise from frame to frame" if temporal else "noise over pixels"
    patch, k = np.unravel_index(int(np.nanargmax(np.abs(ratio - 1.0))), ratio.shape)
    lines = [
        f"{what}, measured over simulated: {by_channel}, medians over patches; the largest difference is "
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
