"""Noise of gray patches against the closed forms of drawn sensors."""

from __future__ import annotations

import math

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import VirtualNoise, virtual_noise
from photosite.studies.virtual_patches import WHITE_DN, raw_patches

_FRAMES = 6


def truth_of(noise: VirtualNoise) -> dict[str, float]:
    """Return the closed forms of a sensor."""
    white = WHITE_DN - noise.black
    floor, slope, prnu2, dsnu2 = noise.temporal_floor, noise.gain, noise.prnu**2, (noise.gain * noise.dsnu) ** 2
    darkest = (slope + math.sqrt(slope**2 + 4 * floor)) / 2
    rest = 1 - 100 * prnu2
    ten = (100 * slope + math.sqrt((100 * slope) ** 2 + 400 * rest * (floor + dsnu2))) / (2 * rest)
    ratios = {}
    for percent in (13, 18):
        signal = percent / 100 * white
        temporal, fixed = floor + slope * signal, dsnu2 + prnu2 * signal**2
        ratios[f"snr_{percent}_temporal_db"] = 20 * math.log10(signal / math.sqrt(temporal))
        ratios[f"snr_{percent}_db"] = 20 * math.log10(signal / math.sqrt(temporal + fixed))
    return ratios | {
        "snr_13_fixed_db": -10 * math.log10(dsnu2 / (0.13 * white) ** 2 + prnu2),
        "dynamic_range_db": 20 * math.log10(white / darkest),
        "fixed_pattern_percent": 100 * noise.prnu,
        "signal_snr_10": ten,
    }


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    noise = virtual_noise(random)
    light = 1.0 + random.uniform(-0.1, 0.1) * (number % 2)
    frames, channels = raw_patches(noise, random, _FRAMES, mosaic=number % 4 >= 2, light=light)
    values = truth_of(noise)
    truth = {(name, channel): value for name, value in values.items() for channel in channels}
    return HiddenChart(frames, "macbeth", truth)


STUDY = MeasurementStudy(
    _draw, "gains of 0.25 to 2 DN/e-, read noise 1 to 30 e-, DSNU, PRNU 0.2 to 1.5 %, uneven light, mosaics, 6 frames"
)
