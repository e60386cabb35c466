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


MOST_JUMPING = 0.03
"""Fraction of the pixels beyond which frames, not pixels, differ."""

JUMP_RATIO = 8.0
"""Standard deviation over frames, relative to the median of all pixels, of pixels that jump."""


def without_jumps(samples: Sequence[NDArray[np.uint16]]) -> list[NDArray[np.uint16]]:
    """Return the samples of frames, with the median over the frames in the few pixels that jump from frame to frame.

    Examples
    --------
    >>> frames = np.random.default_rng(1).normal(500.0, 3.0, (8, 64, 64)).astype(np.uint16)
    >>> frames[::2, 5, 7] = 4000
    >>> len({int(frame[5, 7]) for frame in without_jumps(frames)})
    1
    """
    stack = np.stack(samples)
    spread = stack.std(axis=0)
    jumps = spread > JUMP_RATIO * max(float(np.median(spread)), 0.5)
    if jumps.mean() > MOST_JUMPING:
        return list(samples)
    stack[:, jumps] = np.median(stack[:, jumps], axis=0)
    return list(stack)


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
    left = taken = [sample for place, sample in enumerate(samples) if place not in copies]
    found = find_outlier_frames(left, dark_dn)
    if 2 * len(found) >= len(left) > 2:  # frames do not differ by themselves, but by a few pixels that jump
        left = without_jumps(left)
        found = find_outlier_frames(left, dark_dn)
    outliers = {place: OUTLIER_FRAME(reason) for place, reason in found.items()}
    rest = [place for place in range(len(left)) if place not in outliers]
    foreign = find_foreign_frames([left[place] for place in rest], labels)
    outliers |= {rest[place]: FOREIGN_FRAMES(reason) for place, reason in foreign.items()}
    used = [taken[place] for place in rest if place not in outliers]
    return Screening(copies, outliers, count_codes(used, labels))
