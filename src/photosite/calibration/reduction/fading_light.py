"""A lamp that fades, or is changed, within one list of frames: they are divided into levels by their means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from photosite.frames.frame_set import FrameGroup, FrameSet
from photosite.values.diagnostic import DiagnosticKind

LEAST_FRAMES = 6
"""Frames of a fading lamp: three levels of two."""

LEAST_RANGE = 1.5
"""Ratio of the brightest to the dimmest frame. Below it, the shifts of the frames are taken off their noise."""

LARGEST_STEP = 1.2
"""Largest ratio of the frames of one level, which screening accepts."""

SMOOTH = 0.5
"""Mean squared difference of successive frames over twice their variance, which is 1 for levels in random order."""

LEAST_STEP = 1.02
"""Ratio of two frames from which a lamp that is changed in steps may have a step between them."""

STEP_RATIO = 8.0
"""Logarithm of such a step over that of the usual ratio of neighbors by brightness."""

LEAST_LEVELS, MOST_LEVELS = 3, 64

FADING_LIGHT = DiagnosticKind(
    "fading-light",
    "note",
    "The light of one level changes widely from frame to frame: slowly, or in steps of several frames each.",
    "The frames are divided into levels by their means, and the signal stands for the light: the system gain and what "
    "follows from it are those of a sweep.",
    "Nothing, if the lamp was meant to change. Otherwise let it warm up.",
    ("system_gain_dn_per_e", "prnu*", "linearity_*"),
    "ratio of the brightest to the dimmest frame",
    "none: steady light has a ratio near 1",
)


class LightFades(Exception):  # noqa: N818 - no error: the calibration starts again with the frames
    """The light fades within a level of a frame set; `frames` has the level as several."""

    def __init__(self, frames: FrameSet) -> None:
        super().__init__(frames.source)
        self.frames = frames


def with_fading_levels(
    frames: FrameSet, group: FrameGroup, used: Sequence[int], means: NDArray[np.float64], dark_dn: float | None
) -> FrameSet | None:
    """Return a frame set in which a fading group is several levels; None where its light is steady, or jumps.

    This is for light of unknown strength and one exposure time, where nothing else tells the levels apart.

    Parameters
    ----------
    frames, group
        The frame set, and the group of flat fields.
    used, means
        (n,) the group's frames that are no copies, in the order in which they were taken, and their mean numbers.
    dark_dn
        The level without light; None if unknown, which counts as 0.

    Examples
    --------
    >>> from photosite.frames.frame_set import FrameSource
    >>> sources = tuple(FrameSource(f"{n}", lambda: np.zeros((4, 4), np.uint16)) for n in range(8))
    >>> group = FrameGroup("light", 0.01, sources)
    >>> frames = FrameSet((group,), rows=4, cols=4, bits=12)
    >>> found = with_fading_levels(frames, group, range(8), 64.0 + 100.0 * 0.9 ** np.arange(8.0), 64.0)
    >>> [[source.name for source in level.frames] for level in found.groups]
    [['7', '6'], ['5', '4'], ['3', '2'], ['1', '0']]
    """
    lights = frames.of_kind("light")
    signal = means - (dark_dn or 0.0)
    if (
        len(used) < LEAST_FRAMES
        or group.photons_per_pixel is not None
        or any(each.exposure_s != group.exposure_s for each in lights)
        or not signal.min() > 0.0
        or signal.max() < LEAST_RANGE * signal.min()
        or float((np.diff(signal) ** 2).mean()) > SMOOTH * 2.0 * float(signal.var(ddof=1))
    ):
        return None
    order = np.argsort(signal, kind="stable")
    parts = _levels(order, signal)
    most = max(float(signal[part].max() / signal[part].min()) for part in parts)
    if len(parts) < LEAST_LEVELS or min(map(len, parts)) < 2 or most > LARGEST_STEP:
        return None
    digits = len(str(len(parts)))
    levels = tuple(
        replace(
            group,
            frames=tuple(group.frames[used[i]] for i in part),
            level=f"{group.level or 'light'} {number:0{digits}d}",
        )
        for number, part in enumerate(parts, start=1)
    )
    at = next(n for n, each in enumerate(frames.groups) if each is group)
    low, high = (float(end) for end in (signal.min(), signal.max()))
    text = (
        f"the light of {len(used)} frames of {group.exposure_s:g} s changes between {low:.4g} and {high:.4g} DN above "
        f"dark: they are taken as {len(parts)} levels of light"
    )
    return replace(
        frames,
        groups=(*frames.groups[:at], *levels, *frames.groups[at + 1 :]),
        diagnostics=(*frames.diagnostics, FADING_LIGHT(text, high / low if low > 0.0 else math.inf)),
    )


def _levels(order: NDArray[np.intp], signal: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """Return the frames, sorted by brightness, in levels: those between two steps, or pairs where the light fades."""
    ratio = np.diff(np.log(signal[order]))
    steps = np.flatnonzero(ratio > max(math.log(LEAST_STEP), STEP_RATIO * float(np.median(ratio))))
    size = max(2, -(-len(order) // MOST_LEVELS))
    levels: list[NDArray[np.intp]] = []
    for part in np.split(order, steps + 1):
        steady = signal[part].max() < LEAST_STEP * signal[part].min()
        levels += [part] if steady else np.array_split(part, max(len(part) // size, 1))
    return levels
