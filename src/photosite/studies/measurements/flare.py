"""Veiling glare in light traps, in closed form."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from photosite.metrics.chart_image import ChartImage
from photosite.scene.scene_request import SceneRequest
from photosite.studies.measurement_study import HiddenChart, MeasurementStudy
from photosite.studies.virtual_charts import RGGB

_READ_NOISE_E = 4.0


@cache
def traps() -> NDArray[np.float64]:
    """Return the chart, two pixels to a sample, 1 in its field and 0 in its traps."""
    light = SceneRequest("flare-traps", {}).scene().weights[0].astype(np.float64)
    return np.asarray((light / light.max()).repeat(2, axis=0).repeat(2, axis=1))


def glare_percent(fraction: float, diffracted_percent: float = 0.0) -> float:
    """Return the light in a trap over that of the field, for glare that is uniform over the frame."""
    mean = float(traps().mean())
    trap = (1 - fraction) * diffracted_percent / 100 + fraction * mean
    return 100 * trap / (1 - fraction + fraction * mean)


def _draw(random: np.random.Generator, number: int) -> HiddenChart:
    white = traps()
    fraction, bright = random.uniform(0, 0.02), 10 ** random.uniform(2.5, 4)
    uneven = random.uniform(-0.2, 0.2) * (number % 2)
    # Light and glare both follow the gradient, so that their ratio is that of the closed form.
    light = 1 + uneven * np.linspace(-1, 1, white.shape[1])
    mean = bright * light * ((1 - fraction) * white + fraction * white.mean())
    frame = random.poisson(mean) + random.normal(0, _READ_NOISE_E, mean.shape)
    truth = {("flare_percent", channel): glare_percent(fraction) for channel in "RGB"}
    if fraction > 0.002:
        truth |= {("contrast_db", channel): -20 * np.log10(glare_percent(fraction) / 100) for channel in "RGB"}
    if not uneven:
        field = bright * (1 - fraction + fraction * white.mean())
        noise = np.sqrt(bright * fraction * white.mean() + _READ_NOISE_E**2)
        truth |= {("dynamic_range_glare_db", channel): 20 * np.log10(field / noise) for channel in "RGB"}
    return HiddenChart(ChartImage((frame,), "electrons", RGGB), "flare-traps", truth)


STUDY = MeasurementStudy(_draw, "glare of 0 to 2 %, 300 to 10 000 electrons, light that changes by up to 40 %, mosaics")
