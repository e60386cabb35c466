"""Likely causes of a difference between measured and simulated patches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import Selection
from photosite.validation.result import Validation
from photosite.values.region import Corners
from photosite.values.shown import Shown

_BETTER = 0.5
"""Another orientation or CFA explains the frames if it lowers the scatter of patches to less than this fraction."""

_SMALL = 0.02
"""Relative scatter or difference between channels that uneven light or the chart itself may cause."""


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
    return _scale_causes(found, fitted) if better is None else (better,)


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


def _scale_causes(found: Scale, fitted: str | None) -> tuple[str, ...]:
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
