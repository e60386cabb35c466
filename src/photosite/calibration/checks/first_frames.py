"""Whether the first frame of each level differs from the others: image lag, or light that is still changing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from photosite.calibration.reduction.groups import pooled_level
from photosite.calibration.reduction.reduce import Reduction

BY_CHANCE = 5e-4
"""Share of calibrations with frames in random order in which a difference may be reported."""

LEAST_FRAMES = 3
"""Frames of a level that show whether the first one differs."""

LEAST_SHARE = 5e-4
"""Difference, as a share of the signal, below which nothing is reported: it is lost in the uncertainty of the light."""


@dataclass(frozen=True)
class FirstFrames:
    """First frames that differ from the other frames of their level.

    Parameters
    ----------
    share
        Median difference of their signal from that of the others, as a share of it.
    extreme, levels
        Number of levels whose first frame is the lowest, or the highest where `share` is positive; number of levels.
    """

    share: float
    extreme: int
    levels: int

    def __str__(self) -> str:
        return (
            f"the first frame is the {'highest' if self.share > 0.0 else 'lowest'} in {self.extreme} of {self.levels} "
            f"levels of light, and its signal differs by {100.0 * self.share:+.2g} % from that of the other frames: "
            f"charge of the level before (image lag), or light that is still changing. It shifts responsivity and "
            f"linearity; take more frames and leave out the first ones"
        )


def find_first_frames(reduction: Reduction) -> FirstFrames | None:
    """Return how the first frames of the flat fields differ; None where they do not, within chance.

    In n frames of random order the first is the lowest with probability 1 / n.
    """
    totals = {id(entry.source): entry.total for entry in reduction.used}
    dark = pooled_level(reduction.reference_group.levels).mean
    pixels = reduction.frames.rows * reduction.frames.cols
    shares, chances, lowest, highest = [], [], 0, 0
    for entry in reduction.lights:
        if any(level.clipped for level in entry.levels):
            continue
        signal = [totals[id(source)] / pixels - dark for source in entry.group.frames if id(source) in totals]
        first, others = signal[0], signal[1:]
        if len(signal) < LEAST_FRAMES or np.mean(others) <= 0.0:
            continue
        lowest += first < min(others)
        highest += first > max(others)
        chances.append(1.0 / len(signal))
        shares.append(first / float(np.mean(others)) - 1.0)
    if not shares:
        return None
    # The largest of the chances is an upper limit for groups of different sizes.
    extreme = max(lowest, highest)
    by_chance = 2.0 * float(binom.sf(extreme - 1, len(chances), max(chances)))
    share = float(np.median(shares))
    if by_chance > BY_CHANCE or abs(share) < LEAST_SHARE or (share > 0.0) != (highest > lowest):
        return None
    return FirstFrames(share, extreme, len(shares))
