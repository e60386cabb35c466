"""Patches of a raw mosaic: mean, noise and signal-to-noise ratio of each channel, before any processing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.errors import InputError
from photosite.frames.raw_frame import RawFrame
from photosite.sensor.model import Sensor
from photosite.values.cfa import channel_names, channel_sites
from photosite.values.region import Patch

SATURATED_SHARE = 1e-3
"""A patch is saturated where more than this share of a channel's pixels is: fewer are defects, not light."""


@dataclass(frozen=True, eq=False)
class PatchStatistics:
    """What the patches read. Every array is (patches, channels).

    Parameters
    ----------
    names
        The patches.
    channels
        The channels, in reading order of the colour filter array's tile.
    frames
        How many frames went in.
    pixels
        Pixels of the channel in the patch, per frame.
    mean_dn
        Mean above the black level, over pixels and frames.
    standard_error_dn
        Standard error of `mean_dn` as a statement about the whole chip: the fixed pattern counts, so more
        frames bring it down only to what the pattern leaves.
    spatial_noise_dn
        Standard deviation over the pixels of one frame, root mean square over frames: temporal noise and
        fixed pattern together, and any unevenness of the light.
    spatial_variance_error_dn2
        Standard error of its square, for any distribution: from the scatter over pixels of their squared distances
        from the mean, averaged over frames. More frames bring it down only to what the fixed pattern, which they
        share, leaves. Pixels are taken as independent.
    temporal_noise_dn
        Standard deviation of a pixel over the frames, root mean square over pixels; None for a single frame.
    saturated_share
        Share of the pixels at or above the white level.
    mean_e
        `mean_dn` in electrons; None without a sensor.
    temporal_variance_error_dn2
        Standard error of the square of `temporal_noise_dn`, from the scatter over pixels, which are independent; None
        for a single frame.
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
    saturated_share: NDArray[np.float64]
    mean_e: NDArray[np.float64] | None
    temporal_variance_error_dn2: NDArray[np.float64] | None = None

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Whether more than 0.1 % of the pixels are saturated, so that mean and noise fall short."""
        return self.saturated_share > SATURATED_SHARE

    @property
    def spatial_snr_db(self) -> NDArray[np.float64]:
        """20 log10(mean / spatial noise); -inf where the mean is not above black, else +inf without noise."""
        return _ratio_db(self.mean_dn, self.spatial_noise_dn)

    @property
    def temporal_snr_db(self) -> NDArray[np.float64] | None:
        """20 log10(mean / temporal noise), as `spatial_snr_db`; None for a single frame."""
        return None if self.temporal_noise_dn is None else _ratio_db(self.mean_dn, self.temporal_noise_dn)


