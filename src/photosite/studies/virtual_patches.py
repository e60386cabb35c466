"""Gray patches of a ColorChecker with known light, by plain NumPy."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

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


def patches_in_light(brightest: float, exponent: float = 1.0, ground: float = 0.01) -> Array:
    """Return the frame of a ColorChecker whose signal is a power of the luminance, on a dark ground."""
    image: Array = np.full(color_checker().shape, ground * brightest)
    for patch, luminance in relative_luminances().items():
        image[patch.r0 : patch.r1, patch.c0 : patch.c1] = brightest * luminance**exponent
    return image


WHITE_DN = 4095
CHANNEL_LEVELS = {"M": 1.0, "R": 0.5, "G": 1.0, "B": 0.6}
"""Signals of the channels under the light of the chart, over the brightest one."""


def raw_patches(
    noise: VirtualNoise,
    random: np.random.Generator,
    count: int,
    *,
    mosaic: bool = False,
    exponent: float = 1.0,
    light: float = 1.0,
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
        At the bottom of the frame over that at the top.
    """
    brightest = 0.85 * (WHITE_DN - noise.black) / noise.gain
    mean = patches_in_light(brightest, exponent) * np.linspace(1.0, light, color_checker().shape[0])[:, None]
    if mosaic:
        for r, c in np.ndindex(2, 2):
            mean[r::2, c::2] *= CHANNEL_LEVELS[RGGB[r][c]]
    cfa = RGGB if mosaic else MONOCHROME
    made = noise.frames(random, mean, count, WHITE_DN)
    return [RawFrame(dn, 12, cfa, black_level_dn=noise.black) for dn in made], "RGB" if mosaic else "M"
