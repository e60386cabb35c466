"""Mean colors of the patches of a chart in an image, with the covariance of their channels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photosite.color.colorimetry import adaptation_to_d65
from photosite.errors import InputError
from photosite.metrics.chart_image import LUMA, ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.plane_fit import without_plane
from photosite.metrics.tone.gray_patches import check_structure
from photosite.values.region import Patch
from photosite.values.shown import Shown

Array = NDArray[np.float64]

_BLOCKS = 6
"""Blocks along a side of a patch; their means are independent where noise reaches over a few pixels only."""
_LEAST_BLOCKS, _LEAST_PIXELS = 9, 50
_CLIPPED_FRACTION = 1e-3
_LEAST_CORRELATION = 0.7


@dataclass(frozen=True, eq=False)
class PatchColors(Shown):
    """Colors of the patches of a chart.

    Parameters
    ----------
    names, channels
        Of the patches that are not saturated, and of the channels.
    mean, covariance
        (patches, channels) means above black, and (patches, channels, channels) covariances of the means.
    reference_xyz
        (patches, 3) of the chart, adapted to D65, Y = 1 for a perfect diffuser.
    gray
        (patches,) whether a patch is gray.
    saturated
        Names of the patches that are left out.
    """

    names: tuple[str, ...]
    channels: tuple[str, ...]
    mean: Array
    covariance: Array
    reference_xyz: Array
    gray: NDArray[np.bool_]
    saturated: tuple[str, ...]

    def draws(self, count: int, seed: int) -> Array:
        """Return (count, patches, channels) means with noise drawn from the covariances."""
        scales, vectors = np.linalg.eigh(self.covariance)
        spread = vectors * np.sqrt(np.clip(scales, 0.0, None))[:, None, :]  # negative only by rounding
        normal = np.random.default_rng(seed).standard_normal((count, *self.mean.shape))
        return np.asarray(self.mean + np.einsum("pij,npj->npi", spread, normal))


def patch_colors(image: ChartImage, chart: PlacedChart) -> PatchColors:
    """Return the colors of the patches.

    Raises
    ------
    InputError
        If the image has no color, the chart has no patches, or they are too small.
    """
    channels = tuple(name for name in image.channels if name != LUMA)
    if len(channels) < 3:
        raise InputError("channels", value=", ".join(channels), expected="three or more, for colors")
    if not len(chart.patch_xyz):
        raise InputError("chart", value=chart.name, expected="one with patches")
    # A picture shows what it shows: its clipped colors are its colors.
    clipped = np.array([image.origin == "raw" and _clipped(image, patch, channels) for patch in chart.patches])
    kept = np.flatnonzero(~clipped)
    if kept.size <= len(channels):
        raise InputError("patches below saturation", value=int(kept.size), expected=f"more than {len(channels)}")
    found = [_mean(image, chart.patches[i], channels) for i in kept]
    correlated = max(1.0 + float(np.mean([correlation for *_, correlation in found])), 1.0)
    check_structure(image, chart)
    _check_order(np.array([mean for mean, *_ in found]), chart.patch_xyz[kept, 1])
    return PatchColors(
        tuple(chart.patches[i].name for i in kept),
        channels,
        np.array([mean for mean, *_ in found]),
        np.array([covariance for _, covariance, _ in found]) * correlated,
        chart.patch_xyz[kept] @ adaptation_to_d65(chart.white_xyz).T,
        chart.gray[kept],
        tuple(chart.patches[i].name for i in np.flatnonzero(clipped)),
    )


def _check_order(mean: Array, luminance: Array) -> None:
    """Raise `InputError` unless a channel has the patches in the order of their luminances."""
    from scipy.stats import rankdata

    signals = [signal for signal in mean.T if np.ptp(signal) > 1e-9 * np.abs(signal).max()]
    ranks = [np.corrcoef(rankdata(signal), rankdata(luminance))[0, 1] for signal in signals]
    if (best := max(ranks, default=0.0)) < _LEAST_CORRELATION:
        hint = "Check the chart, its corners, and that it is not turned"
        what = "rank correlation of the patches with the luminances of the chart"
        raise InputError(what, value=round(float(best), 2), expected=f"{_LEAST_CORRELATION} or more", hint=hint)


def _clipped(image: ChartImage, patch: Patch, channels: tuple[str, ...]) -> bool:
    return max(image.saturated_fraction(patch, channel) for channel in channels) > _CLIPPED_FRACTION


def _mean(image: ChartImage, patch: Patch, channels: tuple[str, ...]) -> tuple[Array, Array, float]:
    """Return the means of the channels, their covariance, and the sum of the correlations of a block with others.

    The covariance comes from the means of blocks, less a plane: interpolated colors make neighbors alike, and so, a
    little, blocks that touch.
    """
    counts, sums, centers = [], [], []
    for channel in channels:
        values = image.pixels(patch, channel).mean(axis=0)
        if values.size < _LEAST_PIXELS:
            where = f"patch '{patch.name}'"
            expected = f"{_LEAST_PIXELS} or more"
            raise InputError(f"pixels of channel {channel}", where=where, value=values.size, expected=expected)
        row, col = image.places(patch, channel)
        down = ((row - patch.r0) * (_BLOCKS / (patch.r1 - patch.r0))).astype(np.intp)
        along = ((col - patch.c0) * (_BLOCKS / (patch.c1 - patch.c0))).astype(np.intp)
        block = down * _BLOCKS + along
        counts.append(np.bincount(block, minlength=_BLOCKS**2))
        sums.append(np.bincount(block, values, minlength=_BLOCKS**2))
        centers.append([np.bincount(block, place, minlength=_BLOCKS**2) for place in (row, col)])
    used = np.min(counts, axis=0) > 0
    blocks = int(used.sum())
    if blocks < _LEAST_BLOCKS:
        raise InputError("size of a patch", where=f"patch '{patch.name}'", expected=f"{_LEAST_BLOCKS} blocks of pixels")
    means, rests = [], []
    for count, total, center in zip(counts, sums, centers, strict=True):
        pixels = count[used]
        y, x = (each[used] / pixels for each in center)
        rests.append(without_plane(total[used] / pixels, y, x, pixels) * pixels / count.sum())
        means.append(total.sum() / count.sum())
    rest = np.array(rests)
    down, along = (each[used] for each in np.indices((_BLOCKS, _BLOCKS)).reshape(2, -1))
    touching = (np.abs(down[:, None] - down) <= 1) & (np.abs(along[:, None] - along) <= 1) & ~np.eye(blocks, dtype=bool)
    plane = np.linalg.qr(np.stack([np.ones(blocks), down, along], axis=1))[0]
    variance = np.maximum((rest**2).sum(axis=1), 1e-300) / (blocks - 3)
    # Residuals of independent blocks about a plane have the covariance of the plane's, negative.
    pairs = np.einsum("ci,ij,cj->c", rest, touching, rest) / variance + float((touching * (plane @ plane.T)).sum())
    return np.array(means), rest @ rest.T * (blocks / (blocks - 3)), float(pairs.mean()) / blocks
