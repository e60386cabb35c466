"""Speeds of drawn sensors in closed form."""

from __future__ import annotations

import math

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import virtual_noise
from photosite.studies.virtual_patches import (
    CHANNEL_LEVELS,
    WHITE_DN,
    color_checker,
    developed,
    picture_budgets,
    raw_patches,
)

_FRAMES, _TIME_S, _F_NUMBER = 4, 0.01, 4.0


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    noise = virtual_noise(random)
    picture, slopes = number % 8 >= 5, random.uniform(-0.1, 0.1, 2) * (number % 4 >= 2)
    frames, channels = raw_patches(
        noise, random, _FRAMES, mosaic=number % 2 == 1 or picture, light=(slopes[0], slopes[1])
    )
    white = WHITE_DN - noise.black
    per_lx_s = 0.85 / (0.65 * color_checker().patch_xyz[:, 1].max() * _TIME_S / _F_NUMBER**2)
    dsnu2 = (noise.gain * noise.dsnu) ** 2
    # Variances of signals over white: floor + slope S + pattern S^2.
    budgets = {
        channel: np.array([(noise.temporal_floor + dsnu2) / white**2, noise.gain / white, noise.prnu**2])
        for channel in channels
    }
    levels = {channel: CHANNEL_LEVELS[channel] for channel in channels}
    if picture:
        budgets, levels = picture_budgets(budgets), dict.fromkeys("RGBY", 1.0)
    truth: dict[tuple[str, str], float] = {}
    for channel, (floor, slope, pattern) in budgets.items():
        signal_per_lx_s = levels[channel] * per_lx_s
        truth["saturation", channel] = 78 * signal_per_lx_s
        if picture:
            truth["standard_output", channel] = 10 / 0.18 * signal_per_lx_s
        for ratio in (10, 40):
            rest = 1 - ratio**2 * pattern
            b, c = ratio**2 * slope, ratio**2 * floor
            if rest > 0:
                truth[f"noise_{ratio}", channel] = (
                    10 * signal_per_lx_s * 2 * rest / (b + math.sqrt(b**2 + 4 * rest * c))
                )
    options = {"f_number": _F_NUMBER, "exposure_s": _TIME_S}
    shown = developed(frames) if picture else frames
    return HiddenChart(shown, "macbeth", truth, options, {"luminance_cd_m2": 100.0})


STUDY = MeasurementStudy(
    _draw, "the sensors of `noise`, light that changes by up to 10 %, mosaics, developed pictures, 4 frames"
)
