"""Dark frames whose stated exposure time contradicts the other dark frames, by their mean and by their noise.

Dark charge adds to the mean, and its shot noise to the temporal variance. Frames of another exposure time, or frames
that light fell on, deviate from both lines against exposure by the same charge. A black level that moves leaves the
variance unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.calibration.photon_transfer.fit import fit_linear
from photosite.calibration.reduction.groups import CLIPPED_DARK_FRACTION, GroupStatistics, pooled_level
from photosite.values.diagnostic import DiagnosticKind
from photosite.values.exposure import format_exposure

_Array = NDArray[np.float64]


@dataclass(frozen=True)
class WrongExposure:
    """A dark group off the line of the others.

    Parameters
    ----------
    group
        Its index.
    stated_s, shown_s
        Stated exposure time, and that at which the others have its mean, seconds.
    """

    group: int
    stated_s: float
    shown_s: float

    def __str__(self) -> str:
        return (
            f"its stated exposure time, {format_exposure(self.stated_s)} s, contradicts the other dark frames: mean "
            f"and noise are those of {self.shown_s:.3g} s; the time is wrong, or light fell on it"
        )


SATURATED = 0.95
"""Variance over the pixels, relative to that at the shown exposure time, below which hot pixels saturate."""


def _saturates(exposure_s: _Array, spatial: _Array, index: int, shown_s: float) -> bool:
    """Return whether a group has less pattern than its mean shows: hot pixels that saturate lower both.

    The variance over the pixels rises with the square of the exposure time.
    """
    others = np.arange(len(exposure_s)) != index
    rise, constant = np.polyfit(exposure_s[others] ** 2, spatial[others], 1)
    expected = constant + rise * shown_s**2
    return shown_s < exposure_s[index] and bool(spatial[index] < SATURATED * expected)


WRONG_DARK_EXPOSURE = DiagnosticKind(
    "wrong-dark-exposure",
    "left out",
    "Level and noise of a group of dark frames are those of another exposure time than stated.",
    "The group was left out of all dark figures.",
    "Correct the exposure time, or look for light on these frames.",
    size="exposure time that the frames show, s",
)


LEAST_EXPOSURES = 4
"""Exposure times of repeated dark frames that show which one of them is wrong: three others lie on a line."""
MEAN_SIGMA = 10.0
"""Deviation of a mean from the line of the others, in standard uncertainties, from which its noise is looked at."""
NOISE_SIGMA = 4.0
"""Deviation of its variance, in standard uncertainties: from the line at the stated exposure time, at least, and at the
exposure time that explains the mean, at most."""


def find_wrong_exposure(darks: Sequence[GroupStatistics]) -> WrongExposure | None:
    """Return the dark group whose exposure time is wrong; None where none is, or the frames do not tell which."""
    places = [i for i, entry in enumerate(darks) if entry.frames > 1]
    levels = [pooled_level(darks[i].levels) for i in places]
    if any(level.low_fraction > CLIPPED_DARK_FRACTION for level in levels):
        return None
    exposure_s = np.array([darks[i].group.exposure_s for i in places])
    if len(np.unique(exposure_s)) < LEAST_EXPOSURES:
        return None
    mean, variance = (np.array([getattr(level, name) for level in levels]) for name in ("mean", "variance"))
    spatial = np.array([level.spatial_variance for level in levels])
    u2_mean = np.array([level.mean_variance + level.rounding_mean**2 for level in levels])
    u2_variance = np.array([level.variance_uncertainty**2 + level.rounding_variance**2 for level in levels])
    design = np.vander(exposure_s, 2, increasing=True)
    found: dict[float, WrongExposure] = {}
    for i, at in enumerate(design):
        others = np.arange(len(places)) != i
        if len(np.unique(exposure_s[others])) < LEAST_EXPOSURES - 1:
            continue
        line = fit_linear(design[others], mean[others], np.diag(u2_mean[others]))
        black, slope = line.parameters
        spread = np.sqrt(u2_mean[i] + line.extra_variance + at @ line.covariance @ at)
        far = abs(mean[i] - at @ line.parameters) / spread
        if far < MEAN_SIGMA or slope <= MEAN_SIGMA * np.sqrt(line.covariance[1, 1]):
            continue
        noise = fit_linear(design[others], variance[others], np.diag(u2_variance[others]))
        shown_line = np.array([1.0, (mean[i] - black) / slope])
        stated_off, shown_off = (
            abs(variance[i] - t @ noise.parameters)
            / np.sqrt(u2_variance[i] + noise.extra_variance + t @ noise.covariance @ t)
            for t in (at, shown_line)
        )
        if _saturates(exposure_s, spatial, i, float(shown_line[1])):
            continue
        if shown_line[1] > 0.0 and stated_off > NOISE_SIGMA and shown_off < NOISE_SIGMA:
            found[far] = WrongExposure(places[i], float(exposure_s[i]), float(shown_line[1]))
    return found[max(found)] if found else None
