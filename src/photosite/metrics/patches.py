"""Statistics of patches of a raw mosaic: mean, noise and signal-to-noise ratio of each channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.frames.companding import decompanded
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names, channel_sites
from photosite.values.region import Patch
from photosite.values.shown import Shown

SATURATED_FRACTION = 1e-3
"""Fraction of saturated pixels above which a patch counts as saturated; fewer are taken as defects."""


@dataclass(frozen=True, eq=False)
class PatchStatistics(Shown):
    """Statistics of patches. Every array is (patches, channels).

    Parameters
    ----------
    names, channels, frames
        The patches; the channels, in reading order of the tile of the color filter array; the number of frames.
    pixels
        Pixels of the channel in the patch, per frame.
    mean_dn, standard_error_dn
        Mean above the black level, over pixels and frames, and its standard error as an estimate for the whole chip: it
        includes the fixed pattern, which more frames do not reduce.
    spatial_noise_dn
        Standard deviation over the pixels of one frame, root mean square over frames: temporal noise, fixed pattern and
        non-uniform illumination together.
    spatial_variance_error_dn2
        Standard error of its square, for any distribution, from the scatter over pixels of their squared deviations
        from the mean, averaged over frames. It includes the fixed pattern, which more frames do not reduce. Pixels are
        assumed to be independent.
    temporal_noise_dn
        Standard deviation of a pixel over the frames, root mean square over pixels; None for a single frame.
    saturated_fraction, mean_e
        Fraction of the pixels at or above the white level; `mean_dn` in electrons, None without a sensor.
    temporal_variance_error_dn2
        Standard error of the square of `temporal_noise_dn`, from the scatter over independent pixels; None for a single
        frame.
    """

    names: tuple[str, ...]
    channels: tuple[str, ...]
    frames: int
    pixels: NDArray[np.int64]
    mean_dn: NDArray[np.float64]
    standard_error_dn: NDArray[np.float64]
    spatial_noise_dn: NDArray[np.float64]
    spatial_variance_error_dn2: NDArray[np.float64]
    temporal_noise_dn: NDArray[np.float64] | None
    saturated_fraction: NDArray[np.float64]
    mean_e: NDArray[np.float64] | None
    temporal_variance_error_dn2: NDArray[np.float64] | None = None

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Whether more than 0.1 % of the pixels are saturated, so that mean and noise are biased low."""
        return self.saturated_fraction > SATURATED_FRACTION

    @property
    def spatial_snr_db(self) -> NDArray[np.float64]:
        """20 log10(mean / spatial noise); -inf if the mean is not above the black level, +inf without noise."""
        return _ratio_db(self.mean_dn, self.spatial_noise_dn)

    @property
    def temporal_snr_db(self) -> NDArray[np.float64] | None:
        """20 log10(mean / temporal noise), as `spatial_snr_db`; None for a single frame."""
        return None if self.temporal_noise_dn is None else _ratio_db(self.mean_dn, self.temporal_noise_dn)


def patch_statistics(
    frames: RawFrame | Sequence[RawFrame], regions: Sequence[Patch], sensor: Sensor | None = None
) -> PatchStatistics:
    """Return mean, noise and signal-to-noise ratio of every channel in every patch of a raw mosaic.

    Parameters
    ----------
    frames, regions
        One frame, or several of the same scene and setting, companded ones as linear numbers; rectangles or
        quadrilaterals anywhere in the mosaic.
    sensor
        Source of the system gain for `mean_e`.

    Raises
    ------
    InputError
        If there is no frame or region, frames differ in size, tile, bits, levels or exposure, a region is outside the
        frame, or it holds fewer than two pixels of a channel.

    Notes
    -----
    The standard error combines the standard deviation over pixels of the mean frame, divided by the square root of
    their number, with the quantization error of the mean. Noise of standard deviation s dithers the converter; the
    remaining quantization error has the variance sum_k exp(-(2 pi k s)^2) / (2 pi^2 k^2), which is 1/12 DN^2 without
    noise and below 1e-5 for s above 0.5 DN (B. Widrow and I. Kollar, "Quantization Noise", 2008, chapter 4).

    Examples
    --------
    >>> dn = np.full((8, 8), 100, np.uint16)
    >>> dn[::2] += 10
    >>> from photosite.values.region import Region
    >>> found = patch_statistics(RawFrame(dn, bits=12, black_level_dn=5), [Region("all", 0, 8, 0, 8)])
    >>> float(found.mean_dn[0, 0]), float(found.spatial_snr_db[0, 0].round(2)), int(found.pixels[0, 0])
    (100.0, 25.95, 64)
    """
    stack = (frames,) if isinstance(frames, RawFrame) else tuple(frames)
    _check_stack(stack)
    stack = tuple(map(decompanded, stack))
    _check_regions(regions, stack[0])
    first = stack[0]
    channels = channel_names(first.cfa)
    cells = [[_cell(stack, region, channel) for channel in channels] for region in regions]
    arrays: dict[str, Any] = {name: np.array([[cell[name] for cell in row] for row in cells]) for name in cells[0][0]}
    if len(stack) == 1:
        arrays |= {"temporal_noise_dn": None, "temporal_variance_error_dn2": None}
    mean_e = None if sensor is None else arrays["mean_dn"] / sensor.system_gain_dn_per_e
    return PatchStatistics(tuple(region.name for region in regions), channels, len(stack), mean_e=mean_e, **arrays)


