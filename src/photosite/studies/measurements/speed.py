"""Speeds of drawn sensors in closed form."""

from __future__ import annotations

import math

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import virtual_noise
from photosite.studies.virtual_patches import CHANNEL_LEVELS, WHITE_DN, color_checker, raw_patches

_FRAMES, _TIME_S, _F_NUMBER = 4, 0.01, 4.0


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    noise = virtual_noise(random)
    frames, channels = raw_patches(noise, random, _FRAMES, mosaic=number % 2 == 1)
    white = WHITE_DN - noise.black
    per_lx_s = 0.85 * white / (0.65 * color_checker().patch_xyz[:, 1].max() * _TIME_S / _F_NUMBER**2)
    truth: dict[tuple[str, str], float] = {}
    for channel in channels:
        level = CHANNEL_LEVELS[channel]
        truth["saturation", channel] = 78 * level * per_lx_s / white
        for ratio in (10, 40):
            # S^2 = ratio^2 (floor + gain S + pattern S^2)
            rest = 1 - ratio**2 * noise.prnu**2
            floor = noise.temporal_floor + (noise.gain * noise.dsnu) ** 2
            b, c = ratio**2 * noise.gain, ratio**2 * floor
            if rest > 0:
                truth[f"noise_{ratio}", channel] = (
                    10 * level * per_lx_s * 2 * rest / (b + math.sqrt(b**2 + 4 * rest * c))
                )
    options = {"f_number": _F_NUMBER, "exposure_s": _TIME_S}
    return HiddenChart(frames, "macbeth", truth, options, {"luminance_cd_m2": 100.0})


STUDY = MeasurementStudy(_draw, "the sensors of `noise`, mosaics, 4 frames; light is even")
