"""Exponent and factor of a tone curve put in."""

from __future__ import annotations

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import virtual_noise
from photosite.studies.virtual_patches import CHANNEL_LEVELS, WHITE_DN, color_checker, raw_patches

_FRAMES = 4


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    noise = virtual_noise(random)
    exponent = random.uniform(0.6, 1.1) if number % 2 else 1.0
    frames, channels = raw_patches(noise, random, _FRAMES, mosaic=number % 4 >= 2, exponent=exponent)
    truth: dict[tuple[str, str], float] = {("exponent", channel): exponent for channel in channels}
    if exponent == 1.0:
        factor = 0.85 * (WHITE_DN - noise.black) / color_checker().patch_xyz[:, 1].max()
        truth |= {("signal_per_luminance", channel): factor * CHANNEL_LEVELS[channel] for channel in channels}
    return HiddenChart(frames, "macbeth", truth, placing={"luminance_cd_m2": 100.0})


STUDY = MeasurementStudy(_draw, "the sensors of `noise`, exponents of 0.6 to 1.1, mosaics, 4 frames; light is even")