def _check_stack(stack: tuple[RawFrame, ...]) -> None:
    if not stack:
        raise InputError("frames", value=0, expected="one or more")
    stack[0].check_mosaic()
    for what in ("shape", "cfa", "bits", "black_level_dn", "white_level_dn", "exposure_s"):
        for number, frame in enumerate(stack[1:], start=2):
            one, other = getattr(stack[0], what), getattr(frame, what)
            if one != other:
                raise InputError(what, where=f"frame {number}", value=other, expected=f"{one}, as in frame 1")


def _check_regions(regions: Sequence[Patch], frame: RawFrame) -> None:
    if not regions:
        raise InputError("regions", value=0, expected="one or more")
    rows, cols = frame.shape
    for region in regions:
        if region.r1 > rows or region.c1 > cols:
            value = (region.r0, region.r1, region.c0, region.c1)
            expected = f"within the frame of {rows} x {cols} pixels"
            raise InputError("region", where=f"patch '{region.name}'", value=value, expected=expected)


def patch_pixels(stack: tuple[RawFrame, ...], region: Patch, channel: str) -> NDArray[np.float64]:
    """Return the (frames, pixels) digital numbers of a channel in the region, black level included."""
    cfa = stack[0].cfa
    height, width = len(cfa), len(cfa[0])
    inside = region.inside()
    parts = []
    for r, c in channel_sites(cfa, channel):
        down, along = (r - region.r0) % height, (c - region.c0) % width
        which = inside[down::height, along::width]
        rows = slice(region.r0 + down, region.r1, height)
        cols = slice(region.c0 + along, region.c1, width)
        parts.append(np.stack([frame.dn[rows, cols][which] for frame in stack]))
    return np.concatenate(parts, axis=1).astype(np.float64)


def _cell(stack: tuple[RawFrame, ...], region: Patch, channel: str) -> dict[str, float]:
    """Return the statistics of one patch and channel, by their names in `PatchStatistics`."""
    dn = patch_pixels(stack, region, channel)
    count = dn.shape[1]
    if count < 2:
        where = f"patch '{region.name}'"
        raise InputError(f"pixels of channel {channel}", where=where, value=count, expected="two or more")
    spatial_variance = float(dn.var(axis=1, ddof=1).mean())
    temporal_variance = dn.var(axis=0, ddof=1) if len(stack) > 1 else np.zeros(count)
    error_variance = float(dn.mean(axis=0).var(ddof=1)) / count + _rounding_variance(spatial_variance)
    return {
        "pixels": count,
        "mean_dn": float(dn.mean()) - stack[0].black_level_dn,
        "standard_error_dn": error_variance**0.5,
        "spatial_noise_dn": spatial_variance**0.5,
        "spatial_variance_error_dn2": _error_of_variance(dn),
        "temporal_noise_dn": float(temporal_variance.mean()) ** 0.5,
        "temporal_variance_error_dn2": float(temporal_variance.std(ddof=1)) / count**0.5,
        "saturated_fraction": float((dn >= stack[0].white_level_dn).mean()),
    }


def _error_of_variance(dn: NDArray[np.float64]) -> float:
    """Return the standard error of the mean over frames of the variance over pixels; `dn` is (frames, pixels).

    With q_i the mean over frames of pixel i's squared distance from its frame's mean, and C_fg the covariance over
    pixels of frames f and g, the mean of F unbiased variances over n pixels has the variance

        (var(q) + 2 / (n - 1) sum_fg C_fg^2 / F^2) / n,

    since two sample variances have the covariance kappa_ffgg / n + 2 C_fg^2 / (n - 1) (P. McCullagh, "Tensor Methods
    in Statistics", 1987, chapter 4). For one frame this is (m4 - m2^2 (n - 3) / (n - 1)) / n (A. Stuart and J. K. Ord,
    "Kendall's Advanced Theory", vol. 1).
    """
    frames, count = dn.shape
    deviation = dn - dn.mean(axis=1, keepdims=True)
    pixel_variance = float((deviation**2).mean(axis=0).var())
    shared = float(((deviation @ deviation.T / count) ** 2).sum()) / frames**2
    return float(((pixel_variance + 2.0 * shared / (count - 1)) / count) ** 0.5)


def _rounding_variance(variance_dn2: float) -> float:
    """Return the variance of the quantization error of a mean, given the variance of the rounded values."""
    # Sheppard's correction: rounding added 1/12. A smaller total means that all pixels are within one step.
    before_rounding = max(variance_dn2 - 1.0 / 12.0, 0.0)
    if before_rounding == 0.0:
        return 1.0 / 12.0
    k = np.arange(1, 101)
    return float(np.sum(np.exp(-((2 * np.pi * k) ** 2) * before_rounding) / (2 * np.pi**2 * k**2)))


def _ratio_db(mean: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    result = np.full(mean.shape, -np.inf)
    lit = mean > 0
    with np.errstate(divide="ignore"):
        result[lit] = 20.0 * np.log10(mean[lit] / noise[lit])
    return result
