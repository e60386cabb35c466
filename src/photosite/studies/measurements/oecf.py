"""Exponent and factor of a tone curve put in."""

from __future__ import annotations

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import virtual_noise
from photosite.studies.virtual_patches import CHANNEL_LEVELS, WHITE_DN, color_checker, developed, raw_patches

_FRAMES = 4


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    noise = virtual_noise(random)
    exponent = random.uniform(0.6, 1.1) if number % 2 else 1.0
    down, across = random.uniform(-0.1, 0.1, 2) * (number % 8 >= 4)
    mosaic, picture = number % 4 >= 2, number % 16 >= 10
    frames, channels = raw_patches(
        noise, random, _FRAMES, mosaic=mosaic or picture, exponent=exponent, light=(down, across)
    )
    white = WHITE_DN - noise.black
    factor = 0.85 * white / color_checker().patch_xyz[:, 1].max()
    factors = {channel: factor * CHANNEL_LEVELS[channel] for channel in channels}
    if picture:
        factors = dict.fromkeys("RGBY", factor / white)
    truth = {("exponent", channel): exponent for channel in factors}
    if exponent == 1.0:
        truth |= {("signal_per_luminance", channel): each for channel, each in factors.items()}
    shown = developed(frames) if picture else frames
    return HiddenChart(shown, "macbeth", truth, placing={"luminance_cd_m2": 100.0})


STUDY = MeasurementStudy(
    _draw,
    "the sensors of `noise`, exponents of 0.6 to 1.1, light that changes by up to 10 % over the frame, mosaics, "
    "developed pictures, 4 frames",
)
