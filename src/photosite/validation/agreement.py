"""Agreement of two cameras: whether patches differ by more than their noise, and noise that the frames share."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError, PhotositeWarning
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.patches import PatchStatistics, patch_pixels
from photosite.values.cfa import channel_names
from photosite.values.region import Patch
from photosite.values.shown import Shown

BY_CHANCE = 3.29
"""Correlation of the pixels, in standard deviations, beyond which it is not by chance: 1 of 2000 pairs of chips."""


@dataclass(frozen=True, eq=False)
class SharedNoise(Shown):
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


def dependence(
    measured: Sequence[RawFrame], simulated: Sequence[RawFrame], patches: Sequence[Patch]
) -> tuple[SharedNoise | None, list[str]]:
    """Return the covariances that the tests take into account, and notes of frames that are not independent.

    A fixed pattern is shared by frames of one chip, and the covariances account for it. Frames that are the same, or
    have the same random numbers, are tested as independent ones: the noise that they share would otherwise make
    differences significant that no frames of two cameras show. They get a note and a warning.
    """
    if notes := _repeats(measured, simulated):
        for note in notes:
            warnings.warn(PhotositeWarning(note), stacklevel=3)
        return None, notes
    return shared_noise(measured, simulated, patches), []


def _repeats(measured: Sequence[RawFrame], simulated: Sequence[RawFrame]) -> list[str]:
    """Return a note where a simulated frame is a measured one, or has its seed and number.

    Frames with one value everywhere (all black or all white) are not compared.
    """
    if _digests(measured) & _digests(simulated):
        return [
            "measured and simulated frames are the same in every pixel, so that their agreement shows nothing; compare "
            "measured frames with simulated ones"
        ]
    if common := _draws(measured) & _draws(simulated):
        seed, frame = min(common)
        return [
            f"measured and simulated frames share the random numbers of seed {seed} (frame {frame}), so that they "
            "differ by less than independent frames, as which they are tested; simulate with another seed"
        ]
    return []


def _digests(frames: Sequence[RawFrame]) -> set[bytes]:
    uneven = (frame.dn for frame in frames if frame.dn.min() < frame.dn.max())
    return {sha256(np.ascontiguousarray(dn).data).digest() for dn in uneven}


def _draws(frames: Sequence[RawFrame]) -> set[tuple[str, str]]:
    """Return the seeds and frame numbers that the metadata of simulated frames state."""
    known = (frame.metadata for frame in frames if "seed" in frame.metadata and "frame" in frame.metadata)
    return {(str(metadata["seed"]), str(metadata["frame"])) for metadata in known}


Selection = NDArray[np.bool_]
RelativeDifference = np.ma.MaskedArray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True)
class ChiSquare(Shown):
    """A sum of squared standardized differences.

    The degrees of freedom, the number of differences less that of fitted parameters, are the expected sum for two equal
    cameras; the p-value is the probability of a sum this large or larger.
    """

    statistic: float
    degrees_of_freedom: int
    p_value: float

    @property
    def p_text(self) -> str:
        """The p-value as text, to two digits.

        Examples
        --------
        >>> ChiSquare(80.0, 72, 0.2431).p_text, ChiSquare(9e4, 72, 0.0).p_text
        ('p = 0.24', 'p < 1e-12')
        """
        return f"p = {self.p_value:.2g}" if self.p_value >= 1e-12 else "p < 1e-12"


def chi_square_of_means(
    measured: PatchStatistics,
    simulated: PatchStatistics,
    used: Selection,
    tolerance: float = 0.0,
    fitted: int = 0,
    shared: SharedNoise | None = None,
) -> ChiSquare:
    """Test whether patch means differ by more than their standard errors.

    A difference divided by the estimated standard errors of both means follows Student's t with Welch's degrees of
    freedom nu; with known covariances, that of pairs of pixels with nu = pixels - 1. Its square is multiplied by
    (nu - 2) / nu, so that its mean is 1 as for chi-square.

    Parameters
    ----------
    measured, simulated
        Statistics of the same patches.
    used
        (patches, channels), true where a value is compared.
    tolerance
        Relative tolerance; only the excess over it counts.
    fitted
        Number of parameters of the simulation that were fitted to these means; each takes a degree of freedom.
    shared
        Covariances of measured and simulated patches; None for two chips.

    Raises
    ------
    InputError
        If a patch has so few pixels that nu is 2 or less.

    Notes
    -----
    B. L. Welch, Biometrika 34, 1947.
    """
    error_m, error_s = measured.standard_error_dn[used] ** 2, simulated.standard_error_dn[used] ** 2
    pixels_m, pixels_s = measured.pixels[used], simulated.pixels[used]
    error = error_m + error_s
    freedom = error**2 / (error_m**2 / (pixels_m - 1) + error_s**2 / (pixels_s - 1))
    if shared is not None:
        freedom = np.asarray(pixels_m - 1.0, np.float64)
        error = np.maximum(error - 2.0 * shared.mean_dn2[used], 0.0)
    if (freedom <= 2).any():
        raise InputError("patches hold too few pixels to compare", hint="Widen the regions to 4 pixels of each channel")
    difference = np.abs(measured.mean_dn[used] - simulated.mean_dn[used])
    beyond = np.maximum(difference - tolerance * np.abs(simulated.mean_dn[used]), 0.0)
    return chi_square(_squares(beyond, np.sqrt(error)) * (freedom - 2) / freedom, fitted)


def chi_square_of_noise(
    measured: PatchStatistics,
    simulated: PatchStatistics,
    used: Selection,
    tolerance: float = 0.0,
    shared: SharedNoise | None = None,
) -> ChiSquare:
    """Test whether the variances over the pixels of a frame differ by more than their standard errors.

    Parameters and errors are those of `chi_square_of_means`, with the relative tolerance of standard deviations.

    Notes
    -----
    The standard errors come from the scatter over pixels. Neither a distribution nor a fraction of fixed pattern is
    assumed. A patch without noise in both frames counts as equal.
    """
    covariance = None if shared is None else shared.spatial_variance_dn4
    return _chi_square_of_variances(spatial_noise(measured), spatial_noise(simulated), used, tolerance, covariance)


def chi_square_of_temporal_noise(
    measured: PatchStatistics,
    simulated: PatchStatistics,
    used: Selection,
    tolerance: float = 0.0,
    shared: SharedNoise | None = None,
) -> ChiSquare | None:
    """Test the noise from frame to frame, as `chi_square_of_noise`; None unless both have at least two frames.

    This noise does not contain unevenness of the light. The standard errors come from the scatter of the pixels'
    variances; no distribution is assumed.
    """
    seen, made = temporal_noise(measured), temporal_noise(simulated)
    covariance = None if shared is None else shared.temporal_variance_dn4
    return None if seen is None or made is None else _chi_square_of_variances(seen, made, used, tolerance, covariance)


NoiseWithError = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Standard deviations and the standard errors of their squares, (patches, channels)."""