def patch_statistics(
    frames: RawFrame | Sequence[RawFrame], regions: Sequence[Patch], sensor: Sensor | None = None
) -> PatchStatistics:
    """Mean, noise and signal-to-noise ratio of every channel in every patch, on the raw mosaic.

    Parameters
    ----------
    frames
        One frame, or several of the same scene and setting.
    regions
        The patches. Which channel a pixel has follows from its place in the whole mosaic, so any rectangle or
        quadrilateral will do.
    sensor
        Gives the system gain for `mean_e`.

    Returns
    -------
    PatchStatistics

    Raises
    ------
    InputError
        If there is no frame or region, frames differ in size, tile, bits, levels or exposure, a region lies
        outside the frame, or it holds fewer than two pixels of a channel.

    Notes
    -----
    The standard error is the standard deviation over pixels of the mean frame, divided by the square root of
    their number, and what rounding to whole numbers leaves: noise of standard deviation s smears the steps of
    the converter, and the mean's remaining rounding error, over all places between two steps, has the
    variance sum_k exp(-(2 pi k s)^2) / (2 pi^2 k^2), which is 1/12 DN^2 without noise and below 1e-5 from s =
    0.5 DN on (B. Widrow and I. Kollar, "Quantization Noise", 2008, chapter 4).

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
    _check_regions(regions, stack[0])
    first = stack[0]
    channels = channel_names(first.cfa)
    cells = np.array([[_cell(stack, region, channel) for channel in channels] for region in regions])
    pixels, mean, error, spatial, variance_error, temporal, temporal_error, saturated = np.moveaxis(cells, -1, 0)
    return PatchStatistics(
        names=tuple(region.name for region in regions),
        channels=channels,
        frames=len(stack),
        pixels=pixels.astype(np.int64),
        mean_dn=mean,
        standard_error_dn=error,
        spatial_noise_dn=spatial,
        spatial_variance_error_dn2=variance_error,
        temporal_noise_dn=temporal if len(stack) > 1 else None,
        saturated_share=saturated,
        mean_e=None if sensor is None else mean / sensor.system_gain_dn_per_e,
        temporal_variance_error_dn2=temporal_error if len(stack) > 1 else None,
    )


def _check_stack(stack: tuple[RawFrame, ...]) -> None:
    if not stack:
        raise InputError("patch statistics need a frame or more, not an empty sequence")
    for what in ("shape", "cfa", "bits", "black_level_dn", "white_level_dn", "exposure_s"):
        for number, frame in enumerate(stack[1:], start=2):
            one, other = getattr(stack[0], what), getattr(frame, what)
            if one != other:
                raise InputError(f"frames of one stack must agree in {what}: frame 1 has {one}, frame {number} {other}")


def _check_regions(regions: Sequence[Patch], frame: RawFrame) -> None:
    if not regions:
        raise InputError("patch statistics need a region or more, not an empty sequence")
    rows, cols = frame.shape
    for region in regions:
        if region.r1 > rows or region.c1 > cols:
            raise InputError(
                f"patch '{region.name}', rows {region.r0} to {region.r1} and columns {region.c0} to "
                f"{region.c1}, reaches beyond the frame of {rows} x {cols} pixels"
            )


def _pixels_of(stack: tuple[RawFrame, ...], region: Patch, channel: str) -> NDArray[np.float64]:
    """(frames, pixels): the channel's digital numbers in the region, black level included."""
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


def _cell(stack: tuple[RawFrame, ...], region: Patch, channel: str) -> tuple[float, ...]:
    """One patch and channel: the columns that `patch_statistics` takes apart."""
    dn = _pixels_of(stack, region, channel)
    count = dn.shape[1]
    if count < 2:
        raise InputError(
            f"patch '{region.name}' holds {count} pixels of channel {channel}; noise needs two or more: "
            "widen the region"
        )
    spatial_variance = float(dn.var(axis=1, ddof=1).mean())
    temporal_variance = dn.var(axis=0, ddof=1) if len(stack) > 1 else np.zeros(count)
    error_variance = float(dn.mean(axis=0).var(ddof=1)) / count + _rounding_variance(spatial_variance)
    return (
        count,
        float(dn.mean()) - stack[0].black_level_dn,
        error_variance**0.5,
        spatial_variance**0.5,
        _error_of_variance(dn),
        float(temporal_variance.mean()) ** 0.5,
        float(temporal_variance.std(ddof=1)) / count**0.5,
        float((dn >= stack[0].white_level_dn).mean()),
    )


def _error_of_variance(dn: NDArray[np.float64]) -> float:
    """Standard error of the mean over frames of the variance over pixels; (frames, pixels).

    With q_i the mean over frames of pixel i's squared distance from its frame's mean, and C_fg the covariance over
    pixels of frames f and g, the mean of F unbiased variances over n pixels has the variance

        (var(q) + 2 / (n - 1) sum_fg C_fg^2 / F^2) / n,

    since two sample variances have the covariance kappa_ffgg / n + 2 C_fg^2 / (n - 1) (P. McCullagh, "Tensor Methods
    in Statistics", 1987, chapter 4). For one frame this is (m4 - m2^2 (n - 3) / (n - 1)) / n (A. Stuart and J. K. Ord,
    "Kendall's Advanced Theory", vol. 1).
    """
    frames, count = dn.shape
    away = dn - dn.mean(axis=1, keepdims=True)
    of_pixels = float((away**2).mean(axis=0).var())
    shared = float(((away @ away.T / count) ** 2).sum()) / frames**2
    return float(((of_pixels + 2.0 * shared / (count - 1)) / count) ** 0.5)


def _rounding_variance(variance_dn2: float) -> float:
    """Variance of what rounding shifts a mean by, given the variance of the rounded numbers."""
    # Sheppard: rounding added 1/12. Less than that in all means that the pixels agreed within a step.
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
