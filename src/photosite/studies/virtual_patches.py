"""Gray patches of a ColorChecker with known light, by plain NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.develop.demosaic import demosaic
from photosite.frames.raw_frame import RawFrame
from photosite.metrics.chart_image import chart_image
from photosite.metrics.charts.placed_chart import PlacedChart, placed_chart
from photosite.studies.virtual_charts import RGGB, VirtualNoise
from photosite.values.cfa import MONOCHROME
from photosite.values.region import Patch

Array = NDArray[np.float64]

LUMINANCE_CD_M2 = 100.0
"""Mean luminance of the chart."""


@cache
def color_checker(rows: int = 264, cols: int = 392) -> PlacedChart:
    """Return a ColorChecker that fills a frame."""
    return placed_chart(chart_image(np.ones((rows, cols))), "macbeth", luminance_cd_m2=LUMINANCE_CD_M2)


def relative_luminances(chart: PlacedChart | None = None) -> dict[Patch, float]:
    """Return the luminance of each patch over that of the brightest one."""
    placed = chart or color_checker()
    light = placed.patch_xyz[:, 1]
    return dict(zip(placed.patches, (light / light.max()).tolist(), strict=True))


def patches_in_light(brightest: float, exponent: float = 1.0, ground: float = 0.01, margin: int = 0) -> Array:
    """Return the frame of a ColorChecker whose signal is a power of the luminance, on a dark ground.

    `margin` is the number of pixels by which patches are larger than what is measured of them.
    """
    image: Array = np.full(color_checker().shape, ground * brightest)
    for patch, luminance in relative_luminances().items():
        rows, cols = (slice(a - margin, b + margin) for a, b in ((patch.r0, patch.r1), (patch.c0, patch.c1)))
        image[rows, cols] = brightest * luminance**exponent
    return image


def in_light(shape: tuple[int, int], down: float, across: float) -> Array:
    """Return light that changes over a frame by fractions of that in its middle."""
    row, col = (np.linspace(-0.5, 0.5, size) for size in shape)
    return np.asarray(1.0 + down * row[:, None] + across * col)


WHITE_DN = 4095
_MARGIN = 4
CHANNEL_LEVELS = {"M": 1.0, "R": 0.5, "G": 1.0, "B": 0.6}
"""Signals of the channels under the light of the chart, over the brightest one."""


def raw_patches(
    noise: VirtualNoise,
    random: np.random.Generator,
    count: int,
    *,
    mosaic: bool = False,
    exponent: float = 1.0,
    light: tuple[float, float] = (0.0, 0.0),
) -> tuple[list[RawFrame], str]:
    """Return raw frames of a ColorChecker that a sensor takes, and their channels.

    Parameters
    ----------
    noise, random, count
        The sensor, the source of random numbers, and the number of frames.
    mosaic
        RGGB, otherwise monochrome.
    exponent
        Of the signal over the luminance.
    light
        Change over the frame, down and across, over that in the middle.
    """
    brightest = 0.85 * (WHITE_DN - noise.black) / noise.gain
    mean = patches_in_light(brightest, exponent, margin=_MARGIN) * in_light(color_checker().shape, *light)
    if mosaic:
        for r, c in np.ndindex(2, 2):
            mean[r::2, c::2] *= CHANNEL_LEVELS[RGGB[r][c]]
    cfa = RGGB if mosaic else MONOCHROME
    made = noise.frames(random, mean, count, WHITE_DN)
    return [RawFrame(dn, 12, cfa, black_level_dn=noise.black) for dn in made], "RGB" if mosaic else "M"


def developed(frames: list[RawFrame]) -> list[Array]:
    """Return linear pictures of mosaics by bilinear interpolation, the default of `photosite.develop`, white-balanced.

    White is 1, as for the brightest channel.
    """
    levels = [CHANNEL_LEVELS[name] for name in "RGB"]
    scales = [(WHITE_DN - frame.black_level_dn) * np.array(levels) for frame in frames]
    return [
        demosaic(frame.dn - frame.black_level_dn, RGGB) / scale for frame, scale in zip(frames, scales, strict=True)
    ]


BILINEAR_VARIANCE = {"R": 9 / 16, "G": 5 / 8, "B": 9 / 16}
"""Mean over pixels of the variance of bilinear interpolation, over that of the mosaic: pixels are kept, or are means of
two or four."""


def picture_budgets(mosaic: Mapping[str, Array]) -> dict[str, Array]:
    """Return the variances of `developed` pictures and of their luma, from those of the channels of the mosaic.

    A budget is (floor, slope, pattern): the variance without signal, and its parts over the signal and its square.
    """
    found = {}
    for channel, part in BILINEAR_VARIANCE.items():
        level, budget = CHANNEL_LEVELS[channel], mosaic[channel]
        found[channel] = part * budget / np.array([level**2, level, 1.0])
    found["Y"] = np.sum([weight**2 * found[name] for name, weight in zip("RGB", LUMA_WEIGHTS, strict=True)], axis=0)
    return found


LUMA_WEIGHTS = 0.2126, 0.7152, 0.0722
"""Of red, green and blue (IEC 61966-2-1)."""
