"""Speed: the exposures at which frames saturate, and at which noise is small."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from photosite.errors import InputError
from photosite.metrics.chart_image import ChartImage
from photosite.metrics.charts.placed_chart import PlacedChart
from photosite.metrics.measurement import Measurement, Quantity, Result
from photosite.metrics.tone.gray_patches import GRAY_CHARTS, gray_patches
from photosite.metrics.tone.noise_model import NoiseModel
from photosite.metrics.tone.oecf import power_law
from photosite.values.estimate import Estimate
from photosite.values.uncertain import Missing, Value, derive

_CAMERA = 0.65
"""Exposure of the focal plane in lx s over luminance times exposure time over the square of the f-number."""
_SATURATION, _NOISE = 78.0, 10.0
"""Speed times the exposure at saturation, and at a ratio or output level."""
_STANDARD_OUTPUT = 0.18
"""Linear signal over white at 118 of 255 in sRGB."""


def _measure(
    image: ChartImage,
    chart: PlacedChart,
    *,
    f_number: Annotated[float, Field(gt=0)] | None = None,
    exposure_s: Annotated[float, Field(gt=0)] | None = None,
) -> Result:
    aperture, time_s = f_number or image.f_number, exposure_s or image.exposure_s
    for name, known, hint in (
        ("luminance_cd_m2", chart.known_light or None, "Give the mean luminance of the chart"),
        ("f_number", aperture, "Set speed.f_number"),
        ("exposure_s", time_s, "Set speed.exposure_s"),
    ):
        if known is None:
            raise InputError(name, expected="known", hint=hint)
    assert aperture is not None
    assert time_s is not None
    per_luminance = _CAMERA * time_s / aperture**2
    white = image.white - image.black
    values: dict[tuple[str, str], Estimate] = {}
    for channel in image.channels:
        patches = [patch for patch in gray_patches(image, chart, channel) if patch.sound]
        slope = power_law(patches)[1] / per_luminance  # signal per lx s
        model = NoiseModel.of(patches, several=len(image.frames) > 1)
        found: dict[str, Value] = {}
        if math.isfinite(white):
            found["saturation"] = slope * (_SATURATION / white)
        else:
            found["saturation"] = Missing("the image has no level of saturation")
        for ratio in (40, 10):
            found[f"noise_{ratio}"] = derive(lambda signal, s=slope: s * _NOISE / signal, model.signal_at(ratio))
        if image.origin == "picture":
            found["standard_output"] = slope * (_NOISE / (_STANDARD_OUTPUT * white))
        values |= {(name, channel): Estimate.of(value, "") for name, value in found.items()}
    return Result(values)


MEASUREMENT = Measurement(
    title="Speed",
    standard="ISO 12232:2019",
    charts=GRAY_CHARTS,
    measure=_measure,
    quantities={
        "saturation": Quantity("saturation speed", "ISO", "78 lx s over the exposure at which the channel saturates."),
        "noise_40": Quantity(
            "noise speed, SNR 40", "ISO", "10 lx s over the exposure at a signal of 40 times its noise."
        ),
        "noise_10": Quantity(
            "noise speed, SNR 10", "ISO", "10 lx s over the exposure at a signal of 10 times its noise."
        ),
        "standard_output": Quantity(
            "standard output sensitivity", "ISO", "10 lx s over the exposure at 118 of 255 in sRGB."
        ),
    },
    oracle="closed forms from gain, noise and light that are put in",
    left_out=(
        "Exposures follow from luminance, exposure time and f-number by the standard's camera method, with 0.65. Noise "
        "is that of a channel, not of a developed picture's luminance and color differences. The recommended exposure "
        "index is a statement of the maker, not a measurement."
    ),
    order=30,
    headline=("saturation",),
)
