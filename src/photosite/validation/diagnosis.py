"""What may be wrong where measured and simulated patches differ: what explains the difference, in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.patches import PatchStatistics
from photosite.validation.agreement import Selection
from photosite.validation.result import Validation
from photosite.values.region import Corners

_BETTER = 0.5
"""Another reading of the frames explains them where its patches scatter by less than this part of what they did."""

_SMALL = 0.02
"""Relative: what of scatter or of difference between channels is put down to an uneven light or the chart."""


@dataclass(frozen=True, slots=True)
class Scale:
    """How measured patches follow simulated ones, channel by channel.

    Parameters
    ----------
    ratio
        Measured over simulated, by channel: of the sums over the patches.
    scatter
        Root mean square over patches and channels of what a patch's ratio differs from its channel's, relative.
    """

    ratio: Mapping[str, float]
    scatter: float


def scale_of(measured: PatchStatistics, simulated: PatchStatistics, used: Selection) -> Scale | None:
    """The ratio of each channel and the scatter of patches about it; None where nothing is above black.

    Parameters
    ----------
    measured, simulated
        The same patches and channels.
    used
        (patches, channels).
    """
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
    """A chart's corners in the seven other orders that go round it, by what the chart was if that order is right."""
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
    """Why measured and simulated patches differ, as far as their numbers tell.

    Parameters
    ----------
    validation
        The comparison.
    others
        The measured frames read in other ways, by what would have to be the case: corners in another order, another
        colour filter array.
    fitted
        What the simulation was fitted in. It took up whatever scales all patches alike, so none of that is named.

    Returns
    -------
    tuple of str
        None where the patch means agree.
    """
    if validation.means.p_value >= validation.level / len(validation.tests):
        return ()
    found = scale_of(validation.measured, validation.simulated, validation.used)
    if found is None:
        return ("the measured patches are not above black: check the black level and that light reached the chart",)
    better = _better(validation, others, found.scatter)
    if better is not None:
        return (better,)
    return _of_scale(found, fitted)


def _better(validation: Validation, others: Mapping[str, PatchStatistics], scatter: float) -> str | None:
    """The other reading that fits best, if it is much better."""
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
        f"{best}: then patches would scatter by {100 * tried[best]:.3g} % about one ratio of each channel, not by "
        f"{100 * scatter:.3g} %"
    )


def _of_scale(found: Scale, fitted: str | None) -> tuple[str, ...]:
    ratios = np.array(list(found.ratio.values()))
    middle = float(np.exp(np.log(ratios).mean()))
    apart = float(ratios.max() / ratios.min() - 1.0)
    listed = ", ".join(f"{channel} {ratio:.4f}" for channel, ratio in found.ratio.items())
    about = f"about {'them' if len(ratios) > 1 else 'it'} patches scatter by {100 * found.scatter:.3g} %"
    lines = [f"measured over simulated is {listed}; {about}"]
    if found.scatter > max(_SMALL, apart):
        lines.append(
            "patches differ one from another, not by a common ratio: another chart, misplaced corners, light "
            "that is uneven, stray light, or spectra (lamp, quantum efficiency) that are not those told"
        )
    elif apart > _SMALL:
        lines.append("the channels differ in their ratios: the lamp's spectrum or the quantum efficiencies are others")
    elif fitted is not None:
        lines.append(
            f"what scales all patches alike is fitted ({fitted.replace('_', ' ')}); what is left is small: misplaced "
            "corners, uneven or stray light, or spectra that are not quite those told"
        )
    else:
        lines.append(
            f"all channels alike, {middle:.4f} of the simulation: level of light, exposure, f-number, fill factor or "
            "the scale of the quantum efficiencies"
        )
    return tuple(lines)
