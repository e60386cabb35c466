"""Dark noise of the flat fields against that of the dark frames: frames that were averaged or subtracted show in it.

The temporal variance of flat fields, extrapolated to no signal, is that of dark frames. It is N times as large where
each dark frame is the mean of N, 1/N where each flat field is, and twice as large where a dark frame was subtracted
from each flat field in the camera. Photon transfer then subtracts a wrong dark variance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from photosite.calibration.photon_transfer.channel import Channel
from photosite.values.diagnostic import DiagnosticKind, one_in

RATIO_P_VALUE = 1e-4
"""Fraction of channels of ordinary frames that may be reported (Student's t)."""

LEAST_DIFFERENCE = 0.3
"""Difference of the ratio from 1 that matters: averaged and subtracted frames have 0.5 or 2 at least."""

LEAST_LEVELS, LEAST_RANGE = 5, 3.0
"""Light levels that the extrapolation needs, and the factor in signal between them."""


@dataclass(frozen=True)
class DarkNoiseRatio:
    """Temporal variance of the flat fields at no signal over that of the dark frames, with its standard uncertainty."""

    ratio: float
    uncertainty: float
    freedom: float = math.inf

    @property
    def beyond_chance(self) -> bool:
        """Whether the ratio differs from 1 beyond chance, and by enough to matter."""
        limit = float(stdtrit(min(self.freedom, 1e6), 1.0 - RATIO_P_VALUE / 2.0)) * self.uncertainty
        return abs(self.ratio - 1.0) > max(LEAST_DIFFERENCE, limit)

    def __str__(self) -> str:
        cause = "a dark frame was subtracted from each flat field in the camera, or each dark frame is the mean of two"
        if self.ratio < 1.0:
            cause = f"each flat field is the mean of about {1.0 / max(self.ratio, 0.01):.2g} frames, or was denoised"
        elif self.ratio - 3.0 * self.uncertainty > 2.0:
            cause = f"each dark frame is the mean of about {self.ratio:.2g} frames, or was denoised"
        return (
            f"the temporal variance of flat fields at no signal is {self.ratio:.3g} ± {self.uncertainty:.2g} times "
            f"that of the dark frames, as if {cause}; photon transfer needs flat fields and dark "
            f"frames of the same mode"
        )


PROCESSED_FRAMES = DiagnosticKind(
    "different-modes",
    "warning",
    "The temporal variance of the flat fields at no signal is not that of the dark frames.",
    "Dark frames or flat fields were averaged, denoised, or had a dark frame subtracted: the system gain and what "
    "follows from it are withheld.",
    "Take flat fields and dark frames in one mode, without averages, noise reduction or dark frame subtraction.",
    ("system_gain_dn_per_e", "*_e", "*_e_per_s", "quantum_efficiency_*"),
    "variance of the flat fields at no signal over that of the dark frames",
    f"below {one_in(RATIO_P_VALUE)} channels",
)


def find_dark_noise_ratio(channels: Sequence[Channel]) -> DarkNoiseRatio | None:
    """Return the ratio of the channel where it differs most from 1, None where no channel differs beyond chance."""
    found = [entry for channel in channels if (entry := _ratio(channel)) is not None and entry.beyond_chance]
    return max(found, key=lambda entry: abs(entry.ratio - 1.0) / entry.uncertainty, default=None)


def _ratio(channel: Channel) -> DarkNoiseRatio | None:
    levels = channel.levels
    take = channel.used & levels.repeated & (levels.signal > 0.0)
    # Without the bend of the response, where that is known.
    straight = channel.straightening()
    y, v = levels.signal[take], (straight * levels.shot)[take]
    if len(np.unique(y)) < LEAST_LEVELS or y.max() < LEAST_RANGE * y.min():
        return None
    slope = float(np.median(v / y))
    covariance = np.outer(straight, straight) * levels.shot_covariance + slope**2 * levels.signal_covariance
    unit = y / y.max()
    # The square takes up what is left of a bend.
    powers = range(2 if channel.curve is None or channel.curve.shape is None else 3)
    root = np.linalg.cholesky(covariance[np.ix_(take, take)])
    design = np.linalg.solve(root, np.column_stack([unit**power for power in powers]))
    scaled = np.linalg.solve(root, v)
    normal = np.linalg.inv(design.T @ design)
    fitted = normal @ design.T @ scaled
    freedom = len(y) - len(powers)
    # Birge's ratio: a misfit widens all uncertainties alike, which keeps the weight of the dim levels.
    birge = max(float(np.sum((scaled - design @ fitted) ** 2)) / freedom, 1.0)
    dark = float(np.median((levels.noise - levels.shot)[take]))
    if dark <= 0.0:
        return None
    uncertainty = math.sqrt(birge * float(normal[0, 0])) / dark
    return DarkNoiseRatio(1.0 + float(fitted[0]) / dark, uncertainty, freedom if birge > 1.0 else math.inf)