def spatial_noise(found: PatchStatistics) -> NoiseWithError:
    """Return the noise over pixels."""
    return found.spatial_noise_dn, found.spatial_variance_error_dn2


def temporal_noise(found: PatchStatistics) -> NoiseWithError | None:
    """Return the noise from frame to frame; None for a single frame."""
    if found.temporal_noise_dn is None or found.temporal_variance_error_dn2 is None:
        return None
    return found.temporal_noise_dn, found.temporal_variance_error_dn2


def _chi_square_of_variances(
    measured: NoiseWithError,
    simulated: NoiseWithError,
    used: Selection,
    tolerance: float,
    covariance: NDArray[np.float64] | None,
) -> ChiSquare:
    (noise_m, error_m), (noise_s, error_s) = ([values[used] for values in side] for side in (measured, simulated))
    both = 0.0 if covariance is None else 2.0 * covariance[used]
    error = np.sqrt(np.maximum(error_m**2 + error_s**2 - both, 0.0))
    allowed = ((1.0 + tolerance) ** 2 - 1.0) * noise_s**2
    beyond = np.maximum(np.abs(noise_m**2 - noise_s**2) - allowed, 0.0)
    return chi_square(_squares(beyond, error))


def _squares(beyond: NDArray[np.float64], error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squares of differences over their errors, 0 where both are 0."""
    if ((error == 0) & (beyond > 0)).any():
        raise InputError("patches hold too few pixels to compare", hint="Widen the regions")
    ratio = np.zeros_like(beyond)
    np.divide(beyond, error, out=ratio, where=error > 0)
    return np.asarray(ratio**2)


def compared(saturated: Selection, names: Sequence[str], channels: Sequence[str], notes: list[str]) -> Selection:
    """Return which patches and channels are not saturated; `notes` gets the others. `InputError` if all are."""
    if saturated.all():
        raise InputError("every patch is saturated", hint="Use a shorter exposure time")
    lost = [
        f"{name} ({', '.join(channel for channel, full in zip(channels, row, strict=True) if full)})"
        for name, row in zip(names, saturated, strict=True)
        if row.any()
    ]
    if lost:
        notes.append(f"left out as saturated: {'; '.join(lost)}")
    return ~saturated


def largest(difference: RelativeDifference, used: Selection) -> tuple[int, int] | None:
    """Return the patch and channel of the largest used difference; None where all are masked."""
    size = np.ma.abs(np.ma.array(difference, mask=~used | np.ma.getmaskarray(difference)))
    if not size.count():
        return None
    patch, channel = np.unravel_index(int(size.argmax()), size.shape)
    return int(patch), int(channel)


def relative_difference(measured: NDArray[np.float64], simulated: NDArray[np.float64]) -> RelativeDifference:
    """Return (measured - simulated) / simulated, masked where simulated is not above 0."""
    base = np.ma.masked_less_equal(simulated, 0.0)
    return (measured - base) / base


def dict_or_none(value: Any) -> dict[str, Any] | None:
    """Return the fields of a dataclass by name, for JSON."""
    return None if value is None else asdict(value)


def check_verdict_settings(level: float, tolerance_percent: float) -> None:
    """Raise `InputError` for an invalid false-alarm rate or tolerance."""
    if not 0 < level < 1:
        raise InputError("level", value=level, expected="a false-alarm rate between 0 and 1")
    if not (np.isfinite(tolerance_percent) and tolerance_percent >= 0):
        raise InputError("tolerance_percent", value=tolerance_percent, expected="0 or more")


def chi_square(squares: NDArray[np.float64], fitted: int = 0) -> ChiSquare:
    """Return the sum of squared standardized differences, less the number of fitted parameters in freedom."""
    from scipy.stats import chi2

    total, freedom = float(squares.sum()), int(squares.size) - fitted
    if freedom < 1:
        raise InputError(
            "patches", value=squares.size, expected=f"more patch means than the {fitted} fitted parameters"
        )
    return ChiSquare(total, freedom, float(chi2.sf(total, freedom)))
