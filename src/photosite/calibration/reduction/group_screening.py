"""All checks of the sampled frames of a group: near copies, outlier frames, frames of another chip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.reduction.codes import Counts, count_codes
from photosite.calibration.reduction.foreign_frames import FOREIGN_FRAMES, find_foreign_frames
from photosite.calibration.reduction.frame_screening import OUTLIER_FRAME, find_near_copies, find_outlier_frames
from photosite.values.diagnostic import Diagnostic


class Screening(NamedTuple):
    """What the samples of a group show."""

    copies: dict[int, tuple[int, int]]
    """The frames that repeat an earlier one, by their place: its place, and the sampled pixels that differ."""

    outliers: dict[int, Diagnostic]
    """The frames that differ from the others: how, by their place among the frames that are no copies."""

    counts: Counts
    """`count_codes` of the frames that are left."""


def screen_frames(
    samples: Sequence[NDArray[np.uint16]], labels: NDArray[np.int64], dark_dn: float | None, *, dark: bool
) -> Screening:
    """Find the frames of a group that must be left out.

    Parameters
    ----------
    samples
        Sampled pixels (rows, cols) of each frame (`sample_grid`).
    labels
        Channels of these pixels.
    dark_dn
        Level without light; None if unknown.
    dark
        Whether these are dark frames.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> frames = [np.uint16(rng.normal(500.0, 10.0, (64, 64))) for _ in range(5)]
    >>> frames[3][30:] = 0
    >>> found = screen_frames([frames[0], *frames], np.zeros((64, 64), np.int64), 64.0, dark=False)
    >>> found.copies, found.outliers[3].text, int(found.counts[:, 2].sum()) // 64**2
    ({1: (0, 0)}, 'its mean is 234 DN, that of the others 499.4 DN', 4)
    """
    copies = find_near_copies(samples)
    # Clipped flat fields with a pattern of their own, such as that of a black level, are all alike.
    if not dark and len(copies) >= len(samples) - 1:
        copies = {}
    left = [sample for place, sample in enumerate(samples) if place not in copies]
    outliers = {place: OUTLIER_FRAME(reason) for place, reason in find_outlier_frames(left, dark_dn).items()}
    rest = [place for place in range(len(left)) if place not in outliers]
    foreign = find_foreign_frames([left[place] for place in rest], labels)
    outliers |= {rest[place]: FOREIGN_FRAMES(reason) for place, reason in foreign.items()}
    used = [left[place] for place in rest if place not in outliers]
    return Screening(copies, outliers, count_codes(used, labels))
