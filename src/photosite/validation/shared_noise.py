"""Noise and fixed pattern that measured and simulated frames share, and frames that are no independent test."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from photosite.errors import PhotositeWarning
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import patch_pixels
from photosite.values.cfa import channel_names
from photosite.values.region import Patch

BY_CHANCE = 3.29
"""Correlation of the pixels, in standard deviations, beyond which it is not by chance: 1 of 2000 pairs of chips."""


@dataclass(frozen=True, eq=False)
class SharedNoise:
    """Covariances between the statistics of measured and simulated patches, (patches, channels) each.

    Frames of one chip share its fixed pattern, and frames of one seed their noise.

    Parameters
    ----------
    mean_dn2
        Covariance of the means.
    spatial_variance_dn4, temporal_variance_dn4
        Covariance of the variances over pixels, and from frame to frame; the latter None unless both are stacks.
    """

    mean_dn2: NDArray[np.float64]
    spatial_variance_dn4: NDArray[np.float64]
    temporal_variance_dn4: NDArray[np.float64] | None


def shared_noise(
    measured: Sequence[RawFrame], simulated: Sequence[RawFrame], patches: Sequence[Patch]
) -> SharedNoise | None:
    """Return the covariances of the same pixels in measured and simulated frames of one size and CFA.

    None where all patches together show no correlation beyond chance, as with two chips.
    """
    channels = channel_names(measured[0].cfa)
    found = [[_covariances(measured, simulated, patch, channel) for channel in channels] for patch in patches]
    mean, spatial, temporal, correlation, pixels = np.moveaxis(np.array(found), 2, 0)
    if float((pixels * correlation).sum()) < BY_CHANCE * math.sqrt(float(pixels.sum())):
        return None
    return SharedNoise(mean, spatial, temporal if min(len(measured), len(simulated)) > 1 else None)


def _covariances(
    measured: Sequence[RawFrame], simulated: Sequence[RawFrame], patch: Patch, channel: str
) -> tuple[float, float, float, float, int]:
    """Return the three covariances of a patch and channel, the correlation of its pixels, and their number.

    `metrics.patches` has the equations of the variances.
    """
    one, other = (patch_pixels(tuple(frames), patch, channel) for frames in (measured, simulated))
    count = one.shape[1]
    seen, made = one.mean(axis=0), other.mean(axis=0)
    mean = _covariance(seen, made)
    spread = math.sqrt(_covariance(seen, seen) * _covariance(made, made))
    correlation = mean / spread if spread > 0.0 else 0.0
    a, b = (dn - dn.mean(axis=1, keepdims=True) for dn in (one, other))
    squares = float(np.mean((a**2).mean(axis=0) * (b**2).mean(axis=0)) - (a**2).mean() * (b**2).mean())
    shared = float(((a @ b.T / count) ** 2).mean())
    spatial = (squares + 2.0 * shared / (count - 1)) / count
    temporal = 0.0
    if min(len(one), len(other)) > 1:
        temporal = _covariance(one.var(axis=0, ddof=1), other.var(axis=0, ddof=1)) / count
    return mean / count, spatial, temporal, correlation, count


def _covariance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float((a - a.mean()) @ (b - b.mean()) / (a.size - 1))


def warn_of_dependence(measured: Sequence[RawFrame], simulated: Sequence[RawFrame]) -> list[str]:
    """Warn where a simulated frame is a measured one, or has its seed and number; return the warnings as notes.

    Frames with one value everywhere (all black or all white) are not compared.
    """
    notes = []
    if _digests(measured) & _digests(simulated):
        notes.append(
            "measured and simulated frames are the same in every pixel, so that their agreement shows nothing; compare "
            "measured frames with simulated ones"
        )
    elif common := _draws(measured) & _draws(simulated):
        seed, frame = min(common)
        notes.append(
            f"measured and simulated frames share the random numbers of seed {seed} (frame {frame}), so that they "
            "differ by less than independent frames; simulate with another seed"
        )
    for note in notes:
        warnings.warn(PhotositeWarning(note), stacklevel=3)
    return notes


def _digests(frames: Sequence[RawFrame]) -> set[bytes]:
    uneven = (frame.dn for frame in frames if frame.dn.min() < frame.dn.max())
    return {sha256(np.ascontiguousarray(dn).data).digest() for dn in uneven}


def _draws(frames: Sequence[RawFrame]) -> set[tuple[str, str]]:
    """Return the seeds and frame numbers that the metadata of simulated frames state."""
    known = (frame.metadata for frame in frames if "seed" in frame.metadata and "frame" in frame.metadata)
    return {(str(metadata["seed"]), str(metadata["frame"])) for metadata in known}
