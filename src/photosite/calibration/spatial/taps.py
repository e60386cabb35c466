"""Taps: halves or quadrants of a chip that are read out by amplifiers of different gain or offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]

BY_CHANCE = 1e-4
"""Share of mean frames without a step in which one may be reported."""

LEAST_STEP = 0.002
"""Step in flat fields, relative to the signal, below which nothing is reported."""

LEAST_DARK_STEP = 0.2
"""Step in dark frames, in standard deviations of their pixels, below which nothing is reported."""

OTHERS = 2.0
"""Factor by which a step must exceed all steps elsewhere, which shading, dust or single lines make."""

NARROWEST, WIDEST = 8, 64
"""Lines at each side of a step that show it, at least and at most; an eighth of the frame between."""

_SIDES = ("top", "bottom"), ("left", "right")


@dataclass(frozen=True)
class Taps:
    """Levels of the taps: of the quadrants of a frame, less their mean.

    Parameters
    ----------
    level
        (2, 2) level of top left, top right, bottom left, bottom right: relative to the signal in flat fields, in DN in
        dark frames.
    uncertainty
        Standard uncertainty of a step between two of them.
    dark
        Whether the frames are dark frames.
    """

    level: Array
    uncertainty: float
    dark: bool

    @property
    def step(self) -> float:
        """Difference between the highest and the lowest tap."""
        return float(self.level.max() - self.level.min())

    @property
    def named(self) -> dict[str, float]:
        """Level of each tap by its place: two halves, where the quadrants of each are alike, or four quadrants."""
        for axis in (0, 1):
            across = self.level - self.level.mean(axis=1 - axis, keepdims=True)
            if np.abs(across).max() < max(0.1 * self.step, 2.0 * self.uncertainty):
                return dict(zip(_SIDES[axis], self.level.mean(axis=1 - axis).tolist(), strict=True))
        return {f"{r} {c}": float(self.level[i, j]) for i, r in enumerate(_SIDES[0]) for j, c in enumerate(_SIDES[1])}

    def __str__(self) -> str:
        scale, unit = (1.0, " DN") if self.dark else (100.0, " %")
        each = ", ".join(f"{name} {scale * level:+.2g}{unit}" for name, level in self.named.items())
        parts = "halves" if len(self.named) == 2 else "quadrants"
        frames, cause, result = ("dark frames", "offset", "DSNU") if self.dark else ("flat fields", "gain", "PRNU")
        return (
            f"the {frames} step by {scale * self.step:.2g}{unit} between {parts} of the sensor ({each}), as with taps "
            f"of different {cause}; {result} includes this step"
        )


def find_taps(planes: Sequence[Array], *, dark: bool = False) -> Taps | None:
    """Return the levels of the taps; None where there is no step at half the width or height beyond chance.

    The step is that between two straight lines through the means of lines on both sides, extrapolated to the middle, in
    each half of the frame. It is compared with its uncertainty, from the scatter about these lines, and with the steps
    at other places.

    Parameters
    ----------
    planes
        (rows, cols) mean frames of each site of the color filter array, of one size: mean flat fields less the dark,
        over the mean of their channel; or mean `dark` frames.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> flat = 1.0 + 0.01 * rng.normal(size=(96, 128))
    >>> find_taps([flat]) is None
    True
    >>> flat[:, 64:] += 0.02
    >>> {name: round(level, 2) for name, level in find_taps([flat]).named.items()}
    {'left': -0.01, 'right': 0.01}
    """
    if not planes:
        return None
    mean = np.mean(planes, axis=0)
    rows, cols = mean.shape
    if min(rows, cols) < 6 * NARROWEST:
        return None
    parts = mean[: rows // 2], mean[rows // 2 :], mean[:, : cols // 2].T, mean[:, cols // 2 :].T
    found = [_middle_step(part.mean(axis=0)) for part in parts]
    steps, uncertainty = np.array([step for step, _, _ in found]), max(u for _, u, _ in found)
    if not any(beyond for _, _, beyond in found):
        return None
    # Right less left at top and bottom, bottom less top at left and right; the mean is 0.
    design = np.array([[-1, 1, 0, 0], [0, 0, -1, 1], [-1, 0, 1, 0], [0, -1, 0, 1], [1, 1, 1, 1]], dtype=np.float64)
    level = np.linalg.lstsq(design, np.append(steps, 0.0), rcond=None)[0].reshape(2, 2)
    taps = Taps(level, uncertainty, dark)
    least = LEAST_DARK_STEP * float(np.std(mean)) if dark else LEAST_STEP
    return taps if taps.step > least else None


def _middle_step(profile: Array) -> tuple[float, float, bool]:
    """Return the step in the middle of a profile, its standard uncertainty, and whether it is beyond chance."""
    n = min(max(len(profile) // 8, NARROWEST), WIDEST)
    design = np.stack([np.ones(n), np.arange(n) + 0.5], axis=1)
    estimator = np.linalg.pinv(design)
    lines = np.lib.stride_tricks.sliding_window_view(profile, n)
    after, before = lines[n:], lines[:-n, ::-1]  # of each place with n values on both sides
    ends, squares = [], 0.0
    for side in (after, before):
        line = side @ estimator.T
        ends.append(line[:, 0])
        squares = squares + np.sum((side - line @ design.T) ** 2, axis=1)
    freedom = 2 * (n - 2)
    steps = ends[0] - ends[1]
    uncertainty = np.sqrt(squares / freedom * 2.0 * (estimator[0] @ estimator[0]))
    here = len(profile) // 2 - n
    elsewhere = np.abs(steps[np.abs(np.arange(len(steps)) - here) >= n]).max(initial=0.0)
    t = -float(stdtrit(freedom, BY_CHANCE / 8.0))  # four steps, both signs
    beyond = abs(steps[here]) > max(t * uncertainty[here], OTHERS * elsewhere)
    return float(steps[here]), float(uncertainty[here]), bool(beyond)
