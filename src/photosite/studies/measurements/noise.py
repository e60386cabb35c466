"""Noise of gray patches against the closed forms of drawn sensors."""

from __future__ import annotations

import math

import numpy as np

from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import VirtualNoise, virtual_noise
from photosite.studies.virtual_patches import WHITE_DN, developed, picture_budgets, raw_patches

_FRAMES = 6


def truth_of(noise: VirtualNoise) -> dict[str, float]:
    """Return the closed forms of a sensor."""
    dsnu2 = (noise.gain * noise.dsnu) ** 2
    return _closed_forms(WHITE_DN - noise.black, noise.temporal_floor, noise.gain, noise.prnu**2, dsnu2)


def _closed_forms(white: float, floor: float, slope: float, prnu2: float, dsnu2: float) -> dict[str, float]:
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
        "fixed_pattern_percent": 100 * math.sqrt(prnu2),
        "signal_snr_10": ten,
    }


def truth_of_picture(noise: VirtualNoise) -> dict[tuple[str, str], float]:
    """Return the closed forms of pictures that were developed from a sensor's mosaics."""
    full = WHITE_DN - noise.black
    floor, dsnu2 = noise.temporal_floor / full**2, (noise.gain * noise.dsnu / full) ** 2
    # Fixed pattern and temporal noise each have a part without signal, and one that grows with it.
    temporal, fixed = (
        picture_budgets(dict.fromkeys("RGB", np.array(each)))
        for each in ((floor, noise.gain / full, 0.0), (dsnu2, 0.0, noise.prnu**2))
    )
    values = {
        channel: _closed_forms(1.0, temporal[channel][0], temporal[channel][1], fixed[channel][2], fixed[channel][0])
        for channel in temporal
    }
    return {(name, channel): value for channel, each in values.items() for name, value in each.items()}


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    noise = virtual_noise(random)
    light = random.uniform(-0.1, 0.1) * (number % 2), 0.0
    picture = number % 8 >= 5
    frames, channels = raw_patches(noise, random, _FRAMES, mosaic=number % 4 >= 2 or picture, light=light)
    if picture:
        return HiddenChart(developed(frames), "macbeth", truth_of_picture(noise))
    values = truth_of(noise)
    truth = {(name, channel): value for name, value in values.items() for channel in channels}
    return HiddenChart(frames, "macbeth", truth)


STUDY = MeasurementStudy(
    _draw,
    "gains of 0.25 to 2 DN/e-, read noise 1 to 30 e-, DSNU, PRNU 0.2 to 1.5 %, uneven light, mosaics, developed "
    "pictures, 6 frames",
)
